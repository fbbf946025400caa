"""From a recording to the source that the loop asks: which plain model, which sensor, which noise."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from sinan.calibration.poses.evidence.faults import Fault, poses_that_measured
from sinan.calibration.poses.evidence.poses import NormPoses
from sinan.calibration.poses.evidence.source import LeastSquaresSource
from sinan.calibration.poses.evidence.turns import GyroTurns
from sinan.calibration.poses.gyro import read_turns
from sinan.calibration.poses.segments import find_poses
from sinan.estimator.evidence.source import FieldUnit, field_unit
from sinan.estimator.filter.faults import frozen_runs, stuck_runs
from sinan.estimator.filter.imu import beyond_the_range
from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import STANDARD_GRAVITY
from sinan.sensors.covariates import covariates_for
from sinan.sensors.effects import effect
from sinan.sensors.errors import InputError
from sinan.sensors.formats.header import LARGEST
from sinan.sensors.formats.plausible import OTHER_UNIT
from sinan.sensors.recording import ACCEL, GYRO, MAG, Recording, Stream
from sinan.sensors.window import told_from

#: Rows closer than this are a full-rate log, in which static poses have to be found, else each row is a pose [s]: a
#: pose takes `SHORTEST` + 2 `MARGIN` = 1.4 s, and of 1 / 0.1 = 10 readings a second a window has the 5 that tell a
#: scatter.
_FULL_RATE_STEP = 0.1

Made = TypeVar("Made")


@dataclass(frozen=True)
class TriadReadings:
    """Static or slowly turned readings of one three-axis sensor, as a calibration by norm needs them.

    Attributes
    ----------
    t, reading : (n,) s, (n, 3) divided by `normalised_by`
    norm, unit : of the true reading
    sigma : (n,) declared noise per axis, or None
    walk : declared random walk of the bias, or None
    normalised_by : what the readings were divided by
    covariates : (n,) each
    full_rate : means over the static poses of a log
    """

    sensor: str
    t: FloatArray
    reading: FloatArray
    norm: float
    unit: str
    sigma: FloatArray | None
    walk: float | None
    normalised_by: float
    covariates: dict[str, FloatArray]
    full_rate: bool = False


def sensors_in_poses(recording: Recording) -> tuple[str, ...]:
    """The sensors that a poses recording can calibrate."""
    columns = {name: stream.columns for name, stream in recording.streams.items()}
    rows = columns.get("poses", {})
    found = []
    if "accel_x" in rows or "imu" in columns:
        found.append("accel")
    if "imu" in columns:
        found.append("gyro")
    if "mag_x" in rows or "mag" in columns:
        found.append("mag")
    return tuple(found)


def sensors_asked_for(recording: Recording, sensor: str | None) -> tuple[str, ...]:
    """The sensor asked for, or all that there are.

    Raises
    ------
    InputError : not there
    """
    there = sensors_in_poses(recording)
    if sensor is None:
        return there
    if sensor not in there:
        raise InputError(
            recording.where, f"no {sensor} (there are {', '.join(there) or 'none'})", "a sensor that is there"
        )
    return (sensor,)


def of_each_sensor(
    recording: Recording, sensors: Iterable[str], make: Callable[[str], Made]
) -> tuple[dict[str, Made], dict[str, str]]:
    """What is made of each sensor, and of the others why it cannot be made.

    Raises
    ------
    InputError : it can be made of none
    """
    done, failed = dict[str, Made](), dict[str, InputError]()
    for sensor in sensors:
        try:
            done[sensor] = make(sensor)
        except InputError as error:
            failed[sensor] = error
    if len(failed) == 1 and not done:
        raise next(iter(failed.values()))
    why = {sensor: f"{error.found}; expected {error.expected}" for sensor, error in failed.items()}
    if not done:
        raise InputError(
            recording.where, "; ".join(f"{s}: {e.found}" for s, e in failed.items()), "poses of one of them"
        )
    return done, why


def require_recording(recording: object) -> None:
    """Raise unless something is a recording: a script may give the name of one."""
    if not isinstance(recording, Recording):
        raise InputError("recording", repr(recording), "a `Recording`, of `sinan.read` or `sinan.simulate`")


def require_kind(recording: Recording, kind: str, command: str, instead: str) -> None:
    """Raise unless the recording is one, and of a kind, naming the command that fits."""
    require_recording(recording)
    if recording.kind != kind:
        raise InputError(recording.where, f'kind = "{recording.kind}"', f'"{kind}" for {command}; {instead} fits')


def triad_readings(recording: Recording, sensor: str, gravity: float | None = None) -> TriadReadings:
    """The readings of an accelerometer or magnetometer in a poses recording, and the norm they are aimed at.

    An accelerometer's full-rate log is averaged over its static poses; rows of `poses.csv` and readings of a slowly
    turned magnetometer are taken as they are. Norm: accel `gravity`, else what the recording declares, else 9.80665;
    mag the declared field's, else 1 with the readings divided by their mean norm.
    """
    if sensor == "accel":
        t, reading, sigma = _accel_readings(recording)
        norm = gravity_of(recording, gravity)
        unit, divisor = "m/s^2", 1.0
    else:
        t, reading, sigma = _mag_readings(recording)
        field = recording.environment.magnetic_field
        norm, divisor, unit = 1.0, 1.0, "1"
        if field is None:
            divisor = float(np.mean(np.linalg.norm(reading, axis=1))) or 1.0
        else:
            norm = float(np.linalg.norm(field))
            unit = field_unit(norm, recording.environment.field_unit)
            _require_unit_of_field(recording.where, reading, norm)
    spec = recording.spec(sensor)
    walk = None if spec.bias_walk is None else spec.bias_walk / divisor
    return TriadReadings(
        sensor,
        t,
        reading / divisor,
        norm,
        unit,
        None if sigma is None else sigma / divisor,
        walk,
        divisor,
        covariates_for(recording, sensor, t),
        sensor == "accel" and _full_rate_log(recording) is not None,
    )


def gravity_of(recording: Recording, gravity: float | None) -> float:
    """Gravity [m/s^2]: what the user says, else what the recording declares, else the standard one.

    Raises
    ------
    InputError : not a positive number
    """
    if gravity is None:
        return recording.environment.gravity or STANDARD_GRAVITY
    if not 0.0 < gravity <= LARGEST:
        raise InputError("--gravity", f"{gravity}", f"a number above 0 and at most {LARGEST:g} [m/s^2]")
    return gravity


def _require_unit_of_field(where: str, reading: FloatArray, norm: float) -> None:
    """Raise if the readings cannot be in the unit of the declared field.

    They spread over a sphere of its norm, wherever an offset has put it; few directions make the spread smaller.
    """
    spread = float(np.median(np.linalg.norm(reading - np.median(reading, axis=0), axis=1)))
    longest = float(np.max(np.linalg.norm(reading, axis=1)))
    if spread > OTHER_UNIT * norm or max(spread, longest) * OTHER_UNIT < norm:
        raise InputError(
            where,
            f"magnetometer readings that spread over {spread:.3g}, a declared magnetic_field of {norm:.3g}: looks like "
            "another unit",
            "[environment] magnetic_field in the unit of the readings (or none)",
        )


def _accel_readings(recording: Recording) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    spec = recording.spec("accel")
    stream = _full_rate_log(recording)
    if stream is None:
        poses = recording.streams["poses"]
        return poses.t, poses.array(ACCEL), _row_sigma(spec.noise_std, len(poses))
    gyro = stream.array(GYRO) if stream.has(GYRO) else None
    still = find_poses(stream.t, stream.array(ACCEL), gyro, where=recording.where, at_least=6)
    lasting = stream.t[still.stop - 1] - stream.t[still.start]
    sigma = None
    if spec.noise_density is not None:
        sigma = spec.noise_density / np.sqrt(lasting)
    elif stream is recording.streams.get("poses") and spec.noise_std is not None:
        sigma = spec.noise_std / np.sqrt(still.count)
    if sigma is not None:  # a bias that wanders makes a mean differ from its middle
        sigma = np.hypot(sigma, (spec.bias_walk or 0.0) * np.sqrt(lasting / 12.0))
    return still.t, still.mean[:, :3], sigma


def _full_rate_log(recording: Recording) -> Stream | None:
    """The accelerometer's full-rate log, in which static poses have to be found; None: each row is a pose."""
    poses = recording.streams.get("poses")
    if poses is None or not poses.has(ACCEL):
        return recording.streams["imu"]
    return None if len(poses) < 2 or np.median(np.diff(poses.t)) >= _FULL_RATE_STEP else poses


def _mag_readings(recording: Recording) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    stream: Stream = recording.streams["mag"] if "mag" in recording.streams else recording.streams["poses"]
    return stream.t, stream.array(MAG), _row_sigma(recording.spec("mag").noise_std, len(stream))


def _row_sigma(noise_std: float | None, n: int) -> FloatArray | None:
    return None if not noise_std else np.full(n, noise_std)


def pose_source(recording: Recording, sensor: str | None = None, gravity: float | None = None) -> LeastSquaresSource:
    """The source of one sensor of a poses recording.

    Raises
    ------
    InputError : the sensor is not there; there are several, and none is named
    """
    sensor, *others = sensors_asked_for(recording, sensor)
    if others:
        raise InputError(recording.where, f"sensors {', '.join((sensor, *others))}", "one of them")
    if sensor == "gyro":
        return LeastSquaresSource(_turns(recording, gravity, declared_for(recording, sensor)), told_from(recording))
    return LeastSquaresSource(norm_poses(recording, triad_readings(recording, sensor, gravity)), told_from(recording))


def declared_for(recording: Recording, sensor: str, normalised_by: float = 1.0) -> dict[str, tuple[float, ...]]:
    """The declared effects of a sensor, in the unit of its readings divided by `normalised_by`."""
    named = {name: beta for name, beta in recording.effects.items() if name.startswith(f"{sensor}.")}
    return {
        name: tuple(b / normalised_by for b in beta) if effect(name).in_field_units else beta
        for name, beta in named.items()
    }


def norm_poses(recording: Recording, r: TriadReadings) -> NormPoses:
    """The readings of an accelerometer or magnetometer as a problem, with the effects that the recording declares."""
    declared = declared_for(recording, r.sensor, r.normalised_by)
    keep, faults = poses_that_measured(r.sensor, r.t, r.reading, r.norm, r.sigma, recording.where)
    return NormPoses(
        recording.name,
        r.sensor,
        r.t[keep],
        r.reading[keep],
        r.norm,
        r.unit,
        None if r.sigma is None else r.sigma[keep],
        r.walk,
        {name: value[keep] for name, value in r.covariates.items()},
        declared,
        recording.where,
        r.full_rate,
        faults,
        FieldUnit(recording.environment.field_unit if r.sensor == "mag" else "", r.normalised_by),
    )


def _turns(recording: Recording, gravity: float | None, declared: dict[str, tuple[float, ...]]) -> GyroTurns:
    imu = recording.streams["imu"]
    gyro, accel = recording.spec("gyro"), recording.spec("accel")
    known = gyro.noise_density is not None and accel.noise_density is not None
    log = read_turns(
        imu.t,
        imu.array(ACCEL),
        imu.array(GYRO),
        gravity_of(recording, gravity),
        gyro.noise_density,
        accel.noise_density,
        recording.where,
    )
    covariates = covariates_for(recording, "gyro", imu.t)
    earth = recording.environment.earth_rotation
    return GyroTurns(
        recording.name, log, known, gyro.bias_walk, covariates, declared, earth, recording.where, accel.bias_walk,
        _faults_of_log(imu),
    )  # fmt: skip


def _faults_of_log(imu: Stream) -> tuple[Fault, ...]:
    """Stretches of a full-rate log in which the IMU was frozen, an axis stuck, or beyond its range."""
    t, u = imu.t, imu.array((*ACCEL, *GYRO))
    found = [("imu", "frozen", float(t[a]), float(t[b - 1])) for a, b in frozen_runs(u)]
    _, notes = beyond_the_range(t, u)
    found += [(note.stream, note.kind, note.start, note.stop) for note in notes]
    for name, part in (("accel", slice(0, 3)), ("gyro", slice(3, 6))):
        for a, b in stuck_runs(u[:, part]):
            stretch = (name, "frozen", float(t[a]), float(t[b - 1]))
            if not any(f[0] == name and f[2] <= stretch[3] and f[3] >= stretch[2] for f in found):
                found.append(stretch)
    return tuple(found)
