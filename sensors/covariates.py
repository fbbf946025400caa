"""What a recording knows besides the readings: the covariates that effects need, at given instants."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.camera import LOOKS_AHEAD, Camera, Intrinsics
from sinan.sensors.errors import InputError
from sinan.sensors.noise import sample_std
from sinan.sensors.recording import ACCEL, Recording, SensorSpec, Stream
from sinan.sensors.registry import BySensor
from sinan.sensors.rotation import matrix_from_quaternion

#: Where the temperature of a sensor is looked for, in order: its own chip first, then the board it sits on
_THERMOMETERS = BySensor(lambda entry: entry.thermometers)
#: Covariates that power and air carry, and their columns
_ABOARD: dict[str, tuple[str, ...]] = {
    "current": ("current",),
    "voltage": ("voltage",),
    "airspeed": ("airspeed",),
    "wind": ("wind_north", "wind_east"),
}
#: Effects whose declared size other effects need as a covariate
_DECLARED = {"rotor_drag": "motion.rotor_drag"}


def covariates_for(recording: Recording, stream: str, t: FloatArray) -> dict[str, FloatArray]:
    """The covariates of a stream's effects at the instants t, linear between the readings; unknown ones are left out.

    Parameters
    ----------
    recording : whose streams are looked at
    stream : the sensor, as `Effect.stream` names it
    t : (n,) s

    Returns
    -------
    by the names in `Motion.covariates`:
    `temperature` [degC] of the sensor's own chip (a magnetometer without one: the IMU's), `current` [A] and
    `voltage` [V] of `power`, `throttle` = mean of the columns of `motors`, `airspeed` [m/s] and `wind` (n, 2) [m/s] of
    `air`, `vibration` (n, 3) [(m/s^2)^2] of the IMU, `rotor_drag` [1/s] where it is declared, `angles` (n, beams) [rad]
    of a laser scan; of a camera itself (`camera`) and the place `point_n` (n, 3) [m] that each of its readings is of, t
    being the instants of these, in their order.
    Columns of `poses` or of the stream itself go before those of the other streams.
    """
    found: dict[str, FloatArray] = {}
    own = recording.streams.get("poses") or recording.streams.get(stream)
    for name, columns in _ABOARD.items():
        source = _with_columns(columns, own, recording.streams.get("power"), recording.streams.get("air"))
        if source is not None:
            values = _at(t, source, columns)
            found[name] = values if len(columns) > 1 else values[:, 0]
    thermometer = _with_columns(("temperature",), *(recording.streams.get(s) for s in _THERMOMETERS.get(stream, ())))
    if thermometer is not None:
        found["temperature"] = _at(t, thermometer, ("temperature",))[:, 0]
    motors = recording.streams.get("motors")
    if motors is not None:
        commands = [name for name in motors.columns if name.startswith("motor_")]
        found["throttle"] = np.mean(_at(t, motors, commands), axis=1)
    for name, effect in _DECLARED.items():
        if effect in recording.effects:
            found[name] = np.full(len(t), recording.effects[effect][0])
    angles = recording.spec(stream).angles
    if angles is not None:
        found["angles"] = np.tile(angles, (len(t), 1))
    if stream == "camera":
        found.update(seen_points(recording, len(t)))
    if stream == "accel" and "imu" in recording.streams:
        found["vibration"] = _vibration(recording, t)
    return found


def camera_of(recording: Recording) -> Camera:
    """The camera that a recording declares in `[sensors.camera]`.

    Raises
    ------
    InputError : no focal length, principal point or noise; coefficients that its lens has not
    """
    return camera_from(recording.spec("camera"), recording.where)


def camera_from(spec: SensorSpec, place: str) -> Camera:
    """The camera of a specification; errors as of `camera_of`, `place` in them."""
    where = "[sensors.camera]"
    for key in ("noise_std", "focal", "centre"):
        if getattr(spec, key) is None:
            raise InputError(place, "not declared", f"{key} in pixels", f"{where} {key}")
    assert spec.noise_std is not None
    assert spec.focal is not None
    assert spec.centre is not None
    k = np.zeros(0) if spec.coefficients is None else spec.coefficients
    try:
        intrinsics = Intrinsics(spec.focal, spec.centre, spec.lens or "brown", k)
    except ValueError as error:
        raise InputError(place, str(error), "a lens of docs/camera.md", where) from None
    C_bc = LOOKS_AHEAD
    if spec.mounting is not None:
        norm = float(np.linalg.norm(spec.mounting))
        if abs(norm - 1.0) > 0.01:
            raise InputError(place, f"norm {norm:g}", "a quaternion of norm 1", f"{where} mounting")
        C_bc = matrix_from_quaternion(spec.mounting / norm)
    return Camera(spec.noise_std, intrinsics, C_bc, np.zeros(3) if spec.lever_arm is None else spec.lever_arm)


def seen_points(recording: Recording, n: int) -> dict[str, FloatArray]:
    """Covariates `camera` and `point_n` of the n readings of a recording's camera.

    Raises
    ------
    InputError : a point that is not among the known ones, or another number of readings
    """
    stream = recording.streams["camera"]
    if n != len(stream):
        raise ValueError(f"{n} instants; expected those of the {len(stream)} readings, each of its own point")
    known = np.zeros((0, 4)) if recording.points is None else recording.points
    places = {float(row[0]): row[1:] for row in known}
    unknown = [number for number in np.unique(stream["point"]) if float(number) not in places]
    if unknown:
        raise InputError(recording.where, f"point {unknown[0]:g}", "a point of points.csv", "stream camera")
    point_n = np.array([places[float(number)] for number in stream["point"]])
    return {"point_n": point_n, "camera": camera_of(recording).covariate(n)}


_POWER: dict[tuple[int, float | None], tuple[Stream, FloatArray]] = {}


def _with_columns(columns: Sequence[str], *streams: Stream | None) -> Stream | None:
    """The first of the streams that has the columns."""
    return next((stream for stream in streams if stream is not None and stream.has(columns)), None)


def _at(t: FloatArray, stream: Stream, columns: Sequence[str]) -> FloatArray:
    """(n, k) the columns at the instants t, linear in between; beyond the ends the last value holds."""
    if len(stream) == len(t) and np.array_equal(stream.t, t):
        return stream.array(columns)
    return np.stack([np.interp(t, stream.t, stream[name]) for name in columns], axis=-1)


def _vibration(recording: Recording, t: FloatArray) -> FloatArray:
    """(n, 3) vibration of the IMU at the instants t, with the declared noise taken off."""
    from sinan.sensors.vibration import vibration_power

    imu = recording.streams["imu"]
    spec = recording.spec("accel")
    noise = spec.noise_std
    if spec.noise_density is not None and len(imu) > 1:
        noise = sample_std(spec.noise_density, 1.0 / imu.step)
    key = (id(imu), noise)
    if key not in _POWER:  # the same stream is asked many times in a row
        _POWER.clear()
        _POWER[key] = (imu, vibration_power(imu.t, imu.array(ACCEL), noise))
    power = _POWER[key][1]
    return np.stack([np.interp(t, imu.t, column) for column in power.T], axis=-1)
