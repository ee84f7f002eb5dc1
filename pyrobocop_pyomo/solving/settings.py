"""What the caller of `solve` chose, and what goes with every call below it: the clock, the options, the progress."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, TextIO

from pyrobocop_pyomo.ipopt.backends import Backend
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.presentation.progress import Progress
from pyrobocop_pyomo.programs.compiled_model import KeptProgram

from .ipopt_options import IpoptOptions
from .iterates import Tolerances
from .strategies import Strategy


@dataclass(frozen=True)
class Settings:
    """How to solve; see `solve`.

    Attributes
    ----------
    relaxation, grouping : object
    backend : Backend
    fallbacks : tuple of Backend
        What to take, in this order, where the backend cannot take the model.
    strategies : tuple of Strategy or None
        None for the default sequence.
    options : IpoptOptions
    tolerances : Tolerances
    second_tries : bool
        Whether strategies with other starts follow where the run of a model without pairs fails.
    polish : bool
    exploration : float or None
        How long to look for better optima beyond the nearest, as a multiple of the time that the solve took so far; by
        default 1 in small problems.
    deadline : Deadline
    output : sequence of text streams
        Where Ipopt's log goes.
    progress : Progress
    scaling : bool
        Whether programs without pairs are scaled by their bounds, initial values and derivatives.
    program : KeptProgram or None
        Of a model without pairs that is solved again and again.
    """

    relaxation: Any
    grouping: Any
    backend: Backend
    fallbacks: tuple[Backend, ...] = ()
    strategies: tuple[Strategy, ...] | None = None
    options: IpoptOptions = field(default_factory=IpoptOptions)
    tolerances: Tolerances = field(default_factory=Tolerances)
    second_tries: bool = True
    polish: bool = True
    exploration: float | None = None
    deadline: Deadline = field(default_factory=Deadline)
    output: Sequence[TextIO] = ()
    progress: Progress = field(default_factory=Progress)
    scaling: bool = True
    program: KeptProgram | None = None
