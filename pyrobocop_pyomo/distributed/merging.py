"""One model out of the models of several agents: shared quantities become one set of variables."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.common.collections import ComponentMap
from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.block import Block, BlockData
from pyomo.core.base.constraint import Constraint, ConstraintList
from pyomo.core.base.expression import Expression
from pyomo.core.base.objective import Objective, minimize
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.reference import Reference
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.complementarity import Complementarity, complements
from pyrobocop_pyomo.errors import TeamError
from pyrobocop_pyomo.modeling.shared_nodes import NodeReplacement, variables_in
from pyrobocop_pyomo.numerics import Array

from .agents import Agent


@dataclass(frozen=True, eq=False)
class MergedModel:
    """Models of several agents in one.

    Attributes
    ----------
    model : ConcreteModel
        With a block for each agent, named as the agent, where there are several; else the agent's own model.
    parts : dict of agent to block
    """

    model: Any
    parts: dict[str, Any]

    def find(self, name: str, agent: str | None = None) -> Any:
        """A component by its name in an agent's own model; in the first that has it, where no agent is named.

        Raises
        ------
        TeamError
            When none has it.
        """
        *others, last = self.parts if agent is None else (agent,)
        for asked in (*others, last):
            component = self.parts[asked].find_component(name)
            if component is not None:
                return component
        known = ", ".join(map(self.own_name, self.parts[last].component_objects(Var))) or "none"
        raise TeamError(f"agent '{last}': its model has no component '{name}'. Its variables are {known}.")

    def own_name(self, component: Any) -> str:
        """The name of a component in the model of its agent, as all agents have it."""
        name: str = component.name
        for part in self.parts.values():
            if part is not self.model and name.startswith(part.name + "."):
                return name[len(part.name) + 1 :]
        return name

    def all_values(self) -> dict[str, dict[str, Array]]:
        """Values of all variables over their index, by agent and by name in its own model."""
        return {
            agent: {self.own_name(v): variable_numbers(v.values()) for v in part.component_objects(Var)}
            for agent, part in self.parts.items()
        }

    def put_on(self, values: Mapping[str, Mapping[str, Array]]) -> None:
        """Put values that `all_values` gave on the model, except where it holds a variable fast."""
        for agent, part in self.parts.items():
            for variable in part.component_objects(Var):
                numbers = values.get(agent, {}).get(self.own_name(variable))
                if numbers is None or variable.is_reference():
                    continue
                for data, number in zip(variable.values(), numbers.tolist(), strict=True):
                    if not data.fixed:
                        data.set_value(number, skip_validation=True)

    def objective_value(self) -> float:
        """Sum of the agents' objectives, each to be minimised."""
        return sum(float(value(objective)) for objective in _active(self.model, Objective))

    def values_of(self, names: Iterable[str], agent: str | None = None) -> dict[str, Array]:
        """Values of components over their index, by name, as `find` finds them."""
        return {name: variable_numbers(self.find(name, agent).values()) for name in names}


def variable_numbers(variables: Iterable[Any]) -> Array:
    """Their values; 0 where there is none."""
    return np.array([0.0 if variable.value is None else variable.value for variable in variables], dtype=float)


def variables_behind(component: Any) -> list[Any]:
    """The component, or all variables of a block; nothing for what is neither."""
    if isinstance(component, BlockData) or component.ctype is Block:
        return list(component.component_objects(Var, descend_into=True))
    return [component] if component.ctype is Var else []


def _build_model(agent: Agent) -> Any:
    """What the builder of an agent gives.

    Raises
    ------
    TeamError
        When it gives no model.
    """
    model = agent.builder(*agent.data)
    if not isinstance(model, BlockData) or not model.is_constructed():
        raise TeamError(
            f"agent '{agent.name}': its builder '{getattr(agent.builder, '__name__', agent.builder)}' returned "
            f"{type(model).__name__}; expected a ConcreteModel."
        )
    return model


def merge_agents(agents: Sequence[Agent], shared: Iterable[str]) -> MergedModel:
    """Build the models of agents and make one of them.

    Parameters
    ----------
    agents : sequence of Agent
        The first one's variables stand for those that are shared.
    shared : iterable of str
        Names of the components that are one and the same wherever they appear.

    Raises
    ------
    TeamError
        When a builder gives no model, or a shared variable has an index in one model only.
    """
    models = {agent.name: _build_model(agent) for agent in agents}
    if len(models) == 1:
        ((name, model),) = models.items()
        return MergedModel(model, {name: model})
    with PauseGC():
        merged = ConcreteModel(name="team")
        for name, model in models.items():
            merged.add_component(name, model)  # as it is: rules hold on to the model that they were written for
        parts = {name: merged.component(name) for name in models}
        merged.agreement = ConstraintList()
        names = list(dict.fromkeys(shared))
        first, *others = parts.values()
        components = [c for label in names for c in _variable_components(first, label).values()]
        agreed = {id(variable) for component in components for variable in component.values()}
        known = set(_said_of(first, agreed).values())
        for other in others:
            _unify(first, other, names, merged.agreement)
            said = _said_of(other, agreed)
            for row, statement in said.items():
                if statement in known:
                    row.deactivate()
            known.update(said.values())
        _add_up_objectives(merged)
    return MergedModel(merged, parts)


def _active(block: Any, ctype: Any) -> Iterator[Any]:
    return block.component_data_objects(ctype, active=True, descend_into=True)


def _variable_components(block: Any, name: str) -> dict[str, Any]:
    """Components of variables behind a shared name, by their names within the block."""
    component = block.find_component(name)
    if component is None:
        return {}
    cut = len(block.name) + 1 if block.parent_block() is not None else 0
    return {variable.name[cut:]: variable for variable in variables_behind(component)}


def _unify(first: Any, other: Any, names: Sequence[str], agreement: ConstraintList) -> None:
    """Put the first block's variables in the place of the other's, wherever both have them.

    A variable without an index, such as a duration, stays where phases read it as a number, and is tied by a row.
    """
    substitution: dict[int, Any] = {}
    replaced: list[tuple[Any, Any]] = []
    for name in names:
        masters, copies = _variable_components(first, name), _variable_components(other, name)
        # In the order of the copies: a set of names has another order in each process.
        for label, copied in copies.items():
            if label not in masters:
                continue
            master = masters[label]
            for key, variable in copied.items():
                if key not in master:
                    raise TeamError(
                        f"'{label}' has index {key} in the model of '{other.local_name}', but not in that of "
                        f"'{first.local_name}'. Give both models the same horizon and mesh."
                    )
                _tighten(master[key], variable)
                if copied.is_indexed():
                    substitution[id(variable)] = master[key]
                else:
                    agreement.add(variable == master[key])
            if copied.is_indexed():
                replaced.append((copied, master))
    _substitute(other, substitution)
    for copied, master in replaced:
        block, label = copied.parent_block(), copied.local_name
        keys = list(copied)
        BlockData.del_component(block, copied)
        # The copy's own rules go on to find it under its name.
        reference = Reference({key: master[key] for key in keys}, ctype=Var)
        BlockData.add_component(block, label, reference)


def _tighten(master: Any, copied: Any) -> None:
    if copied.fixed and not master.fixed:
        master.fix(copied.value)
    for bound, better, set_bound in (("lb", max, master.setlb), ("ub", min, master.setub)):
        own, its = getattr(master, bound), getattr(copied, bound)
        if its is not None:
            set_bound(its if own is None else better(own, its))
    if master.value is None:
        master.set_value(copied.value, skip_validation=True)


class _Substitution(NodeReplacement):
    """Named expressions stay: the integrals of a phase are such, and get other terms where its mesh changes."""

    def of_operation(self, node: Any, found: list[Any]) -> Any:
        """A node with other arguments."""
        if not node.is_named_expression_type():
            return super().of_operation(node, found)
        if found[0] is not node.expr:
            node.set_value(found[0])
        return node


def _substitute(block: Any, substitution: Mapping[int, Any]) -> None:
    replaced = _Substitution(substitution).of
    for ctype in (Constraint, Objective, Expression):
        for data in block.component_data_objects(ctype, descend_into=True):
            new = data.expr if data.expr is None else replaced(data.expr)
            if new is not data.expr:
                data.set_value(new)
    for pair in block.component_data_objects(Complementarity, descend_into=True):
        first, second = map(replaced, pair.args)
        pair.set_value(complements(first, second, first_bound=pair.bounds[0], second_bound=pair.bounds[1]))


def _said_of(block: Any, shared: Collection[int]) -> ComponentMap:
    """From each active equation of shared variables alone in a block to what it says, as a text."""
    rows = (row for row in _active(block, Constraint) if row.equality)
    return ComponentMap(
        (row, str(row.expr)) for row in list(rows) if all(id(variable) in shared for variable in variables_in(row.expr))
    )


def _add_up_objectives(merged: Any) -> None:
    total: Any = 0.0
    for objective in list(_active(merged, Objective)):
        total += objective.expr if objective.sense == minimize else -objective.expr
        objective.deactivate()
    merged.objective = Objective(expr=total)
