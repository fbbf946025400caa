"""The first state: from what the recording declares, and what it does not declare from its first readings.

Attitude from the mean specific force (down) and the field (heading), with the covariance that the sensors' biases,
their
noise and the motion during the window leave, and its correlation with the biases. Position and velocity from the first
readings of GPS and barometer, with a sigma so wide that using the same reading again as an update does not count it
twice.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from estimator.flight_model import FlightModel
from sensors.arrays import FloatArray
from sensors.errors import InputError
from sensors.recording import ACCEL, MAG, POSITION, VELOCITY, Recording
from sensors.rotation import quaternion_conjugate, quaternion_from_matrix, quaternion_log, quaternion_multiply

WINDOW = 1.0  # s, over which the first specific force and field are averaged
WIDE = 10.0  # sigma of a state that starts from one reading, in sigmas of that reading: reuse counts 1 % of it twice
UNKNOWN_ATTITUDE = np.pi / np.sqrt(3.0)  # rad, of a heading that nothing shows: uniform over the circle
UNKNOWN_VELOCITY = 5.0  # m/s, of a body of which nothing is known but that it is carried or flies
UNKNOWN_POSITION = 1.0  # m, along axes that nothing aids: the origin is where the recording starts


def first_state(recording: Recording, model: FlightModel) -> tuple[FloatArray, FloatArray]:
    """Nominal state (n + 1,) and covariance (n, n) at the first IMU sample.

    Raises
    ------
    InputError : a first state that cannot be: not finite, a quaternion of no length, negative sigmas
    """
    layout, initial = model.layout, recording.initial
    _check(recording)
    x, P = np.zeros(layout.n + 1), np.zeros((layout.n, layout.n))
    for process in [model.accel.bias, model.gyro.bias, *(s.bias for s in model.sensors.values())]:
        if process is not None:
            block = layout.slice(process.block)
            P[block, block] = np.eye(process.size) * process.std**2
    position, velocity = _first_position(recording, model), _first_velocity(recording, model)
    for name, declared, std, found in (
        ("position", initial.position, initial.position_std, position),
        ("velocity", initial.velocity, initial.velocity_std, velocity),
    ):
        block = layout.slice(name)
        x[block] = found[0] if declared is None else declared
        if model.translation:
            P[block, block] = np.diag(found[1] ** 2 if std is None else np.full(3, std**2))
    if initial.quaternion is not None:
        x[6:10] = initial.quaternion / np.linalg.norm(initial.quaternion)
        if initial.attitude_std is not None:
            P[6:9, 6:9] = np.eye(3) * initial.attitude_std**2
            return x, P
    x_aligned, P_attitude, cross = align(recording, model)
    if initial.quaternion is None:
        x[6:10] = x_aligned
    if initial.attitude_std is not None:
        P[6:9, 6:9] = np.eye(3) * initial.attitude_std**2
        return x, P
    P[6:9, 6:9] = P_attitude
    for name, block_cross in cross.items():
        if layout.has(name):
            P[6:9, layout.slice(name)] = block_cross
            P[layout.slice(name), 6:9] = block_cross.T
    return x, P


def attitude_from_vectors(f_b: FloatArray, m_b: FloatArray | None, m_n: FloatArray) -> FloatArray:
    """(4,) q_nb whose down is -f_b and whose heading turns m_b to the azimuth of m_n; no field: heading zero.

    Rows of C_nb are north, east and down in the body: down = -f / |f|, then the field's horizontal part (TRIAD).
    """
    down = -f_b / np.linalg.norm(f_b)
    azimuth = 0.0
    if m_b is None:
        seen = np.array([1.0, 0.0, 0.0]) if abs(down[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    else:
        seen, azimuth = m_b, np.arctan2(m_n[1], m_n[0])
    level = seen - (seen @ down) * down
    ahead = level / np.linalg.norm(level)
    right = np.cross(down, ahead)
    north = np.cos(azimuth) * ahead - np.sin(azimuth) * right
    east = np.sin(azimuth) * ahead + np.cos(azimuth) * right
    return quaternion_from_matrix(np.stack([north, east, down]))


def align(recording: Recording, model: FlightModel) -> tuple[FloatArray, FloatArray, dict[str, FloatArray]]:
    """Attitude from the first `WINDOW`, its covariance (3, 3), and its covariance with b_accel and b_mag.

    d(dtheta_b) = -J_f (b_accel + n + a) - J_m (b_mag + n): J from differences of the construction itself; a is the
    motion,
    as large as the mean force misses gravity and as the force scatters. The field counts with the noise of one reading,
    since the filter uses the same readings again.

    Neglects accel.scale, accel.misalignment and every mag.* effect; turns during the window.
    """
    imu = recording.streams["imu"]
    window = imu.t <= imu.t[0] + WINDOW
    f = imu.array(ACCEL)[window]
    f_b, m_b = f.mean(axis=0), None
    if np.linalg.norm(f_b) < 0.1 * np.linalg.norm(model.g_n):
        raise InputError(recording.where, "free fall in the first second", "[initial] quaternion", "stream imu")
    magnetic = "mag" in model.sensors and float(np.hypot(*model.m_n[:2])) > 0.0
    if magnetic:
        stream = recording.streams["mag"]
        near = np.argsort(np.abs(stream.t - imu.t[0] - 0.5 * WINDOW))[
            : max(1, int(np.sum(stream.t <= imu.t[0] + WINDOW)))
        ]
        m_b = stream.array(MAG)[near].mean(axis=0)
    q = attitude_from_vectors(f_b, m_b, model.m_n)
    J_f = _differences(lambda v: attitude_from_vectors(v, m_b, model.m_n), f_b, q)
    motion = np.hypot(np.linalg.norm(f_b) - np.linalg.norm(model.g_n), np.std(f, axis=0).max())
    spread = model.accel.bias_std**2 + model.accel.sigma**2 / len(f) + motion**2
    covariance = spread * J_f @ J_f.T
    cross = {"b_accel": -(model.accel.bias_std**2) * J_f}
    if m_b is None:
        covariance += UNKNOWN_ATTITUDE**2 * np.outer(-f_b, -f_b) / (f_b @ f_b)
        return q, covariance, cross
    mag = model.sensors["mag"]
    bias_std = 0.0 if mag.bias is None else mag.bias.std
    J_m = _differences(lambda v: attitude_from_vectors(f_b, v, model.m_n), m_b, q)
    covariance += (bias_std**2 + float(mag.R[0, 0])) * J_m @ J_m.T
    return q, covariance, {**cross, "b_mag": -(bias_std**2) * J_m}


def _differences(function: Callable[[FloatArray], FloatArray], v: FloatArray, q: FloatArray) -> FloatArray:
    """(3, 3) derivative of the rotation vector q^-1 q(v) with v, central differences."""
    step = 1e-5 * float(np.linalg.norm(v))
    columns = []
    for axis in np.eye(3):
        ends = [
            quaternion_log(quaternion_multiply(quaternion_conjugate(q), function(v + s * step * axis)))
            for s in (1.0, -1.0)
        ]
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    return np.stack(columns, axis=1)


def _first_position(recording: Recording, model: FlightModel) -> tuple[FloatArray, FloatArray]:
    """Position [m] and its 1-sigma from the first GPS fix, else the first height."""
    p, sigma = np.zeros(3), np.full(3, UNKNOWN_POSITION)
    if "gps" in model.sensors:
        stream, gps = recording.streams["gps"], model.sensors["gps"]
        waited = max(0.0, float(stream.t[0] - recording.streams["imu"].t[0]))
        spread = np.hypot(np.sqrt(gps.R[0, 0]), 0.0 if gps.bias is None else gps.bias.std)
        return stream.array(POSITION)[0], np.full(3, WIDE * spread + UNKNOWN_VELOCITY * waited)
    for name in ("baro", "laser", "sonar"):
        if name not in model.sensors:
            continue
        from estimator.events import readings

        sensor = model.sensors[name]
        first = float(readings(recording, model, name)[0][0, 0])
        p[2] = -first if name == "baro" else model.ground_down - first
        sigma[2] = WIDE * np.hypot(np.sqrt(sensor.R[0, 0]), 0.0 if sensor.bias is None else sensor.bias.std)
        break
    return p, sigma


def _first_velocity(recording: Recording, model: FlightModel) -> tuple[FloatArray, FloatArray]:
    """Velocity [m/s] and its 1-sigma from the first GPS velocity, else unknown."""
    if "gps" in model.sensors and recording.streams["gps"].has(VELOCITY):
        stream, gps = recording.streams["gps"], model.sensors["gps"]
        waited = max(0.0, float(stream.t[0] - recording.streams["imu"].t[0]))
        return stream.array(VELOCITY)[0], np.full(3, WIDE * np.sqrt(gps.R[3, 3]) + UNKNOWN_VELOCITY * min(waited, 1.0))
    return np.zeros(3), np.full(3, UNKNOWN_VELOCITY)


def _check(recording: Recording) -> None:
    initial = recording.initial
    for key in ("position", "velocity", "quaternion"):
        value = getattr(initial, key)
        length = 4 if key == "quaternion" else 3
        if value is None:
            continue
        value = np.asarray(value, dtype=np.float64)
        if value.shape != (length,) or not np.all(np.isfinite(value)):
            raise InputError(recording.where, f"{value.tolist()}", f"{length} finite numbers", f"[initial] {key}")
        if key == "quaternion" and not 0.5 < float(np.linalg.norm(value)) < 2.0:
            found = f"a quaternion of length {np.linalg.norm(value):.3g}"
            raise InputError(recording.where, found, "length 1, scalar first", "[initial] quaternion")
    for key in ("position_std", "velocity_std", "attitude_std"):
        value = getattr(initial, key)
        if value is not None and not (np.isfinite(value) and value >= 0.0):
            raise InputError(recording.where, f"{value:g}", "zero or a positive number", f"[initial] {key}")


def field_of_the_log(recording: Recording) -> FloatArray:
    """(3,) field of a log that declares none: norm and dip as its own readings have them, north is magnetic north.

    Median over the log of |m| and of the angle between field and specific force. Neglects the magnetometer's bias and
    scale, and accelerations longer than the log's median sees.
    """
    mag, imu = recording.streams["mag"], recording.streams["imu"]
    m = mag.array(MAG)
    f = np.stack([np.interp(mag.t, imu.t, imu[name]) for name in ACCEL], axis=-1)
    norm = np.linalg.norm(m, axis=1)
    down = -np.sum(m * f, axis=1) / np.maximum(norm * np.linalg.norm(f, axis=1), 1e-12)
    sine = float(np.median(down))
    return float(np.median(norm)) * np.array([np.sqrt(1.0 - sine**2), 0.0, sine])
