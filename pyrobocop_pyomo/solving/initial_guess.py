"""The user's initial guess, and the point that strategies start from where it has no value."""

from __future__ import annotations

import logging
import math
from typing import Any

from pyrobocop_pyomo.diagnosis.values import named_undefined_rows, undefined_rows
from pyrobocop_pyomo.modeling.variable_values import Values, VariableValues
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

from .starts import defined_start

logger = logging.getLogger(__name__)

_REMEDY = "Give another one, or keep the expression away from there by bounds."
_REMEDY_OF_FIXED = (
    "What is fixed needs another value, or a scheme without a point there: at a start 'radau', at an end 'gauss'."
)


class InitialGuess:
    """Where strategies start, and what is to be said about it.

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
