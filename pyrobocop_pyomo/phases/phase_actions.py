"""`PhaseActions`: what can be done with a phase once it is declared, beyond stating and solving it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.trajectories import Trajectory
from pyrobocop_pyomo.transcription import InitialGuess

from .companions import put_on_model
from .initial_guesses import set_guesses, set_straight_lines, set_trajectory
from .mpc_interface import PhaseInterface
from .phase_values import expression_values, expressions_over_time
from .reintegration import Reintegration, element_end_errors, reintegrate
from .remeshing import remesh_phases
from .simulation import Replay, SimulationOptions, replay, simulate
from .tracking import tracking_cost


class PhaseActions:
    """Initial guesses, simulation, tracking and exchange; part of every `PhaseBlock`."""

    __slots__ = ()

    def initialize(
        self: Any, guess: Trajectory | Mapping[Any, InitialGuess] | None = None, /, **by_name: InitialGuess
    ) -> None:
        """Set where the solver starts, any time after the declarations.

        Variables that are fixed keep their values, bounds are left alone, and a value outside of its bounds is moved
        onto the nearest. Derivatives that are variables follow their states.

        Parameters
        ----------
        guess : Trajectory or dict
            A trajectory of any mesh, scheme and duration is evaluated by its own polynomials, its horizon stretched
            onto that of the phase, and a free duration gets its; names in common are set. A dict has names or variables
            as keys; each initial guess is a number, a function of the time index, or an array as in a declaration.
            ``"duration"``, parameters and ``"<state>_derivative"`` are names as well.
        **by_name : number, array or function
            The same, as in ``initialize(theta=0.5)``; these win.

        Raises
        ------
        InitialGuessError
            Naming what is unknown, of the wrong length or not finite; nothing is set then.
        """
        if isinstance(guess, Trajectory):
            set_trajectory(self, self.record, guess)
        elif isinstance(guess, Mapping):
            by_name = {**guess, **by_name}
        elif guess is not None:
            raise InitialGuessError(
                f"phase '{self.name}': an initial guess is a trajectory or a mapping of names to initial guesses, "
                f"not a {type(guess).__name__}."
            )
        set_guesses(self, self.record, by_name)

    def initialize_straight_lines(self: Any) -> None:
        """Lead every state from its initial to its final value on a straight line.

        A range counts with the value nearest to the other end. A state with one stated end stays there; one with
        none keeps its initial guess. Controls and algebraics keep theirs.
        """
        set_straight_lines(self, self.record)

    def simulate(
        self: Any,
        controls: Mapping[str, InitialGuess] | None = None,
        *,
        initial: Mapping[str, float] | None = None,
        method: str = "DOP853",
        rtol: float = 1e-9,
        atol: float = 1e-10,
        unknown: Sequence[str] | None = None,
        restitution: Mapping[str, float] | None = None,
    ) -> Trajectory:
        """What the equations do from the initial values on, as a trajectory on the phase's own grid.

        Explicit differential equations are integrated by `scipy.integrate.solve_ivp`, element by element with the
        polynomials of controls. With residual equations, step maps, or ``method="scheme"``, the rows of the scheme
        are solved element by element. Where pairs determine what is left, such as the forces of contacts, the rows
        and pairs of an element are solved together, as a mixed complementarity problem. Nothing on the model changes:
        use ``phase.initialize(trajectory)`` to start from the result.

        Parameters
        ----------
        controls : dict of str to number, array or function
            Controls, and algebraics that are to be taken as given; the others are as the phase holds them. A function
            is called with the time index.
        initial : dict of str to number
            Where states start; as the phase holds them by default.
        method : str
            A method of `solve_ivp` (``"Radau"`` for stiff equations), or ``"scheme"``.
        rtol, atol : float
            Tolerances of `solve_ivp`.
        unknown : sequence of str, optional
            Algebraics and controls that are to be found, in the place of the default: the algebraics that are not given
            and, where there are more pairs than these, the controls that stand in pairs.
        restitution : dict of str to number, optional
            Newton's coefficients of impact, from 0 to 1, by the name of a pair, or of a rule or a contact law for all
            of its pairs of a gap and a force. Without one an impact is inelastic. It takes implicit Euler steps.

        Raises
        ------
        InitialGuessError
            When names, lengths or the number of equations do not fit.
        SimulationFailed
            With the time at which it stopped; the elements before are its attribute ``trajectory``.

        Notes
        -----
        Parameters and the duration are as the phase holds them. Bounds and path constraints are ignored. Algebraics
        are found where residual equations, or these and the pairs, determine all of them, and keep the phase's values
        where there are no such equations. Where several motions meet the pairs, the one that is found first from the
        values of the step before is taken. Time stepping: Stewart and Trinkle, An implicit time-stepping scheme for
        rigid body dynamics with inelastic collisions and Coulomb friction (1996),
        doi:10.1002/(SICI)1097-0207(19960815)39:15<2673::AID-NME972>3.0.CO;2-I
        """
        if isinstance(controls, Trajectory):
            raise InitialGuessError(
                f"phase '{self.name}': simulate was given a trajectory; expected a dict of controls, or nothing for "
                "those that the phase holds. Write phase.initialize(trajectory), then phase.simulate()."
            )
        options = SimulationOptions(
            method=method, rtol=rtol, atol=atol, unknown=unknown, restitution=dict(restitution or {})
        )
        found = simulate(self, self.record, controls or {}, initial or {}, options)
        if not expressions_over_time(self):
            return found
        with put_on_model([(self, found)]):
            return replace(found, expressions=expression_values(self))

    def remesh(self: Any, mesh: Any) -> None:
        """Give the phase another mesh, in place; see `remesh_phases`, which takes several at once.

        Components, and variables at times that stay, are the objects that they were. New variables have the values of
        the trajectory that stands on the model.

        Parameters
        ----------
        mesh : int, sequence of float or Mesh
            A number of elements, or element boundaries in the phase's time indices.

        Raises
        ------
        ModelError
            Naming what on the model cannot follow; nothing has changed then.
        ModelError
            When the mesh is none, or does not fit the phase.
        """
        remesh_phases({self: mesh})

    def replay(
        self: Any,
        trajectory: Trajectory | None = None,
        *,
        method: str = "scheme",
        unknown: Sequence[str] | None = None,
        restitution: Mapping[str, float] | None = None,
    ) -> Replay:
        """Simulate a plan under its own controls, and say how far the motion is from it.

        Where pairs determine forces and slip these are found again, step by step, by the equations and the pairs alone:
        a plan whose contacts are physics, and not just values that meet the rows to a tolerance, is found again.

        Parameters
        ----------
        trajectory : Trajectory, optional
            The phase's current values by default. Its parameters and its duration are taken as well.
        method, unknown, restitution
            As for `simulate`; the rows of the scheme by default, which a plan fulfils.

        Raises
        ------
        InitialGuessError, SimulationFailed
            As `simulate`.
        """
        options = SimulationOptions(method=method, unknown=unknown, restitution=dict(restitution or {}))
        return replay(self, self.record, self.trajectory() if trajectory is None else trajectory, options)

    def reintegrate(
        self: Any, trajectory: Trajectory | None = None, *, initial: Mapping[str, float] | None = None
    ) -> Reintegration:
        """The motion that the equations make of a plan under its controls, inside the elements too.

        All elements are integrated at once, by halved steps until nothing changes; implicit derivatives, algebraics and
        controls that equations determine are found at each instant. Where pairs decide something that the motion
        depends on, contact is simulated, in steps of a Radau scheme that are halved where it opens or closes. All other
        controls are taken as the trajectory's polynomials.

        Parameters
        ----------
        trajectory : Trajectory, optional
            The phase's current values by default.
        initial : dict of state name to number, optional
            Where the open loop starts, such as where the phase before has ended; as the plan does by default.

        Raises
        ------
        TrajectoryError
            When there are no states, or a step map leads them, or equations and pairs do not determine all that the
            motion depends on.
        """
        checked = self.trajectory() if trajectory is None else trajectory
        return reintegrate(self, self.record, checked, initial=initial)

    def element_errors(self: Any, trajectory: Trajectory | None = None) -> Array:
        """How far each element ends from where the equations lead from its own start, shape ``(N,)``.

        As `verify` does, and `reintegrate`.

        Parameters
        ----------
        trajectory : Trajectory, optional
            The phase's current values by default.

        Raises
        ------
        TrajectoryError
            When there are no states, or a step map leads them, or the equations do not determine the algebraics.
        """
        checked = self.trajectory() if trajectory is None else trajectory
        return element_end_errors(self, self.record, checked)

    def tracking(self: Any, variable: Any, reference: Any, weight: Any = 1.0) -> Any:
        """Integral of the squared deviation from a reference, for an objective or a constraint.

        Parameters
        ----------
        variable : Var, vector or str
            A state, algebraic or control of this phase; the squares of all components of a vector are summed.
        reference : number, expression, indexed component, rule, function, Trajectory or pair of lists
            A Param, Var or expression is followed as it is; a component over the times of the phase, such as another
            state or an Expression, at each time; for a vector also another vector. A rule ``(phase, t)`` is as in
            `integral`. A function of time, or times and values, which are joined by lines; for a vector an array, a
            function that returns one, or times and an array of shape ``(components, times)``. A trajectory is
            evaluated by its polynomials. With a free duration a function gets an expression for the time, so that it
            has to be made of Pyomo's functions.
        weight : number, expression, indexed component, rule, function or pair of lists
            The same, for the components of a vector alike.

        Raises
        ------
        ModelError
            When the variable is not of this phase, or the reference or the weight does not cover it.
        """
        return tracking_cost(self, self.record, variable, reference, weight)

    def interface(self: Any) -> PhaseInterface:
        """This phase for `pyomo.contrib.mpc`; see `PhaseInterface`."""
        return PhaseInterface(self, self.record)
