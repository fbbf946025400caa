"""Noise densities and the bias process from a log at rest: Allan deviation and the fit of its coefficients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError


@dataclass(frozen=True)
class AllanFit:
    """Allan deviation of one channel and the noise processes fitted to it.

    sigma^2(tau) = N^2 / tau + B^2 (2 ln 2 / pi) + w^2 tau / 3

    Attributes
    ----------
    tau, deviation : (m,) averaging times [s] and overlapping Allan deviation [unit]
    error : (m,) 1-sigma of the deviation
    noise_density : N, white noise [unit/sqrt(Hz)]; a sample at rate f has the standard deviation N sqrt(f)
    instability : B, flicker floor [unit]
    bias_walk : w, random walk [unit/sqrt(s)]
    std : 1-sigma of the three, in this order
    """

    tau: FloatArray
    deviation: FloatArray
    error: FloatArray
    noise_density: float
    instability: float
    bias_walk: float
    std: FloatArray


def allan_deviation(values: FloatArray, rate: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Overlapping Allan deviation at octave averaging times up to a fifth of the log: tau [s], deviation, 1-sigma.

    Parameters
    ----------
    values : (n,) readings at rest [unit]
    rate : Hz

    Source: D. W. Allan, Proc. IEEE 54 (1966) 221; W. J. Riley, NIST SP 1065 (2008), section 5.2.4; `allantools.oadev`.
    """
    import allantools

    if len(values) < 16:
        raise InputError("readings at rest", f"{len(values)} rows", "at least 16")
    tau, deviation, _, _ = allantools.oadev(values, rate=rate, data_type="freq", taus="octave")
    keep = tau <= len(values) / rate / 5.0
    tau, deviation = np.asarray(tau)[keep], np.asarray(deviation)[keep]
    # Equivalent degrees of freedom of the overlapping estimate for white noise, NIST SP 1065 table 5 (alpha = 0).
    m, n = np.round(tau * rate), float(len(values))
    edf = np.maximum(3 * (n - 1) / (2 * m) - 2 * (n - 2) / n, 0.5) * 4 * m**2 / (4 * m**2 + 5)
    return tau, deviation, deviation / np.sqrt(2.0 * np.maximum(edf, 1.0))


def fit_allan(values: FloatArray, rate: float) -> AllanFit:
    """Fit white noise, flicker floor and random walk to the Allan variance, none of them negative.

    Least squares on the variance weighted by its own relative error, so that short and long times count alike.

    Parameters
    ----------
    values : (n,) readings at rest [unit]
    rate : Hz

    Neglects quantisation, sinusoids and temperature drift. Source: IEEE Std 952-1997, annex C.
    """
    from scipy.optimize import nnls

    tau, deviation, error = allan_deviation(values, rate)
    basis = np.stack([1.0 / tau, np.full_like(tau, 2 * np.log(2) / np.pi), tau / 3.0], axis=1)
    weight = 1.0 / (2.0 * deviation * error)
    squares, _ = nnls(basis * weight[:, None], deviation**2 * weight)
    information = (basis * weight[:, None]).T @ (basis * weight[:, None])
    variance = np.diag(np.linalg.pinv(information))
    root = np.sqrt(squares)
    std = np.where(root > 0, np.sqrt(variance) / (2 * np.where(root > 0, root, 1.0)), variance**0.25)
    return AllanFit(tau, deviation, error, float(root[0]), float(root[1]), float(root[2]), std)


def white_density(values: FloatArray, rate: float) -> float:
    """White-noise density [unit/sqrt(Hz)] from the differences of neighbouring readings, deaf to drift.

    N^2 f = mean((x_k+1 - x_k)^2) / 2
    """
    return float(np.sqrt(np.mean(np.diff(values) ** 2) / 2.0 / rate))
