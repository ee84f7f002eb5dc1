"""Ipopt's options of a run: who decides which, in one place.

Each layer overrides those after it::

    user > strategy > purpose > default

* *user*: what the caller of `solve` gave as ``options=``. It always wins.
* *strategy*: what a `Strategy` carries, or sets for small problems.
* *purpose*: what a kind of run needs, such as a warm start or a polish; the constants and functions below.
* *default*: for every run of this package.

One number is a path and not an option: where the ``ipopt`` executable follows the barrier parameter from outside, each
process solves for another ``mu_init``, and the user's is the first of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

# Ipopt's own first barrier parameter and tolerance.
IPOPT_MU_INIT = 0.1
IPOPT_TOLERANCE = 1e-8

# An objective that falls without end takes variables along. Ipopt would let them grow to 1e20, and crawls on from 1e18,
# where their numbers have no digits left.
DEFAULT = {"max_iter": 3000, "diverging_iterates_tol": 1e15}
# Ipopt loosens all bounds a little by default, and the two sides of a pair could both become slightly negative.
DEFAULT_WITH_PAIRS = {**DEFAULT, "bound_relax_factor": 0.0}

# A warm run that takes more does not get anywhere, nor does one that goes on from a failed run. A first run without
# pairs that takes more goes on when others were tried. A start beside a symmetric guess takes few.
ITERATIONS_OF_ONE, SIDE_ITERATIONS = 500, 100

_WARM_PUSHES = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac", "mult_bound_push")


def warm_start(mu: float, push: float = 1e-9) -> dict[str, Any]:
    """Start where the last run ended instead of pushing the point back into the interior.

    Parameters
    ----------
    mu : float
        First barrier parameter: the smaller, the closer to the last point.
    push : float
        Least distance from the bounds.
    """
    pushes = {f"warm_start_{name}": push for name in _WARM_PUSHES}
    return {"warm_start_init_point": "yes", **pushes, "mu_init": mu}


def warm_continuation(delta: float | None) -> dict[str, Any]:
    """Go on with a smaller delta."""
    return {**warm_start(min(IPOPT_MU_INIT, delta or 1e-6)), "max_iter": ITERATIONS_OF_ONE}


def inexact(delta: float) -> dict[str, Any]:
    """Solve for a delta on the way: the next run takes on what is left. Far below delta, a tolerance is wasted."""
    return {"tol": min(1e-4, delta / 10.0)}


# Enough to leave a bound that the branch does not hold any more, little enough to stay near the point. In a degenerate
# branch multipliers grow without bound, and Ipopt would take its tolerance relative to them: hence s_max. A barrier
# parameter that only falls stays in such a branch at its first value and ends beside the optimum, and at the usual
# tolerance detected switches are inexact to 1e-6. What ends as acceptable is to be exact as well.
POLISH = {
    **warm_start(1e-6, 1e-8),
    "mu_strategy": "adaptive",
    "tol": 1e-10,
    "s_max": 1e8,
    "acceptable_constr_viol_tol": 1e-8,
}
# Shows the way to a branch only, which is then solved to the full tolerance.
ROUGH = {"tol": 1e-3}
# From where elastic rows, fewer elements or the solve before led: near a solution, but not at it. Do not go back to
# the middle of the bounds.
NEARLY_THERE = {"mu_init": 1e-3, "bound_push": 1e-4, "bound_frac": 1e-4}
# The answer on a coarse mesh is nearly that on a fine one.
FROM_COARSE_MESH = {"mu_init": 1e-6, "bound_push": 1e-6, "bound_frac": 1e-6}
# The answer on a coarser mesh, interpolated. Multipliers of bounds are those that belong to the barrier parameter,
# and those of rows follow from them; with all of them 1, a start forgets which bounds hold.
FINER_MESH = {**FROM_COARSE_MESH, "bound_mult_init_method": "mu-based"}
# What is solved by Ipopt's scaled tolerances, to be solved by those of the residuals as they are: its bounds too.
TIGHTER_TOLERANCES = {"tol": 1e-10, "constr_viol_tol": 1e-8, "s_max": 1e8, "bound_relax_factor": 0.0}
# A scaled program: typical sizes may be far above the sizes of the solution, and tolerances relative to them be loose.
# What cannot be solved so well counts as solved where it is solved to Ipopt's usual tolerance. Bounds are loosened by
# next to nothing: where an altitude of 1e5 lies at zero, the rows of a climb are as small as what they would give way.
SCALED = {"tol": 1e-10, "compl_inf_tol": 1e-12, "acceptable_tol": IPOPT_TOLERANCE, "bound_relax_factor": 1e-13}
# Margins and finer meshes move a plan by little. A larger barrier would outweigh a flat objective, and lead away.
NEARLY_SAFE = FROM_COARSE_MESH
# Ipopt refuses more equations than variables that it may move, even where they agree.
OVERDETERMINED = {"fixed_variable_treatment": "relax_bounds"}


@dataclass(frozen=True)
class IpoptOptions:
    """The layers of the options, resolved for each run.

    Attributes
    ----------
    user, strategy, default : mapping
    most_iterations : int or None
        The smaller limit counts: this one, or the limit of the layers.
    """

    user: Mapping[str, Any] = field(default_factory=dict)
    strategy: Mapping[str, Any] = field(default_factory=dict)
    default: Mapping[str, Any] = field(default_factory=lambda: DEFAULT)
    most_iterations: int | None = None

    def with_strategy(self, options: Mapping[str, Any], most_iterations: int | None = None) -> IpoptOptions:
        """The same with another layer of a strategy."""
        return replace(self, strategy=dict(options), most_iterations=most_iterations)

    def with_default(self, options: Mapping[str, Any]) -> IpoptOptions:
        """The same with further defaults."""
        return replace(self, default={**self.default, **options})

    def resolve(self, *purposes: Mapping[str, Any]) -> dict[str, Any]:
        """Options of one run; of several purposes, later ones win."""
        resolved = dict(self.default)
        for layer in (*purposes, self.strategy, self.user):
            resolved.update(layer)
        if self.most_iterations is not None:
            resolved["max_iter"] = min(resolved["max_iter"], self.most_iterations)
        return resolved
