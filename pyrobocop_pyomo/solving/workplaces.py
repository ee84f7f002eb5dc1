"""Where strategies run: the relaxed model, and a session of the first backend that takes it."""

from __future__ import annotations

import contextlib
import logging
from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.complementarity.relaxed_model import RelaxedModel, relaxed_model
from pyrobocop_pyomo.errors import EvaluationError, FunctionError, ModelError
from pyrobocop_pyomo.ipopt.backends import Backend
from pyrobocop_pyomo.modeling.variable_values import Values, VariableValues

from .executable_session import ExecutableSession
from .in_process_session import InProcessSession
from .initial_guess import InitialGuess
from .ipopt_options import DEFAULT_WITH_PAIRS, IpoptOptions
from .iterates import step_header
from .session import Session
from .settings import Settings
from .strategies import Strategy

logger = logging.getLogger(__name__)


@dataclass(eq=False)
class Workplace:
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


class Workplaces:
    """One workplace after the other, as strategies ask for other relaxations.

    Parameters
    ----------
    model : Block
    settings : Settings
    guess : InitialGuess

    Attributes
    ----------
    place : Workplace or None
        The one that is open.
    last : Workplace or None
        The last that was, also after it is closed.
    """

    def __init__(self, model: Any, settings: Settings, guess: InitialGuess) -> None:
        self._model, self._settings, self._guess = model, settings, guess
        self._backends = [settings.backend, *settings.fallbacks]
        self._stack = contextlib.ExitStack()
        self.place: Workplace | None = None
        self.last: Workplace | None = None

    def close(self) -> None:
        """Take back what was stated for the pairs."""
        self.place = None
        self._stack.close()

    def move_to(self, strategy: Strategy) -> Workplace:
        """Keep the workplace, or change it for one with the relaxation that the strategy asks for."""
        relaxation = self._settings.relaxation if strategy.relaxation is None else strategy.relaxation
        if self.place is not None and self.place.relaxation == relaxation:
            return self.place
        self.close()
        self._guess.variables.write(self._guess.start)
        delta = 1e-2 if strategy.schedule is None else next(iter(strategy.schedule.steps()))
        relaxed = self._stack.enter_context(relaxed_model(self._model, relaxation, self._settings.grouping, delta))
        session = self._open_session(relaxed)
        self._stack.callback(session.close)
        values = VariableValues.of_free(self._model)
        self.place = self.last = Workplace(relaxation, relaxed, session, values, values.read())
        return self.place

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
