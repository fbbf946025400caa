"""What of a noisy reading is signal: the regressor of an effect must not follow the noise that it is tested against.

A rate that hovers about zero is nothing but noise, and an effect in proportion to it would "explain" the angle into
which the filter integrates that same noise. So regressors on the IMU are taken along

    w_signal(f) = max(0, 1 - k N / P(f)) w(f)

with P the power of the reading averaged over neighbouring frequencies and N the declared noise's: Wiener's filter, with
k > 1 so that bins of noise alone, whose estimate of P scatters, are shut.

What a receiver follows is slower still: some hundredths of a second later a vibration has another phase, and no
receiver's velocity follows it. Its effects are taken along the motion without it.

Source: S. F. Boll, IEEE Trans. Acoustics, Speech, Signal Processing 27(2), 1979 (subtraction of the noise's spectrum).
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from sinan.estimator.filter.imu import GAP
from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion

#: Above this a rate or an acceleration is vibration, no motion of the vehicle [Hz]: a choice, half and twice of which
#: move the lateness of a shaken receiver by 0.8 % of its sigma (`bounds_of_work shaken`).
VEHICLE_BANDWIDTH = 10.0
#: Periods of that bandwidth after which the low pass has settled, by which a stretch goes on beyond its ends, turned
#: about them: its slowest poles, of damping sin(pi / 8), have then decayed to exp(-2 pi 4 sin(pi / 8)) = 7e-5.
SETTLED = 4.0
#: Frequencies over which power is averaged: it is known to sqrt(2 / 65), a sixth.
NEIGHBOURS = 65
#: k above: the mean of so many frequencies of noise exceeds twice its own with chi2.sf(2 * 65, 65) = 1 in 320,000.
SUBTRACTED = 2.0


def signal_part(values: FloatArray, sigma: float) -> FloatArray:
    """(n, m) the part of evenly sampled readings (n, m) that is not white noise of standard deviation `sigma`.

    The cosine transform, which continues a series by its mirror image, has no jump at the ends.
    """
    from scipy.fft import dct, idct

    if len(values) < 4 * NEIGHBOURS:
        return values
    spectrum = dct(values, norm="ortho", axis=0)
    padded = np.pad(spectrum**2, ((NEIGHBOURS // 2, NEIGHBOURS // 2), (0, 0)), mode="reflect")
    sums = np.cumsum(np.concatenate([np.zeros((1, values.shape[1])), padded]), axis=0)
    power = np.maximum((sums[NEIGHBOURS:] - sums[:-NEIGHBOURS]) / NEIGHBOURS, 1e-300)
    return np.asarray(idct(np.maximum(0.0, 1.0 - SUBTRACTED * sigma**2 / power) * spectrum, norm="ortho", axis=0))


def without_vibration(motion: Motion) -> Motion:
    """The motion with what is slower than `VEHICLE_BANDWIDTH` of its velocity, acceleration and rate, without delay
    (Butterworth, fourth order, both ways), each stretch that no gap cuts by itself; all else stays as it is: a position
    shakes by v / (2 pi f), of a centimetre a second by less than 0.2 mm. Even sampling is taken for granted.
    """
    from scipy.signal import sosfiltfilt

    step = np.diff(motion.t)
    usual = float(np.median(step))
    settled = max(15, round(SETTLED / (VEHICLE_BANDWIDTH * usual)))
    if usual * VEHICLE_BANDWIDTH >= 0.5 or len(motion) <= settled:
        return motion
    slow = np.hstack([motion.v_n, motion.acceleration_n(), motion.w_ib_b])
    for rows in np.split(np.arange(len(motion)), np.flatnonzero(step > GAP * usual) + 1):
        if len(rows) > settled:
            slow[rows] = sosfiltfilt(_low_pass(VEHICLE_BANDWIDTH, 1.0 / usual), slow[rows], axis=0, padlen=settled)
    v_n, a_n, w_ib_b = np.split(slow, 3, axis=1)
    return replace(motion, v_n=v_n, a_n=a_n, w_ib_b=w_ib_b)


@lru_cache
def _low_pass(corner: float, rate: float) -> FloatArray:
    """Second-order sections of the filter of a corner, at a sampling rate [Hz]."""
    from scipy.signal import butter

    return np.asarray(butter(4, corner, fs=rate, output="sos"))
