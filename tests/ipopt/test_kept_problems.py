"""A problem object that several runs share: each run ends as if it had one of its own."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest

from pyrobocop_pyomo.ipopt.ipopt_callbacks import KeptProblem
from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt
from pyrobocop_pyomo.programs.compiled_model import CompiledModel

pytestmark = pytest.mark.casadi


def program() -> CompiledModel:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(3), initialize=0.5, bounds=(-2, 2))
    m.row = pyo.Constraint(expr=m.x[0] + m.x[1] * m.x[2] == 1)
    m.cost = pyo.Objective(expr=sum((m.x[i] - i) ** 4 for i in range(3)))
    return CompiledModel(m, "vectorised")


def address(kept: KeptProblem) -> Any:
    return kept._address


def test_runs_share_the_object_and_end_as_without_it() -> None:
    nlp, kept = program().nlp, KeptProblem()
    alone = run_ipopt(nlp, {"max_iter": 50})
    first = run_ipopt(nlp, {"max_iter": 50}, kept=kept)
    used = address(kept)
    second = run_ipopt(nlp, {"max_iter": 3}, kept=kept)
    third = run_ipopt(nlp, {"max_iter": 50}, kept=kept)
    assert used == address(kept)
    assert (second.iterations, second.status.solved) == (3, False)
    for outcome in (first, third):
        np.testing.assert_array_equal(outcome.x, alone.x)
        assert len(outcome.records) == len(alone.records)


def test_an_option_of_an_earlier_run_is_forgotten() -> None:
    nlp, kept = program().nlp, KeptProblem()
    run_ipopt(nlp, {"max_iter": 1}, kept=kept)
    assert run_ipopt(nlp, {}, kept=kept).status.solved


def test_other_bounds_and_other_programs_are_noticed() -> None:
    compiled, kept = program(), KeptProblem()
    run_ipopt(compiled.nlp, {}, kept=kept)
    compiled.variables[0].setlb(0.25)
    compiled.update()
    assert run_ipopt(compiled.nlp, {}, kept=kept).x[0] >= 0.25 - 1e-7
    assert run_ipopt(program().nlp, {}, kept=kept).x[0] < 0.2


def test_a_run_within_a_run_has_an_object_of_its_own() -> None:
    nlp, kept, inner = program().nlp, KeptProblem(), []

    def again(record: Any) -> bool:
        if not inner:
            inner.append(run_ipopt(nlp, {}, kept=kept))
        return True

    outer = run_ipopt(nlp, {}, kept=kept, on_iteration=again)
    np.testing.assert_array_equal(outer.x, inner[0].x)


def test_what_a_callback_raises_spoils_no_later_run() -> None:
    nlp, kept = program().nlp, KeptProblem()

    def fail(record: Any) -> bool:
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        run_ipopt(nlp, {}, kept=kept, on_iteration=fail)
    assert run_ipopt(nlp, {}, kept=kept).status.solved


@pytest.mark.parametrize("carry", [copy.deepcopy, lambda kept: pickle.loads(pickle.dumps(kept))])
def test_a_copy_has_none_yet(carry: Any) -> None:
    kept = KeptProblem()
    run_ipopt(program().nlp, {}, kept=kept)
    assert address(carry(kept)) is None
    assert address(kept) is not None
