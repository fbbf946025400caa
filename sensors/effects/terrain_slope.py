"""<sonar or laser>.terrain_slope: the ground that the range sensor sees is inclined."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.beams import inclined_ground, inclined_ground_slope
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion

PLAUSIBLE = 0.05  # 1; a meadow that looks flat rises by up to 5 %


def regressor(motion: Motion) -> FloatArray:
    """(n, beams, 2): -(north, east of the point where the beam meets the ground) / c."""
    return inclined_ground_slope(motion)


def exact(plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None) -> FloatArray:
    """Range to the inclined plane, in closed form."""
    return inclined_ground(motion, beta)


def for_stream(stream: str) -> Effect:
    """Of sonar or laser."""
    return Effect(
        name=f"{stream}.terrain_slope",
        stream=stream,
        summary=f"The ground under the {stream} is inclined.",
        enters="height of the ground += b_north x north + b_east x east",
        physics=(
            "The ground's height above `ground_down` is b0 north + b1 east; the range is that to the inclined plane "
            "along the beam. Sonar and laser see one ground, so the two slopes go together."
        ),
        source="Intersection of a line and a plane (derivation: `sensors.effects.beams.inclined_ground`)",
        parameters=(Parameter("north", "1", PLAUSIBLE), Parameter("east", "1", PLAUSIBLE)),
        needs=("p_n", "q_nb"),
        regressor=regressor,
        exact=exact,
        scenario="low_pass",
        separates="legs across the ground with a barometer",
    )
