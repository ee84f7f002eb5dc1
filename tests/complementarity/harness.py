"""What the tests of complementarity share: the model as bytes, its state, and how to get the transformation."""

from __future__ import annotations

import io
from typing import Any

import pyomo.environ as pyo
from pyomo.gdp import Disjunct
from pyomo.repn.plugins.nl_writer import NLWriter

import pyrobocop_pyomo.complementarity  # registers the transformation
from pyrobocop_pyomo.complementarity.pairs import active_sources


def relaxation() -> Any:
    assert pyrobocop_pyomo.complementarity.RelaxComplementarity is not None
    return pyo.TransformationFactory("pyrobocop.relax_complementarity")


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


def sleep(model: Any) -> list[Any]:
    """Deactivate all pairs, so that the writer takes the model; returns them for waking up."""
    pairs = active_sources(model)
    for pair in pairs:
        pair.deactivate()
    return pairs


def row_values(transformation: Any, model: Any) -> list[float]:
    """Value of ``body - bound`` for each relaxed row: not positive where the row holds."""
    return [pyo.value(row.body) - row.ub for row in transformation.relaxed_rows(model)]
