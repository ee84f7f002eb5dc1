"""Statements that are refused or misread later, or that derivatives cannot follow: objectives, pairs, states, units."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, islice
from typing import Any

from pyomo.core.base.block import Block, BlockData
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.units_container import InconsistentUnitsError, UnitsError
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value
from pyomo.dae import DerivativeVar, Integral
from pyomo.gdp import Disjunct, Disjunction
from pyomo.util.check_units import assert_units_consistent

from pyrobocop_pyomo.complementarity import Complements, canonical_form
from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES, active_sources
from pyrobocop_pyomo.complementarity.replaced_rows import has_kink, is_smooth_product, is_zero_product
from pyrobocop_pyomo.errors import ComplementarityError, ModelError
from pyrobocop_pyomo.modeling.activity import BLOCK_TYPES, ONE_MODEL, foreign_read, foreign_variable
from pyrobocop_pyomo.modeling.rows_by_rule import as_read
from pyrobocop_pyomo.modeling.shared_nodes import topmost_nodes, variables_in, variables_in_any
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.phases import Control, phases_of
from pyrobocop_pyomo.phases.declarations import Declaration
from pyrobocop_pyomo.phases.structure import sides_of

from .findings import Finding, error_about, quoted, warning_about

# Rows of one component come from one rule, which says the same at each time: the first ones are looked at.
_ROWS = 8


def statement_findings(block: Any) -> Iterator[Finding]:
    """Statements that are refused, or misread, later on."""
    stated = block.model().component_data_objects(Objective, active=True, descend_into=Block)
    objectives = [objective.name for objective in stated]
    if len(objectives) > 1:
        message = f"{len(objectives)} objectives are active: {', '.join(map(repr, objectives))}."
        yield error_about(message, objectives, "Add them up in one, or deactivate all but one.")
    variables = block.component_data_objects(Var, active=True, descend_into=Block)
    discrete = (data for data in variables if not (data.is_continuous() or data.fixed))
    for name in dict.fromkeys(data.parent_component().name for data in discrete):
        remedy = "Ipopt knows real numbers only: fix it, or use a pair."
        yield error_about(f"'{name}' is a discrete variable.", (name,), remedy)
    wrong: dict[str, str] = {}
    for source in active_sources(block):
        try:
            canonical_form(source)
        except ComplementarityError as error:
            wrong.setdefault(source.parent_component().name, str(error))
    for name, message in wrong.items():
        yield error_about(message, (name,), "rcp.solve refuses the model until then.")


def foreign_findings(block: Any, rows_of_each: int | None = None) -> Iterator[Finding]:
    """Components that read free variables of another model.

    Parameters
    ----------
    block : Block
    rows_of_each : int, optional
        How many rows or pairs of each component are looked at, and no objectives, which are one long row; all by
        default.
    """
    kinds = (Constraint, *PAIR_TYPES) if rows_of_each is not None else (Constraint, Objective, *PAIR_TYPES)
    for component in block.component_objects(kinds, active=True, descend_into=Block):
        rows = islice((row for row in component.values() if row.active), rows_of_each)
        read = variables_in_any(chain.from_iterable(map(sides_of, rows))).values()
        foreign = foreign_variable(block, (variable for variable in read if not variable.fixed))
        if foreign is not None:
            yield error_about(f"'{component.name}' {foreign_read(foreign, block)}", (component.name,), ONE_MODEL)


def unfinished_findings(block: Any) -> Iterator[Finding]:
    """Derivatives and integrals along sets that were not discretised, and disjunctions that were not transformed.

    What is transformed has another type, or is not active any more.
    """
    along: dict[str, list[str]] = {}
    for component in block.component_objects((DerivativeVar, Integral), active=True, descend_into=BLOCK_TYPES):
        is_derivative = component.ctype is DerivativeVar
        for domain in component.get_continuousset_list() if is_derivative else [component.get_continuousset()]:
            if "scheme" not in domain.get_discretization_info():
                along.setdefault(domain.name, []).append(component.name)
    for name, components in along.items():
        yield error_about(
            f"the ContinuousSet '{name}' was not discretised: nothing ties {quoted(components)} to values along it.",
            components,
            f"Call pyo.TransformationFactory('pyrobocop.collocation').apply_to(m, wrt=m.{name}, nfe=20), or Pyomo's "
            "'dae.collocation', before the solve.",
        )
    choices = [*block.component_data_objects((Disjunction, Disjunct), active=True, descend_into=Block)]
    if choices:
        names = list(dict.fromkeys(data.parent_component().name for data in choices))
        yield error_about(
            f"{quoted(names)} {'is a choice' if len(names) == 1 else 'are choices'} of pyomo.gdp, which no interior "
            "method sees.",
            names,
            "Apply 'gdp.bigm' or 'gdp.hull' and use a mixed-integer solver, or SolverFactory('gdpopt'); or state the "
            "choice as a pair, which rcp.solve takes.",
        )


def misplaced_findings(block: Any) -> Iterator[Finding]:
    """Declarations and pairs that were assigned to a block that does nothing with them."""
    for part in block.block_data_objects(active=True, descend_into=Block):
        for name, held in vars(part).items():
            if isinstance(held, Declaration):
                yield error_about(
                    f"'{name}' (declared at {held.declared_at}) is a {type(held).__name__} on '{part.name}', which is "
                    "no phase: nothing was made of it.",
                    (part.name,),
                    f"Assign it to a phase: m.p = rcp.PhaseBlock(...), m.p.{name} = rcp.{type(held).__name__}(...).",
                )
            elif isinstance(held, Complements):
                yield error_about(
                    f"'{name}' on '{part.name}' is a pair that no component holds: nothing was made of it.",
                    (part.name,),
                    f"Write m.{name} = rcp.Complementarity(expr=rcp.complements(...)).",
                )


def scaled_pair_findings(block: Any) -> Iterator[Finding]:
    """Pairs that Pyomo's ``core.scale_model`` has passed over, while it scaled the variables that they hold."""
    factors = getattr(block.model(), "component_scaling_factor_map", {})
    scaled: dict[str, Any] = {}
    for source in active_sources(block) if factors else ():
        held = (variable for side in sides_of(source) for variable in variables_in(side))
        for variable in (variable for variable in held if factors.get(variable, 1) != 1):
            scaled.setdefault(source.parent_component().name, variable)
    for name, variable in scaled.items():
        yield error_about(
            f"'{name}' holds '{variable.name}', which core.scale_model multiplied by {factors[variable]:g}; it "
            "changes constraints, and leaves pairs as they were: they mean something else now.",
            (name,),
            "Apply pyrobocop.relax_complementarity before core.scale_model, or solve the model itself.",
        )


def without_objective(block: Any) -> str:
    """Words that say so, for a block in which no objective has something to choose; empty otherwise."""
    objectives = list(block.component_data_objects(Objective, active=True, descend_into=Block))
    if any(next(variables_in(each.expr, include_fixed=False), None) is not None for each in objectives):
        return ""
    if objectives:
        return f"the objective '{objectives[0].name}' is constant"
    inactive = next(block.component_data_objects(Objective, descend_into=Block), None)
    return "there is no objective" if inactive is None else f"the objective '{inactive.name}' is deactivated"


def objective_findings(model: Any) -> Iterator[Finding]:
    """A model whose controls are free and that has no objective, or one in which nothing may move."""
    without = without_objective(model)
    objectives = list(model.component_data_objects(Objective, active=True, descend_into=Block)) if without else []
    for objective in objectives:
        held = next(variables_in(objective.expr), None) is not None
        number = value(objective.expr, exception=False)
        # An objective of 0 says that any point will do that meets the constraints.
        if held or number != 0:
            yield warning_about(
                f"objective '{objective.name}' is the number {number}: it holds no variable"
                f"{' that is not fixed' if held else ''}.",
                (objective.name,),
                "Free one of them, or state an objective of 0 where any point will do."
                if held
                else "A variable that is called, as x(), or read by .value or pyo.value is its present value: write x.",
            )
    controls = free_controls(model)
    if without and controls and not objectives:
        yield warning_about(
            f"{without} in '{model.name}', while {quoted(controls)} may be chosen: any values that "
            "meet the constraints are an answer.",
            controls,
            "State what is to be small: m.cost = pyo.Objective(expr=phase.integral(lambda b, t: ...)), or solve the "
            "model that does; where any values will do, 0.",
        )


def duration_findings(model: Any) -> Iterator[Finding]:
    """Durations at their lower bounds, where the objective reads nothing else: it chooses between no motions then."""
    ends = {id(phase.duration): phase for phase in phases_of(model) if phase.has_free_duration}
    if not ends:
        return
    goals = [objective.expr for objective in model.component_data_objects(Objective, active=True, descend_into=Block)]
    read = [variable for variable in variables_in_any(goals).values() if not variable.fixed]
    is_decided = all(id(of) in ends and of.lb not in (None, of.ub) and of.value - of.lb <= MET for of in read)
    controls = free_controls(model) if is_decided else {}
    for duration in read if controls else ():
        yield warning_about(
            f"the objective reads durations alone, and that of phase '{ends[id(duration)].name}' ends at its lower "
            f"bound, {duration.lb:g}: any values of {quoted(controls)} that meet the constraints are an answer.",
            (duration.name, *controls),
            "The bound decides. Lower it, or add a cost of the motion: phase.integral(lambda b, t: ...).",
        )


def free_controls(block: Any) -> dict[str, set[int]]:
    """Ids of the variables of each control that are not fixed: one that is held has them under several times."""
    every = ((phase, name) for phase in phases_of(block) for name in phase.record.names(Control))
    free = {
        f"{phase.name}.{name}": {id(data) for data in phase.record.nodes(name).variables(phase) if not data.fixed}
        for phase, name in every
    }
    return {name: ids for name, ids in free.items() if ids}


def refuse_no_model(model: Any) -> None:
    """Refuse what is no model, or one that is not built.

    Raises
    ------
    ModelError
        With what to write instead.
    """
    if not isinstance(model, BlockData):
        raise ModelError(
            f"{model!r:.80} is no model. Give solve a ConcreteModel or one of its blocks: rcp.solve(m)."
            if not hasattr(model, "create_instance") or hasattr(model, "component_map")
            else f"'{model}' is not built yet: rcp.solve(model.create_instance(data))."
        )


def unit_findings(block: Any, rows_of_each: int | None = None) -> Iterator[Finding]:
    """Rows and objectives whose terms have different units, one finding per component; nothing without units.

    Parameters
    ----------
    block : Block
    rows_of_each : int, optional
        How many rows or pairs of each component are looked at; all by default.
    """
    variables = block.component_data_objects(Var, active=True, descend_into=Block)
    if all(data.get_units() is None for data in variables):
        return
    for component in block.component_objects((Constraint, Objective, *PAIR_TYPES), active=True, descend_into=Block):
        try:
            for row in islice(component.values(), rows_of_each):
                for part in sides_of(row) if component.ctype in PAIR_TYPES else (row,):
                    assert_units_consistent(part)
        except (InconsistentUnitsError, UnitsError) as inconsistency:
            yield error_about(
                f"'{component.name}': {str(inconsistency).strip().rstrip('.')}.",
                (component.name,),
                "Give constants their units (9.81 * units.m / units.s**2), or correct the units of a declaration.",
            )


def form_findings(model: Any) -> Iterator[Finding]:
    """Absolute values and products that are to be zero, one finding per component and kind.

    Parameters
    ----------
    model : Block
    """
    for component, argument in absolute_values_in(model):
        text = f"'{argument}'"
        parts = (
            "In an objective that falls with it, split the quantity: two controls with bounds=(0, None) whose "
            "difference it is, and their sum in place of abs(...). "
        )
        yield warning_about(
            f"'{component.name}' holds abs(...) of {text if len(text) <= 62 else 'an expression'}, which has no "
            "derivative at zero, where optima tend to be.",
            (component.name,),
            f"{parts if component.ctype is Objective else ''}"
            "pyo.TransformationFactory('pyrobocop.absolute_values_to_complementarity').apply_to(model) puts two such "
            "parts in place of every absolute value. On a phase, b.size = "
            "rcp.mechanics.AbsoluteValue(lambda b, t: ...) states it exactly, and sqrt(x**2 + 1e-6) rounds it off.",
        )
    for component in model.component_objects(Constraint, active=True, descend_into=Block):
        if any(map(is_zero_product, map(as_read, islice(component.values(), _ROWS)))):
            yield warning_about(
                f"constraint '{component.name}' states that a product is zero; its derivatives vanish where both "
                "factors do, and solvers stall there.",
                (component.name,),
                "State a pair, on a phase under @b.complementarity: rcp.complements(first >= 0, second >= 0), or "
                "rcp.either_zero(first >= 0, second) where the second factor may have any sign.",
            )


def absolute_values_in(model: Any) -> Iterator[tuple[Any, Any]]:
    """Components with the argument of their first absolute value that may pass zero."""
    for component in model.component_objects((Constraint, Objective), active=True, descend_into=Block):
        arguments = (_absolute_value(as_read(row).expr) for row in islice(component.values(), _ROWS) if row.active)
        argument = next((argument for argument in arguments if argument is not None), None)
        if argument is not None:
            yield component, argument


def _absolute_value(expression: Any) -> Any:
    """The argument of the first absolute value whose argument may be zero; None where there is none."""

    def is_wanted(node: Any) -> bool:
        return is_smooth_product(node) or has_kink(node)

    for node in topmost_nodes((expression,), is_wanted):
        if has_kink(node):
            return node.arg(0)
    return None
