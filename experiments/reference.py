"""Errors against what a recording may be scored against, at the reference's own stamps, whatever the estimator.

A reference on another body is brought to the sensor's axes and clock first: mounting and delay from the rates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sinan.estimator.filter.flight_model import FlightModel
from sinan.estimator.filter.layout import P_N, Q_NB, V_N
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray, integral
from sinan.sensors.recording import GYRO, POSITION, QUATERNION, VELOCITY, Recording, Stream, Truth
from sinan.sensors.rotation import (
    quaternion_conjugate,
    quaternion_from_matrix,
    quaternion_interpolate,
    quaternion_log,
    quaternion_multiply,
    rpy_from_quaternion,
    turned_since_start,
)

#: A reference that turns faster than this is wrong: three turns a second are beyond hands and robots [rad/s].
FASTEST = 20.0
#: Rows left out on either side of such a jump [s]: interpolation carried it that far.
AROUND = 0.08
#: Delays that are tried, their step, the width over which rates are averaged before they are compared, and the spacing
#: of such stretches [s].
LARGEST_DELAY, DELAY_STEP, WIDTH, SPACING = 0.2, 0.01, 0.2, 0.05
GRID = 0.02
#: A turn between two stamps that is nearer to half a turn may have been the other way round [rad]; so few turns show
#: no mounting.
_NEARLY_HALF, _FEWEST_TURNS = 2.5, 3
#: An estimate is not known in gaps of the IMU longer than so many of its steps.
_GAP = 3.0
_NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class Mounted:
    """A reference brought to the sensor's axes and clock.

    Attributes
    ----------
    reference : on the recording's clock, its jumps left out
    mounting : (4,) sensor axes -> axes of the reference
    delay : how much later the recording's stamps are than the reference's [s]
    same_north : it has the recording's north; else one constant heading is taken off
    """

    reference: Stream
    mounting: FloatArray
    delay: float
    same_north: bool = False

    @property
    def knows_heading(self) -> bool:
        """Whether it has an attitude with heading; one of roll and pitch scores the tilt alone."""
        return self.reference.has(QUATERNION)

    @property
    def knows_attitude(self) -> bool:
        """Whether it has an attitude at all."""
        return self.knows_heading or self.reference.has(("roll", "pitch"))

    def after(self, t: float) -> Mounted:
        """The part of it after an instant."""
        return replace(self, reference=self.reference.rows(self.reference.t > t))


@dataclass(frozen=True)
class AttitudeError:
    """Error of an attitude, row by row of the reference [rad].

    Attributes
    ----------
    t : (n,) s
    total, tilt, heading : (n,) angle of the whole rotation; of the vertical; about the vertical, signed
    north : constant heading between the two norths, taken off
    """

    t: FloatArray
    total: FloatArray
    tilt: FloatArray
    heading: FloatArray
    north: float


def reference_of(recording: Recording) -> Mounted | None:
    """What a recording may be scored against, in its own axes and on its clock; None where there is nothing."""
    truth = recording.truth
    if truth is None:
        return None
    if truth.is_own or truth.aligned:
        return Mounted(truth.stream, _NO_TURN, 0.0, same_north=truth.is_own)
    return mounted(recording, truth.stream)


def described(truth: Truth, target: Mounted) -> dict[str, object]:
    """What a reference is and what was done to it, for JSON: kind, known, whether its makers aligned it, else the
    mounting (sensor -> reference) and the delay [s] that were found.
    """
    said: dict[str, object] = {"kind": truth.kind or None, "known": list(truth.known)}
    if target.knows_heading and not target.same_north:
        said |= {"aligned": truth.aligned, "mounting": target.mounting.tolist(), "delay": target.delay}
    return said


def mounted(recording: Recording, reference: Stream) -> Mounted:
    """Find mounting and delay of a reference with attitude from the recording's gyroscope alone.

    Least squares over rotations C and delays: sum |w_gyro - C w_reference|^2, w being the turn between two stamps of
    the reference over the time between them, of the gyroscope as much later as the delay.
    Source of the rotation: G. Wahba's problem, solved by SVD (F. L. Markley, J. Astronaut. Sci. 36, 1988).
    A reference without heading is returned as it is; one whose turns are not seen loses its attitude.
    """
    if not reference.has(QUATERNION):
        return Mounted(reference, _NO_TURN, 0.0)
    reference, imu = without_jumps(reference), recording.streams["imu"]
    a, b = _pairs(reference.t, imu.t[0] + LARGEST_DELAY, imu.t[-1] - LARGEST_DELAY)
    q, q_gyro = reference.array(QUATERNION), turned_since_start(imu.t, imu.array(GYRO))
    turn = _turn(q[a], q[b])
    short = np.linalg.norm(turn, axis=1) < _NEARLY_HALF
    if np.sum(short) < _FEWEST_TURNS:
        return Mounted(Stream(reference.t, {n: c for n, c in reference.columns.items() if n not in QUATERNION}),
                       _NO_TURN, 0.0)  # fmt: skip
    start, stop = reference.t[a[short]], reference.t[b[short]]
    w_reference = turn[short] / (stop - start)[:, None]
    best, found = np.inf, (np.eye(3), 0.0)
    for delay in np.arange(-LARGEST_DELAY, LARGEST_DELAY + 1e-9, DELAY_STEP):
        ends = (quaternion_interpolate(t + delay, imu.t, q_gyro) for t in (start, stop))
        w_gyro = _turn(*ends) / (stop - start)[:, None]
        u, _, vt = np.linalg.svd(w_gyro.T @ w_reference)
        C = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
        miss = float(np.sum((w_gyro - w_reference @ C.T) ** 2))
        if miss < best:
            best, found = miss, (C, float(delay))
    C, delay = found
    return Mounted(Stream(reference.t + delay, reference.columns), quaternion_from_matrix(C.T), delay)


def _pairs(t: FloatArray, first: float, last: float) -> tuple[IntArray, IntArray]:
    """Rows a, b of stamps between `first` and `last`: about `WIDTH` apart, or neighbours where they are rarer; not
    across a gap. One pair every `SPACING`.
    """
    a = np.flatnonzero((t >= first) & (t <= last))
    a = a[np.unique(np.floor(t[a] / SPACING), return_index=True)[1]]
    b = np.searchsorted(t, t[a] + WIDTH - 1e-9)
    a, b = a[b < len(t)], b[b < len(t)]
    near = (t[b] <= last) & (t[b] - t[a] <= 2.0 * max(WIDTH, float(np.median(np.diff(t)))))
    return a[near], b[near]


def _turn(q: FloatArray, q_later: FloatArray) -> FloatArray:
    """(n, 3) rotation vector from one attitude to a later one, in the turning axes."""
    return quaternion_log(quaternion_multiply(quaternion_conjugate(q), q_later))


@dataclass(frozen=True)
class GyroError:
    """A gyroscope against the rates of a reference, whatever the estimator.

    Attributes
    ----------
    scale : (3,) w_i += scale_i w_i
    cross_axis : (3,) symmetric part xy, xz, yz; the rest is the mounting
    rms : of the rate that neither explains [rad/s]
    """

    scale: FloatArray
    cross_axis: FloatArray
    rms: float


def gyro_error(recording: Recording, target: Mounted) -> GyroError:
    """Scale and crookedness of a gyroscope from a reference with attitude.

    w_gyro = G w_reference + bias by least squares; G = K R with K symmetric (polar decomposition), R the mounting.
    The reference's own noise takes a little off the scale.
    """
    imu = recording.streams["imu"]
    t, w_reference = _rates_of(target.reference, imu)
    w_gyro = _rates(t, imu.t, integral(imu.t, imu.array(GYRO)))
    A = np.hstack([w_reference, np.ones((len(w_reference), 1))])
    x = np.linalg.lstsq(A, w_gyro, rcond=None)[0]
    u, size, _ = np.linalg.svd(x[:3].T)
    K = u @ np.diag(size) @ u.T
    left = w_gyro - A @ x
    return GyroError(np.diag(K) - 1.0, np.array([K[0, 1], K[0, 2], K[1, 2]]), float(np.sqrt(np.mean(left**2))))


def without_jumps(reference: Stream) -> Stream:
    """The reference without rows around turns that no body makes, such as interpolation through a change of sign."""
    q = reference.array(QUATERNION)
    rate = np.linalg.norm(_turn(q[:-1], q[1:]), axis=1)
    jumps = reference.t[1:][rate / np.diff(reference.t) > FASTEST]
    if not len(jumps):
        return reference
    after = np.clip(np.searchsorted(jumps, reference.t), 0, len(jumps) - 1)
    before = np.clip(after - 1, 0, None)
    near = np.minimum(np.abs(jumps[after] - reference.t), np.abs(jumps[before] - reference.t))
    return reference.rows(near > AROUND)


def errors_of(
    target: Mounted, t: FloatArray, x: FloatArray, translation: bool = True, place: bool = True, height: bool = True
) -> dict[str, float]:
    """RMS errors of estimated states, of what the reference knows and at its own stamps.

    Parameters
    ----------
    t, x : (n,) s, (n, 10 or more) nominal states: position, velocity, quaternion
    translation : position and velocity are estimated
    place, height : readings tell where the body is, how high; else it is wherever it began

    Returns
    -------
    `position_rms`, `height_rms` [m], `velocity_rms` [m/s], `attitude_rms`, `tilt_rms`, `heading_rms` [rad]: those that
    are known; none where the estimate is not known at any stamp of the reference
    """
    target = replace(target, reference=target.reference.rows(covered(target.reference.t, t)))
    reference, errors = target.reference, dict[str, float]()
    if not len(reference):
        return errors
    x = states_at(reference.t, t, x)
    if translation and reference.has(POSITION):
        away = x[:, P_N] - reference.array(POSITION)
        errors |= {"position_rms": _rms(away)} if place else {}
        errors |= {"height_rms": _rms(away[:, 2:])} if height else {}
    if translation and reference.has(VELOCITY):
        errors["velocity_rms"] = _rms(x[:, V_N] - reference.array(VELOCITY))
    if target.knows_attitude:
        error = attitude_error(reference.t, x[:, Q_NB], target)
        parts = {"attitude": error.total, "tilt": error.tilt, "heading": error.heading}
        known = parts if target.knows_heading else {"tilt": error.tilt}
        errors |= {f"{part}_rms": _rms(angle[:, None]) for part, angle in known.items()}
    return errors


def told_of(model: FlightModel) -> tuple[bool, bool, bool]:
    """`translation`, `place` and `height` of `errors_of`, for the states of a model."""
    return model.translation, model.place_is_read, model.height_is_read


def covered(stamps: FloatArray, t: FloatArray) -> BoolArray:
    """Which stamps lie among the instants of an estimate, and in none of its gaps."""
    if len(t) < 2:
        return np.zeros(len(stamps), dtype=bool)
    after = np.clip(np.searchsorted(t, stamps), 1, len(t) - 1)
    whole = t[after] - t[after - 1] <= _GAP * np.median(np.diff(t))
    return np.asarray((stamps >= t[0]) & (stamps <= t[-1]) & whole)


def states_at(stamps: FloatArray, t: FloatArray, x: FloatArray) -> FloatArray:
    """(m, n + 1) nominal states between those at the instants t: attitude on the sphere, everything else linearly."""
    between = np.stack([np.interp(stamps, t, column) for column in x.T], axis=-1)
    between[:, Q_NB] = quaternion_interpolate(stamps, t, x[:, Q_NB])
    return between


def attitude_error(t: FloatArray, q_nb: FloatArray, target: Mounted) -> AttitudeError:
    """Error of an estimated attitude against a mounted reference.

    The norths of a robot, of cameras and of the Earth differ: the mean heading between the two is taken off for every
    estimator. A reference of roll and pitch scores the tilt alone.

    Parameters
    ----------
    t, q_nb : (n,), (n, 4) the estimate
    target : the reference
    """
    inside = (target.reference.t >= t[0]) & (target.reference.t <= t[-1])
    reference = target.reference.rows(inside)
    q = quaternion_interpolate(reference.t, t, q_nb)
    if not target.knows_heading:
        rpy = rpy_from_quaternion(q)
        between = np.sum(_down(rpy[:, 0], rpy[:, 1]) * _down(reference["roll"], reference["pitch"]), axis=1)
        tilt = np.arccos(np.clip(between, -1.0, 1.0))
        return AttitudeError(reference.t, tilt, tilt, np.zeros(len(tilt)), 0.0)
    q_reference = reference.array(QUATERNION)
    q_reference = quaternion_multiply(q_reference, np.broadcast_to(target.mounting, q_reference.shape))
    d = quaternion_multiply(q, quaternion_conjugate(q_reference))  # in NED
    heading = 2.0 * np.arctan2(d[:, 3], d[:, 0])
    north = 0.0 if target.same_north else float(np.angle(np.mean(np.exp(1j * heading))))
    back = np.array([np.cos(0.5 * north), 0.0, 0.0, -np.sin(0.5 * north)])
    d = quaternion_multiply(np.broadcast_to(back, d.shape), d)
    heading = np.angle(np.exp(2j * np.arctan2(d[:, 3], d[:, 0])))
    tilt = 2.0 * np.arcsin(np.clip(np.hypot(d[:, 1], d[:, 2]), 0.0, 1.0))
    return AttitudeError(reference.t, np.linalg.norm(quaternion_log(d), axis=1), tilt, heading, north)


def _rms(error: FloatArray) -> float:
    """Root of the mean squared length."""
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


def _down(roll: FloatArray, pitch: FloatArray) -> FloatArray:
    """(n, 3) down in the body."""
    return np.stack([-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)], axis=-1)


def _rates_of(reference: Stream, imu: Stream) -> tuple[FloatArray, FloatArray]:
    """A grid of instants that both cover, and the averaged rates of the reference between them."""
    t = np.arange(max(imu.t[0], reference.t[0]) + 0.5, min(imu.t[-1], reference.t[-1]) - 0.5, GRID)
    at = quaternion_interpolate(t, reference.t, reference.array(QUATERNION))
    return t, _averaged(_turn(at[:-1], at[1:]) / GRID)


def _rates(t: FloatArray, at: FloatArray, turned: FloatArray) -> FloatArray:
    """Averaged rates between the instants t of readings whose integral `turned` is known."""
    ends = np.stack([np.interp(t, at, column) for column in turned.T], axis=-1)
    return _averaged(np.diff(ends, axis=0) / GRID)


def _averaged(values: FloatArray) -> FloatArray:
    width = round(WIDTH / GRID)
    return np.stack([np.convolve(column, np.full(width, 1.0 / width), mode="same") for column in values.T], axis=-1)
