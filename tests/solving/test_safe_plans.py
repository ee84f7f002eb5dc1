"""No plan is called safe that dense sampling, by Shapely, finds too close: on three hundred plans for random scenes."""

from dataclasses import dataclass
from functools import cache

import pytest

import pyrobocop_pyomo as rcp

shapely = pytest.importorskip("shapely")

from tests.harness.random_scenes import CLEARANCE, build, random_scene, sampled_distance  # noqa: E402

pytestmark = [pytest.mark.casadi, pytest.mark.slow]

SCENES = 150
BATCH = 5
# What `verify` lets pass: one hundredth of the clearance.
KEPT = CLEARANCE * (1 - 0.01)


@dataclass(frozen=True)
class Judged:
    """What a solve said about its plan, and what sampling says."""

    called_safe: bool
    feasible: bool
    sampled: float
    rounds: str


@cache
def judged(seed: int, between: str | None) -> Judged:
    """A mesh as coarse as six elements: plans between its nodes go where they like."""
    scene = random_scene(seed)
    m = build(scene, 6, between=between)
    result = rcp.solve(m, progress=False)
    feasible = result.quality is not rcp.Quality.INFEASIBLE
    return Judged(result.safe, feasible, sampled_distance(scene, m.move.trajectory()), result.rounds_table())


@pytest.mark.parametrize("between", ["plane", None], ids=["planes", "nodes"])
@pytest.mark.parametrize("first", range(0, SCENES, BATCH))
def test_what_is_called_safe_is_clear_and_what_is_clear_is_called_safe(first: int, between: str | None) -> None:
    for seed in range(first, first + BATCH):
        plan = judged(seed, between)
        if plan.called_safe:
            assert plan.sampled >= KEPT - 1e-9, f"scene {seed}\n{plan.rounds}"
        elif plan.feasible:
            # Sampling overlooks what happens within a four-hundredth of an element.
            assert plan.sampled < KEPT + 1e-4, f"scene {seed}\n{plan.rounds}"


def test_nearly_all_scenes_end_safe() -> None:
    failed = {seed: plan.rounds for seed in range(SCENES) if not (plan := judged(seed, "plane")).called_safe}
    assert len(failed) <= SCENES // 50, "\n".join(f"scene {seed}\n{rounds}" for seed, rounds in failed.items())


def test_plans_that_look_at_nodes_only_collide_and_are_not_called_safe() -> None:
    plans = [judged(seed, None) for seed in range(SCENES)]
    collide = [plan for plan in plans if plan.feasible and plan.sampled == 0.0]
    assert len(collide) > SCENES // 20  # Else nothing above was put to the test.
    assert not any(plan.called_safe for plan in collide)
