"""Every benchmark runs in its quick form and prints its table; what it measures is for people to read."""

import ctypes
import os
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


# What a table has to say; where its rows have to agree, the exit code tells that they do not.
SAID: dict[str, tuple[str, ...]] = {
    "code_lines": (" phases ",),
    "planar_pushing_treatments": ("(i) ", "(ii) ", "(iii) ", "(iv) ", "(v) ", "default of rcp.solve"),
    "iteration_costs --without ASL": ("CasADi by hand", "phase, vectorised, CasADi"),
    "objective_errors": ("18 of 18 estimates within a factor of 10",),
    "obstacle_scale": ("8x15: 1 of 1 safe",),
    "parking_cases": ("1 of 1 safe",),
    "car_paths": ("reverse ", "\nparallel ", "\nmean "),
    "identification": ("covered", "5 fits, 1 of them from scratch"),
    "second_tries": ("6 of 6 starts are solved by one run", "\nsolved "),
    "independent_transcription": (" agrees",),
    "several_optima": ("best: 0 without, 2 with, of 2",),
    "safety_adversary": (
        "0 faults, and 0 beyond documented limits, in 6 trials",
        "not spoilt, without pairs: 2 trials, 2 called safe",
    ),
    "safety_adversary --seed 8": ("seed 8: ",),
    "unit_changes": ("2 of 2 change little",),
    "textbook": ("3 of 3 within 0.001 of the published value",),
}


@pytest.mark.parametrize("command", SAID)
def test_the_table_says_what_it_is_to_show(command: str) -> None:
    table = run_quick(*command.split())
    assert [words for words in SAID[command] if words not in table] == []
    assert "WRONG" not in table


def test_import_costs_seconds_and_modules() -> None:
    row = run_quick("import_time").splitlines()[-1].split()
    assert row[0] == "pyrobocop_pyomo"
    assert float(row[1]) > 0.0
    assert int(row[2]) > 0


@pytest.mark.executable
@pytest.mark.asl
def test_ways_to_state_the_cart_pole_agree() -> None:
    table = run_quick("cart_pole_transcription")
    for way in ("phase, in process, ASL", "phase, executable", "pyomo.dae, executable", "CasADi by hand, vectorised"):
        assert way in table
    assert "all objectives agree" in table


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


def test_what_a_phase_costs_stands_beside_pyomo_dae() -> None:
    lines = [line for line in run_quick("growth").splitlines() if line.startswith(("phase", "pyomo.dae"))]
    rows = {(line[:18].strip(), int(line[18:].split()[0])): line[18:].split() for line in lines}
    ways = ("phase, vectorised", "phase, ASL", "pyomo.dae", "pyomo.dae, ours")
    assert set(rows) == {(way, 100) for way in ways}
    assert all(float(row[1]) > 0.0 for row in rows.values())


def test_a_re_solve_is_measured_against_ipopt_alone() -> None:
    (row,) = [line.split() for line in run_quick("receding_horizon").splitlines() if line.split()[0] == "20"]
    assert float(row[3]) >= 1.0
    assert float(row[7]) > 0.0


def test_methods_on_the_catalogue_are_checked_alike() -> None:
    table = run_quick("mpcc_methods")
    assert "4 feasible and 1 infeasible problems" in table
    rows = {line[:38].strip(): line[38:].split() for line in table.splitlines()[4:]}
    assert {"Pyomo mpec.simple_nonlinear", "Pyomo mpec_nlp, 1 to 1e-7", "cold continuation, 1 to 1e-8"} < set(rows)
    assert rows["rcp.solve"][0] == "4"  # solved, all of them
    assert [row[3:5] for row in rows.values()] == [["0", "0"]] * len(rows)  # none falsely, and none broken


def test_costs_of_certificates_are_split_into_their_parts() -> None:
    lines = run_quick("certificate_costs").splitlines()
    rows = {line[:32].strip(): line[32:].split() for line in lines[2:6]}
    assert set(rows) == {"ralph1", "kth1", "planted qpec 2x4", "all together"}
    assert [rows[name][6] for name in ("ralph1", "kth1", "planted qpec 2x4")] == ["proven"] * 3
    for row in rows.values():
        solve, polish, linear, explore = map(float, row[:4])
        assert solve > 0.0
        assert float(row[5]) >= float(row[4]) >= 0.0
        assert polish + linear + explore >= 0.0


def test_nonsmooth_problems_are_solved_by_default_and_softened_first() -> None:
    table = run_quick("nonsmooth_control")
    rows = [line for line in table.splitlines() if line.startswith(("sliding by step", "pushed blocks"))]
    assert len(rows) == 2 * 3 * 2
    for way in (" default ", " x 0.1 "):
        assert [" yes " in line for line in rows if way in line] == [True] * 6
    assert "solved, of 2" in table


@pytest.mark.executable
@pytest.mark.asl
def test_a_continuation_is_shorter_warm() -> None:
    seconds, iterations = run_quick("continuation_backends").split("iterations of Ipopt")
    *_, files, _, _, warm_ratio, _ = next(line for line in seconds.splitlines() if line.startswith("sum")).split()
    assert min(float(files), float(warm_ratio)) > 0.0
    rows = [line for line in iterations.splitlines() if line.startswith(("bard2", "gripper", "sliding"))]
    assert len(rows) == 3
    for row in rows:
        assert float(row.split()[-3]) > 1.5  # cold to warm
        assert float(row.split()[-1]) < 1e-5  # all end at the same answer


def test_what_relaxing_a_pair_costs_stands_beside_pyomo() -> None:
    lines = run_quick("complementarity_cost").splitlines()
    rows = [line for line in lines if line.startswith(("variables", "affine"))]
    assert len(rows) == 12
    assert sum("lifted" in line for line in rows) == 4
    for kind in ("variables", "affine"):
        applied = {line[11:43].strip(): float(line[43:].split()[-4]) for line in rows if line.startswith(kind)}
        assert len(applied) == 6
        assert "mpec.simple_nonlinear" in applied
        assert min(applied.values()) > 0.0


def test_a_plane_per_interval_is_clear_where_planes_per_node_are_not() -> None:
    table = run_quick("obstacle_formulations")
    verdicts = {line[11:35].strip(): line.split()[-1] for line in table.splitlines() if line.startswith("car")}
    assert len(verdicts) == 2
    assert verdicts["plane per interval"] == "clear"
    assert verdicts["plane per node"] == "overlap"  # between the nodes of a mesh as coarse as this


def test_far_obstacles_cost_little_and_change_nothing() -> None:
    lines = run_quick("obstacle_broad_phase").splitlines()
    rows = {line[7:18].strip(): line[18:].split() for line in lines if line.startswith("0 ")}
    assert set(rows) == {"all pairs", "broad phase", "by hand"}
    variables = {stated: int(row[0]) for stated, row in rows.items()}
    assert variables["broad phase"] < variables["by hand"] <= variables["all pairs"]
    objectives = [float(row[8]) for row in rows.values()]
    assert objectives == pytest.approx([objectives[0]] * 3, rel=1e-5)
    assert [row[-1] for row in rows.values()] == ["clear"] * 3


def test_distances_of_many_pairs_are_measured_against_one_by_one() -> None:
    lines = [line.rsplit(maxsplit=1) for line in run_quick("distances").splitlines() if line and "us per" not in line]
    microseconds = {name.strip(): float(value) for name, value in lines}
    assert len(microseconds) == 8 + 4
    assert min(microseconds.values()) > 0.0


def test_evaluations_and_their_preparation_are_measured() -> None:
    evaluated, prepared = run_quick("evaluation_costs").split("\n\n")
    assert [line.split()[0] for line in evaluated.splitlines()[2:]] == ["cart_pole", "planar_pushing"]
    alike, different = (line.split() for line in prepared.splitlines()[2:])
    assert [alike[:2], different[:2]] == [["40", "alike"], ["40", "different"]]


def test_random_parkings_end_safe_where_the_points_alone_collide() -> None:
    rows = {line.split()[1]: line.split()[2:] for line in run_quick("obstacle_success").splitlines()[2:]}
    scenes, feasible, safe, too_close, overlap = map(int, rows["nodes"][:5])
    assert (scenes, feasible, safe + too_close + overlap) == (2, 2, 2)
    assert safe < 2
    assert rows["planes"][:5] == ["2", "2", "2", "0", "0"]


def test_the_film_of_two_cars_is_of_a_safe_plan() -> None:
    name, _, safe, size = run_quick("films").splitlines()[-1].split()
    assert (name, safe) == ("vehicles", "yes")
    assert float(size) > 1.0


def test_few_files_receive_a_schedule_or_an_option() -> None:
    rows = {line[:20].strip(): line[20:].split() for line in run_quick("walks").splitlines()[2:4]}
    assert set(rows) == {"schedule", "option of Ipopt"}
    for row in rows.values():
        assert 1 <= int(row[0]) <= 3  # folders
        assert int(row[0]) <= int(row[1]) <= 8  # files


def test_planners_of_a_rod() -> None:
    table = run_quick("rod_teams")
    for planner in ("central", "hub", "paper"):
        assert planner in table


def test_worlds_in_which_a_team_moves() -> None:
    rows = [line.split() for line in run_quick("team_execution").splitlines()[2:]]
    assert [row[0] for row in rows] == 4 * ["closed"] + 4 * ["open"]
    assert all(float(row[-1]) > 0 for row in rows[:4])
    # Two ticks lead nowhere, and what differs between worlds differs in the end.
    assert len({row[-4] for row in rows[4:]}) == 3


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


def test_a_learned_model_written_out_and_called_is_one_model() -> None:
    rows = [line.split() for line in run_quick("learned_models").splitlines() if " 40 " in line]
    assert [row[0] for row in rows] == ["expressions", "function"]
    assert rows[0][-2:] == rows[1][-2:]  # iterations and objective


def test_no_plan_that_is_called_safe_comes_closer_when_it_is_integrated_again() -> None:
    rows = [line.split() for line in run_quick("reintegrated_plans").splitlines()[2:] if line]
    assert [row[0] for row in rows] == ["unicycle", "car", "arm", "quadrotor", "cart", "slider"]
    assert sum(int(row[2]) for row in rows) >= 2  # called safe
    assert all(int(row[4]) == 0 for row in rows)  # though they are not


@pytest.mark.executable
def test_spoilt_problems_are_counted_and_can_be_repeated() -> None:
    table = run_quick("adversary")
    assert "0 faults in 6 trials" in table
    assert "seed 2: " in run_quick("adversary", "--seed", "2")


@pytest.mark.casadi
def test_both_linear_solvers_end_alike() -> None:
    if find_linear_solver() is None:
        pytest.skip("there is no C compiler")
    table = run_quick("linear_solvers")
    assert table.count("alike") == 2
    assert "2 of 2 end as well" in table


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


@pytest.mark.skipif(not hasattr(os, "fork"), reason="kills and full disks are those of a forked process")
def test_no_fault_loses_a_file() -> None:
    assert "nothing was lost" in run_quick("file_faults")


def test_checks_before_a_solve_are_a_small_part_of_it() -> None:
    rows = run_quick("check_costs").splitlines()[2:]
    assert [row.split()[0].rstrip(",") for row in rows] == ["take-off", "cart-pole", "simulation"]


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallinfo2"), reason="what is in use the GNU C library tells")
def test_solves_leave_no_memory_behind() -> None:
    table = run_quick("memory")
    assert table.count("pairs") >= 1


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


@pytest.mark.heavy
def test_contact_is_planned_again_and_again() -> None:
    rows = [line[16:].split() for line in run_quick("contact_receding_horizon").splitlines()[2:]]
    assert [row[:3] for row in rows] == [["10", "10", "0"]] * 3  # steps, strict, lost


@pytest.mark.heavy
def test_pictures_of_contact_are_drawn() -> None:
    assert "knob: optimal" in run_quick("contact_pictures")
