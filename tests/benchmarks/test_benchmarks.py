"""Every benchmark runs in its quick form and prints its table; what it measures is for people to read."""

import ctypes
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from pyrobocop_pyomo.linear_solver import find_linear_solver

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"

pytestmark = pytest.mark.casadi


def run_quick(name: str, *arguments: str) -> str:
    ended = subprocess.run(
        [sys.executable, "-W", "error", BENCHMARKS / f"{name}.py", "--quick", *arguments],
        capture_output=True,
        text=True,
        timeout=900,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert ended.stderr == ""  # progress is for terminals only
    return ended.stdout


# What a table has to say, as patterns of lines; where its rows have to agree, the exit code tells that they do not.
SAID: dict[str, tuple[str, ...]] = {
    "code_lines": (" phases ",),
    "planar_pushing_treatments": (r"\(i\) ", r"\(ii\) ", r"\(iii\) ", r"\(iv\) ", r"\(v\) ", "default of rcp.solve"),
    "iteration_costs --without ASL": ("CasADi by hand", "phase, vectorised, CasADi"),
    "objective_errors": ("18 of 18 estimates within a factor of 10",),
    "obstacle_scale": ("8x15: 1 of 1 safe",),
    "obstacle_success": (r"nodes +2 +2 +[01] ", r"planes +2 +2 +2 +0 +0 "),  # scenes, feasible, safe, close, overlap
    "reintegrated_plans": (  # of those that are called safe none comes closer
        r"(?s)(^(unicycle|car|arm|quadrotor|cart|slider) +\d+ +\d+ +\d+ +0 .*?){6}",
    ),
    "walks": (r"^schedule +[1-3] +[1-8] ", r"^option of Ipopt +[1-3] +[1-8] "),  # folders and files
    "parking_cases": ("1 of 1 safe",),
    "car_paths": ("^reverse ", "^parallel ", "^mean "),
    "identification": ("covered", "5 fits, 1 of them from scratch"),
    "second_tries": ("6 of 6 starts are solved by one run", "^solved "),
    "independent_transcription": (" agrees",),
    "several_optima": ("best: 0 without, 2 with, of 2",),
    "safety_adversary": (
        "0 faults, and 0 beyond documented limits, in 6 trials",
        "not spoilt, without pairs: 2 trials, 2 called safe",
    ),
    "adversary": ("0 faults in 6 trials",),
    "unit_changes": ("2 of 2 change little",),
    "textbook": ("3 of 3 within 0.001 of the published value",),
    "import_time": (r"^pyrobocop_pyomo +0\.\d+ +\d+",),
    "cart_pole_transcription": (
        "phase, in process, ASL",
        "phase, executable",
        "pyomo.dae, executable",
        "CasADi by hand, vectorised",
        "all objectives agree",
    ),
    "growth": ("^phase, vectorised +100 ", "^phase, ASL +100 ", "^pyomo.dae +100 ", "^pyomo.dae, ours +100 "),
    "receding_horizon": (r"^ +20( +[\d.]+){10}$",),
    "certificate_costs": (r"^ralph1 .*proven", r"^kth1 .*proven", r"^planted qpec 2x4 .*proven", "^all together "),
    "continuation_backends": (  # all end at the same answer, and warm is shorter
        r"(?s)(^(bard2|gripper|sliding by step)[^\n]+e-(0[5-9]|1\d)$.*?){3}",
        r"^sum( +\d+){5} +[2-9]",
    ),
    "complementarity_cost": (r"(?s)(^(variables|affine) .*?){12}", "mpec.simple_nonlinear"),
    "obstacle_formulations": ("^car +plane per interval .* clear", "^car +plane per node .* overlap"),
    "distances": (r"(?s)(^(plane|space), .*?){12}",),
    "evaluation_costs": ("^cart_pole ", "^planar_pushing ", "^40 alike ", "^40 different "),
    "films": (r"^vehicles .* yes +\d",),
    "rod_teams": (" central ", " hub ", " paper "),
    "team_execution": ("(?s)(^closed .*?){4}(^open .*?){4}",),
    "learned_models": (r"(?s)^expressions +40 .* (\d+ +[\d.]+)$.*^function +40 .* \1$",),  # iterations and objective
    "check_costs": ("^take-off ", "^cart-pole, 20 ", "^simulation, 20 "),
    "memory": ("^pairs ",),
    "linear_solvers": (r"(?s)(alike.*?){2}", "2 of 2 end as well"),
    "nonsmooth_control": (r"(?s)(^(sliding|pushed)[^\n]+ (default|x 0.1) +yes .*?){12}", "solved, of 2"),
    "contact_receding_horizon": (r"(?s)(^.{16} *10 +10 +0 .*?){3}",),  # steps, strict, lost
    "contact_pictures": ("knob: optimal",),
    "file_faults": ("nothing was lost",),
}
skipif = pytest.mark.skipif
NEEDS = {
    **dict.fromkeys(("cart_pole_transcription", "continuation_backends"), (pytest.mark.executable, pytest.mark.asl)),
    "adversary": (pytest.mark.executable,),
    **dict.fromkeys(("contact_receding_horizon", "contact_pictures"), (pytest.mark.heavy,)),
    "linear_solvers": (skipif(find_linear_solver() is None, reason="there is no C compiler"),),
    "memory": (skipif(not hasattr(ctypes.CDLL(None), "mallinfo2"), reason="the GNU C library tells what is in use"),),
    "file_faults": (skipif(not hasattr(os, "fork"), reason="kills and full disks are those of a forked process"),),
}


@pytest.mark.parametrize("command", [pytest.param(name, marks=NEEDS.get(name, ())) for name in SAID])
def test_the_table_says_what_it_is_to_show(command: str) -> None:
    table = run_quick(*command.split())
    assert [line for line in SAID[command] if re.search(line, table, re.MULTILINE) is None] == []
    assert not re.search(r"WRONG(?! *$)", table, re.MULTILINE)  # but for the head of a column


def test_measured_orders_are_the_computed_ones() -> None:
    rows = [line.split() for line in run_quick("convergence_orders").splitlines() if "(" in line]
    named = [f"{family}({s})" for family in ("radau", "gauss") for s in (1, 2)]
    assert [row[0] for row in rows] == [*named, "lobatto(2)"]
    for row in rows:
        order, state, _, dae_state, _, _, optimal_cost = map(float, row[1:8])
        assert [state, dae_state, optimal_cost] == pytest.approx([order] * 3, abs=0.15)


def test_refined_meshes_take_less_than_half_of_the_elements() -> None:
    rows = [line.split() for line in run_quick("mesh_refinement").splitlines() if line.startswith("regulator")]
    (refined, uniform) = ([int(row[3]), float(row[4])] for row in rows)
    assert max(refined[1], uniform[1]) <= 1e-4
    assert 2 * refined[0] <= uniform[0]


def test_models_of_pyomo_dae_are_more_accurate_and_leave_nothing_free() -> None:
    table = run_quick("dae_models")
    assert table.count("cannot be discretised") == 2
    errors, _, others = table.partition("variables  iterations")
    assert errors.count("optimal") == 22
    rows = [line[34:].split() for line in others.splitlines() if "collocation" in line]
    assert {row[-1] for row in rows} == {"optimal"}
    for theirs, ours in zip(rows[::2], rows[1::2], strict=True):
        assert (theirs[0], ours[0]) == ("dae.collocation", "pyrobocop.collocation")
        assert int(ours[1]) <= int(theirs[1])


def test_methods_on_the_catalogue_are_checked_alike() -> None:
    table = run_quick("mpcc_methods")
    assert "4 feasible and 1 infeasible problems" in table
    rows = {line[:38].strip(): line[38:].split() for line in table.splitlines()[4:]}
    assert {"Pyomo mpec.simple_nonlinear", "Pyomo mpec_nlp, 1 to 1e-7", "cold continuation, 1 to 1e-8"} < set(rows)
    assert rows["rcp.solve"][0] == "4"  # solved, all of them
    assert [row[3:5] for row in rows.values()] == [["0", "0"]] * len(rows)  # none falsely, and none broken


def test_far_obstacles_cost_little_and_change_nothing() -> None:
    lines = run_quick("obstacle_broad_phase").splitlines()
    rows = {line[7:18].strip(): line[18:].split() for line in lines if line.startswith("0 ")}
    assert set(rows) == {"all pairs", "broad phase", "by hand"}
    variables = {stated: int(row[0]) for stated, row in rows.items()}
    assert variables["broad phase"] < variables["by hand"] <= variables["all pairs"]
    objectives = [float(row[8]) for row in rows.values()]
    assert objectives == pytest.approx([objectives[0]] * 3, rel=1e-5)
    assert [row[-1] for row in rows.values()] == ["clear"] * 3


def test_the_table_of_examples_shows_every_case_and_writes_its_pages(tmp_path: Path) -> None:
    shown = run_quick("example_table", "--docs", str(tmp_path))
    assert [line.split()[:2] for line in sorted(shown.splitlines()[2:])] == [
        ["car_between_obstacles", "one"],
        ["car_between_obstacles", "two"],
        ["pendulum", "physical"],
        ["pendulum", "published"],
    ]
    page = (tmp_path / "examples" / "table.md").read_text(encoding="utf-8")
    rows = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("| pendulum")]
    assert [len(row) for row in rows] == [7, 7, 8, 8]
    assert rows[0][:5] == ["pendulum", "published", "120", "80", "0"]
    assert "clear" in page
    assert "## Pendulum" in (tmp_path / "examples" / "gallery.md").read_text(encoding="utf-8")
    for name in ("pendulum", "car_between_obstacles"):
        assert 5_000 < (tmp_path / "images" / "examples" / f"{name}.png").stat().st_size <= 80_000


def test_versions_by_hand_agree_with_the_example(tmp_path: Path) -> None:
    assert "all objectives agree" in run_quick("comparison", "--docs", str(tmp_path))
    page = (tmp_path / "examples" / "comparison.md").read_text(encoding="utf-8")
    assert "| pendulum | CasADi by hand |" in page


@pytest.mark.executable
def test_ratios_compare_alike_programs(tmp_path: Path) -> None:
    table = run_quick("ratios", "--docs", str(tmp_path))
    page = (tmp_path / "examples" / "ratios.md").read_text(encoding="utf-8")
    for way in ("CasADi by hand, fatrop", "pyomo.dae, executable", "rcp.solve, second opinion"):
        assert table.count(way) == 1
        assert page.count(f"| {way} |") == 2  # together, and in one iteration
    for way in ("CasADi by hand, MUMPS", "rcp.solve, MUMPS", "SolverFactory, "):
        assert table.count(way) == 4
        assert page.count(f"| {way}") == 8
    assert page.count("The doors: ") == 1
    assert "other objective" not in table
    assert "did not converge" not in table


def test_contact_is_planned_from_zero() -> None:
    rows = [
        line for line in run_quick("contact_from_nothing").splitlines() if line.startswith(("push box", "cart-pole"))
    ]
    assert len(rows) == 4
    for row in rows:
        cases, strict, *counts = row[40:].split()[:4]
        assert (cases, strict) == ("1", "1")
        if "rcp.solve" in row:
            assert counts == ["1", "1"]  # certified, and claimed
