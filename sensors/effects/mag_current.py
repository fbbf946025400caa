"""mag.current: the magnetometer reads the supply current."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.algebra import covariate_on_each_axis
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

#: A wire pair with 1 cm between the wires at 10 cm makes 0.2 uT/A (Biot-Savart), 0.4 % of the field an ampere; boards
#: that sit on the battery lead read ten times that
PLAUSIBLE = 0.03  # share of the field, 1/A


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 3): B += b I; where the current is not known, mean throttle in its place (b is then per full throttle)."""
    return covariate_on_each_axis(motion, "current" if motion.has("current") else "throttle")


EFFECT = Effect(
    name="mag.current",
    stream="mag",
    summary="The magnetometer reads the motor current.",
    enters="B += b I",
    physics=(
        "B += b I: the loop of battery, leads and motor controllers makes a field fixed in the body and proportional "
        "to its current. Exact for fixed leads; neglects that the share of each motor's lead varies with its own "
        "current. Where only the motors' commands are known, mean throttle stands for the current, and b is per full "
        "throttle."
    ),
    source="Law of Biot and Savart; ArduPilot documentation, 'Magnetic interference' (compass-motor compensation)",
    parameters=tuple(Parameter(axis, "1/A", PLAUSIBLE) for axis in "xyz"),
    needs=("current",),
    regressor=regressor,
    kinds=frozenset({"flight", "poses"}),
    scenario="aerobatics",
    separates="changes of throttle at one heading: climbs and descents",
    in_field_units=True,
)
