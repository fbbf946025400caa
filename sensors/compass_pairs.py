"""Pairs of a compass's readings, and the turns of the gyroscope between them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sinan.sensors.arrays import FloatArray, integral
from sinan.sensors.recording import GYRO, MAG, Stream
from sinan.sensors.rotation import matrix_from_quaternion, quaternion_exp, quaternion_log, quaternion_multiply

#: Seconds between two readings, and from pair to pair: a hand turns by 0.1 to 3 rad in 0.5 s, a bias of 0.1 rad/s by
#: 0.05.
_APART, _EVERY = 0.5, 0.25
#: Bounds of work: pairs that are looked at, those of the largest turns that count, steps of an integral (16 ms each).
_LOOKS, _PAIRS, _STEPS = 3000, 400, 2**5
#: Fewer pairs, of three numbers each, say nothing of the 22 unknowns.
_FEWEST = 10
#: Noise of a reading is as large as what a turn by 0.1 rad changes, 10 % of the field; errors of a model grow with it.
_STILL = 0.1
#: Rates at a reading are means over so long [s], 20 samples at 200 Hz.
_RATE = 0.1


class Pairs(NamedTuple):
    """Readings m1 and m2 (n, 3), and what the gyroscope says of the time between.

    Attributes
    ----------
    m1, m2 : less their `middle` (3,), over `unit`, the size of their change
    t1, t2 : (n,) times of the readings [s]
    weight : (n,) one over the sigma of what is left of a change, but for a factor
    Ct, phi : (n, 3, 3) a field that stands still turns by, v2 = Ct v1; (n, 3) rotation vector from body 1 to 2 [rad]
    w1, w2 : (n, 3) rates at the readings [rad/s]
    """

    m1: FloatArray
    m2: FloatArray
    middle: FloatArray
    unit: float
    t1: FloatArray
    t2: FloatArray
    weight: FloatArray
    Ct: FloatArray
    phi: FloatArray
    w1: FloatArray
    w2: FloatArray


def pairs_of(imu: Stream, mag: Stream) -> Pairs | None:
    """Those with the largest turns, in the order of time, without those over a gap; None: there are too few."""
    t, m = mag.t, mag.array(MAG)
    if len(imu) < _FEWEST or len(mag) < _FEWEST:
        return None
    i = np.unique(np.floor((t - t[0]) / _EVERY), return_index=True)[1]  # the first of each
    i = i[:: 1 + len(i) // _LOOKS]
    j = np.searchsorted(t, t[i] + 0.99 * _APART)
    i, j = i[j < len(t)], j[j < len(t)]
    inside = (t[i] >= imu.t[0]) & (t[j] <= imu.t[-1]) & (t[j] - t[i] < 3.0 * _APART)
    samples = np.searchsorted(imu.t, t[j]) - np.searchsorted(imu.t, t[i]) + 1
    whole = samples * imu.step > 0.8 * (t[j] - t[i])
    keep = inside & whole & np.all(np.isfinite(m[i] + m[j]), axis=1)
    i, j = i[keep], j[keep]
    if len(i) < _FEWEST:
        return None
    angle = _angles(imu)
    turned = np.linalg.norm(_turns(angle, t[i], t[j])[1], axis=1)
    most = np.sort(np.argsort(-turned)[:_PAIRS])
    most = most[np.isfinite(turned[most])]
    i, j, weight = i[most], j[most], 1.0 / np.hypot(turned[most], _STILL)
    unit = float(np.sqrt(np.sum((weight[:, None] * (m[j] - m[i])) ** 2) / max(len(most), 1)))
    if len(most) < _FEWEST or not unit > 0.0:
        return None
    middle = np.median(m[i], axis=0)
    m1, m2 = (m[i] - middle) / unit, (m[j] - middle) / unit
    return Pairs(m1, m2, middle, unit, t[i], t[j], weight, *_between(angle, t[i], t[j]))


def when_late(imu: Stream, pairs: Pairs, late: float) -> Pairs:
    """The same pairs of readings, if these are late by so much [s]."""
    Ct, phi, w1, w2 = _between(_angles(imu), pairs.t1 - late, pairs.t2 - late)
    return pairs._replace(Ct=Ct, phi=phi, w1=w1, w2=w2)


def _between(angle: Callable[[FloatArray], FloatArray], t1: FloatArray, t2: FloatArray) -> tuple[FloatArray, ...]:
    """Ct, phi, w1 and w2 of `Pairs`."""
    half = 0.5 * _RATE
    return (*_turns(angle, t1, t2), *((angle(t + half) - angle(t - half)) / _RATE for t in (t1, t2)))


def _angles(imu: Stream) -> Callable[[FloatArray], FloatArray]:
    """Integrals (..., 3) of the rates to some instants."""
    total = integral(imu.t, imu.array(GYRO))
    return lambda at: np.stack([np.interp(at, imu.t, column) for column in total.T], axis=-1)


def _turns(angle: Callable[[FloatArray], FloatArray], t1: FloatArray, t2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ct (n, 3, 3) and phi (n, 3) between two instants each: halves are joined, from single steps on."""
    grid = t1[:, None] + (t2 - t1)[:, None] * np.linspace(0.0, 1.0, _STEPS + 1)
    q = quaternion_exp(np.diff(angle(grid), axis=1))
    while q.shape[1] > 1:
        q = quaternion_multiply(q[:, 0::2], q[:, 1::2])
    return np.swapaxes(matrix_from_quaternion(q[:, 0]), 1, 2), quaternion_log(q[:, 0])
