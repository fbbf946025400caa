"""The law of innovations: normal about its centre, Student's beyond, and of a range finder partly uniform.

A range finder answers a share eps of its readings with what is not the ground: an object, a wall, its own noise where
the ground is out of its reach. Such answers are as likely anywhere within its reach, whatever the height (the beam
model: S. Thrun, W. Burgard, D. Fox, Probabilistic Robotics, MIT Press 2005, section 6.3). With rho what of -2 log
density goes with NIS = nu' S^-1 nu where the ground answers,

    p = (1 - eps) |2 pi S|^-1/2 exp(-rho / 2) + eps / reach^m
    b = log(eps / (1 - eps) / reach^m) + 1/2 log |2 pi S|    `stray` here, of something else over the ground's centre
    r = 1 / (1 + exp(b + rho / 2))                           how probable it is that the ground has answered

a reading has r times the weight of Student's law: what else has answered draws nothing, however often it does.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from sinan.sensors.arrays import FloatArray, IntArray

#: Degrees of freedom of a Student law that is normal: of a reading that is 10 sigma off the two differ by 100 / 1e6 of
#: the weight.
NORMAL = 1e6

#: Logarithm of the odds against a reading beyond which its weight, exp(-30) = 1e-13, is nothing to a float.
NOTHING = 30.0


class Laws(Protocol):
    """What says the law of each sensor: a `FlightModel`."""

    def tail_of(self, sensor: str) -> float | None:
        """Degrees of freedom of the Student law; None: normal."""

    def stray_of(self, sensor: str) -> float:
        """Logarithm of the density of what it answers besides, over the share of its right answers."""


def deviance_of(
    nis: FloatArray,
    m: FloatArray | IntArray | int,
    tail: FloatArray | float | None,
    stray: FloatArray | float = -np.inf,
) -> FloatArray:
    """(K,) what of -2 log density goes with nu' S^-1 nu: rho - 2 log(1 + exp(b + rho / 2)), and rho where nothing else
    answers.

    rho(NIS) = m + (nu + m) log((nu + NIS) / (nu + m)) for NIS > m, else NIS: the normal law up to m, Student's beyond.
    Its slope is the weight (nu + m) / (nu + NIS) that the filter gives such a reading. None or infinite: normal
    throughout.
    """
    if tail is None:
        return nis
    v = np.broadcast_to(np.asarray(tail, dtype=np.float64), nis.shape)
    heavy = np.isfinite(v) & (nis > m)
    found = np.array(nis, dtype=np.float64)
    v, k, far = v[heavy], np.broadcast_to(m, nis.shape)[heavy], nis[heavy]
    found[heavy] = k + (v + k) * np.log1p((far - k) / (v + k))
    over = stray + 0.5 * found
    return found - 2.0 * (np.maximum(over, 0.0) + np.log1p(np.exp(-np.abs(over))))


def spread_of(
    nis: FloatArray | float, m: IntArray | int, tail: FloatArray | float, stray: FloatArray | float = -np.inf
) -> FloatArray:
    """(K,) one over the weight of readings of m components: (nu + NIS) / (nu + m), or 1 below NIS = m, over r.

    Of a Student law with nu degrees of freedom the expected precision given the innovation is (nu + m) / (nu + NIS) of
    the nominal one (Lange, Little, Taylor, J. Am. Stat. Assoc. 84(408), 1989).
    """
    own = deviance_of(np.asarray(nis, dtype=np.float64), m, tail)
    return np.maximum(1.0, (tail + nis) / (tail + m)) * (1.0 + np.exp(np.minimum(stray + 0.5 * own, NOTHING)))


def stray_over_centre(stray: FloatArray | float, normal: FloatArray | float, nis: FloatArray | float) -> FloatArray:
    """(K,) b of readings whose log density is `normal` by the normal law, from the density of what else answers."""
    return np.asarray(stray - normal - 0.5 * nis)


def log_density(
    model: Laws, names: Sequence[str], sensor: IntArray, m: IntArray, normal: FloatArray, nis: FloatArray
) -> FloatArray:
    """(K,) logarithm of the density of each innovation by the law of its sensor, up to a constant of the sensor.

    Parameters
    ----------
    names, sensor : of the sensors; (K,) index of each reading's
    m : (K,) components that tell something
    normal, nis : (K,) logarithm of the normal density; nu' S^-1 nu
    """
    tails = np.array([model.tail_of(name) or np.inf for name in names])[sensor]
    stray = np.array([model.stray_of(name) for name in names])[sensor]
    return np.asarray(normal + 0.5 * (nis - deviance_of(nis, m, tails, stray_over_centre(stray, normal, nis))))
