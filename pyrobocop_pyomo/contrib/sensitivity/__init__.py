"""How a solution moves with its data: derivatives by Params or fixed Vars, without another solve.

`sensitivity` differentiates the branch of a solution of a model; `derivatives` does so on arrays.
"""

from .sensitivity import Sensitivity, sensitivity

__all__ = ["Sensitivity", "sensitivity"]
