"""<sonar or laser>.lever_arm: the range sensor sits beside the body's reference point."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.beams import lever_arm_slope
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

PLAUSIBLE = 0.1  # m, the size of a small multicopter's frame


def regressor(motion: Motion) -> FloatArray:
    """(n, beams, 3): d range / d r = -d_b / c, d_b = C_bn e_down, c = d_b . beam; exact."""
    return lever_arm_slope(motion)


def for_stream(stream: str) -> Effect:
    """Of sonar or laser."""
    return Effect(
        name=f"{stream}.lever_arm",
        stream=stream,
        summary=f"The {stream} sits beside the reference point.",
        enters="range -= (R r)_down / c,  r = b,  c = descent of the beam",
        physics=(
            f"The beam starts at p + R r with r = beta, the place of the {stream} in the body; over flat ground the "
            "range is shorter by how far that lies below the reference point, along the beam. Exact. "
            f"A {stream} ahead reads more when the nose is up. At one height it looks like `{stream}.boresight`, which "
            f"grows with the height; straight down the body the z of a single beam is `{stream}.mount_offset`. "
            f"`{stream}.terrain_slope` acts on top, of the reference "
            "point's own range."
        ),
        source="J. Skaloud, D. Lichti, ISPRS J. Photogrammetry and Remote Sensing 61(1), 2006, equation 1 (lever arm)",
        parameters=tuple(Parameter(axis, "m", PLAUSIBLE) for axis in "xyz"),
        needs=("p_n", "q_nb"),
        regressor=regressor,
        scenario="low_pass",
        separates="tilts to both sides, low and high",
    )
