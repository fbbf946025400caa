"""The first state: from what the recording declares, and what it does not declare from its first readings.

Attitude from the mean specific force (down) and the field (heading), in motion from force and velocities of the first
seconds (`alignment_in_motion`), with the covariance that biases, noise and motion leave, and its correlation with the
biases. Position and velocity from the first readings of
GPS and barometer, with a sigma so wide that using them again as updates does not count them twice.
"""

from __future__ import annotations

import numpy as np

from sinan.estimator.filter.alignment_in_motion import Field, align_in_motion
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import FlightModel
from sinan.estimator.filter.layout import DTHETA, Q_NB
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.gps import Gps
from sinan.sensors.recording import ACCEL, GYRO, MAG, POSITION, VELOCITY, Recording, tells_height
from sinan.sensors.registry import is_sensor, sensor
from sinan.sensors.rotation import (
    cross,
    quaternion_conjugate,
    quaternion_from_matrix,
    quaternion_interpolate,
    rotate,
    rpy_from_quaternion,
    skew,
    turned_since_start,
)

#: Over which the first specific force and field are averaged [s]: meanwhile a rate that is off by 0.01 rad/s turns them
#: by 0.01 * 1 / 2 = 5 mrad about the middle, as much as an accelerometer that is off by 0.05 m/s^2 tilts.
WINDOW = 1.0
#: Sensors whose bias and colour the first attitude depends on.
ALIGNING = ("accel", "gyro", "mag")
WIDE = 10.0  # sigma of a state that starts from one reading, in sigmas of that: reuse counts 1 / 10^2 = 1 % of it twice
#: Sigmas that a sensor at rest may scatter and stand off zero: a choice. Half changes nothing on a table that shakes
#: 2.5 times as much as the noise, twice makes the sigma of the tilt on one that shakes 6 times as much less by a
#: quarter (`bounds_of_work shaky`).
AT_REST = 4.0
UNKNOWN_ATTITUDE = np.pi / np.sqrt(3.0)  # rad, of a heading that nothing shows: of +-a, uniform, sigma = a / sqrt(3)
#: Of a body of which nothing is known but that it is carried or flies [m/s]: a choice. Half and twice make
#: half and twice the sigma of the place of a hover without a GPS (`bounds_of_work unaided`).
UNKNOWN_VELOCITY = 5.0
#: Along axes that nothing aids, where the origin is the place at which the recording starts [m]: a choice.
#: Half and twice move a hover without a GPS by 2e-5 of its sigma (`bounds_of_work unaided`).
UNKNOWN_POSITION = 1.0
#: The horizontal direction that counts as ahead where no field is read: since any heading of one turn is as likely then
#: (`UNKNOWN_ATTITUDE`), none is nearer to the truth than another.
_NORTH = np.array([1.0, 0.0, 0.0])


def first_state(flight: Flight) -> tuple[FloatArray, FloatArray]:
    """Nominal state (n + 1,) and covariance (n, n) at the first IMU sample.

    Raises
    ------
    InputError : a first state that cannot be: not finite, a quaternion of no length, negative sigmas
    """
    model, layout, initial = flight.model, flight.model.layout, flight.recording.initial
    _check(flight.recording)
    x, P = np.zeros(layout.n + 1), np.zeros((layout.n, layout.n))
    for process in model.processes:
        block = layout.slice(process.block)
        P[block, block] = np.eye(process.size) * process.std**2
    if model.field is not None:
        P[layout.slice("field"), layout.slice("field")] = model.field
    if model.iron is not None and layout.has("b_mag"):
        x[layout.nominal("b_mag")] = model.iron
    flight = _of_what_is_there(flight)
    q, P_attitude, cross_covariances = _first_attitude(flight)
    x[Q_NB], P[DTHETA, DTHETA] = q, P_attitude
    for name, cross_covariance in cross_covariances.items():
        if layout.has(name):
            P[DTHETA, layout.slice(name)] = cross_covariance
            P[layout.slice(name), DTHETA] = cross_covariance.T
    _put_first_motion(flight, x, P)
    if model.own_north and model.field is not None and initial.quaternion is None:
        P = _north_of_first_heading(q, P, model)
    return x, P


def with_first_motion(flight: Flight, x: FloatArray, P: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A first state and its covariance with the position and the velocity that a flight's readings and noise say."""
    x, P = x.copy(), P.copy()
    _put_first_motion(_of_what_is_there(flight), x, P)
    return x, P


def _put_first_motion(flight: Flight, x: FloatArray, P: FloatArray) -> None:
    """Put first position and velocity, declared or found, into a first state with an attitude."""
    layout, initial = flight.model.layout, flight.recording.initial
    position, velocity = _first_position(flight, x[Q_NB]), _first_velocity(flight)
    for name, declared, std, found in (
        ("position", initial.position, initial.position_std, position),
        ("velocity", initial.velocity, initial.velocity_std, velocity),
    ):
        block = layout.slice(name)
        x[block] = found[0] if declared is None else declared
        if flight.model.translation:
            P[block, block] = np.diag(found[1] ** 2 if std is None else np.full(3, std**2))


def _north_of_first_heading(q_nb: FloatArray, P: FloatArray, model: FlightModel) -> FloatArray:
    """(n, n) covariance of the first state where its heading is right by definition.

    Where nothing but the compass tells a direction (`FlightModel.own_north`), all that is measured is the same for a
    body, a motion and a field turned about the vertical together. So the error of the heading, h = d . C_nb dtheta
    about the vertical d, may be taken off all of them: dtheta - C_bn d h, and the field's error less (d x m_n) h, which
    then is that of the declination.
    """
    layout, down = model.layout, np.array([0.0, 0.0, 1.0])
    down_b = rotate(quaternion_conjugate(q_nb), down)
    T = np.eye(layout.n)
    T[DTHETA, DTHETA] -= np.outer(down_b, down_b)
    T[layout.slice("field"), DTHETA] -= np.outer(np.cross(down, model.m_n), down_b)
    return T @ P @ T.T


def _of_what_is_there(flight: Flight) -> Flight:
    """The flight without readings from before the first IMU sample, which say where the body was then; and without
    sensors that have no reading here: a stretch may lack a stream that others have.
    """
    streams, sensors, start = flight.recording.streams, flight.model.sensors, flight.recording.streams["imu"].t[0]
    early = {name for name in sensors if name in streams and streams[name].t[0] < start}
    if early:
        later = {name: one.rows(one.t >= start) if name in early else one for name, one in streams.items()}
        streams = {name: one for name, one in later.items() if len(one)}
        flight = flight.reading(flight.recording.replace(streams=streams))
    there = {
        name: model_of
        for name, model_of in sensors.items()
        if not is_sensor(name) or (name in streams and len(streams[name]))
    }
    return flight if len(there) == len(sensors) else flight.believing(sensors=there)


def _first_attitude(flight: Flight) -> tuple[FloatArray, FloatArray, dict[str, FloatArray]]:
    """q_nb, its covariance (3, 3) and that with the biases: what is declared, the rest as `align` finds it."""
    initial, known = flight.recording.initial, {}
    if initial.quaternion is not None:
        known["q"] = initial.quaternion / np.linalg.norm(initial.quaternion)
    if initial.attitude_std is not None:
        known["P"] = np.eye(3) * initial.attitude_std**2
    if len(known) == 2:
        return known["q"], known["P"], {}
    q, P, cross_covariances = align(flight)
    return known.get("q", q), known.get("P", P), {} if "P" in known else cross_covariances


def attitude_from_vectors(f_b: FloatArray, m_b: FloatArray | None, f_n: FloatArray, m_n: FloatArray) -> FloatArray:
    """(..., 4) q_nb that turns f_b (..., 3) exactly, and m_b (..., 3) as nearly as it can, to f_n and m_n; no field:
    north is ahead (TRIAD).

    Source: M. D. Shuster, S. D. Oh, J. Guidance 4(1), 1981, eqs. 6 to 14.
    """
    m_b, m_n = (_ahead(f_b), _NORTH) if m_b is None else (m_b, m_n)
    return quaternion_from_matrix(np.swapaxes(_triad(f_n, m_n), -1, -2) @ _triad(f_b, m_b))


def _ahead(f_b: FloatArray) -> FloatArray:
    """(..., 3) the body axis that counts as ahead: x, unless the force (..., 3) lies along it."""
    is_along = np.abs(f_b[..., :1]) > 0.9 * np.linalg.norm(f_b, axis=-1, keepdims=True)
    return np.where(is_along, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])


def _triad(first: FloatArray, second: FloatArray) -> FloatArray:
    """(..., 3, 3) orthonormal rows along `first`, across both, and the third."""
    a = first / np.linalg.norm(first, axis=-1, keepdims=True)
    across = cross(a, second)
    b = across / np.linalg.norm(across, axis=-1, keepdims=True)
    return np.stack([np.broadcast_to(a, b.shape), b, cross(a, b)], axis=-2)


def _slopes(
    f_b: FloatArray, m_b: FloatArray | None, f_n: FloatArray, m_n: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(3, 3) each: how far dtheta_b of `attitude_from_vectors` goes with f_b, with m_b and with m_n.

    With a, b, c the triad in the body: a change turns it by w, where w . c = b . da, w . b = -c . da, w . a = c . db;
    da is df / |f| across a, and of db that counts along c, c . db = (b . dm - (a . m) b . da) / |a x m|. The attitude
    follows by dtheta_b = -w, and by C_bn w_n where the triad of the navigation frame turns.
    """
    m_b, m_n = (_ahead(f_b), _NORTH) if m_b is None else (m_b, m_n)
    (a, b, c), (up, west, _) = _triad(f_b, m_b), _triad(f_n, m_n)
    along, across = float(a @ m_b), float(np.linalg.norm(np.cross(a, m_b)))
    J_f = (along / across * np.outer(a, b) + np.outer(b, c) - np.outer(c, b)) / np.linalg.norm(f_b)
    return J_f, -np.outer(a, b) / across, np.outer(a, west) / np.linalg.norm(np.cross(up, m_n))


def align(flight: Flight) -> tuple[FloatArray, FloatArray, dict[str, FloatArray]]:
    """Attitude from the first `WINDOW`, its covariance (3, 3), and its covariance with the biases and the colour in it.

    Force and field are turned back to the first instant with the gyroscope and averaged; the force is that of gravity
    and, where a GPS gives velocities, of the acceleration between them. A body in motion that has enough of those
    starts as `align_in_motion` has it.

        d(dtheta_b) = -J_f (b_accel + n + a) - J_m (b_mag + c_mag + m x t + n) + J_n d(m_n)

    J of `_slopes`; a is the acceleration that nobody told (`_unknown_acceleration`).
    The field counts with the noise of one reading, since the filter uses the same readings again.

    Neglects accel.scale, accel.misalignment and every mag.* effect but the turn of the compass's axes, where that is a
    state; the gyroscope's bias over the window.
    """
    model, imu = flight.model, flight.recording.streams["imu"]
    window = imu.t <= imu.t[0] + WINDOW
    turn = turned_since_start(imu.t[window], imu.array(GYRO)[window])
    f = rotate(turn, imu.array(ACCEL)[window])
    f_b = f.mean(axis=0)
    if np.linalg.norm(f_b) < 0.1 * np.linalg.norm(model.g_n):
        raise InputError(flight.where, "free fall in the first second", "[initial] quaternion", "stream imu")
    at_rest = _at_rest(f, imu.array(GYRO)[window], model)
    field = _first_field(flight, imu.t[window], turn)
    moving = None if at_rest else align_in_motion(flight, field)
    if moving is not None:
        return moving
    a_n, spread = _acceleration(flight)
    if spread is None:
        a_n, spread = np.zeros(3), _unknown_acceleration(f, f_b, model, at_rest)
    f_n, m_b = a_n - model.g_n, None if field is None else field.m_b
    q = attitude_from_vectors(f_b, m_b, f_n, model.m_n)
    J_f, J_m, J_n = _slopes(f_b, m_b, f_n, model.m_n)
    noise = model.accel.bias_std**2 + model.accel.sigma**2 / len(f) + spread**2
    covariance = noise * J_f @ J_f.T
    cross_covariances = {"b_accel": -(model.accel.bias_std**2) * J_f}
    if field is None:
        covariance = covariance + UNKNOWN_ATTITUDE**2 * np.outer(f_b, f_b) / (f_b @ f_b)
        return q, covariance, cross_covariances
    read = field.variance * np.eye(3) + sum(field.wrong)
    covariance = covariance + J_m @ read @ J_m.T
    cross_covariances |= {name: -J_m @ A @ P for name, A, P in field.errors}
    if field.of_place is not None:
        covariance, cross_covariances["field"] = covariance + J_n @ field.of_place @ J_n.T, J_n @ field.of_place
    return q, covariance, cross_covariances


def _first_field(flight: Flight, t: FloatArray, turn: FloatArray) -> Field | None:
    """The field of the window, its readings turned back (t, turn: the IMU's) and averaged; None: no compass.

    Of a compass that begins later, its first reading, turned back over all that time, to what the gyroscope's bias may
    have turned meanwhile.
    """
    model = flight.model
    if "mag" not in model.sensors or float(np.hypot(*model.m_n[:2])) == 0.0:
        return None
    stream, mag = flight.recording.streams["mag"], model.sensors["mag"]
    near = np.flatnonzero((stream.t >= t[0]) & (stream.t <= t[0] + WINDOW))
    unknown_turn = 0.0
    if not len(near):
        near = np.array([int(np.argmin(np.abs(stream.t - t[0])))])
        imu = flight.recording.streams["imu"]
        until = imu.t <= max(float(stream.t[near[0]]), t[-1])
        t = imu.t[until]
        turn = turned_since_start(t, imu.array(GYRO)[until])
        unknown_turn = min(model.gyro.bias_std * float(t[-1] - t[0]), UNKNOWN_ATTITUDE)
    back = quaternion_interpolate(np.clip(stream.t[near], t[0], t[-1]), t, turn)
    iron = np.zeros(3) if model.iron is None else model.iron
    m_b = rotate(back, stream.array(MAG)[near] - iron).mean(axis=0)
    variance = float(mag.R[0, 0]) + float(m_b @ m_b) * unknown_turn**2
    processes = [
        process for process in (mag.bias, *(part for _, part in model.colour_of("mag"))) if process is not None
    ]
    to_first = np.stack([rotate(back, axis).mean(axis=0) for axis in np.eye(3)], axis=-1)
    errors = [(process.block, to_first, process.std**2 * np.eye(3)) for process in processes]
    if model.turn is not None:
        errors.append((model.turn.block, skew(m_b) @ to_first, model.turn.std**2 * np.eye(3)))
    return Field(m_b, model.m_n, variance, tuple(errors), model.field)


def _acceleration(flight: Flight) -> tuple[FloatArray, float | None]:
    """Mean acceleration over the window from the GPS velocities around it [m/s^2], and its 1-sigma; None: not known."""
    model, streams = flight.model, flight.recording.streams
    if "gps" not in model.sensors or not streams["gps"].has(VELOCITY):
        return np.zeros(3), None
    gps, t0 = streams["gps"], streams["imu"].t[0]
    i0, i1 = int(np.argmin(np.abs(gps.t - t0))), int(np.argmin(np.abs(gps.t - t0 - WINDOW)))
    missed = abs(gps.t[i0] - t0) + abs(gps.t[i1] - t0 - WINDOW)
    if i1 == i0 or missed > 0.5 * WINDOW:
        return np.zeros(3), None
    v = gps.array(VELOCITY)
    span = float(gps.t[i1] - gps.t[i0])
    a_n = (v[i1] - v[i0]) / span
    return a_n, float(np.sqrt(2.0 * model.sensors["gps"].R[3, 3]) / span + np.linalg.norm(a_n) * missed / WINDOW)


def _at_rest(f: FloatArray, w: FloatArray, model: FlightModel) -> bool:
    """Whether force and rate scatter and stand as those of instruments at rest."""
    quiet = np.all(np.std(f, axis=0) < AT_REST * model.accel.sigma) and np.all(
        np.std(w, axis=0) < AT_REST * model.gyro.sigma
    )
    return bool(quiet and np.all(np.abs(w.mean(axis=0)) < AT_REST * (model.gyro.bias_std + model.gyro.sigma)))


def _unknown_acceleration(f: FloatArray, f_b: FloatArray, model: FlightModel, at_rest: bool) -> float:
    """1-sigma per axis of the mean acceleration, of which nothing is known but what the force shows [m/s^2].

    At rest none. In motion a horizontal acceleration a makes |f|^2 = g^2 + a^2, and what changes over the window
    shows too.
    """
    if at_rest:
        return 0.0
    g = float(np.linalg.norm(model.g_n))
    return float(np.hypot(np.sqrt(abs(f_b @ f_b - g * g) / 2.0), np.std(f, axis=0).max()))


def _first_position(flight: Flight, q_nb: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Position [m] and its 1-sigma from the first GPS fix; where that tells no height from the first height, a range's
    with the first tilt, else from the first fix that tells one.
    """
    from sinan.estimator.filter.events import readings, white_shares

    p, sigma = np.zeros(3), np.full(3, UNKNOWN_POSITION)
    model, streams = flight.model, flight.recording.streams
    if "gps" in model.sensors:
        stream, gps = streams["gps"], model.sensors["gps"]
        waited = stream.t - streams["imu"].t[0]
        white = np.sqrt(np.diag(gps.R)[:3] * white_shares(flight, "gps")[:, :3])
        spread = np.hypot(white, 0.0 if gps.bias is None else gps.bias.std)
        fixes = stream.array(POSITION)
        if isinstance(gps, Gps) and gps.lead != 0.0:
            fixes = fixes - gps.lead * stream.array(VELOCITY)
        sigmas = WIDE * spread + UNKNOWN_VELOCITY * waited[:, None]
        p[:2], sigma[:2] = fixes[0, :2], sigmas[0, :2]
        told = np.flatnonzero(tells_height(stream))
        if len(told):
            p[2], sigma[2] = fixes[told[0], 2], sigmas[told[0], 2]
            if told[0] == 0:
                return p, sigma
    heights = [sensor(name) for name in model.sensors if is_sensor(name)]
    for entry in sorted(heights, key=lambda entry: entry.height_turn):
        if entry.height is None:
            continue
        instrument = model.sensors[entry.name]
        first = readings(flight, entry.name)[0][:1]
        roll, pitch, _ = rpy_from_quaternion(q_nb[None]).T
        height = entry.height(instrument, first, roll, pitch)
        if entry.kernel == "range":
            height = height - model.ground_down
        p[2] = -float(height[0])
        bias = instrument.bias
        sigma[2] = WIDE * np.hypot(np.sqrt(instrument.R[0, 0]), 0.0 if bias is None else bias.std)
        break
    return p, sigma


def _first_velocity(flight: Flight) -> tuple[FloatArray, FloatArray]:
    """Velocity [m/s] and its 1-sigma from the first GPS velocity, else unknown."""
    from sinan.estimator.filter.events import white_shares

    model, streams = flight.model, flight.recording.streams
    if "gps" in model.sensors and streams["gps"].has(VELOCITY):
        stream, gps = streams["gps"], model.sensors["gps"]
        waited = float(stream.t[0] - streams["imu"].t[0])
        white = np.sqrt(gps.R[3, 3] * white_shares(flight, "gps")[0, 3])
        spread = np.hypot(white, max((part.std for first, part in model.colour_of("gps") if first == 3), default=0.0))
        return stream.array(VELOCITY)[0], np.full(3, WIDE * spread + UNKNOWN_VELOCITY * min(waited, 1.0))
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
