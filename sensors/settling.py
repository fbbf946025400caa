"""Readings from before an instrument had settled: a receiver's first fixes, a barometer's first pressures.

What follows them starts from a first reading (an origin, a first position, the zero of a height) and would take every
right one after it for the outlier.
"""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.gps import SENSOR as GPS

#: False-alarm rate per stream: a stated risk.
UNSETTLED_LEVEL = 1e-6
#: Degrees of freedom of the law of steps, as rough as instruments are (Lange, Little, Taylor, J. Am. Stat. Assoc.
#: 84(408), 1989: from 3 on).
STEPS_TAIL = 4.0
#: A filter that starts this far off is led back by right readings [m]: ten sigmas of a receiver's bias, as wide as its
#: start is taken (`estimator.filter.alignment.WIDE`).
LED_BACK = 10.0 * GPS.believed_bias
#: Steps longer than this many usual ones are outages: 2 < 2.5 < 3, one reading that is lost makes two of them.
LOST = 2.5
#: Speed of what tells none [m/s]: beyond small aircraft; a choice that only the first steps of such a log depend on.
FASTEST = 100.0


def unsettled(t: FloatArray, values: FloatArray, velocity: FloatArray | None = None) -> int:
    """How many of the first readings are from before the instrument had settled; fewer than half, most often none.

    e_k = (p_{k+1} - p_k) - (v_k + v_{k+1}) / 2 (t_{k+1} - t_k) is what the velocities do not explain of a step. The
    readings before a step are out where it is farther than any motion, as is all that they are off by in sum (a glitch
    comes back), and faster by c than all later ones. With tails x^-nu a step is c times the largest of n others with
    the probability c^-nu / n, of up to half of a stream c^-nu at most.

    Parameters
    ----------
    t : (n,) s
    values : (n, k) places or heights [m]; NaN: not told
    velocity : (n, k) [m/s]; None: none is told
    """
    most = (len(t) - 1) // 2
    if most < 1:
        return 0
    h = np.diff(t)
    e, fastest = np.diff(values, axis=0), np.full(len(h), FASTEST)
    if velocity is not None:
        e = e - 0.5 * h[:, None] * (velocity[1:] + velocity[:-1])
        told = float(np.max(np.linalg.norm(velocity, axis=1)))
        fastest = np.where(h > LOST * np.median(h), max(FASTEST, told), told)  # what moved while none was told
    e = np.nan_to_num(e)
    step, off = np.linalg.norm(e, axis=1), np.linalg.norm(np.cumsum(e, axis=0), axis=1)
    later = np.maximum.accumulate((step / h)[::-1])[::-1]
    farther = np.minimum(step, off) > LED_BACK + 2.0 * fastest * h  # there and back at the largest speed
    faster = step[:most] / h[:most] > UNSETTLED_LEVEL ** (-1.0 / STEPS_TAIL) * later[1 : most + 1]
    found = np.flatnonzero(farther[:most] & faster)
    return int(found[-1]) + 1 if len(found) else 0
