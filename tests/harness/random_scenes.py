"""Random planning problems in the plane: one body among convex obstacles, from one side of them to the other."""

from dataclasses import dataclass

import numpy as np
import pyomo.environ as pyo
import shapely

import pyrobocop_pyomo as rcp

from .scenes import effort_of, keep_clear, placed, rigid_body

CLEARANCE = 0.05


@dataclass(frozen=True)
class Scene:
    """What a plan is made for."""

    body: rcp.Polytope
    obstacles: dict[str, rcp.Polytope]
    start: tuple[float, float, float]
    goal: tuple[float, float, float]


def random_scene(seed: int) -> Scene:
    """One to three obstacles between start and goal, which are free."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1.0, 1.0, (int(rng.integers(3, 7)), 2)) * rng.uniform(0.1, 0.4, 2)
    body = rcp.Polytope.hull(corners + np.array([[0.3, 0.0], [-0.3, 0.1], [0.0, -0.2]])[:1], name="body")
    obstacles = {}
    for i in range(int(rng.integers(1, 4))):
        ring = rng.uniform(-1.0, 1.0, (8, 2)) * rng.uniform(0.1, 0.6, 2) + rng.uniform(-0.8, 0.8, 2)
        obstacles[f"obstacle {i}"] = rcp.Polytope.hull(ring, name=f"obstacle {i}")
    turns = rng.uniform(-np.pi, np.pi, 2)
    return Scene(body, obstacles, (-2.5, rng.uniform(-1, 1), turns[0]), (2.5, rng.uniform(-1, 1), turns[1]))


def build(scene: Scene, elements: int, *, between: str | None = "plane") -> pyo.ConcreteModel:
    """The least effort from start to goal."""
    m = pyo.ConcreteModel(name="random scene")
    m.move = b = rcp.PhaseBlock(duration=5.0, elements=elements, stages=2)
    rigid_body(b, scene.start, scene.goal, bounds=(-5, 5))
    m.effort = pyo.Objective(expr=effort_of(b))
    keep_clear(b, scene.body, scene.obstacles, placed, CLEARANCE, between=between)
    return m


def sampled_distance(scene: Scene, trajectory: rcp.Trajectory, per_element: int = 400) -> float:
    """Smallest distance along the motion, by Shapely; negative, by the depth of the deepest corner, in overlap."""
    boundaries = np.array(trajectory.grid.mesh.boundaries)
    fractions = np.linspace(0.0, 1.0, per_element + 1)
    times = np.unique(boundaries[:-1, None] + np.diff(boundaries)[:, None] * fractions)
    found = trajectory(times)
    outline = np.asarray(scene.body.vertices)
    walls = shapely.union_all([shapely.Polygon(wall.vertices) for wall in scene.obstacles.values()])
    cosine, sine = np.cos(found["theta"]), np.sin(found["theta"])
    corners = np.stack(
        [
            found["x"][:, None] + cosine[:, None] * outline[:, 0] - sine[:, None] * outline[:, 1],
            found["y"][:, None] + sine[:, None] * outline[:, 0] + cosine[:, None] * outline[:, 1],
        ],
        axis=-1,
    )
    return float(shapely.distance(shapely.polygons(corners), walls).min())
