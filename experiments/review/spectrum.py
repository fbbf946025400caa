"""How much of a reading lies at which frequency."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray

#: Samples of a segment at most; segments overlap by half, and are weighted by Hann's window.
_SEGMENT = 1024
_LEAST = 64
#: A step that is so many times the median one ends a stretch that is sampled evenly enough.
_GAP = 3.5


def even_stretch(t: FloatArray) -> slice:
    """The longest stretch of a clock without a gap."""
    step = np.diff(t)
    edges = np.concatenate([[0], np.flatnonzero(step > _GAP * np.median(step)) + 1, [len(t)]])
    longest = int(np.argmax(np.diff(edges)))
    return slice(int(edges[longest]), int(edges[longest + 1]))


def amplitude_density(t: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Root of the power spectral density by Welch's method, over the longest stretch without a gap.

    Parameters
    ----------
    t : (n,) s
    values : (n, k) readings

    Returns
    -------
    (m,) frequencies above zero [Hz], and (m, k) densities [unit/sqrt(Hz)]; None: too few samples

    Neglects that samples are not quite evenly spaced, and what aliases to below half the rate.
    Source: P. D. Welch, IEEE Trans. Audio Electroacoust. 15, 1967.
    """
    from scipy.signal import welch

    if len(t) < _LEAST:
        return None
    part = even_stretch(t)
    t, values = t[part], values[part]
    if len(t) < _LEAST:
        return None
    rate = (len(t) - 1) / float(t[-1] - t[0])
    frequency, density = welch(values, rate, nperseg=min(_SEGMENT, len(t) // 2), axis=0, detrend="constant")
    return frequency[1:], np.sqrt(density[1:])
