"""How hard an accelerometer is shaken: the covariate `vibration`."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray

WINDOW = 0.5  # s over which the variance is taken: EFFECTS, accel.vibration
CORNER = 15.0  # Hz: a multicopter's own motion stays below 5 Hz, rotors and propellers shake it above 40 Hz
ORDER = 4


def vibration_power(t: FloatArray, f_s: FloatArray, noise_std: float | None = None) -> FloatArray:
    """Variance of the vibration on each axis, without the white noise.

    P = mean over `WINDOW` of (high-passed reading)^2 - c noise_std^2, c the mean of the high-pass's |H|^4;
    not cut at zero, so that its mean is that of the vibration.

    Parameters
    ----------
    t : (n,) s, nearly even
    f_s : (n, 3) accelerometer readings [m/s^2]
    noise_std : white noise of one reading [m/s^2]; None: the quietest tenth of the recording is taken for noise alone

    Returns
    -------
    (n, 3) (m/s^2)^2; zero where the rate is too low to see any vibration above `CORNER`

    Neglects vibration below the corner, the motion above it, and what aliases to below it.
    """
    from scipy.signal import butter, sosfiltfilt

    rate = 1.0 / float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    width = max(1, round(WINDOW * rate))
    if rate < 4.0 * CORNER or len(t) < 2 * width:
        return np.zeros_like(f_s)
    sections = butter(ORDER, CORNER, "highpass", fs=rate, output="sos")
    shaken = sosfiltfilt(sections, f_s, axis=0)
    power = _running_mean(shaken**2, width)
    if noise_std is None:
        return np.asarray(power - np.quantile(power, 0.1, axis=0))
    return np.asarray(power - _mean_response(sections) * noise_std**2)


def _mean_response(sections: FloatArray) -> float:
    """Variance after the filter, forward and backward, of white noise of variance one: mean of |H|^4 over frequency."""
    from scipy.signal import sosfreqz

    _, response = sosfreqz(sections, worN=4096)
    return float(np.mean(np.abs(response) ** 4))


def _running_mean(value: FloatArray, width: int) -> FloatArray:
    """Centred mean over `width` rows, over fewer at the ends."""
    total = np.vstack([np.zeros(value.shape[1]), np.cumsum(value, axis=0)])
    n = len(value)
    first = np.maximum(np.arange(n) - width // 2, 0)
    last = np.minimum(np.arange(n) - width // 2 + width, n)
    return np.asarray((total[last] - total[first]) / (last - first)[:, None])
