"""Where strategies run: the relaxed model, and a session of the first backend that takes it.

The user's initial guess, and the point that strategies start from where it has no value.
"""

from __future__ import annotations

import contextlib
import logging
import math
from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.complementarity.relaxed_model import RelaxedModel, relaxed_model
from pyrobocop_pyomo.diagnosis.values import named_undefined_rows, undefined_rows
from pyrobocop_pyomo.errors import EvaluationError, FunctionError, ModelError
from pyrobocop_pyomo.ipopt.backends import Backend
from pyrobocop_pyomo.modeling.variable_values import Values, VariableValues
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

from .executable_session import ExecutableSession
from .in_process_session import InProcessSession
from .ipopt_options import DEFAULT_WITH_PAIRS, IpoptOptions
from .iterates import step_header
from .session import Session
from .starts import defined_start
from .strategies import Settings, Strategy

_REMEDY = "Give another one, or keep the expression away from there by bounds."
_REMEDY_OF_FIXED = (
    "What is fixed needs another value, or a scheme without a point there: at a start 'radau', at an end 'gauss'."
)


class InitialGuess:
    """Where strategies start, and remarks about it.

    Parameters
    ----------
    model : Block
    values : VariableValues
        The free variables, with the user's initial guess.

    Attributes
    ----------
    variables : VariableValues
        The same free variables, to read and write.
    values : Values
        As the user gave them.
    start : Values
        Where strategies start: the same, or a point nearby at which all expressions have values.
    remarks : list of str
        For the result.
    undefined : (CompiledModel, float array) or None
        Where on the way to a point that is no solution a function had no value.
    """

    def __init__(self, model: Any, values: VariableValues) -> None:
        self._model, self.variables = model, values
        self.values: Values = values.read()
        self.start = self.values
        if any(number is not None and math.isinf(number) for number in self.values):  # as good as none
            self.start = [None if number is None or math.isinf(number) else number for number in self.values]
        self.remarks: list[str] = []
        self.undefined: tuple[CompiledModel, FloatArray] | None = None

    def move(self) -> bool:
        """Start elsewhere, where an expression has no value at the initial guess and such a point is found.

        Returns
        -------
        bool
            Whether the start has changed, and is on the model; asked a second time, it has not.
        """
        if self.start is not self.values:
            return False
        self.variables.write(self.values)
        remark = defined_start(self._model)
        if not remark:
            return False
        logger.info("'%s': %s", self._model.name, remark)
        self.remarks.append(remark)
        self.start = self.variables.read()
        return True

    def explain(self, *, began: bool) -> None:
        """Add a remark on what has no value, where the initial guess has none, or a function had none on the way.

        Parameters
        ----------
        began : bool
            Whether a run came away from the initial guess: then all has values there, which takes long to go through.
        """
        self.variables.write(self.values)
        at_start = "" if began or self.remarks else named_undefined_rows(self._model)
        if at_start:
            remedy = _REMEDY_OF_FIXED if next(undefined_rows(self._model)).is_fixed else _REMEDY
            self.remarks.append(f"The initial guess could not be evaluated: {at_start}. {remedy}")
        elif self.undefined is not None:
            self.undefined[0].load_point(self.undefined[1])
            where = named_undefined_rows(self._model)
            self.remarks.append(
                f"On the way an expression had no value: {where}. Bounds that keep it away from there may help."
            )


# ---------------------------------------------------------------------------------------------------- the initial guess


logger = logging.getLogger(__name__)


@dataclass(eq=False)
class SolverSession:
    """A relaxed model with an open session.

    Attributes
    ----------
    relaxation : object
    relaxed : RelaxedModel
    session : Session
    values : VariableValues
        The free variables, those that the relaxation generated among them.
    start : Values
        Where strategies start.
    """

    relaxation: Any
    relaxed: RelaxedModel
    session: Session
    values: VariableValues
    start: Values

    def options(self, settings: Settings) -> IpoptOptions:
        """Ipopt's options, those that pairs need by default among them."""
        return settings.options.with_default(DEFAULT_WITH_PAIRS) if self.relaxed.pairs else settings.options


class SolverSessions:
    """One solver session after the other, as strategies ask for other relaxations.

    Parameters
    ----------
    model : Block
    settings : Settings
    guess : InitialGuess

    Attributes
    ----------
    current : SolverSession or None
        The one that is open.
    last : SolverSession or None
        The last that was, also after it is closed.
    """

    def __init__(self, model: Any, settings: Settings, guess: InitialGuess) -> None:
        self._model, self._settings, self._guess = model, settings, guess
        self._backends = [settings.backend, *settings.fallbacks]
        self._stack = contextlib.ExitStack()
        self.current: SolverSession | None = None
        self.last: SolverSession | None = None

    def close(self) -> None:
        """Take back the rows that were stated for the pairs."""
        self.current = None
        self._stack.close()

    def move_to(self, strategy: Strategy) -> SolverSession:
        """Keep the solver session, or change it for one with the relaxation that the strategy asks for."""
        relaxation = self._settings.relaxation if strategy.relaxation is None else strategy.relaxation
        if self.current is not None and self.current.relaxation == relaxation:
            return self.current
        self.close()
        self._guess.variables.write(self._guess.start)
        delta = 1e-2 if strategy.schedule is None else next(iter(strategy.schedule.steps()))
        relaxed = self._stack.enter_context(relaxed_model(self._model, relaxation, self._settings.grouping, delta))
        session = self._open_session(relaxed)
        self._stack.callback(session.close)
        values = VariableValues.of_free(self._model)
        self.current = self.last = SolverSession(relaxation, relaxed, session, values, values.read())
        return self.current

    def _open_session(self, relaxed: RelaxedModel) -> Session:
        """A session of the first backend that takes the model."""
        name, progress = self._model.name, self._settings.progress
        refused: Exception | None = None
        while True:
            backend = self._backends[0]
            try:
                session = (
                    ExecutableSession(relaxed, self._settings)
                    if backend is Backend.EXECUTABLE
                    else InProcessSession(relaxed, self._settings, backend.derivatives)
                )
                break
            except (ModelError, EvaluationError) as error:
                refused = refused or error
                if len(self._backends) == 1 or isinstance(error, FunctionError):
                    raise refused from None  # ASL calls no functions in Python
                logger.info("'%s': %s is not taken: %s", name, backend.value, error)
                del self._backends[0]
        logger.info("'%s': %s, derivatives by %s", name, session.solver, session.derivatives)
        progress.line_once(f"{name}: {session.solver}, derivatives by {session.derivatives}")
        progress.line(step_header(pairs=bool(relaxed.pairs)))
        return session
