"""Smooth functions of time with exact derivatives, from which paths, headings and winds are put together.

A curve is c + fade(t) sum A sin(w t + phi) + sum of smooth steps. Derivatives up to the fourth are closed forms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.polynomial import Polynomial

from sinan.sensors.arrays import FloatArray

#: s(x) = 126 x^5 - 420 x^6 + 540 x^7 - 315 x^8 + 70 x^9: from 0 to 1 with four derivatives zero at both ends.
STEP = Polynomial([0.0, 0.0, 0.0, 0.0, 0.0, 126.0, -420.0, 540.0, -315.0, 70.0])
#: Largest |s''| of that step over the unit interval.
STEP_ACCELERATION = 9.372
#: Largest s' of the step, at its middle: 630 / 256.
STEP_SPEED = 630.0 / 256.0


@dataclass(frozen=True)
class Sine:
    """amplitude sin(omega t + phase)."""

    amplitude: float
    omega: float
    phase: float


@dataclass(frozen=True)
class Rise:
    """A smooth step of the given height that begins at `start` [s] and takes `duration` [s]."""

    height: float
    start: float
    duration: float


@dataclass(frozen=True)
class Curve:
    """constant + fade(t) * (sum of sines) + sum of rises.

    Attributes
    ----------
    constant : value where nothing has begun
    sines : periodic part
    rises : steps from one level to the next
    fade : (start, duration) [s] over which the periodic part comes in, or None: it is always there
    """

    constant: float = 0.0
    sines: Sequence[Sine] = ()
    rises: Sequence[Rise] = ()
    fade: tuple[float, float] | None = None

    def derivatives(self, t: FloatArray, highest: int) -> FloatArray:
        """(highest + 1, n) the value and its derivatives at times (n,)."""
        periodic = np.zeros((highest + 1, len(t)))
        for sine in self.sines:
            for k in range(highest + 1):
                periodic[k] += sine.amplitude * sine.omega**k * np.sin(sine.omega * t + sine.phase + 0.5 * np.pi * k)
        if self.fade is not None:
            periodic = product(rise_derivatives(Rise(1.0, *self.fade), t, highest), periodic)
        for rise in self.rises:
            periodic += rise_derivatives(rise, t, highest)
        periodic[0] += self.constant
        return periodic


def rise_derivatives(rise: Rise, t: FloatArray, highest: int) -> FloatArray:
    """(highest + 1, n) of one smooth step."""
    x = np.clip((t - rise.start) / rise.duration, 0.0, 1.0)
    rows = [rise.height * STEP(x)]
    inside = (x > 0.0) & (x < 1.0)
    for k in range(1, highest + 1):
        rows.append(np.where(inside, rise.height * STEP.deriv(k)(x) / rise.duration**k, 0.0))
    return np.stack(rows)


def product(left: FloatArray, right: FloatArray) -> FloatArray:
    """Derivatives of a product by Leibniz's rule; both (orders, n)."""
    orders = len(left)
    return np.stack([
        np.asarray(sum(comb(m, i) * left[i] * right[m - i] for i in range(m + 1))) for m in range(orders)
    ])  # fmt: skip
