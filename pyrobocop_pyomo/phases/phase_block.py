"""`PhaseBlock`: one horizon with its states, controls and equations, as an ordinary Pyomo block."""

from __future__ import annotations

from numbers import Real
from typing import TYPE_CHECKING, Any

from pyomo.core.base.component import ModelComponentFactory
from pyomo.core.expr.numvalue import NumericValue

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.blocks import BuiltBlock, Rule
from pyrobocop_pyomo.numerics import Scheme

from .declarations import Bounds, Declaration, Duration, Law
from .phase_data import PhaseBlockData

if TYPE_CHECKING:

    class _Phases(BuiltBlock, PhaseBlockData):
        """What editors and type checkers know: one phase, whose variables are attributes, or several by index."""

        def __new__(cls, *indexes: Any, **options: Any) -> PhaseBlock: ...
        def __getitem__(self, index: Any) -> PhaseBlockData: ...
else:
    _Phases = BuiltBlock


@ModelComponentFactory.register("A phase of motion: states, controls and equations over one horizon.")
class PhaseBlock(_Phases, data=PhaseBlockData):
    """One horizon with its states, algebraics, controls, parameters and equations, transcribed by collocation.

    Parameters
    ----------
    *indexes
        Index sets, as for any Pyomo block.
    duration : float, Duration, Var, Param or expression
        How long the phase lasts. With `Duration` it is a variable, and time indices run from 0 to 1; so they do
        whenever something about the horizon is to be found.
    elements : int, optional
        Number of elements of a uniform mesh; 10 by default.
    mesh : sequence of float or Mesh, optional
        Element boundaries, from start to end, kept exactly as given. In normalised time with a free duration.
    scheme : str or Scheme
        ``"radau"`` (default), ``"gauss"``, ``"implicit_euler"``, ``"implicit_midpoint"``, or a scheme object.
    stages : int, optional
        Collocation points per element; 3 by default.
    start : float, Start, expression, PhaseBlock or callable
        Time at which the phase starts: a number, a variable, an expression, or the phase after whose end it starts.
        For indexed phases also ``start(model, *index)``, which returns one of these for each.
    free_element_widths : tuple of two floats, optional
        Lets the element boundaries move: factors between which each element's width may change, so that a switch
        or a contact can fall on an element end.
    allow_higher_index : bool
        Let equations through that determine derivatives and algebraics only after differentiation. They are
        transcribed as they stand; `check` refuses them otherwise.
    time_units : Pyomo unit, optional
        Units of time, such as ``pyo.units.s``. With them, and with `units` in the declarations, Pyomo's
        ``assert_units_consistent`` checks the transcribed rows.
    rule : callable, optional
        ``rule(phase, *index)`` declares and states everything; needed for indexed phases and abstract models.

    Raises
    ------
    ModelError
        When the arguments make no grid; the block is then not added to the model.

    Notes
    -----
    The equations hold at the collocation points ``t_{i,k} = t_i + c_k h_i``. States live at element boundaries
    and collocation points, everything else at collocation points only, so that no value is left undetermined.

    References
    ----------
    Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation,
    ICRA 2022, sec. III, doi:10.1109/ICRA46639.2022.9812069

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> import pyrobocop_pyomo as rcp
    >>> m = pyo.ConcreteModel()
    >>> m.cart = rcp.PhaseBlock(duration=1.0, elements=20)
    >>> m.cart.position = rcp.State(initial=0, final=1)
    >>> m.cart.velocity = rcp.State(initial=0, final=0)
    >>> m.cart.force = rcp.Control(bounds=(-10, 10))
    >>> @m.cart.ode
    ... def newton(b, t):
    ...     return {b.position: b.velocity[t], b.velocity: b.force[t]}
    >>> m.effort = pyo.Objective(expr=m.cart.integral(lambda b, t: b.force[t] ** 2))
    """

    def __init__(
        self,
        *indexes: Any,
        duration: float | Duration | NumericValue = 1.0,
        elements: int | None = None,
        mesh: Any = None,
        scheme: str | Scheme = "radau",
        stages: int | None = None,
        start: Any = 0.0,
        free_element_widths: Bounds | None = None,
        allow_higher_index: bool = False,
        time_units: Any = None,
        rule: Rule | None = None,
        **block_options: Any,
    ) -> None:
        if any(isinstance(index, Real) for index in indexes):
            raise ModelError(
                f"PhaseBlock was given {', '.join(map(repr, indexes))} by position, where only sets may stand. Write "
                "PhaseBlock(duration=..., elements=...)."
            )
        options = {
            "duration": duration,
            "elements": elements,
            "mesh": mesh,
            "scheme": scheme,
            "stages": stages,
            "start": start,
            "free_element_widths": free_element_widths,
            "allow_higher_index": allow_higher_index,
            "time_units": time_units,
        }
        super().__init__(*indexes, options=options, rule=rule, **block_options)

    def __setattr__(self, name: str, value: Any) -> None:
        if isinstance(value, (Declaration, Law)):  # a single phase has taken it by now
            raise ModelError(
                f"phases '{self.name}': '{name}' (declared at {value.declared_at}) is declared on one phase at a time. "
                "Pass rule=..., or assign it to each of the phases."
            )
        super().__setattr__(name, value)
