"""The verdict on a trajectory in words: what holds, what does not, and what a large error over the horizon means."""

from __future__ import annotations

import math
from collections.abc import Mapping

# What is violated by more than this does not hold; an error of an element above this, in sizes of the states, is a
# coarse mesh; errors of the horizon are said to grow where they exceed the sum of those of the elements so many times.
HOLDS, COARSE, GROWS = 1e-5, 1e-2, 10.0


def verdict_in_words(
    violations: Mapping[str, float],
    element_error: float | None,
    relative_error: float | None,
    horizon_error: float | None,
    sum_of_errors: float,
    contact: bool,
) -> str:
    """One to three sentences.

    Parameters
    ----------
    violations : mapping of str to float
        What was recomputed at the points of the mesh, by name.
    element_error, horizon_error : float or None
        As in `Verification`.
    relative_error : float or None
        The error of the worst element in sizes of the states.
    sum_of_errors : float
        Of the errors of all elements.
    contact : bool
        Whether pairs decide what happens.
    """
    worst = max(violations, key=lambda name: violations[name])
    if not violations[worst] <= HOLDS:
        return (
            f"Verdict: this does NOT hold: {worst} by {violations[worst]:.1e}. After a failed solve print(result) says "
            "what is not met. Values that another integrator made, as simulate() does, are off by its error."
        )
    said = [
        f"Verdict: equations{', bounds and pairs' if contact else ' and bounds'} hold at the points of the mesh (to "
        f"{violations[worst]:.0e})"
    ]
    if element_error is None or relative_error is None:
        return f"{said[0]}; what happens between the points is not known."
    if relative_error > COARSE:
        said[0] += (
            f", but the mesh is coarse: between two element ends the equations lead up to {100 * relative_error:.2g} % "
            "of a state's size elsewhere. "
            + ("Where an impact is spread over one element, that is its height. " if contact else "")
            + "Take more elements."
        )
    else:
        said[0] += f", and each element follows its equations to {element_error:.0e}."
    grows = GROWS * max(sum_of_errors, HOLDS)
    if horizon_error is not None and not horizon_error <= grows:
        why = "contact opens or closes a moment apart" if contact else "the motion is unstable"
        size = f"to {horizon_error:.1e}" if horizon_error < math.inf else "beyond what can be followed"
        said.append(
            f"Integrated over the whole horizon the difference grows {size}, since {why}: small "
            "differences at the start are large at the end. That is harmless where a controller or replanning corrects "
            "the motion on the way, for which the error per element counts, and matters where controls are replayed "
            "without measurements."
        )
    return " ".join(said)
