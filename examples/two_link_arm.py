"""A two-link arm in a horizontal plane reaches around a box, between two posts.

Each link is a capsule; the second is hinged to the end of the first, so this pair is left out: two links that share a
joint touch by design. The pose of the forearm is the pose of the upper arm, followed by a turn at the elbow. The arm
starts below the box, ends above it, and has to fold on the way; the posts stand where the forearm would swing. The
objective is the integral of the squared torques.

Rigid links with torques in both joints: Spong, Hutchinson & Vidyasagar, Robot Modeling and Control (2006), ch. 7
"""

from __future__ import annotations

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

LENGTH, MASS, RADIUS = (0.5, 0.4), (1.0, 0.8), (0.04, 0.03)  # metres, kilograms; uniform slender links
UPPER_ARM, FOREARM = (
    rcp.Polytope.capsule((0, 0), (length, 0), radius) for length, radius in zip(LENGTH, RADIUS, strict=True)
)
OBSTACLES = {
    "box": rcp.Polytope.box(0.3, 0.5, center=(0.72, 0.0)),
    "lower post": rcp.Polytope.ball(0.06, (0.3, -0.7)),
    "upper post": rcp.Polytope.ball(0.06, (0.3, 0.7)),
}
CLEARANCE = 0.02
START, GOAL = (-0.9, 0.1), (0.9, -0.1)


def build(elements: int = 40, stages: int = 3) -> pyo.ConcreteModel:
    """Rest to rest in 2 seconds."""
    m = pyo.ConcreteModel(name="two-link arm")
    m.reach = b = rcp.PhaseBlock(duration=2.0, elements=elements, stages=stages)
    b.q1 = rcp.State(initial=START[0], final=GOAL[0], bounds=(-3, 3))
    b.q2 = rcp.State(initial=START[1], final=GOAL[1], bounds=(-2.8, 2.8))
    b.dq1 = rcp.State(initial=0, final=0)
    b.dq2 = rcp.State(initial=0, final=0)
    b.shoulder = rcp.Control(bounds=(-8, 8), parametrization="piecewise_constant")
    b.elbow = rcp.Control(bounds=(-4, 4), parametrization="piecewise_constant")

    @b.ode
    def arm(b, t):
        ddq1, ddq2 = accelerations(b.q2[t], b.dq1[t], b.dq2[t], b.shoulder[t], b.elbow[t])
        return {b.q1: b.dq1[t], b.q2: b.dq2[t], b.dq1: ddq1, b.dq2: ddq2}

    def upper_arm(b, t):
        return rcp.planar_pose(0, 0, b.q1[t])

    def forearm(b, t):
        return upper_arm(b, t) @ rcp.planar_pose(LENGTH[0], 0, b.q2[t])

    b.initialize_straight_lines()
    m.reach.avoid = rcp.ObstacleAvoidanceBlock(
        b.time,
        bodies={"upper arm": rcp.Body(UPPER_ARM, pose=upper_arm), "forearm": rcp.Body(FOREARM, pose=forearm)},
        obstacles=OBSTACLES,
        exclude=[("upper arm", "forearm")],
        clearance=CLEARANCE,
    )
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.shoulder[t] ** 2 + b.elbow[t] ** 2))
    return m


def accelerations(q2, dq1, dq2, shoulder, elbow):
    """Angular accelerations of both joints; plain arithmetic."""
    (l1, l2), (m1, m2) = LENGTH, MASS
    coupling = m2 * l1 * l2 / 2
    i2 = m2 * l2**2 / 3
    m11 = m1 * l1**2 / 3 + m2 * l1**2 + i2 + 2 * coupling * pyo.cos(q2)
    m12 = i2 + coupling * pyo.cos(q2)
    force_1 = shoulder + coupling * pyo.sin(q2) * (2 * dq1 * dq2 + dq2**2)
    force_2 = elbow - coupling * pyo.sin(q2) * dq1**2
    determinant = m11 * i2 - m12**2
    return (i2 * force_1 - m12 * force_2) / determinant, (m11 * force_2 - m12 * force_1) / determinant


def draw(figure, m: pyo.ConcreteModel) -> None:
    """Both links around the box, and the joints over time."""
    left, right = figure.subfigures(1, 2)
    rcp.scenes.draw_avoidance(m.reach.avoid, snapshots=10, title=m.name, figure=left)
    labels = {"q1": "q1 [rad]", "q2": "q2 [rad]", "shoulder": "shoulder [N m]", "elbow": "elbow [N m]"}
    m.reach.trajectory().plot(labels, figure=right)


if __name__ == "__main__":
    from run_example import run_example

    run_example(build, draw, cases={"reach": {}}, default="reach", coarse={"elements": 20}, size=(11, 5))
