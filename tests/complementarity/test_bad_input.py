"""Wrong statements: each is refused by the name of the pair, says what to do, and leaves nothing behind.

An entry is a function that makes the mistake in a right model and returns the options of the transformation.
"""

import math
from collections.abc import Callable
from typing import Any

import pyomo.environ as pyo
import pyomo.mpec as mpec
import pytest

from pyrobocop_pyomo.complementarity import Complementarity, complements, either_zero, shifted_rows_of
from pyrobocop_pyomo.errors import ComplementarityError

from .harness import RELAX, nl_text, state, text_without_pairs

NAN, INF = float("nan"), math.inf
between = pyo.inequality


def right_model() -> Any:
    m = pyo.ConcreteModel(name="right")
    m.I = pyo.Set(initialize=[1, 2, 3])
    m.x, m.y = pyo.Var(m.I, bounds=(0, None), initialize=1), pyo.Var(m.I, bounds=(0, None), initialize=1)
    m.free, m.box = pyo.Var(initialize=1), pyo.Var(bounds=(0, 1), initialize=0.5)
    m.above = pyo.Var(bounds=(2, None), initialize=3)
    m.count = pyo.Var(domain=pyo.NonNegativeIntegers, initialize=1)
    m.p, m.hole = pyo.Param(initialize=1, mutable=True), pyo.Param(initialize=NAN, mutable=True, domain=pyo.Any)
    m.unset = pyo.Param([1], mutable=True)
    m.cost = pyo.Objective(expr=sum(m.x[i] for i in m.I))
    m.good = Complementarity(m.I, rule=lambda m, i: complements(m.x[i] >= 0, m.y[i] >= 0))
    return m


# What a pair with index 7 says, and what the refusal says about it.
PAIRS: dict[str, tuple[Callable[[Any], Any], str]] = {
    "three finite bounds": (
        lambda m: (between(0, m.free, 1), m.x[1] >= 2),
        "three finite bounds, where two are needed.*make its bound a Constraint",
    ),
    "three by an own bound": (
        lambda m: (between(0, m.free, 1), m.above),
        "three finite bounds.*second_bound='free'",
    ),
    "four finite bounds": (
        lambda m: (between(0, m.free, 1), between(0, m.x[1], m.p)),
        "four finite bounds, where two are needed.*make the bounds of that side a Constraint",
    ),
    "four by own bounds": (lambda m: (between(0, m.free, 1), m.box), "four finite bounds.*second_bound='free'"),
    "boxed variable against one bound": (
        lambda m: (m.box, m.x[1] >= 0),
        "one is meant. Write 'box >= 0' or 'box <= 1'",
    ),
    "strict inequality": (lambda m: (m.x[1] > 0, m.free >= 0), "strict inequality.*Write >= or <="),
    "no bound": (lambda m: (m.free, m.x[1] >= 0), "side 'free' has no finite bound.*free.setlb"),
    "bare expression against one bound": (lambda m: (m.free + 1, m.x[1] >= 0), "bare expression.*Write expr >= 0"),
    "bound beyond everything": (lambda m: (m.free >= INF, m.x[1] >= 0), "lower bound inf, which no value can meet"),
    "side None": (lambda m: (None, m.x[1] >= 0), "the constant None.*Complementarity.Skip"),
    "parameter": (lambda m: (m.p >= 0, m.x[1] >= 0), "holds no variable.*Leave the pair out"),
    "parameter in a range": (lambda m: (between(0, m.p, 1), m.x[1]), "holds no variable.*Leave the pair out"),
    "equality against one bound": (lambda m: (m.free == 0, m.x[1] >= 0), "equality.*Make it a Constraint"),
    "bound that is a variable": (lambda m: (between(0, m.free, m.x[1]), m.box), "holds a variable.*Write two pairs"),
    "crossed range": (lambda m: (between(2, m.free, m.p), m.x[1] - 1), "bounds 2 and 1, which contradict"),
    "NaN bound": (lambda m: (m.free >= NAN, m.x[1] >= 0), "lower bound nan, which no value can meet. Give a finite"),
    "NaN parameter": (lambda m: (m.hole * m.free >= 0, m.x[1] >= 0), "the parameter 'hole' is NaN. Give it a number"),
    "uninitialised bound": (
        lambda m: (m.free >= m.unset[1], m.x[1] >= 0),
        r"'unset\[1\]' of side .* has no value.*Give",
    ),
    "integer variable": (lambda m: (m.count >= 0, m.x[1] >= 0), "discrete variable 'count'.*relax its domain"),
    "object": (lambda m: (object(), m.x[1] >= 0), "of type object; expected a relation"),
    "chosen bound that is not there": (
        lambda m: complements(m.x[1], m.y[1], first_bound="upper"),
        "no finite upper bound, which was chosen.*setub",
    ),
    "chosen bound of a relation": (
        lambda m: complements(m.x[1] >= 0, m.y[1], first_bound="lower"),
        "plain variable: leave it out",
    ),
    "either_zero without a bound": (lambda m: either_zero(m.free, m.x[1]), "no finite bound"),
    "either_zero of a bare expression": (lambda m: either_zero(m.free + m.p, m.x[1]), "bare expression"),
    "either_zero against a relation": (lambda m: either_zero(m.x[1] >= 0, m.free >= 0), "any sign"),
    "unknown word for a bound": (lambda m: complements(m.x[1], m.y[1], first_bound="left"), "Say 'lower', 'upper'"),
    "tuple of three": (lambda m: (m.x[1] >= 0, m.y[1] >= 0, 1), "expected complements.*found tuple of length 3"),
    "no pair": (lambda m: None, "the rule returned None. Return complements"),
}


# What no bound and no value can make right; the rest is refused when the model is relaxed.
AT_ONCE = {
    "four finite bounds", "strict inequality", "bare expression against one bound", "side None",
    "parameter", "parameter in a range", "equality against one bound", "bound that is a variable",
    "object", "chosen bound of a relation", "either_zero of a bare expression", "either_zero against a relation",
    "unknown word for a bound", "tuple of three", "no pair",
}  # fmt: skip


def is_refused(component: Any, wrong: Callable[[Any], Any], words: str) -> bool:
    """The statement is refused or, if that could be made, the relaxation; whether it was the statement."""
    m = right_model()
    before, text = state(m), text_without_pairs(m)

    def act() -> None:
        nonlocal before, text
        m.cc = component([7], rule=lambda m, i: wrong(m))
        before, text = state(m), text_without_pairs(m)
        RELAX.apply_to(m)

    with pytest.raises(ComplementarityError, match=r"^'cc\[7\]': (.|\n)*" + words) as caught:
        act()
    assert str(caught.value).endswith(".")
    assert state(m) == before
    assert text_without_pairs(m) == text
    return m.component("cc") is None


@pytest.mark.parametrize("name", PAIRS)
def test_a_wrong_pair_is_named_where_it_is_stated_or_else_when_it_is_relaxed(name: str) -> None:
    assert is_refused(Complementarity, *PAIRS[name]) == (name in AT_ONCE)


def test_a_wrong_pair_of_pyomo_mpec_is_named_when_it_is_relaxed() -> None:
    is_refused(mpec.Complementarity, *PAIRS["strict inequality"])


# ---- components, values and targets


def families_in_a_scalar(m: Any) -> dict[str, Any]:
    m.cc = Complementarity(expr=complements(m.x, m.y))
    return {}


def family_against_one(m: Any) -> dict[str, Any]:
    m.cc = Complementarity(m.I, expr=complements(m.x, m.box))
    return {}


def mpec_family(m: Any) -> dict[str, Any]:
    m.cc = mpec.Complementarity(m.I, expr=mpec.complements(m.x, m.y))
    return {}


def value_that_is_no_number(m: Any) -> dict[str, Any]:
    m.x[2].set_value(NAN, skip_validation=True)
    return {}


def own_bound_that_is_no_number(m: Any) -> dict[str, Any]:
    m.z = pyo.Var(bounds=(NAN, None))
    m.cc = Complementarity(expr=complements(m.z, m.x[1]))
    return {}


def target_in_a_deactivated_block(m: Any) -> dict[str, Any]:
    m.part = pyo.Block([1])
    m.part[1].cc = Complementarity(expr=complements(m.x[1] >= 0, m.y[1] >= 0))
    m.part[1].deactivate()
    return {"targets": [m.part[1].cc]}


def target_of_another_model(m: Any) -> dict[str, Any]:
    return {"targets": [right_model().good]}


def target_of_another_kind(m: Any) -> dict[str, Any]:
    return {"targets": [m.x]}


MODELS: dict[Callable[[Any], dict[str, Any]], str] = {
    families_in_a_scalar: "^'cc': side 'x' stands for many variables. Pass a rule that gives one pair per index",
    family_against_one: "^'cc': one pair cannot serve all indices. Pass a rule, or a mapping from index to pair",
    mpec_family: r"^'cc\[1\]': side 'x' stands for many variables. Pass a rule that gives one pair per index",
    value_that_is_no_number: r"^'good\[2\]': the value of variable 'x\[2\]' is NaN. Give it a number, or None",
    own_bound_that_is_no_number: "^'cc': side 'z' has the lower bound nan",
    target_in_a_deactivated_block: "^'right': no active complementarity pair in the targets.*Activate pairs",
    target_of_another_model: "^'good': is no part of 'right'. Pass components of the model that is transformed",
    target_of_another_kind: "^'x': a target is one of Block, Complementarity, or a single part of one",
}


@pytest.mark.parametrize("spoil", MODELS, ids=lambda spoil: spoil.__name__)
def test_a_wrong_component_value_or_target_is_named(spoil: Callable[[Any], dict[str, Any]]) -> None:
    m = right_model()
    before = state(m)

    def act() -> None:
        nonlocal before
        options = spoil(m)
        before = state(m)
        RELAX.apply_to(m, **options)

    with pytest.raises(ComplementarityError, match=MODELS[spoil]) as caught:
        act()
    assert str(caught.value).endswith(".")
    # What the mistake itself brought beside the pair, a variable z, is not the refusal's to remove.
    after = {name: active for name, active in state(m).items() if name in before or not name.startswith("z")}
    assert after == before


# ---- what is no mistake


def test_the_same_pair_twice_is_no_error_and_a_fixed_integer_is_a_number() -> None:
    m = right_model()
    m.count.fix(2)
    m.scaled = Complementarity(expr=complements(m.count * m.x[1] >= 0, m.y[1] >= 0))
    m.again = Complementarity(expr=complements(m.x[1] >= 0, m.y[1] >= 0))
    m.swapped = Complementarity(expr=complements(m.y[1], m.x[1]))
    RELAX.apply_to(m)
    assert len(shifted_rows_of(m)) == 6
    nl_text(m)


def test_what_pairs_share_is_checked_with_the_first_and_what_is_their_own_with_each():
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=1), pyo.Var(initialize=1)
    m.shared = pyo.Expression(expr=m.x * m.y)
    factors = {1: 1.0, 2: 2.0, 3: NAN}
    m.good = Complementarity(
        [1, 2, 3], rule=lambda m, i: complements(m.shared + factors[i] * m.x >= 0, m.shared + m.y >= 0)
    )
    with pytest.raises(ComplementarityError, match=r"^'good\[3\]': a coefficient is NaN"):
        RELAX.apply_to(m)
    m.good[3].deactivate()
    m.y.set_value(NAN, skip_validation=True)
    with pytest.raises(ComplementarityError, match=r"^'good\[1\]': the value of variable 'y' is NaN"):
        RELAX.apply_to(m)
    m.y.set_value(1)
    m.y.domain = pyo.Integers
    with pytest.raises(ComplementarityError, match=r"^'good\[1\]': holds the discrete variable 'y'"):
        RELAX.apply_to(m)
