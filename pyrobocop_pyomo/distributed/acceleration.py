"""Anderson's acceleration of a fixed-point iteration, safeguarded: what shortens the tail of convex teams."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pyrobocop_pyomo.numerics import Array

_MEMORY = 12
_WORSE = 2.0  # times the last residual: an extrapolation after which it has grown more is not trusted


@dataclass
class AndersonAcceleration:
    """From the last points and their images, the point at which the linear model of the iteration stands still.

    Attributes
    ----------
    steps : list of (point, image)
        The last ones.

    References
    ----------
    Walker & Ni, Anderson acceleration for fixed-point iterations, SIAM J. Numer. Anal. 49 (2011),
    doi:10.1137/10078356X
    """

    steps: list[tuple[Array, Array]] = field(default_factory=list)

    def next(self, point: Array, image: Array) -> Array:
        """Where to go on from.

        Parameters
        ----------
        point : float array, shape (n,)
        image : float array, shape (n,)
            What the iteration made of it.
        """
        if self.steps:
            before, after = self.steps[-1]
            if np.linalg.norm(image - point) > _WORSE * np.linalg.norm(after - before):
                self.steps.clear()
        self.steps = [*self.steps, (point.copy(), image.copy())][-_MEMORY:]
        if len(self.steps) < 2:
            return image
        points, images = (np.array(column) for column in zip(*self.steps, strict=True))
        residuals = np.diff(images - points, axis=0)
        weights = np.linalg.lstsq(residuals.T, image - point, rcond=1e-10)[0]
        accelerated: Array = image - np.diff(images, axis=0).T @ weights
        return accelerated
