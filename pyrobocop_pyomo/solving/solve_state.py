"""What the parts of one solve share."""

from __future__ import annotations

import time
from typing import Any

from pyrobocop_pyomo.complementarity import active_sources, pairs_of
from pyrobocop_pyomo.modeling.variable_values import VariableValues

from .found_points import FoundPoints
from .initial_guess import InitialGuess
from .iterate_log import IterateLog, ModelCheck
from .polish import Exploration
from .settings import Settings
from .workplaces import Workplaces


class SolveState:
    """A model, how it is solved, and what has been found so far.

    Parameters
    ----------
    model : Block
    settings : Settings

    Attributes
    ----------
    started : float
        On the clock `time.perf_counter`.
    check : ModelCheck
    has_pairs : bool
        Whether the user has stated any.
    log : IterateLog
    values : VariableValues
        The user's free variables.
    guess : InitialGuess
    found : FoundPoints
    places : Workplaces
    exploration : Exploration
    """

    def __init__(self, model: Any, settings: Settings) -> None:
        self.model, self.settings, self.started = model, settings, time.perf_counter()
        self.check = ModelCheck(model)
        self.has_pairs = bool(active_sources(model) or pairs_of(model))
        self.log = IterateLog(self.check, settings.progress)
        self.values = VariableValues.of_free(model)
        self.guess = InitialGuess(model, self.values)
        self.found = FoundPoints(settings, self.check.sign)
        self.places = Workplaces(model, settings, self.guess)
        self.exploration = Exploration(settings.exploration, self.started, settings.explored_work)
