"""<stream>.outliers: isolated readings are wrong, more often than the noise allows."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.effects.streams import STREAMS
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion

PLAUSIBLE = 0.05  # 1; GPS in streets and sonar over grass lose some per cent of their readings
SMALLEST, LARGEST = 8.0, 30.0  # sigma of a reading's noise: what `draw` makes; below 8 a reading is hardly an outlier


def draw(n: int, share: float, sigma: FloatArray, rng: np.random.Generator) -> FloatArray:
    """One realisation: (n, size) offsets, zero but for a share of isolated rows, each component of random sign.

    Parameters
    ----------
    n : readings
    share : probability that a reading is wrong
    sigma : (size,) standard deviation of one reading's noise
    """
    wrong = rng.random(n) < share
    size = rng.uniform(SMALLEST, LARGEST, (n, len(sigma)))
    sign = rng.choice(np.array([-1.0, 1.0]), (n, len(sigma)))
    return wrong[:, None] * sign * size * sigma


def for_stream(stream: str, size: int | None = None) -> Effect:
    """The outliers of one stream. Their mean is zero: not the mean reading but its scatter shows them."""
    sizes = STREAMS[stream]
    width = size or len(sizes.components)

    def regressor(motion: Motion) -> FloatArray:
        """(n, size, 1) zero: the mean reading does not change."""
        return np.zeros((len(motion), width, 1))

    def exact(plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None) -> FloatArray:
        """The mean reading, which outliers of either sign leave alone; `draw` makes a realisation."""
        return plain.copy()

    return Effect(
        name=f"{stream}.outliers",
        stream=stream,
        summary=f"Some readings of the {sizes.title} are wrong.",
        enters="a share b of the readings is far off, each on its own",
        physics=(
            "A share b of the readings is wrong, each on its own and of either sign, more often than Gaussian noise "
            "allows: reflections, spikes on the bus, false echoes. The mean stays; gates and robust weights deal with "
            "it."
        ),
        source="P. J. Huber, E. M. Ronchetti, Robust Statistics, 2nd ed. (gross-error model)",
        parameters=(Parameter("share", "1", PLAUSIBLE),),
        needs=(),
        regressor=regressor,
        exact=exact,
        kinds=sizes.kinds,
        scenario="base_receiver" if stream == "base" else "figure_eight",
        separates="more readings",
    )
