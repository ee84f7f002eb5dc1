"""What is known of the motion under a plan's controls, or why it is not known: the one place that decides.

`equations_motion` integrates. Here it is decided whether there is something to integrate, whether the integration can
have seen all that the equations do, and whether the motion goes on where one phase follows another.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint

from pyrobocop_pyomo.links.tied_starts import ties_of
from pyrobocop_pyomo.modeling.blocks import BuiltBlockData
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.phases import PhaseBlockData
from pyrobocop_pyomo.phases.bounds_between_points import unseen_on_the_way

from .equations_motion import EquationsMotion, equations_motion
from .interpolation import parent_of
from .motion import Motion
from .moving_shapes import MovingShape
from .rules_along_motion import SignalFormulas

PLAN_ALONE = "equations=False asks for the plan alone."
NO_EQUATIONS = "a trajectory has no equations. Where its phase is at hand, ask its avoidance block: block.verify()."


def replayed_motion(
    motion: Motion,
    shapes: Mapping[str, list[MovingShape]],
    lengths: Mapping[str, SignalFormulas] | None = None,
    *,
    equations: bool = True,
) -> EquationsMotion:
    """How far the motion under the controls leads each moving part, and each clearance, from the plan.

    Parameters
    ----------
    motion : Motion
    shapes : mapping of body to list of MovingShape
        At the current values.
    lengths : mapping of str to SignalFormulas, optional
        Clearances that read signals.
    equations : bool
        Whether anything but the plan is to be looked at.

    Returns
    -------
    EquationsMotion
        Its deviations are those of what reads variables that move: NaN where nobody looked, and a lower bound where
        `why_unknown` says that not everything was seen. Everything else has no other motion than the plan.
    """
    alone = not motion.interpolation.has_equations
    named = {shape.name: shape.template for parts in shapes.values() for shape in parts} | dict(lengths or {})
    moving = {name: of for name, of in named.items() if of is not None}
    read = {name: of for name, of in moving.items() if alone or _components(of)}
    components = list({id(component): component for of in read.values() for component in _components(of)}.values())
    phases = {id(home): home for of in components if isinstance(home := of.parent_block(), PhaseBlockData)}.values()
    why, led = "", EquationsMotion()
    if alone:
        why = NO_EQUATIONS
    elif phases and not equations:
        why = PLAN_ALONE
    elif phases:
        led = equations_motion(motion, phases, shapes, lengths)
        why = led.why_unknown
    elif _rows_move(components):
        why = "the model has rows at its points for it, which say nothing in between."
    if why:
        nobody = np.full(len(motion.intervals), np.nan)
        return EquationsMotion(dict.fromkeys(read, nobody), why_unknown=why)
    deviation = {name: led.deviation[name] for name in read if name in led.deviation}
    return replace(led, deviation=deviation, why_unknown=_why_not_everywhere(phases, components, bool(led.how)))


def _components(template: SignalFormulas) -> list[Any]:
    """Variables of the model that a pose or a clearance reads over time."""
    return [signal.component for signal in template.signals.values() if signal.component is not None]


def _rows_move(components: Collection[Any]) -> bool:
    """Whether equations of the model tie what poses read to other points, or to other variables.

    Equations among the positions of one point, as a start or a goal, leave the way to it free; those of a block of this
    package, such as one that keeps bodies apart, move nothing.
    """
    own = {id(parent_of(data)) for component in components for data in component.values()}
    models = {id(component.model()): component.model() for component in components}
    for model in models.values():
        for row in model.component_data_objects(Constraint, active=True, descend_into=True):
            if not row.equality or isinstance(row.parent_block(), BuiltBlockData):
                continue
            read = list(variables_in(row.body))
            positions = {variable.index() for variable in read if id(variable.parent_component()) in own}
            others = any(id(variable.parent_component()) not in own for variable in read)
            if len(positions) > 1 or (positions and others):
                return True
    return False


def _why_not_everywhere(phases: Iterable[Any], components: Collection[Any], are_integrated: bool) -> str:
    """What the integration of phases, and of those before them, may not have seen, and where bodies jump."""
    pending = list(phases)
    for phase in pending:
        ties = ties_of(phase)
        pending += [other for other in ties.before if not any(other is of for of in pending)]
        for component in (of for of in components if of.parent_block() is phase):
            start = component[phase.initial_time]
            for other in ties.before if not any(start is given for given in ties.unknowns) else ():
                if component.local_name not in other.record.names_of_states:
                    continue
                end = other.component(component.local_name)[other.final_time]
                if not np.isclose(end.value, start.value):
                    return (
                        f"'{start.name}' does not go on from '{end.name}', and no row says that it jumps by "
                        f"{abs(end.value - start.value):.3g}: let the link between these phases join it."
                    )
        statements = [*phase.record.statements_of("ode"), *phase.record.statements_of("residual")]
        unseen = unseen_on_the_way(phase, phase.record, phase.trajectory(), statements) if are_integrated else ""
        if unseen:
            return unseen
    return ""
