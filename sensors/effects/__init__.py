"""The catalogue of effects: one file an effect, one line here.

`effect("mag.current")` gives a declaration, `effects_for("flight", ("accel", "mag"))` the candidates. A file is read
when its effect is first asked for. Effects of one's own, which no file here declares, are those of `own.py`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from functools import cache
from importlib import import_module
from importlib.util import find_spec

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.effects.own import own_effects
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion
from sinan.sensors.registry import sensors
from sinan.sensors.sensor_type import SensorType

__all__ = ["CATALOGUE", "Effect", "Parameter", "apply_effects", "effect", "effects_for"]

#: name of the effect -> file; the families of the sensors come on top
_FILES: dict[str, tuple[str, str | None]] = {
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
    "sonar.terrain_slope": ("sonar_terrain_slope", None),
    "sonar.boresight": ("sonar_boresight", None),
    "sonar.lever_arm": ("sonar_lever_arm", None),
    "laser.boresight": ("laser_boresight", None),
    "laser.mount_offset": ("laser_mount_offset", None),
    "laser.scale": ("laser_scale", None),
    "laser.terrain_slope": ("laser_terrain_slope", None),
    "laser.lever_arm": ("laser_lever_arm", None),
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
_STREAM_OF = {"motion": "level"}  # where the first part of a name is not the stream


@cache
def _is_there(file: str) -> bool:
    return find_spec(f"{__name__}.{file}") is not None


class _Catalogue(Mapping[str, Effect]):
    """All effects by name; a file is read when its effect is first asked for."""

    def __getitem__(self, name: str) -> Effect:
        return effect(name)

    def __iter__(self) -> Iterator[str]:
        return iter(_names())

    def __len__(self) -> int:
        return len(_names())


CATALOGUE: Mapping[str, Effect] = _Catalogue()


@cache
def _files(listed: tuple[SensorType, ...]) -> dict[str, tuple[str, str | None]]:
    """File and, for a family, the stream of every shipped effect that is there with these sensors."""
    found = {f"{entry.name}.{family}": (family, entry.name) for family in _FAMILIES for entry in listed if entry.unit}
    late = {f"{entry.name}.time_offset": ("time_offset", entry.name) for entry in listed if entry.late}
    head = {name: line for name, line in _FILES.items() if not name.startswith("pseudorange.")}
    tail = {name: line for name, line in _FILES.items() if name not in head}
    return {name: line for name, line in {**head, **found, **late, **tail}.items() if _is_there(line[0])}


def _names() -> tuple[str, ...]:
    return (*_files(sensors()), *own_effects())


def is_shipped(name: str) -> bool:
    """Whether an effect of that name comes with the project."""
    return name in _FILES or name in _files(sensors())


def forget() -> None:
    """Forget what was looked up: another effect is known, or one is no longer."""
    for looked_up in (_is_there, _files, _read):
        looked_up.cache_clear()


def effect(name: str) -> Effect:
    """The effect of that name.

    Raises
    ------
    KeyError : no such effect; names the nearest ones
    """
    files = _files(sensors())
    if name in files:
        return _read(*files[name])
    mine = own_effects()
    if name not in mine:
        from difflib import get_close_matches

        near = get_close_matches(name, _names(), n=3, cutoff=0.4) or _names()
        raise KeyError(f"no effect `{name}`; there are {', '.join(near)}")
    return mine[name]


@cache
def _read(file: str, stream: str | None) -> Effect:
    module = import_module(f"{__name__}.{file}")
    found: Effect = module.EFFECT if stream is None else module.for_stream(stream)
    return found


def effects_for(kind: str, streams: Collection[str], localised: bool = False) -> tuple[Effect, ...]:
    """The effects that are candidates in a recording of a kind with certain streams.

    Parameters
    ----------
    kind : flight or poses (pseudoranges are effects of stream `pseudorange`)
    streams : sensors that the recording has, as `Effect.stream` names them (`level` where that pseudo-sensor is on)
    localised : also the time-localised families (step, transient, outliers), whose interval has to be searched
    """
    ours = [name for name in CATALOGUE if _STREAM_OF.get(name.split(".")[0], name.split(".")[0]) in streams]
    return tuple(e for e in map(effect, ours) if kind in e.kinds and (localised or not e.is_local))


def apply_effects(
    plain: FloatArray,
    effects: Mapping[str, FloatArray] | list[tuple[Effect, FloatArray]],
    motion: Motion,
    model: SensorModel,
) -> FloatArray:
    """The reading with several effects of one stream in it, each taken of the plain reading.

    reading = plain + sum (effect_i(plain) - plain); with `gps.latency` a lever arm is that of t - b too.

    Parameters
    ----------
    plain : (n, size) what the perfect sensor reads
    effects : beta by name, or pairs of an effect and its beta
    motion : at the instants of the readings
    model : of the sensor
    """
    pairs = [(effect(n), b) for n, b in effects.items()] if isinstance(effects, Mapping) else list(effects)
    late = next((float(np.asarray(b)[0]) for e, b in pairs if e.name == "gps.latency"), 0.0)
    reading = plain.copy()
    for entry, beta in pairs:
        if entry.name == "gps.lever_arm" and late != 0.0:
            reading += entry.change(plain, beta, motion.at(motion.t - late), model)
        else:
            reading += entry.change(plain, beta, motion, model)
    return reading
