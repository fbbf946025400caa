"""The effects that come with the project: one file an effect, one line here for each sensor that has it."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from importlib.util import find_spec

from sinan.sensors.effects.declaration import Effect
from sinan.sensors.registry import sensors
from sinan.sensors.sensor_type import SensorType

#: name of the effect -> file; the families of the sensors come on top
FILES: dict[str, tuple[str, str | None]] = {
    "accel.cross_axis": ("accel_cross_axis", None),
    "accel.scale": ("accel_scale", None),
    "accel.scale_nonlinearity": ("accel_scale_nonlinearity", None),
    "accel.temperature": ("accel_temperature", None),
    "accel.lever_arm": ("accel_lever_arm", None),
    "accel.vibration": ("accel_vibration", None),
    "accel.misalignment": ("accel_misalignment", None),
    "gyro.scale": ("gyro_scale", None),
    "gyro.cross_axis": ("gyro_cross_axis", None),
    "gyro.temperature": ("gyro_temperature", None),
    "gyro.g_sensitivity": ("gyro_g_sensitivity", None),
    "mag.cross_axis": ("mag_cross_axis", None),
    "mag.scale": ("mag_scale", None),
    "mag.current": ("mag_current", None),
    "mag.temperature": ("mag_temperature", None),
    "mag.declination": ("mag_declination", None),
    "mag.misalignment": ("mag_misalignment", None),
    "baro.airspeed": ("baro_airspeed", None),
    "baro.temperature": ("baro_temperature", None),
    "baro.propwash": ("baro_propwash", None),
    "baro.lag": ("baro_lag", None),
    "baro.scale": ("baro_scale", None),
    "sonar.sound_speed": ("sonar_sound_speed", None),
    "sonar.mount_offset": ("sonar_mount_offset", None),
    "sonar.beam_cone": ("sonar_beam_cone", None),
    "sonar.terrain_slope": ("terrain_slope", "sonar"),
    "sonar.boresight": ("boresight", "sonar"),
    "sonar.lever_arm": ("beam_lever_arm", "sonar"),
    "laser.boresight": ("boresight", "laser"),
    "laser.mount_offset": ("laser_mount_offset", None),
    "laser.scale": ("laser_scale", None),
    "laser.terrain_slope": ("terrain_slope", "laser"),
    "laser.lever_arm": ("beam_lever_arm", "laser"),
    "gps.lever_arm": ("gps_lever_arm", None),
    "gps.latency": ("gps_latency", None),
    "camera.focal": ("camera_focal", None),
    "camera.principal_point": ("camera_principal_point", None),
    "camera.distortion": ("camera_distortion", None),
    "camera.misalignment": ("camera_misalignment", None),
    "camera.lever_arm": ("camera_lever_arm", None),
    "camera.time_offset": ("camera_time_offset", None),
    "motion.rotor_drag": ("motion_rotor_drag", None),
    "motion.wind": ("motion_wind", None),
    "pseudorange.satellite_clock": ("pseudorange_satellite_clock", None),
    "pseudorange.earth_rotation": ("pseudorange_earth_rotation", None),
    "pseudorange.relativity": ("pseudorange_relativity", None),
    "pseudorange.group_delay": ("pseudorange_group_delay", None),
    "pseudorange.troposphere": ("pseudorange_troposphere", None),
    "pseudorange.ionosphere": ("pseudorange_ionosphere", None),
    "pseudorange.satellite_fault": ("pseudorange_satellite_fault", None),
}
#: Families that each sensor has whose readings may be disturbed; late stamps where its declaration names a scenario.
_FAMILIES = ("step", "transient", "outliers")


@cache
def _is_there(file: str) -> bool:
    return find_spec(f"{__package__}.{file}") is not None


def shipped_files() -> dict[str, tuple[str, str | None]]:
    """By name, the file of every shipped effect that is there and, of one that several have, the stream."""
    return _files(sensors())


@cache
def _files(listed: tuple[SensorType, ...]) -> dict[str, tuple[str, str | None]]:
    """The same with these sensors."""
    found = {f"{entry.name}.{family}": (family, entry.name) for family in _FAMILIES for entry in listed if entry.unit}
    late = {f"{entry.name}.time_offset": ("time_offset", entry.name) for entry in listed if entry.late}
    head = {name: line for name, line in FILES.items() if not name.startswith("pseudorange.")}
    tail = {name: line for name, line in FILES.items() if name not in head}
    return {name: line for name, line in {**head, **found, **late, **tail}.items() if _is_there(line[0])}


def is_shipped(name: str) -> bool:
    """Whether an effect of that name comes with the project."""
    return name in FILES or name in shipped_files()


def forget() -> None:
    """Forget what was looked up: another file is there, or one is no longer."""
    for looked_up in (_is_there, _files, read):
        looked_up.cache_clear()


@cache
def read(file: str, stream: str | None) -> Effect:
    """The declaration in a file."""
    module = import_module(f"{__package__}.{file}")
    found: Effect = module.EFFECT if stream is None else module.for_stream(stream)
    return found
