"""Noise densities and the bias process from a log at rest: Allan deviation and the fit of its coefficients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError


@dataclass(frozen=True)
class AllanFit:
    """Allan deviation of one channel and the noise processes fitted to it.

    sigma^2(tau) = N^2 / tau + B^2 (2 ln 2 / pi) + w^2 tau / 3 + R^2 tau^2 / 2

    Attributes
    ----------
    tau, deviation : (m,) averaging times [s] and overlapping Allan deviation [unit]
    error : (m,) 1-sigma of the deviation
    noise_density : N, white noise [unit/sqrt(Hz)]; a sample at rate f has the standard deviation N sqrt(f)
    instability : B, flicker floor [unit]
    bias_walk : w, random walk [unit/sqrt(s)]
    std : (4,) 1-sigma of N, B, w, R; of one that is not seen (zero) how large it may be
    ramp : R, a steady drift [unit/s]; zero where it was not fitted
    first : index of the shortest averaging time that took part in the fit
    """

    tau: FloatArray
    deviation: FloatArray
    error: FloatArray
    noise_density: float
    instability: float
    bias_walk: float
    std: FloatArray
    ramp: float = 0.0
    first: int = 0

    def at(self, tau: FloatArray) -> FloatArray:
        """(m,) deviation of the fit at averaging times [s]."""
        return np.asarray(np.sqrt(_basis(tau) @ np.array(self.coefficients) ** 2))

    @property
    def coefficients(self) -> tuple[float, float, float, float]:
        """N, B, w, R."""
        return self.noise_density, self.instability, self.bias_walk, self.ramp


def _basis(tau: FloatArray) -> FloatArray:
    """(m, 4) Allan variance of N = 1, B = 1, w = 1 and R = 1."""
    return np.stack([1.0 / tau, np.full_like(tau, 2 * np.log(2) / np.pi), tau / 3.0, tau**2 / 2.0], axis=1)


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


def fit_allan(values: FloatArray, rate: float, ramp: bool = False, floor: float = 0.0) -> AllanFit:
    """Fit white noise, flicker floor and random walk, if asked for a ramp too, to the Allan variance, none negative.

    Least squares on the variance weighted by its own relative error, so that short and long times count alike. With a
    `floor`, the shortest times are left out as long as they do not lie on the curve of the others: a low-pass filter or
    quantisation has changed them.

    Parameters
    ----------
    values : (n,) readings at rest [unit]
    rate : Hz
    ramp : whether there may be a steady drift
    floor : relative error of the deviation that is allowed to the form of the curve; zero: all times take part

    Neglects quantisation, sinusoids and temperature drift; and in the stated sigmas that overlapping deviations at
    different times share readings, and that where a walk rules they have fewer degrees of freedom than with white
    noise. In 200 logs of 200,000 readings without a `floor` N scatters by 1.4 of its sigma, a walk that is seen by 2.7
    (`test_allan`); with a `floor` of 2 % N of 60,000 by 0.7. Source: IEEE Std 952-1997, annex C.
    """
    tau, deviation, error = allan_deviation(values, rate)
    error = np.hypot(error, floor * deviation)
    last = max(len(tau) - LEAST_TIMES, 0) if floor > 0.0 else 0
    first = next((k for k in range(last) if _predicted(tau[k:], deviation[k:], error[k:], ramp)), last)
    root, std = _fit_terms(tau[first:], deviation[first:], error[first:], ramp)
    N, B, w, R = (float(value) for value in root)
    return AllanFit(tau, deviation, error, N, B, w, std, R, first)


#: So many times stay in the fit at least, since it has four unknowns and two are left to judge by; the shortest stays
#: where the others predict it within so many sigmas, as 2 norm.sf(2) = 5 % of good ones do not.
LEAST_TIMES, PREDICTED_WITHIN = 6, 2.0


def _predicted(tau: FloatArray, deviation: FloatArray, error: FloatArray, ramp: bool) -> bool:
    """Whether the two shortest times lie on the curve of the rest."""
    root, _ = _fit_terms(tau[2:], deviation[2:], error[2:], ramp)
    expected = np.sqrt(_basis(tau[:2]) @ root**2)
    return bool(np.all(np.abs(deviation[:2] - expected) < PREDICTED_WITHIN * error[:2]))


def _fit_terms(tau: FloatArray, deviation: FloatArray, error: FloatArray, ramp: bool) -> tuple[FloatArray, FloatArray]:
    """(4,) N, B, w, R, and their 1-sigma."""
    from scipy.optimize import nnls

    terms = 4 if ramp else 3
    basis = _basis(tau)[:, :terms]
    weight = 1.0 / np.maximum(2.0 * deviation * error, np.finfo(float).tiny)
    scale = np.linalg.norm(basis * weight[:, None], axis=0)
    squares = nnls(basis * weight[:, None] / scale, deviation**2 * weight)[0] / scale
    information = (basis * weight[:, None] / scale).T @ (basis * weight[:, None] / scale)
    variance = np.diag(np.linalg.pinv(information)) / scale**2
    root = np.sqrt(squares)
    std = np.where(root > 0, np.sqrt(variance) / (2 * np.where(root > 0, root, 1.0)), variance**0.25)
    absent = np.zeros(4 - terms)
    return np.concatenate([root, absent]), np.concatenate([std, absent])


def white_density(values: FloatArray, rate: float) -> float:
    """White-noise density [unit/sqrt(Hz)] from the differences of neighbouring readings, deaf to drift.

    N^2 f = mean((x_k+1 - x_k)^2) / 2
    """
    return float(np.sqrt(np.mean(np.diff(values) ** 2) / 2.0 / rate))
