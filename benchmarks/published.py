"""Objectives that are published for examples, or that the authors' package reaches, by script and case.

Where two values are known, of the published mesh and of a finer one, the case says which it is. Each is the value of a
local optimum: "as good" means not larger.
"""

from __future__ import annotations

PUBLISHED = {
    ("pendulum", "published"): 19.8856274,
    ("acrobot", "published"): 62.5233007,
    ("cart_pole", "published"): 13.4251464,
    (
        "planar_pushing",
        "turn",
    ): 10.60468,  # on 100 elements, products up to 3.8e-6, which lower it by about one per mille
    ("planar_pushing", "turn-and-shift"): 15.51736,  # so does this
    ("mode_sequence", "published"): 12.88355,
    ("mode_sequence", "precise"): 12.80857,
    ("pushing_among_obstacles", "slot"): 4.96129,  # 0.004 from the obstacle, where 0.02 was asked for
    ("car_between_obstacles", "one"): 35.25407,  # 0.0195 from the obstacle at the points, less between them
    ("belt_drive", "first-1"): 74.44288,
    ("belt_drive", "second-1"): 107.18969,
    ("linear_complementarity_control", "1"): 0.8019186,
    ("linear_complementarity_control", "2"): 0.8160857,
}
