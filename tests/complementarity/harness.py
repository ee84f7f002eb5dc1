"""What the tests of complementarity share: the model as bytes, its state, and how to get the transformation."""

import io
import pickle
from typing import Any

import pyomo.environ as pyo
from pyomo.gdp import Disjunct
from pyomo.repn.plugins.nl_writer import NLWriter

from pyrobocop_pyomo.complementarity import (
    Complementarity,
    complements,
    lifted_pairs_of,
    pairs_of,
    relaxation_rows_of,
    rows_of,
    shifted_rows_of,
    sources_of,
)
from pyrobocop_pyomo.complementarity.pairs import active_sources

RELAX = pyo.TransformationFactory("pyrobocop.relax_complementarity")


def stages(values: Any = (1.0,) * 8, weight: float = 0.5) -> Any:
    """Two elements of two stages."""
    m = pyo.ConcreteModel(name="stages")
    m.I = pyo.Set(initialize=[0, 1])
    m.a = pyo.Var(m.I, m.I, bounds=(0, None), initialize=dict(zip(m.I * m.I, values[:4], strict=True)))
    m.b = pyo.Var(m.I, m.I, bounds=(0, None), initialize=dict(zip(m.I * m.I, values[4:], strict=True)))
    m.cc = Complementarity(
        m.I, m.I, rule=lambda m, i, k: complements(m.a[i, k], m.b[i, k]), group=lambda m, i, k: i, weight=weight,
        family="stages",
    )  # fmt: skip
    m.cost = pyo.Objective(expr=m.a[0, 0])
    return m


def nl_text(model: Any) -> str:
    """The model as the solver would get it; names included, so that equal texts mean equal models."""
    stream, rows, columns = io.StringIO(), io.StringIO(), io.StringIO()
    NLWriter().write(model, stream, rows, columns)
    return stream.getvalue() + rows.getvalue() + columns.getvalue()


def state(model: Any) -> dict[str, bool | None]:
    """Every component and every datum by name, with its activity."""
    found: dict[str, bool | None] = {}
    for block in model.block_data_objects(active=None, descend_into=(pyo.Block, Disjunct)):
        for component in block.component_map().values():
            found[component.name] = getattr(component, "active", None)
            for data in component.values():
                found[f"{data.name} (data)"] = getattr(data, "active", None)
    return found


def deactivate_pairs(model: Any) -> list[Any]:
    """Deactivate all pairs, so that the writer takes the model; returns them."""
    pairs = active_sources(model)
    for pair in pairs:
        pair.deactivate()
    return pairs


def row_values(model: Any) -> list[float]:
    """Value of ``body - bound`` for each relaxed row: not positive where the row holds."""
    return [pyo.value(row.body) - row.ub for row in shifted_rows_of(model)]


def text_without_pairs(model: Any) -> str:
    """The written model without its pairs, which are deactivated for a moment."""
    pairs = deactivate_pairs(model)
    try:
        return nl_text(model)
    finally:
        for pair in pairs:
            pair.activate()


def round_trip(model: Any, **options: Any) -> None:
    """What holds for every choice: the way there, questions, copies and the way back, leaving nothing behind."""
    before, text = state(model), text_without_pairs(model)
    residuals = RELAX.residuals(model)
    relaxed = RELAX.create_using(model, **options)
    assert state(model) == before
    assert text_without_pairs(model) == text

    token = RELAX.apply_to(model, **options)
    written = nl_text(model)
    assert nl_text(relaxed) == written != text
    assert RELAX.residuals(model) == residuals
    _answers(model)
    for copy in (model.clone(), pickle.loads(pickle.dumps(model))):
        assert nl_text(copy) == written
        assert RELAX.residuals(copy) == residuals
        _answers(copy)
        delta = RELAX.delta_of(copy)
        delta.set_value(1e-3)
        assert nl_text(model) == written
        delta.set_value(RELAX.delta_of(model).value)
        assert nl_text(copy) == written
        RELAX.revert(copy)
        assert state(copy) == before
    RELAX.revert(model, token)
    assert state(model) == before
    assert text_without_pairs(model) == text


def _answers(model: Any) -> None:
    """Every generated row has sources of this very model, and is among the rows of each of them."""
    pairs = pairs_of(model)
    assert all(pair.source.model() is model and not pair.source.active for pair in pairs)
    for row in relaxation_rows_of(model):
        sources = sources_of(row)
        assert sources
        assert all(source.model() is model and row in rows_of(source) for source in sources)
    assert set(map(id, shifted_rows_of(model))) <= set(map(id, relaxation_rows_of(model)))
    for lifted in lifted_pairs_of(model):
        assert lifted.a.variable.model() is lifted.b.variable.model() is model
