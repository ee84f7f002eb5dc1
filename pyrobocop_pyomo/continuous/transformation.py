"""The transformation `pyrobocop.collocation`: discretises models of pyomo.dae by the schemes of this package."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from pyomo.common.config import ConfigDict, ConfigValue, PositiveInt
from pyomo.common.gc_manager import PauseGC
from pyomo.common.modeling import unique_component_name
from pyomo.core.base import Transformation, TransformationFactory
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.var import Var
from pyomo.core.expr import LinearExpression
from pyomo.dae import ContinuousSet, Integral

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.failures import undone_on_failure
from pyrobocop_pyomo.numerics import Grid, Mesh, Scheme, find_scheme
from pyrobocop_pyomo.numerics.polynomials import evaluation_matrix
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE

from .discretisation import discretise, finalise, undo_discretisation
from .structure import Discretisation, axes_of, axis_on, continuous_sets, discretisation_of, spots

logger = logging.getLogger(__name__)

# As users of pyomo.dae write them.
DAE_SCHEMES = {"LAGRANGE-RADAU": "radau", "LAGRANGE-LEGENDRE": "gauss", "BACKWARD": "implicit_euler"}


def _scheme(name: Any) -> str | Scheme:
    if not isinstance(name, (str, Scheme)):
        raise ValueError(f"{name!r} is neither the name of a scheme nor a Scheme")
    return DAE_SCHEMES.get(name, name) if isinstance(name, str) else name


@TransformationFactory.register(
    "pyrobocop.collocation", doc="Discretise the continuous sets of a pyomo.dae model by collocation."
)
class Collocation(Transformation):
    """Discretise continuous sets: every component indexed by one gets its points, derivatives their rows.

    Options of ``apply_to`` and ``create_using``: ``wrt`` (a ContinuousSet or several; all that are not yet discretised
    by default), ``nfe`` (elements, 10), ``ncp`` (stages per element, 3), ``scheme`` ("radau", "gauss", any name that
    `find_scheme` knows, "LAGRANGE-RADAU", "LAGRANGE-LEGENDRE" or a Scheme) and ``mesh`` (element boundaries).

    Where an equation says ``dx[t] == f``, ``f`` goes into the collocation rows and ``m.dx`` becomes an expression,
    unless it has bounds or is used elsewhere. Of the sets that a component is indexed by, one can be discretised here,
    and the others by pyomo.dae.

    Equations hold at the collocation points and at the first point. At other points states have a value, and what
    equations determine from them. A control at a point without a stage has the value of the nearest collocation point
    in its element, where that restricts nothing else; fixing it, or what follows from it, takes that back. Pairs and
    inequalities that would restrict it there are deactivated, and named in the log. It does not matter whether
    variables and derivatives are fixed before or after. A refusal leaves the model as it was.

    It cannot be reversed with ``TransformationFactory.reverse``, as ``dae.collocation`` cannot: rows and values of
    points that would go away may be in use by then. ``create_using`` leaves the model alone and returns a discretised
    copy.
    """

    CONFIG = ConfigDict("pyrobocop.collocation")
    CONFIG.declare("wrt", ConfigValue(default=None, description="The ContinuousSet to discretise; default all."))
    CONFIG.declare("nfe", ConfigValue(default=10, domain=PositiveInt, description="Number of elements."))
    CONFIG.declare("ncp", ConfigValue(default=None, domain=PositiveInt, description="Stages per element; default 3."))
    CONFIG.declare("scheme", ConfigValue(default="radau", domain=_scheme, description="Which collocation scheme."))
    CONFIG.declare("mesh", ConfigValue(default=None, description="Element boundaries, used exactly as given."))

    def _apply_to(self, model: Any, **options: Any) -> None:
        options = {**options.pop("options", {}), **options}
        config = self.CONFIG(options)
        if not model.is_constructed():
            raise ModelError(f"'{model.name}': is not constructed. Create its instance first.")
        if config.mesh is not None and "nfe" in options and len(config.mesh) - 1 != config.nfe:
            raise ModelError(
                f"nfe = {config.nfe}, but the mesh has {len(config.mesh) - 1} elements. Give one of the two."
            )
        scheme = find_scheme(config.scheme, config.ncp)
        with PauseGC():
            domains = _domains(model, config.wrt)
            done: list[Discretisation] = []
            with undone_on_failure(lambda: _undo(done)):
                for domain in domains:
                    points = tuple(domain)
                    grid = make_grid(domain, points, scheme, config.nfe, config.mesh)
                    done.append(discretise(domain, points, grid))
            for discretisation in done:
                finalise(discretisation)
        for discretisation in done:
            domain = discretisation.domain
            lost = dict.fromkeys(row.parent_component().name for row in discretisation.deactivated)
            if lost:
                logger.info(
                    "some points of '%s' are no collocation points of %s; these do not hold there: %s",
                    domain.name,
                    scheme.name,
                    ", ".join(map(repr, lost)),
                )

    def reduce_collocation_points(self, instance: Any, var: Any = None, ncp: int = 1, contset: Any = None) -> Any:
        """Give a control fewer free values per element than the states have, as in ``dae.collocation``.

        Parameters
        ----------
        instance : ConcreteModel or Block
            The discretised model; a constraint that is named after the variable, ``u_interpolation_constraints``, is
            added to it.
        var : Var
            A control or algebraic that is indexed by the set.
        ncp : int
            How many values stay free in each element. With 1 the variable is constant there, with 2 linear. The last
            points are free, and the others follow by interpolation.
        contset : ContinuousSet
            A set that this transformation has discretised.

        Returns
        -------
        ConcreteModel or Block
            The instance.

        Raises
        ------
        ModelError
            When the set is not discretised, the variable is a state or not indexed by it, or ``ncp`` does not fit.
        """
        discretisation = discretisation_of(contset) if getattr(contset, "ctype", None) is ContinuousSet else None
        if discretisation is None:
            raise ModelError(
                f"contset: '{getattr(contset, 'name', contset)}' was not discretised by pyrobocop.collocation. Apply "
                "it first, and pass the ContinuousSet."
            )
        axis = axis_on(var, contset) if getattr(var, "ctype", None) is Var else None
        if axis is None:
            raise ModelError(f"var: '{getattr(var, 'name', var)}' is no variable that is indexed by '{contset.name}'.")
        scheme, stages = discretisation.grid.scheme, discretisation.grid.scheme.stages
        if not isinstance(ncp, int) or not 1 <= ncp <= stages:
            raise ModelError(
                f"'{var.name}': ncp = {ncp!r}, but '{contset.name}' has {stages} points in each element. Give a "
                f"whole number from 1 to {stages}."
            )
        if ncp == stages:
            return instance
        if discretisation.grid.elements_share_points:
            raise ModelError(
                f"'{var.name}': with {scheme.name} neighbouring elements share a point, so that no element has values "
                "of its own. Choose radau or gauss."
            )
        if not discretisation.state_ids().isdisjoint(map(id, var.values())):
            raise ModelError(
                f"'{var.name}': has a derivative with respect to '{contset.name}', whose equations need all of its "
                "values. Only controls and algebraics can have fewer."
            )
        weights = evaluation_matrix(scheme.c[-ncp:], scheme.c[:-ncp]).tolist()
        rows = Constraint(var.index_set())
        instance.add_component(unique_component_name(instance, f"{var.local_name}_interpolation_constraints"), rows)
        first = discretisation.grid.points[0]
        for others in [axis.others(index) for index in var if axis.time(index) == first]:
            for times in discretisation.grid.stage_times:
                free = [var[axis.join(others, time)] for time in times[-ncp:]]
                for time, row in zip(times[:-ncp], weights, strict=True):
                    index = axis.join(others, time)
                    rows.add(index, (LinearExpression(linear_vars=[var[index], *free], linear_coefs=[-1.0, *row]), 0))
        return instance


def _undo(done: list[Discretisation]) -> None:
    for discretisation in reversed(done):
        undo_discretisation(discretisation)


def _domains(model: Any, wrt: Any) -> list[Any]:
    """The sets to discretise, all of them within the model."""
    own = continuous_sets(list(spots(model)))
    if wrt is None:
        chosen = [domain for domain in own if domain.active and "scheme" not in domain.get_discretization_info()] or own
    else:
        chosen = list(wrt) if isinstance(wrt, (list, tuple)) else [wrt]
    for chosen_set in chosen:
        if getattr(chosen_set, "ctype", None) is not ContinuousSet:
            raise ModelError(f"wrt: '{getattr(chosen_set, 'name', chosen_set)}' is no ContinuousSet.")
        if not any(chosen_set is domain for domain in own):
            home = chosen_set.parent_block()
            raise ModelError(
                f"'{model.name}': the set '{chosen_set.name}' does not live in it but in "
                f"'{home.name if home is not None else 'no model'}'. Apply the transformation to that, so that "
                "everything which is indexed by the set grows with it."
            )
        if "scheme" in chosen_set.get_discretization_info():
            by = chosen_set.get_discretization_info()["scheme"]
            raise ModelError(
                f"'{chosen_set.name}': was discretised already ({by}), and no rule is called a second time. Start from "
                "the model before that transformation: create_using leaves it as it is."
            )
    if not chosen:
        raise ModelError(f"'{model.name}': holds no ContinuousSet, so that there is nothing to discretise.")
    _refuse_several(model.model(), chosen)
    return chosen


def _refuse_several(root: Any, chosen: list[Any]) -> None:
    """Raise a `ModelError` where a component is indexed by several sets that would all be discretised here."""
    found = list(spots(root))
    ours = {*map(id, chosen), *(id(domain) for domain in continuous_sets(found) if discretisation_of(domain))}
    for spot in found:
        along = [domain for domain, _ in spot.outer] + [axis.domain for axis in axes_of(spot.component)]
        if isinstance(spot.component, Integral):
            along.append(spot.component.get_continuousset())
        names = dict.fromkeys(f"'{domain.name}'" for domain in along if id(domain) in ours)
        if len(names) > 1:
            raise ModelError(
                f"'{spot.component.name}': is indexed by {' and '.join(names)}. Discretise one of them here, and the "
                "others by dae.finite_difference or dae.collocation, before or after."
            )


def make_grid(domain: Any, points: Sequence[float], scheme: Scheme, elements: int, mesh: Any = None) -> Grid:
    """The grid of a scheme on a continuous set.

    Parameters
    ----------
    domain : ContinuousSet
        Named in messages.
    points : sequence of float
        The points that the user gave the set; all of them become element boundaries.
    scheme : Scheme
    elements : int
        Number of elements; more where the points ask for more.
    mesh : sequence of float, optional
        Boundaries to use instead of ``elements``.

    Raises
    ------
    ModelError
        When the mesh does not fit the set.
    """
    points = [float(point) for point in points]
    if mesh is None:
        return Grid(scheme, Mesh(tuple(_refined(domain, points, elements))))
    boundaries = sorted({*(float(value) for value in Mesh.given(mesh).boundaries), *points})
    what = f"'{domain.name}'"
    for given, own in ((mesh[0], points[0]), (mesh[-1], points[-1])):
        if float(given) != own:
            raise ModelError(f"{what}: the mesh ends at {given:g}, but the set ends at {own:g}. Make them equal.")
    for left, right in pairwise(boundaries):
        if right - left < NEGLIGIBLE * (boundaries[-1] - boundaries[0]):
            raise ModelError(
                f"{what}: the boundaries {left!r} and {right!r} are closer than anything that can be meant; one is a "
                "point of the set, the other of the mesh. Use the same number in both."
            )
    return Grid(scheme, Mesh(tuple(boundaries)))


def _refined(domain: Any, points: Sequence[float], elements: int) -> list[float]:
    """The points, and further ones between them: the widest gap is divided first, into equal parts."""
    given = len(points) - 1
    if given > elements:
        logger.warning(
            "'%s': has %d points of its own, hence %d elements instead of %d", domain.name, given + 1, given, elements
        )
    widths = [right - left for left, right in pairwise(points)]
    parts = [1] * given
    for _ in range(elements - given):
        parts[max(range(given), key=lambda i: widths[i] / parts[i])] += 1
    boundaries = [float(points[0])]
    for i, count in enumerate(parts):
        boundaries += Mesh.uniform(points[i], points[i + 1], count).boundaries[1:]
    return boundaries
