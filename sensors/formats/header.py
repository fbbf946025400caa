"""What a recording declares about itself: the tables that `recording.toml` and a map have in common."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.formats.toml_table import Table
from sinan.sensors.formats.units import UNITS
from sinan.sensors.lenses import LENSES
from sinan.sensors.recording import Environment, Initial, SensorSpec
from sinan.sensors.registry import BySensor

Origin = tuple[float, float, float]

#: Sizes that a declared number may have, in SI units, gauss or raw counts: converters have 32 bits, the quietest
#: instruments (ring laser gyroscopes) a noise of 1e-7; the filter squares them.
SMALLEST_NOISE, LARGEST = 1e-12, 1e12
#: Height of the origin [m]: the deepest trench to the orbit of a station.
LOWEST, HIGHEST = -12_000.0, 1e6

#: The keys that each sensor may declare.
SENSOR_KEYS = BySensor(lambda entry: entry.declares)
#: Keys that are lists, and their length; None: any.
LISTS = {"base_position": 3, "focal": 2, "centre": 2, "coefficients": None, "mounting": 4, "lever_arm": 3}


@dataclass(frozen=True)
class Header:
    """What is declared: the attributes of `Recording` that are not readings."""

    origin: Origin | None = None
    environment: Environment = field(default_factory=Environment)
    initial: Initial = field(default_factory=Initial)
    sensors: dict[str, SensorSpec] = field(default_factory=dict)
    effects: dict[str, tuple[float, ...]] = field(default_factory=dict)


def read_header(table: Table) -> Header:
    """Read `[origin]`, `[environment]`, `[initial]`, `[sensors.*]` and `[effects]` of a table.

    Raises
    ------
    InputError : names the key, what was found, what was expected
    """
    return Header(
        origin=_origin(table),
        environment=_environment(table.table("environment")),
        initial=_initial(table.table("initial")),
        sensors=_sensors(table.table("sensors")),
        effects=_effects(table.table("effects")),
    )


def _origin(table: Table) -> Origin | None:
    if "origin" not in table:
        return None
    origin = table.table("origin")
    latitude = origin.number("latitude", at_least=-90.0, at_most=90.0)
    longitude = origin.number("longitude", at_least=-180.0, at_most=360.0)
    height = origin.number("height", at_least=LOWEST, at_most=HIGHEST)
    origin.done()
    for key, value in (("latitude", latitude), ("longitude", longitude), ("height", height)):
        if value is None:
            raise origin.error(key, "no such key", "latitude, longitude [deg] and height [m] of the NED frame")
    assert latitude is not None
    assert longitude is not None
    assert height is not None
    return latitude, longitude, height


def _environment(table: Table) -> Environment:
    environment = Environment(
        gravity=table.number("gravity", at_least=SMALLEST_NOISE, at_most=LARGEST),
        magnetic_field=table.vector("magnetic_field", 3, at_most=LARGEST),
        ground_down=table.number("ground_down", at_least=-LARGEST, at_most=LARGEST) or 0.0,
        earth_rotation=table.flag("earth_rotation") or False,
        field_unit=table.text("field_unit", tuple(UNITS["field"])) or "",
    )
    table.done()
    if environment.magnetic_field is not None and not np.any(environment.magnetic_field):
        raise table.wrong("magnetic_field", "a field that is not zero")
    return environment


def _initial(table: Table) -> Initial:
    initial = Initial(
        position=table.vector("position", 3, at_most=LARGEST),
        velocity=table.vector("velocity", 3, at_most=LARGEST),
        quaternion=table.vector("quaternion", 4),
        position_std=table.number("position_std", at_least=0.0, at_most=LARGEST),
        velocity_std=table.number("velocity_std", at_least=0.0, at_most=LARGEST),
        attitude_std=table.number("attitude_std", at_least=0.0, at_most=LARGEST),
    )
    table.done()
    # Two printed digits of a unit quaternion leave its norm within 1 % of one.
    if initial.quaternion is not None and abs(np.linalg.norm(initial.quaternion) - 1.0) > 0.01:
        raise table.wrong("quaternion", "a quaternion of norm 1, scalar first")
    return initial


def _sensors(table: Table) -> dict[str, SensorSpec]:
    specs = {sensor: _sensor(table.table(sensor), keys) for sensor, keys in SENSOR_KEYS.items() if sensor in table}
    table.done()
    return specs


def _sensor(table: Table, keys: tuple[str, ...]) -> SensorSpec:
    values: dict[str, object] = {}
    for key in keys:
        if key in ("noise_density", "noise_std", "velocity_noise_std", "average_time"):
            values[key] = table.number(key, at_least=SMALLEST_NOISE, at_most=LARGEST)
        elif key in ("bias_walk", "bias_std"):
            values[key] = table.number(key, at_least=0.0, at_most=LARGEST)
        elif key == "imu_samples":
            values[key] = table.text(key, ("instant", "average")) or "instant"
        elif key == "angles":
            values[key] = scan_angles(table)
        elif key == "lens":
            values[key] = table.text(key, tuple(LENSES)) or ""
        else:
            values[key] = table.vector(key, LISTS[key], at_most=LARGEST)
    table.done()
    return SensorSpec(**values)  # type: ignore[arg-type]


def scan_angles(table: Table) -> FloatArray | None:
    """(beams,) `angles` of a scan from body down [rad]; None where the key is missing.

    Raises
    ------
    InputError : a beam that does not point below the body's own horizon, as numbers in degrees do
    """
    angles = table.vector("angles")
    if angles is not None and np.max(np.abs(angles)) >= np.pi / 2:
        found = angles[np.argmax(np.abs(angles) >= np.pi / 2)]
        expected = "angles in rad from body down, beyond -1.5708 and below 1.5708 (90 deg)"
        raise table.error("angles", f"{found:g}", expected)
    return angles


def _effects(table: Table) -> dict[str, tuple[float, ...]]:
    from sinan.sensors.effects import effect

    effects: dict[str, tuple[float, ...]] = {}
    for name in table.names():
        one = not isinstance(table.get(name, "number", "array", items={"type": "number"}), list)
        beta = table.number(name, at_least=-LARGEST, at_most=LARGEST) if one else table.vector(name, at_most=LARGEST)
        effects[name] = tuple(float(value) for value in np.atleast_1d(np.asarray(beta)))
        try:
            entry = effect(name)
        except KeyError as error:
            raise table.error(name, "unknown effect", str(error.args[0])) from None
        if len(effects[name]) != entry.size:
            raise table.error(name, f"{len(effects[name])} numbers", f"{entry.size}")
        entry.check(effects[name], table.path, table.place(name))
    table.done()
    return effects
