"""What rough recordings have and clean ones do not: wrong noise levels, coloured GPS, outliers, jitter, gaps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sinan.experiments.blind.maker.catalogue import log_uniform
from sinan.experiments.blind.maker.instruments import Instrument
from sinan.sensors.arrays import BoolArray, FloatArray

WORLDS = ("declared", "rough")
#: Noise is off by up to a third either way.
NOISE_FACTOR = (2.0 / 3.0, 4.0 / 3.0)
#: Largest share of outliers, and their size in standard deviations.
OUTLIER_SHARE, OUTLIER_SIZE = 0.01, (5.0, 15.0)


@dataclass(frozen=True)
class Rough:
    """How rough a recording is; the default is as declared.

    Attributes
    ----------
    factors : true over declared noise, by sensor
    outliers : share of wrong readings, by sensor
    jitter : standard deviation of a time stamp [s], by sensor
    gaps : intervals without readings [s], by sensor
    colour : (tau [s], standard deviation over the declared noise) of the GPS position's first-order Markov part
    """

    factors: Mapping[str, float] = field(default_factory=dict)
    outliers: Mapping[str, float] = field(default_factory=dict)
    jitter: Mapping[str, float] = field(default_factory=dict)
    gaps: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)
    colour: tuple[float, float] | None = None


def draw_rough(rng: np.random.Generator, instruments: Mapping[str, Instrument], begin: float, end: float) -> Rough:
    """A rough world for these instruments; each kind of roughness comes with probability 0.7 or so."""
    slow = [name for name in instruments if name not in ("accel", "gyro")]
    factors = {name: float(rng.uniform(*NOISE_FACTOR)) for name in instruments}
    outliers = {name: float(rng.uniform(0.0, OUTLIER_SHARE)) for name in slow if rng.uniform() < 0.6}
    jitter = {
        name: min(log_uniform(rng, 5e-4, 5e-3), 0.15 / instruments[name].rate) for name in slow if rng.uniform() < 0.6
    }
    gaps = {}
    for name in slow:
        if rng.uniform() < 0.4:
            starts = begin + (end - begin) * rng.uniform(0.1, 0.9, size=int(rng.integers(1, 4)))
            gaps[name] = tuple((float(a), float(a + rng.uniform(0.3, 3.0))) for a in starts)
    colour = (log_uniform(rng, 2.0, 15.0), float(rng.uniform(0.3, 1.0))) if rng.uniform() < 0.7 else None
    return Rough(factors, outliers, jitter, gaps, colour)


def markov(rng: np.random.Generator, t: FloatArray, tau: float, sigma: float, size: int) -> FloatArray:
    """(n, size) a stationary first-order Markov process with variance sigma^2 and time constant tau."""
    decay = np.exp(-np.diff(t) / tau)
    drive = sigma * np.sqrt(1.0 - decay**2)
    x = np.empty((len(t), size))
    x[0] = sigma * rng.normal(size=size)
    for k in range(1, len(t)):
        x[k] = decay[k - 1] * x[k - 1] + drive[k - 1] * rng.normal(size=size)
    return x


def isolated(
    rng: np.random.Generator, n: int, share: float, sigma: FloatArray, size: tuple[float, float]
) -> FloatArray:
    """(n, k) zero but in a share of the rows, which are off by `size` standard deviations in a random direction."""
    wrong = rng.uniform(size=n) < share
    direction = rng.normal(size=(n, len(sigma)))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return wrong[:, None] * direction * sigma * rng.uniform(*size, size=n)[:, None]


def jittered(rng: np.random.Generator, t: FloatArray, sigma: float) -> FloatArray:
    """Time stamps with an error of `sigma`, cut at 2 sigma so that they stay in order."""
    return np.asarray(t + np.clip(sigma * rng.normal(size=len(t)), -2.0 * sigma, 2.0 * sigma))


def outside_gaps(t: FloatArray, gaps: tuple[tuple[float, float], ...]) -> BoolArray:
    """Which rows remain."""
    keep = np.ones(len(t), dtype=bool)
    for begin, end in gaps:
        keep &= (t < begin) | (t > end)
    return keep
