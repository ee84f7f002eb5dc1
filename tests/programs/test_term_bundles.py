"""Bundles hold every term once, and what rows of one time point share is evaluated once, whoever evaluates it."""

import os
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.expression_zoo import ZOO, ZOO_NAMES
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo
from pyrobocop_pyomo.programs.expression_codes import NUMBER, SUM
from pyrobocop_pyomo.programs.model_terms import collect_terms
from pyrobocop_pyomo.programs.term_bundles import FEWEST_TERMS, Bundle, bundles_of
from pyrobocop_pyomo.programs.term_groups import TermGroup


def sliding_disc(steps: int) -> pyo.ConcreteModel:
    """Rows of four shapes at each time point, which all read the distance between two points."""
    m = pyo.ConcreteModel()
    m.steps = pyo.RangeSet(steps)
    m.x, m.y, m.u, m.v, m.force = (pyo.Var(m.steps, initialize=0.5 + 0.1 * k) for k in range(5))
    m.scale = pyo.Param(m.steps, initialize=lambda m, k: 1.0 + k / steps, mutable=True)

    def distance(k):
        return pyo.sqrt((m.x[k] - pyo.cos(m.y[k])) ** 2 + m.y[k] ** 2 + 1e-4)

    m.gap = pyo.Constraint(m.steps, rule=lambda m, k: m.force[k] * distance(k) <= m.scale[k])
    m.slip = pyo.Constraint(m.steps, rule=lambda m, k: m.scale[k] * m.u[k] / distance(k) + m.v[k] ** 2 >= 0)
    m.press = pyo.Constraint(m.steps, rule=lambda m, k: m.force[k] * m.x[k] / distance(k) == m.u[k])
    m.late = pyo.Constraint(
        m.steps, rule=lambda m, k: pyo.Constraint.Skip if k == 1 else distance(k) * m.v[k] * m.u[k] <= 4.0
    )
    return m


def terms_of_groups(groups) -> Counter:
    found: Counter = Counter()
    for group in groups:
        for i, (row, scale) in enumerate(zip(group.rows, group.scales, strict=True)):
            columns = group.columns[i * group.size : (i + 1) * group.size]
            start = i * group.numbers_per_term
            numbers = group.numbers[start : start + group.numbers_per_term]
            known = sorted((place - start, p) for place, p in group.parameters if 0 <= place - start < len(numbers))
            found[group.code, row, scale, tuple(columns), tuple(numbers), tuple(known)] += 1
    return found


def terms_of_bundles(bundles: list[Bundle]) -> Counter:
    found: Counter = Counter()
    for bundle in bundles:
        for output in bundle.outputs:
            for i, columns in enumerate(bundle.columns[:, output.variables].tolist()):
                known = [(int(k), int(output.parameters[i, k])) for k in np.flatnonzero(output.parameters[i] >= 0)]
                numbers = tuple(output.numbers[i].tolist())
                found[output.code, output.rows[i], output.scales[i], tuple(columns), numbers, tuple(known)] += 1
    return found


def assert_same_terms(groups, variables: int) -> list[Bundle]:
    bundles = bundles_of(groups, variables)
    assert terms_of_bundles(bundles) == terms_of_groups(groups)
    for bundle in bundles:
        ordered = np.sort(bundle.columns, axis=1)
        assert (ordered[:, 1:] != ordered[:, :-1]).all()
    return bundles


@pytest.mark.parametrize("build", [*ZOO, lambda: sliding_disc(30)], ids=[*ZOO_NAMES, "sliding-disc"])
def test_every_term_is_in_one_bundle_and_reads_different_variables(build):
    found = collect_terms(build())
    for terms in (found.rows, found.cost):
        assert_same_terms(list(terms.groups.values()), len(found.variables))


def group_of(number: int, columns: list[tuple[int, ...]]) -> TermGroup:
    """A sum of different variables and one number for each entry; shapes differ in how often the number is added."""
    size = len(columns[0])
    group = TermGroup((SUM + size + 1, *(-1 - k for k in range(size)), NUMBER, number), size, 1)
    for row, several in enumerate(columns):
        parameters = [(0, row)] if (row + number) % 3 == 0 else []
        group.add(row, 1.0 + row, several, [float(row)], parameters)
    return group


@st.composite
def groups(draw) -> list[TermGroup]:
    """Shapes that read windows of variables at some of the time points, in any order, also of neighbouring ones."""
    points = draw(st.integers(1, 60))
    made = []
    for number in range(draw(st.integers(1, 6))):
        window = draw(st.lists(st.integers(0, 7), min_size=0, max_size=5, unique=True))
        chosen = draw(st.permutations(range(points)))[: draw(st.integers(1, points))]
        common = draw(st.sampled_from([(), (0,)]))  # a variable that all read, as a free duration
        made.append(group_of(number, [(*common, *(1 + 4 * point + k for k in window)) for point in chosen]))
    return made


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(made=groups())
def test_whatever_variables_terms_share_none_is_lost(made):
    assert_same_terms(made, 1 + 4 * 60 + 8)


def test_rows_of_one_time_point_become_the_outputs_of_one_function():
    found = collect_terms(sliding_disc(30))
    bundles = bundles_of(list(found.rows.groups.values()), len(found.variables))
    # At the first time point a row is missing: its terms stand alone.
    assert [(bundle.columns.shape, len(bundle.outputs)) for bundle in bundles if bundle.columns.shape[0] > 1] == [
        ((29, 5), 4)
    ]
    assert sum(len(bundle.outputs) for bundle in bundles if bundle.columns.shape[0] == 1) == 3


def test_a_shape_that_reads_other_variables_stays_by_itself():
    shapes = [group_of(0, [(3 * k, 3 * k + 1) for k in range(20)]), group_of(1, [(3 * k + 2,) for k in range(20)])]
    assert [len(bundle.outputs) for bundle in bundles_of(shapes, 60)] == [1, 1]


def test_terms_join_the_time_point_of_their_newest_variable():
    # Intervals share their ends, as in the trapezoid rule; the second shape reads the right end of each.
    intervals = group_of(0, [(k, k + 1, 100 + k) for k in range(40)])
    ends = group_of(1, [(k + 1,) for k in range(1, 40)])
    bundles = assert_same_terms([ends, intervals], 200)
    assert [(bundle.columns.shape, len(bundle.outputs)) for bundle in bundles] == [((39, 3), 2), ((1, 3), 1)]


def test_few_terms_do_not_keep_others_apart():
    one = group_of(0, [tuple(range(40))])
    pairs = [group_of(number, [(2 * k, 2 * k + 1) for k in range(20)]) for number in (1, 2)]
    assert len(one.rows) < FEWEST_TERMS
    assert sorted(len(bundle.outputs) for bundle in assert_same_terms([one, *pairs], 40)) == [1, 2]


# --------------------------------------------------------------------
# The compiled evaluation under sanitizers: no access outside of its arrays, nothing undefined.


GCC = shutil.which("gcc")


def runtime(name: str) -> str | None:
    """A sanitizer's library; gcc repeats the bare name of one that is not there."""
    found = subprocess.run([str(GCC), f"-print-file-name={name}"], capture_output=True, text=True, check=True)
    return found.stdout.strip() if Path(found.stdout.strip()).is_absolute() else None


@pytest.mark.heavy
@pytest.mark.casadi
@pytest.mark.skipif(GCC is None or not sys.platform.startswith("linux"), reason="needs gcc's sanitizers")
def test_no_block_reads_or_writes_outside_of_its_arrays(tmp_path: Path) -> None:
    libraries = [runtime(name) for name in ("libasan.so", "libubsan.so")]
    if None in libraries:
        pytest.skip("gcc has no sanitizers here")
    laws = Path(__file__).with_name("test_compiled_terms.py")
    # A copy of the package, imported from the working folder.
    compiled = shutil.ignore_patterns("__pycache__", "*.so")
    shutil.copytree(Path(pyrobocop_pyomo.__file__).parent, tmp_path / "pyrobocop_pyomo", ignore=compiled)
    compiler = f"{GCC} -fsanitize=address,undefined -fno-sanitize-recover=all -g"
    command = [sys.executable, "-m", "pyrobocop_pyomo", "build-native"]
    subprocess.run(command, cwd=tmp_path, env={**os.environ, "CC": compiler}, check=True)
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", laws, "-k", "129 or ipopt_runs"],
        cwd=tmp_path,
        env={
            **os.environ,
            # Ipopt loads it in a way that sanitizers refuse; it has a test of its own.
            "PYROBOCOP_LINEAR_SOLVER": "none",
            # Python itself frees not all that it takes; the library is loaded into a process without the runtimes.
            "LD_PRELOAD": " ".join(map(str, libraries)),
            "ASAN_OPTIONS": "detect_leaks=0",
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout[-3000:] + ended.stderr[-3000:]
    assert "passed" in ended.stdout
    assert "skipped" not in ended.stdout  # without the library there is nothing to test
