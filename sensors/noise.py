"""White noise and random walks: density <-> sample standard deviation, and how to draw them.

Conventions (one-sided in the sense of data sheets): density N [unit/sqrt(Hz)] means that a sample taken at rate f has
the standard deviation N sqrt(f), so that its Allan deviation is N / sqrt(tau); a walk w means that the variance grows
by w^2 t.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sensors.arrays import FloatArray


@dataclass(frozen=True)
class BiasProcess:
    """A bias as a Gaussian random walk: b(0) ~ N(0, std^2), db/dt = white noise of density `walk`.

    Attributes
    ----------
    block : name of the state block, such as "b_accel"
    size : number of components
    std : 1-sigma of each component at the start [unit of the reading]
    walk : the variance of each component grows by walk^2 t [unit/sqrt(s)]
    """

    block: str
    size: int
    std: float
    walk: float


def sample_std(density: float, rate: float) -> float:
    """Standard deviation of a sample taken at `rate` [Hz] of white noise of `density` [unit/sqrt(Hz)]: N sqrt(f)."""
    return float(density * np.sqrt(rate))


def density_of(std: float, rate: float) -> float:
    """Density [unit/sqrt(Hz)] of white noise whose samples at `rate` [Hz] have the standard deviation `std`."""
    return float(std / np.sqrt(rate))


def random_walk(t: FloatArray, process: BiasProcess, rng: np.random.Generator) -> FloatArray:
    """Draw the bias at the instants t.

    b_0 ~ N(0, std^2),  b_k = b_{k-1} + walk sqrt(t_k - t_{k-1}) n_k

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
    steps[1:] *= process.walk * np.sqrt(np.diff(t))[:, None]
    return np.cumsum(steps, axis=0)
