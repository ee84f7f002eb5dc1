"""A robot arm from a URDF reaches over a box, its three links and its gripper kept clear.

The description is an ordinary URDF: joints with their axes and limits, collision geometry of boxes, cylinders and a
sphere. Cylinders become prisms around them, 2 % wider. Links that share a joint are left out of the body pairs; all
others keep clear of the boxes, and of each other. The hand goes from one side of the box to the other: the straight
line between the two configurations leads through it. Joint accelerations are the controls, and their squares the
objective.
"""

from __future__ import annotations

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

URDF = """
<robot name="three joints">
  <link name="column"><collision><origin xyz="0 0 0.15"/>
    <geometry><cylinder radius="0.08" length="0.3"/></geometry></collision></link>
  <link name="shoulder_block"/>
  <link name="upper_arm"><collision><origin xyz="0.25 0 0" rpy="0 1.5707963267948966 0"/>
    <geometry><cylinder radius="0.04" length="0.4"/></geometry></collision></link>
  <link name="forearm"><collision><origin xyz="0.2 0 0" rpy="0 1.5707963267948966 0"/>
    <geometry><cylinder radius="0.03" length="0.3"/></geometry></collision></link>
  <link name="gripper"><collision><geometry><box size="0.08 0.12 0.04"/></geometry></collision>
    <collision><origin xyz="0.07 0 0"/><geometry><sphere radius="0.03"/></geometry></collision></link>
  <joint name="pan" type="revolute"><parent link="column"/><child link="shoulder_block"/>
    <origin xyz="0 0 0.4"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="20" velocity="2"/></joint>
  <joint name="lift" type="revolute"><parent link="shoulder_block"/><child link="upper_arm"/>
    <axis xyz="0 -1 0"/><limit lower="-0.5" upper="1.5" effort="20" velocity="2"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper_arm"/><child link="forearm"/>
    <origin xyz="0.5 0 0"/><axis xyz="0 -1 0"/><limit lower="-2.5" upper="0.5" effort="10" velocity="2"/></joint>
  <joint name="mount" type="fixed"><parent link="forearm"/><child link="gripper"/><origin xyz="0.4 0 0"/></joint>
</robot>
"""
START, GOAL = {"pan": -0.7, "lift": 0.2, "elbow": -0.6}, {"pan": 0.7, "lift": 0.2, "elbow": -0.6}
OBSTACLES = {
    "box": rcp.Polytope.box(0.3, 0.25, 0.5, center=(0.75, 0.0, 0.25)),
    "beam": rcp.Polytope.box(0.1, 1.2, 0.1, center=(0.2, 0.0, 1.15)),
}
CLEARANCE = 0.02


def build(elements: int = 16) -> pyo.ConcreteModel:
    """From rest to rest in two seconds."""
    m = pyo.ConcreteModel(name="robot arm")
    m.reach = b = rcp.PhaseBlock(duration=2.0, elements=elements, stages=2)
    robot = rcp.scenes.from_urdf(URDF, {joint: joint for joint in START})
    for joint, limits in robot.limits.items():
        setattr(b, joint, rcp.State(initial=START[joint], final=GOAL[joint], bounds=limits))
        setattr(b, f"{joint}_rate", rcp.State(initial=0, final=0, bounds=(-2, 2)))
        setattr(b, f"{joint}_acceleration", rcp.Control(bounds=(-10, 10)))

    @b.ode
    def joints(b, t):
        rates = {b.component(joint): b.component(f"{joint}_rate")[t] for joint in START}
        return rates | {b.component(f"{j}_rate"): b.component(f"{j}_acceleration")[t] for j in START}

    m.effort = pyo.Objective(
        expr=b.integral(lambda b, t: sum(b.component(f"{joint}_acceleration")[t] ** 2 for joint in START))
    )
    b.initialize_straight_lines()
    b.avoid = rcp.ObstacleAvoidanceBlock(
        b.time, bodies=robot.bodies, obstacles=OBSTACLES, exclude=robot.exclude, clearance=CLEARANCE
    )
    return m


def draw(figure, m: pyo.ConcreteModel) -> None:
    """The arm over the box, and the joints over time."""
    left, right = figure.subfigures(1, 2, width_ratios=[3, 2])
    rcp.scenes.draw_avoidance(m.reach.avoid, snapshots=6, title=m.name, figure=left)
    degrees = {joint: f"{joint} [rad]" for joint in START}
    m.reach.trajectory().plot(degrees, figure=right)


if __name__ == "__main__":
    from run_example import run_example

    run_example(build, draw, cases={"reach": {}}, default="reach", coarse={"elements": 6}, size=(11, 5.5))
