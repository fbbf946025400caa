"""What of an effect the noise takes up, where its sizes are found from the readings that have the effect in them.

Let z be the sizes in sigmas along the axes of their covariance, zero where they are found without the effect, and

    gamma_k = -d log lambda / d z_k

how what the effect leaves in the innovations, lambda = beta' Lambda beta, falls with them. Without the effect in the
model the likeliest sizes are those of least |z|^2 + lambda exp(-gamma' z): z = a gamma, and what is left to be found is

    T = lambda exp(-s a) = 2 a,    s = gamma' gamma.

T = 30 asks lambda = 30 exp(15 s): of white noise that n readings tell s = 2 / n, the loss of a t-test; of a bias that
may walk as much as an effect drifts nearly all is lost. No size goes beyond its bounds: it stays there.

Neglects that sizes far off take up less and less, and those that are small now more once they have grown (a walk that
is none without the effect: a size up to four times as large would be needed), that the posterior is quadratic near its
top alone, and lateness.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sinan.estimator.evidence.score import DETECTABLE_LAMBDA
from sinan.estimator.filter.flight import Flight
from sinan.sensors.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class OpenLevels:
    """The sizes with which a flight was opened, as far as its readings leave them open.

    Attributes
    ----------
    sides : of each axis the flight with sizes one sigma to one side, and to the other
    axes : (axes, sizes) what one sigma of each axis changes the sizes by, in the unit of `room`
    room : (2, sizes) how far each size may become smaller, and larger
    """

    sides: Sequence[tuple[Flight, Flight]]
    axes: FloatArray
    room: FloatArray

    def wider(self, less: FloatArray, more: FloatArray) -> FloatArray:
        """(size,) what the smallest size of an effect that is found is multiplied by for what the noise takes up.

        Parameters
        ----------
        less, more : (axes, size) 1-sigma of each component on either side of each axis; NaN where no model follows
        """
        seen = np.isfinite(less) & np.isfinite(more)
        gamma = np.log(np.where(seen, more, 1.0) / np.where(seen, less, 1.0))
        larger, smaller = (np.clip(axes, -self.room[0], self.room[1]) for axes in (self.axes, -self.axes))
        slopes = np.linalg.pinv(0.5 * (larger - smaller)) @ gamma  # of twice the logarithm, by what each side has moved
        moves = 0.5 * DETECTABLE_LAMBDA * self.axes.T @ (self.axes @ slopes)
        moves = np.clip(moves, -self.room[0][:, None], self.room[1][:, None])
        return np.exp(0.5 * np.maximum(np.sum(slopes * moves, axis=0), 0.0))
