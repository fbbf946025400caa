"""White noise and random walks: density <-> sample standard deviation, and how to draw them.

Conventions: density N [unit/sqrt(Hz)] is two-sided, so that a sample taken at rate f, noise in the band from -f/2 to
f/2, has the standard deviation N sqrt(f), and its Allan deviation is N / sqrt(tau); a walk w means that the variance
grows by w^2 t. The density of a data sheet is most often one-sided, sqrt(2) N: noise in a band from 0 to f/2 has the
variance (sqrt(2) N)^2 f/2. Source: IEEE Std 952-1997, annex C.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray


@dataclass(frozen=True)
class BiasProcess:
    """A bias as a first-order Gauss-Markov process: b(0) ~ N(0, std^2), db/dt = -b / tau + white noise.

    With tau infinite it is a random walk. A stationary one has walk^2 = 2 std^2 / tau (`colour`).

    Attributes
    ----------
    block : name of the state block, such as "b_accel"
    size : number of components
    std : 1-sigma of each component at the start [unit of the reading]
    walk : the variance of each component grows by walk^2 t while t is far below tau [unit/sqrt(s)]
    tau : time constant [s]
    """

    block: str
    size: int
    std: float
    walk: float
    tau: float = float("inf")

    @classmethod
    def unless_zero(cls, block: str, size: int, std: float, walk: float) -> BiasProcess | None:
        """Of a sensor whose bias is optional; None where both its sizes are zero: no state."""
        return None if std == 0.0 and walk == 0.0 else cls(block, size, std, walk)

    @property
    def rate(self) -> float:
        """1 / tau [1/s]; 0 of a random walk."""
        return 1.0 / self.tau


def colour(block: str, size: int, std: float, tau: float) -> BiasProcess:
    """A stationary first-order Gauss-Markov process of standard deviation `std` and time constant `tau` [s]."""
    return BiasProcess(block, size, std, float(std * np.sqrt(2.0 / tau)), tau)


def sample_std(density: float, rate: float) -> float:
    """Standard deviation of a sample taken at `rate` [Hz] of white noise of `density` [unit/sqrt(Hz)]: N sqrt(f)."""
    return float(density * np.sqrt(rate))


def walked(std: float, walk: float, elapsed: float) -> float:
    """1-sigma of a random walk so many seconds later: its variance has grown by walk^2 t."""
    return float(np.hypot(std, walk * np.sqrt(elapsed)))


def random_walk(t: FloatArray, process: BiasProcess, rng: np.random.Generator) -> FloatArray:
    """Draw the bias at the instants t.

    b_0 ~ N(0, std^2),  b_k = phi b_{k-1} + sqrt(q) n_k,  phi = exp(-h / tau),  q = walk^2 tau (1 - phi^2) / 2

    over h = t_k - t_{k-1}; of a random walk phi = 1 and q = walk^2 h.

    Parameters
    ----------
    t : (n,) s, increasing
    process : the bias
    rng : source of randomness

    Returns
    -------
    (n, size)
    """
    steps = rng.standard_normal((len(t), process.size))
    steps[0] *= process.std
    if np.isinf(process.tau):
        steps[1:] *= process.walk * np.sqrt(np.diff(t))[:, None]
        return np.cumsum(steps, axis=0)
    phi = np.exp(-np.diff(t) * process.rate)
    steps[1:] *= (process.walk * np.sqrt(0.5 * process.tau * (1.0 - phi**2)))[:, None]
    for k, share in enumerate(phi):
        steps[k + 1] += share * steps[k]
    return steps
