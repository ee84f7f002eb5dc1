"""Blocks of this package: what they show of themselves, how they are built, cloned and pickled."""

from __future__ import annotations

import inspect
import io
import pickle
from typing import Any

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError, ObstacleError
from pyrobocop_pyomo.modeling.blocks import BuiltBlock, BuiltBlockData

BLOCKS = (rcp.PhaseBlock, rcp.Link, rcp.ObstacleAvoidanceBlock, rcp.Containment)


class Springs:
    """Facts behind a block of springs."""

    def __init__(self, stiffness: float) -> None:
        self.stiffness = stiffness


class SpringsData(BuiltBlockData):
    """A minimal kind of block."""

    _kind = "springs"

    def _build(self, stiffness: float) -> None:
        self._record = Springs(stiffness)
        self.length = pyo.Var(initialize=stiffness)
        if stiffness < 0:
            raise ModelError(f"{self._what}: negative stiffness")

    def force(self) -> Any:
        """Force of the springs."""
        return self._record_if_built().stiffness * self.length


class SpringsBlock(BuiltBlock, data=SpringsData):
    """Springs."""

    def __init__(self, *indexes: Any, stiffness: float = 1.0, rule: Any = None, **block_options: Any) -> None:
        super().__init__(*indexes, options={"stiffness": stiffness}, rule=rule, **block_options)


def longer(block: Any, *index: Any) -> None:
    block.extra = pyo.Param(initialize=sum(index))


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.__name__)
def test_a_signature_names_every_keyword_and_nothing_else(block: Any) -> None:
    parameters = inspect.signature(block).parameters
    assert not any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters.values())
    assert {"rule", "name", "doc", "concrete"} <= set(parameters)


def test_signatures_show_the_keywords_of_each_kind() -> None:
    assert {"duration", "elements", "mesh", "scheme", "stages"} <= set(inspect.signature(rcp.PhaseBlock).parameters)
    assert {"states", "omit", "jump", "parameters"} <= set(inspect.signature(rcp.Link).parameters)
    avoidance = inspect.signature(rcp.ObstacleAvoidanceBlock).parameters
    assert {"bodies", "obstacles", "clearance", "between"} <= set(avoidance)
    assert list(inspect.signature(rcp.Containment).parameters)[:5] == ["points", "body", "pose", "region", "clearance"]


@pytest.mark.parametrize(
    ("block", "misspelt", "nearest", "error"),
    [
        (rcp.PhaseBlock, "elemnts", "elements", ModelError),
        (rcp.Link, "jumps", "jump", ModelError),
        (rcp.ObstacleAvoidanceBlock, "obstacle", "obstacles", ObstacleError),
        (rcp.Containment, "regoin", "region", ObstacleError),
    ],
)
def test_a_misspelt_keyword_is_answered_with_the_nearest(block: Any, misspelt: str, nearest: str, error: Any) -> None:
    with pytest.raises(error, match=f"{block.__name__} has no keyword '{misspelt}'. Did you mean '{nearest}'"):
        block(**{misspelt: 1})


def test_a_keyword_without_neighbours_is_answered_with_all() -> None:
    with pytest.raises(ModelError, match="no keyword 'qqq'. Its keywords are duration, elements, "):
        rcp.PhaseBlock(qqq=1)


def test_a_misspelt_keyword_of_build_is_answered_with_the_nearest() -> None:
    m = pyo.ConcreteModel()
    with pytest.raises(ObstacleError, match="Containment has no keyword 'regoin'. Did you mean 'region'"):
        m.inside = rcp.Containment([1, 2], rule=lambda block, i: block.build([0.0, 1.0], regoin=None))
    assert m.component("inside") is None


def test_an_indexed_component_says_who_is_asked() -> None:
    m = pyo.ConcreteModel()
    m.legs = rcp.PhaseBlock(["a", "b"], rule=lambda b, i: None)
    assert not hasattr(m.legs, "ode")
    with pytest.raises(AttributeError, match=r"'legs' is indexed; 'ode' belongs to one of its blocks: legs\[...\].ode"):
        m.legs.ode(lambda b, t: {})
    assert m.legs["a"].trajectory is not None


def test_scalar_and_indexed_blocks_are_built_by_arguments_then_by_the_users_rule() -> None:
    m = pyo.ConcreteModel()
    m.one = SpringsBlock(stiffness=2.0, rule=longer)
    m.many = SpringsBlock([1, 2], [3], stiffness=5.0, rule=longer)
    assert m.one.length.value == 2.0
    assert m.one.extra.value == 0
    assert {index: block.extra.value for index, block in m.many.items()} == {(1, 3): 4, (2, 3): 5}
    text = io.StringIO()
    m.pprint(ostream=text)
    m.one.display(ostream=text)
    assert "length" in text.getvalue()


def test_a_block_is_on_the_model_whole_or_not_at_all() -> None:
    m = pyo.ConcreteModel()
    with pytest.raises(ModelError, match="springs 'one': negative stiffness"):
        m.one = SpringsBlock(stiffness=-1.0)
    with pytest.raises(ZeroDivisionError):
        m.many = SpringsBlock([1, 2], rule=lambda block, i: 1 / (2 - i))
    assert m.component("one") is m.component("many") is None


def test_a_block_that_is_not_constructed_says_so_and_is_built_once() -> None:
    a = pyo.AbstractModel()
    a.one = SpringsBlock()
    with pytest.raises(ModelError, match="springs 'one' is not constructed yet"):
        a.one.force()
    m = a.create_instance()
    with pytest.raises(ModelError, match="springs 'one' is built already"):
        m.one._build_once(stiffness=3.0)


def test_clones_and_pickles_keep_their_class_and_live_their_own_life() -> None:
    m = pyo.ConcreteModel()
    m.one = SpringsBlock(stiffness=2.0, rule=longer)
    m.many = SpringsBlock([1], rule=longer)
    for copied in (m.clone(), pickle.loads(pickle.dumps(m))):
        assert type(copied.one) is type(m.one)
        assert type(copied.many) is type(m.many)
        assert isinstance(copied.one, SpringsBlock)
        copied.one.length.set_value(7.0)
        assert m.one.length.value == 2.0


def test_an_abstract_model_keeps_a_rule_that_a_pickle_could_not_hold() -> None:
    a = pyo.AbstractModel()
    a.p = rcp.PhaseBlock(elements=2, rule=lambda b: setattr(b, "x", rcp.State(initial=1)))
    assert a.create_instance().p.x[0].value == 1
