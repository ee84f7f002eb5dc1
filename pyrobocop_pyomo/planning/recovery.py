"""Starts that a plan among obstacles is made from, one after the other, until one leads to a safe motion.

Normals on a wrong side or in contradiction, or an initial guess deep inside an obstacle end in a point of local
infeasibility. None of the starts is trusted by itself: all end with the full clearance and hard planes.

Starts that know one kind of model stand in folders of `contrib`. A folder with a module `start_provider` is found by
its name, so that nothing here imports one, and its starts are gone where the folder is.

Points that were found on a model, to be put back when they are wanted.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from itertools import islice
from pkgutil import iter_modules
from typing import Any, NamedTuple, Protocol

from pyomo.core.base.block import BlockData
from pyomo.core.base.enums import TraversalStrategy
from pyomo.core.base.suffix import Suffix
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import InitialGuessError, ObstacleError
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.obstacles import avoidance_blocks, containments
from pyrobocop_pyomo.obstacles.rerouting import overlaps_deeply, reroute, runs_into_several
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.phases.remeshing import put_on_meshes
from pyrobocop_pyomo.solving.ipopt_options import ITERATIONS_OF_ONE, SIDE_ITERATIONS
from pyrobocop_pyomo.solving.iterates import StopReason

# -------------------------------------------------------------------------------------------------- the point of a plan


logger = logging.getLogger(__name__)


class PlanningPoint:
    """Values of free variables and imported suffixes of a model, to be put back later, whatever its meshes are then.

    The margins and norms of separations among obstacles, and the margins inside regions, come back with them.

    Parameters
    ----------
    model : Block
    """

    def __init__(self, model: Any) -> None:
        self._values = VariableValues.of_free(model)
        # By component and index as well: on another mesh and back, variables and rows at times in between are new ones.
        self._named = _named(self._values.by_variable)
        self._suffixes = [(suffix, _named(suffix)) for suffix in imported_suffixes(model)]
        self._meshes = {id(phase): (phase, phase.grid.mesh) for phase in phases_of(model.model())}
        self._blocks = [
            (block, {index: value(block.margin[index]) for index in block.separations}, block.record.norm_now)
            for block in avoidance_blocks(model)
        ]
        self._regions = [
            (region, {time: value(region.margin[time]) for time in region.times}) for region in containments(model)
        ]

    def restore(self) -> None:
        """Put values, meshes and margins back; planes that are new by now start at the point."""
        moved = {phase: mesh for phase, mesh in self._meshes.values() if phase.grid.mesh != mesh}
        if moved:
            put_on_meshes(moved)  # they had them, and nothing has been stated since
            for component, index, number in self._named:
                if component.parent_block() is not None and index in component and not component[index].fixed:
                    component[index].set_value(number, skip_validation=True)
        else:
            self._values.restore()
        for suffix, entries in self._suffixes:
            suffix.clear()
            suffix.update(
                (component[index], entry)
                for component, index, entry in entries
                if component.parent_block() is not None and index in component
            )
        for block, margins, norm in self._blocks:
            for index in block.separations:
                block.margin[index] = margins.get(index, 0.0)
            try:
                if moved or set(block.separations) != set(margins):
                    block.initialize()
                else:
                    block.set_norm(norm)
            except ObstacleError as error:  # the point itself counts without their start values
                logger.warning("the separations of '%s' have no start values at the best point: %s", block.name, error)
        for region, room in self._regions:
            region.margin.store_values(room)


def _named(entries: Mapping[Any, Any]) -> list[tuple[Any, Any, Any]]:
    """Component, index and entry of each part of a model that has an entry."""
    return [
        (part.parent_component(), part.index(), entry)
        for part, entry in entries.items()
        if hasattr(part, "parent_component") and part.parent_component() is not None
    ]


def imported_suffixes(model: BlockData) -> list[Suffix]:
    """Suffixes for import, those nearest to the root first."""
    found = model.component_objects(
        Suffix, active=True, descend_into=True, descent_order=TraversalStrategy.BreadthFirstSearch
    )
    return [suffix for suffix in found if suffix.import_enabled()]


# ------------------------------------------------------------------------------------------------------------- recovery


CONTRIB = "pyrobocop_pyomo.contrib"
# Clearances that a provider's path keeps: a second path, farther from everything, is another start.
PATH_CLEARANCES = (1.0, 2.0)
_REGISTERED: list[StartProvider] = []


class PlanStart(NamedTuple):
    """How a plan is solved from the values that are on the model.

    Attributes
    ----------
    purpose : str
        What they are, for the table of rounds.
    most_iterations : int or None
        Of Ipopt, where the user has not set ``max_iter``.
    is_near : bool
        Whether they need no detour over the middle of all bounds.
    """

    purpose: str
    most_iterations: int | None = ITERATIONS_OF_ONE
    is_near: bool = False


class Recovery:
    """Starts to plan from.

    Parameters
    ----------
    model : Block
        Its values are the user's initial guess.
    planning : SafePlanning

    Attributes
    ----------
    why_no_path : str
        Why there is no start at all; empty where that is not known.
    """

    def __init__(self, model: Any, planning: Any) -> None:
        self._model, self._planning = model, planning
        self._blocks, self._regions = avoidance_blocks(model), containments(model)
        self._initial = PlanningPoint(model)
        self.why_no_path = ""

    def starts(self) -> Iterator[PlanStart]:
        """Put one start after the other on the model; whoever has a good plan stops asking."""
        self.start()
        provided = fitting_providers(self._model)
        may_be_led_around = all(fit.may_be_led_around for _, fit in provided)
        in_the_way = may_be_led_around and any(map(runs_into_several, self._blocks))
        is_led_around = in_the_way and self._lead_around(freely=True)
        if is_led_around:
            yield self._from_here("led around all obstacles")
        proposed = self._proposed([provider for provider, _ in provided])
        comes_first = not is_led_around and any(fit.comes_first for _, fit in provided)
        if comes_first:
            yield from islice(proposed, 1)
        # What converges from a good start takes few; from a bad one thousands are spent on restoring feasibility. Where
        # a search knows a better start, a guess that overlaps deeply gets the fewest; the rest comes at the end.
        is_bad = not may_be_led_around and any(map(overlaps_deeply, self._blocks))
        enough = SIDE_ITERATIONS if is_bad else ITERATIONS_OF_ONE
        others = any(block.separations for block in self._blocks)
        if in_the_way or comes_first:
            self.start()
        yield PlanStart("from the initial guess", enough if others else None)
        # Where no separation takes part, obstacles are not what makes the rest infeasible.
        if not any(block.separations for block in self._blocks):
            return
        was_cut_short = self._planning.results[-1].stop_reason is StopReason.ITERATION_LIMIT
        if self.why_no_path and not was_cut_short:
            return
        if not may_be_led_around:
            yield from proposed
        if not is_led_around and self._lead_around():
            yield self._from_here("led around all obstacles")
        yield from proposed
        if was_cut_short:
            self.start()
            yield PlanStart("from the initial guess, to the end", None)

    def start(self) -> None:
        """Back to the initial guess, with separations that start there."""
        self._initial.restore()
        self.initialize_separations()

    def initialize_separations(self) -> None:
        """Separations and regions for the values on the model, without what another motion asked for."""
        for region in self._regions:
            region.margin.store_values(dict.fromkeys(region.times, 0.0))
        for block in self._blocks:
            block.margin.store_values(dict.fromkeys(block.separations, 0.0))
            block.initialize()

    def _proposed(self, providers: Sequence[StartProvider]) -> Iterator[PlanStart]:
        """The starts of providers; each is made with the initial guess on the model."""
        for provider in providers:
            proposals = provider.propose(self._model, self._planning.deadline)
            while True:
                self._initial.restore()
                try:
                    purpose = next(proposals)
                except (StopIteration, InitialGuessError) as end:
                    self.why_no_path = self.why_no_path or str(end)
                    break
                yield self._from_here(purpose)

    def _lead_around(self, *, freely: bool = False) -> bool:
        """Lead the initial guess around all obstacles at once, where there is a way; whether there was one.

        The guess says how fast it goes and where it starts and ends. Where it runs into everything (`freely`), the best
        motion without obstacles says so better, if that is found at once.
        """
        self._initial.restore()
        if freely:
            self._planning.put_motion_without_obstacles()
        rerouted = [name for block in self._blocks for name in reroute(block)]
        return bool(rerouted)

    def _from_here(self, purpose: str) -> PlanStart:
        """From the values on the model."""
        self.initialize_separations()
        return PlanStart(purpose, is_near=not any(block.record.overlapping for block in self._blocks))


# --------------------------------------------------- starts that know one kind of model: paths of cars, or of arms


class Fit(NamedTuple):
    """How starts of one kind stand to those that a plan has anyway.

    Attributes
    ----------
    comes_first : bool
        The initial guess is so far off that solving from it would be in vain.
    may_be_led_around : bool
        Whether the guess is a start too when a path on a grid leads it around obstacles.
    obeys_equations : bool
        The starts are motions that the model can make; providers that only know its shapes are not asked then.
    """

    comes_first: bool = False
    may_be_led_around: bool = True
    obeys_equations: bool = False


class StartProvider(Protocol):
    """Knows starts for models of one kind."""

    def fits(self, model: Any) -> Fit | None:
        """How its starts fit a model, whose values are the user's initial guess; None for models of other kinds."""

    def propose(self, model: Any, deadline: Deadline) -> Iterator[str]:
        """Put one start after another on the model, and say in words what each is.

        Each is made from the user's initial guess, which is on the model whenever this goes on. Where there is no start
        at all, and no plan either, an InitialGuessError says why.
        """


def register_starts(provider: StartProvider) -> None:
    """Let plans start from what a provider proposes."""
    _REGISTERED.append(provider)


@cache
def _loaded() -> None:
    """Import what registers itself."""
    contrib = find_spec(CONTRIB)
    for folder in iter_modules(contrib.submodule_search_locations if contrib is not None else ()):
        if folder.ispkg and find_spec(f"{CONTRIB}.{folder.name}.start_provider") is not None:
            import_module(f"{CONTRIB}.{folder.name}.start_provider")


def fitting_providers(model: Any) -> list[tuple[StartProvider, Fit]]:
    """The providers that know starts for a model."""
    _loaded()
    found = [(provider, provider.fits(model)) for provider in _REGISTERED]
    fitting = [(provider, fit) for provider, fit in found if fit is not None]
    return [(provider, fit) for provider, fit in fitting if fit.obeys_equations] or fitting
