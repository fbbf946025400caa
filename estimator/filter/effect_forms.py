"""Effects in the filter: what they put into each reading along a known motion, handed to the engines as arrays.

An effect on the IMU is taken off the samples: c = e(f) - f at the f that solves u = e(f) + b, so the exact inverse.
An effect on another sensor changes its prediction: z_pred = h(x) + offset + D (x (-) x_ref), with offset = e(h(x_ref))
- h(x_ref) in its exact form and D its derivative by the state: exact in beta, and first order in the distance from the
reference. A lateness moves the stamps instead. The reference is the smoothed motion of the pass before; the passes are
repeated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any

import numpy as np

from sinan.estimator.filter.alignment import first_state
from sinan.estimator.filter.engine import Engine, run
from sinan.estimator.filter.events import StreamForm, collect, is_form_only, stamps, with_added
from sinan.estimator.filter.flight import Flight, OfFlight
from sinan.estimator.filter.flight_model import DRIVERS
from sinan.estimator.filter.imu import ImuTable, imu_table
from sinan.estimator.filter.inputs import RunInputs, prepare
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.layout import DP, DTHETA, DV, PV
from sinan.estimator.filter.low_pass import low_passed
from sinan.estimator.filter.smoother import estimated_motion, smooth, with_imu
from sinan.estimator.filter.wiener import signal_part, without_vibration
from sinan.sensors.arrays import FloatArray, IntArray, zero_unless_finite
from sinan.sensors.covariates import covariates_for
from sinan.sensors.effects import Effect, effect
from sinan.sensors.errors import InputError
from sinan.sensors.gps import Gps
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion
from sinan.sensors.recording import ACCEL, GYRO, MAG, Recording, Stream
from sinan.sensors.rotation import quaternion_exp, quaternion_multiply, rotate_back

#: Steps of the differences that give D, of position [m], velocity [m/s], attitude [rad]: bound of work (`bounds_of_work
#: brief`).
STEPS = np.repeat([1e-3, 1e-3, 1e-4], 3)
#: Rounds of f <- u - b - c(f); each gains the size of the effect, a few per cent, so five reach rounding's reach.
INVERSION_ROUNDS = 5
#: A round that changes nothing by more than this was the last: bound of work (`bounds_of_work flight`) [m/s^2, rad/s].
INVERTED = 1e-9
#: Rows on which it is found out by which states an effect changes, and those that are evaluated at once, few of which
#: cost as much as the calls and many of which leave the cache: bound of work (`bounds_of_work brief`).
PROBES, AT_ONCE = 32, 4000
#: How many sigmas beyond what the IMU's own instants are known to a stream is told late that no log declares late: by
#: chance once in twenty, of a normal law norm.isf(0.05 / 2).
TOLD_LATE = 2.0
#: What of the motion goes with position, velocity or attitude: an effect that needs none of it does not.
OF_STATE = frozenset({"p_n", "v_n", "q_nb", "m_b", "airspeed"})


def is_lateness(entry: Effect) -> bool:
    """Whether the effect is a lateness of its stream, which moves the stamps."""
    return entry.name == "gps.latency" or entry.name.endswith(".time_offset")


def told_late_from(step: float, sigma: FloatArray | float, sigmas: float = TOLD_LATE) -> FloatArray:
    """From what lateness on [s] a stream is told late by an IMU whose samples nobody declares: instants or means, their
    own instants are known to half a step.

    Parameters
    ----------
    step, sigma : from one sample of the IMU to the next, and 1-sigma of the lateness [s]
    """
    return np.asarray(0.5 * step + sigmas * sigma)


@dataclass(frozen=True)
class Terms:
    """Effects in a model with their parameters, those of one name with one interval once: what the filter is given.

    How well they are known is in the estimate of whoever has fitted them.
    """

    pairs: tuple[tuple[Effect, FloatArray], ...] = ()

    @staticmethod
    def of(betas: Mapping[Any, FloatArray] | Iterable[tuple[Any, FloatArray]]) -> Terms:
        """From a mapping or pairs; an effect is named, or given.

        Raises
        ------
        ValueError : beta of the wrong length
        """
        pairs = []
        for key, beta in betas.items() if isinstance(betas, Mapping) else betas:
            entry = effect(key) if isinstance(key, str) else key
            values = np.atleast_1d(np.asarray(beta, dtype=np.float64))
            if values.shape != (entry.size,) or not np.all(np.isfinite(values)):
                raise ValueError(f"beta of `{entry.name}` is {values.tolist()}; expected {entry.size} finite numbers")
            pairs.append((entry, values))
        return Terms(tuple(pairs))

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Their declarations, in order."""
        return tuple(entry for entry, _ in self.pairs)

    @property
    def vector(self) -> FloatArray:
        """(p,) all parameters, one effect after another."""
        return np.concatenate([*(beta for _, beta in self.pairs), np.zeros(0)])

    def split(self, values: FloatArray) -> list[FloatArray]:
        """What goes with each of the parameters (p,), by effect."""
        return np.split(values, np.cumsum([entry.size for entry in self.effects])[:-1]) if self.pairs else []

    def at(self, vector: FloatArray) -> Terms:
        """The same effects with other parameters (p,)."""
        return Terms.of(zip(self.effects, self.split(vector), strict=True))

    def joined(self, other: Terms) -> Terms:
        """These, and those of `other` that are not named here."""
        names = {entry.name for entry, _ in self.pairs}
        return Terms(self.pairs + tuple(pair for pair in other.pairs if pair[0].name not in names))

    def of_stream(self, stream: str, lateness: bool = False) -> tuple[tuple[Effect, FloatArray], ...]:
        """Those that enter one stream: its latenesses, or the others."""
        return tuple((e, b) for e, b in self.pairs if e.stream == stream and is_lateness(e) == lateness)

    def lateness(self, stream: str) -> float:
        """How late the stream's stamps are [s]."""
        return float(sum(beta[0] for _, beta in self.of_stream(stream, lateness=True)))

    def beta(self, entry: Effect) -> FloatArray:
        """The parameters of an effect; zero where it is not among the terms."""
        for other, beta in self.pairs:
            if other.name == entry.name and other.interval == entry.interval:
                return beta
        return np.zeros(entry.size)

    def __bool__(self) -> bool:
        return bool(self.pairs)


def declared_terms(recording: Recording) -> Terms:
    """The effects that the recording declares.

    Raises
    ------
    InputError : no such effect, or a beta of the wrong length or of a size that there cannot be
    """
    try:
        terms = Terms.of({name: np.asarray(beta, dtype=np.float64) for name, beta in recording.effects.items()})
    except (KeyError, ValueError) as error:
        raise InputError(recording.where, str(error.args[0]), "effects of the catalogue", "[effects]") from None
    for entry, beta in terms.pairs:
        entry.check(beta, recording.where, f"[effects] {entry.name}")
    return terms


def run_with_effects(
    flight: Flight,
    terms: Terms,
    *,
    engine: Engine = "auto",
    stride: int = 1,
    passes: int = 6,
    tolerance: float = 1e-3,
    motion: Motion | None = None,
    first: tuple[FloatArray, FloatArray] | None = None,
) -> Journal:
    """Filter, smooth, evaluate the effects along the smoothed motion, filter again, until the innovations settle.

    Parameters
    ----------
    motion : the reference of the first evaluation, at the samples of the IMU table; default: from a plain pass
    passes, tolerance : see `run_filter`
    first : state and covariance to start from; default: those of `first_state`
    """
    _require_streams(flight, terms)
    table = imu_table(flight)
    if motion is None:
        judged = (
            flight.believing(gate_level=None) if flight.model.relinearise else flight
        )  # a coarse start is no outlier
        journal = run(prepare(judged, imu=table, first=first), engine, 0)
        motion = reference_motion(journal, terms, table)
    white: FloatArray | None = None
    for count in range(1, passes + 1):
        journal = run(Along(flight, terms, motion, table, first).inputs, engine, stride)
        change = np.inf if white is None else np.nanmax(np.abs(journal.white - white), initial=0.0)
        if change < tolerance or count == passes:
            break
        white = journal.white
        motion = reference_motion(journal, terms, table)
    return replace(journal, iterations=count)


def _require_streams(flight: Flight, terms: Terms) -> None:
    """Raise unless every effect enters a stream that the run has."""
    for entry, _ in terms.pairs:
        if entry.stream not in (*DRIVERS, *flight.model.sensors):
            raise InputError(flight.where, f"no stream for {entry.name}", f"readings of {entry.stream}", "[effects]")


def reference_motion(journal: Journal, terms: Terms, table: ImuTable) -> Motion:
    """Smoothed motion at the samples of the IMU table; f_b and w_ib_b solve reading = e(f) + b."""
    assert isinstance(journal.run, RunInputs)
    motion = estimated_motion(replace(journal, run=replace(journal.run, imu=table)), smoothed=smooth(journal))
    if not (terms.of_stream("accel") or terms.of_stream("gyro")):
        return motion
    as_read, corrections = np.hstack([motion.f_b, motion.w_ib_b]), np.zeros_like(table.u)
    for _ in range(INVERSION_ROUNDS - 1):
        better = imu_corrections(journal.run.flight, terms, motion, table)
        settled = np.max(np.abs(better - corrections), initial=0.0) < INVERTED
        corrections = better
        if settled:
            break
        motion = with_imu(motion, as_read - corrections)
    return motion


def imu_corrections(flight: Flight, terms: Terms, motion: Motion, table: ImuTable) -> FloatArray:
    """(N, 6) what the effects put into accelerometer and gyroscope along the motion, as the low pass leaves it."""
    recording, parts = flight.recording, []
    for stream, plain in (("accel", motion.f_b), ("gyro", motion.w_ib_b)):
        pairs = terms.of_stream(stream)
        along = with_covariates(recording, stream, motion) if pairs else motion
        own, other = np.zeros_like(plain), np.zeros_like(plain)
        for entry, beta in pairs:
            added = own if is_of_own_reading(entry) else other
            added += entry.change(plain, beta, along)
        parts.append(own + low_passed_in(flight, table, other, stream))
    return np.concatenate(parts, axis=1)


def is_of_own_reading(entry: Effect) -> bool:
    """Whether what an effect adds to accelerometer or gyroscope is a function of the true value of the same reading: of
    samples behind the low pass it then adds that function of them.
    """
    return entry.exact is not None or {"accel": "f_b", "gyro": "w_ib_b"}[entry.stream] in entry.needs


def low_passed_in(flight: Flight, table: ImuTable, values: FloatArray, stream: str) -> FloatArray:
    """(N, ...) what goes with the samples of accelerometer or gyroscope, as the low pass leaves it."""
    return low_passed(table.t, values, stream, flight.model, flight.recording.breaks, table.row)


def with_covariates(recording: Recording, stream: str, motion: Motion) -> Motion:
    """The motion with what the recording knows besides the readings, at the motion's instants."""
    return motion.with_covariates(**covariates_for(recording, stream, motion.t))


@dataclass(frozen=True, eq=False)
class Along(OfFlight):
    """A flight and the effects in its model along one motion: what several passes ask for is evaluated once.

    Attributes
    ----------
    flight : readings and model
    terms : effects in the model
    motion : at the samples of the IMU table
    imu : table of the flight's IMU, where it is known
    first : state and covariance to start from; default: those of `first_state`, where the first attitude is that
        without the effects
    """

    flight: Flight
    terms: Terms
    motion: Motion
    imu: ImuTable | None = None
    first: tuple[FloatArray, FloatArray] | None = None
    _at: dict[str, Motion] = field(default_factory=dict, init=False, repr=False)
    _finer: dict[str, tuple[Motion, FloatArray, IntArray]] = field(default_factory=dict, init=False, repr=False)

    def at(self, name: str) -> Motion:
        """The motion, with covariates, at the instants at which a sensor's readings were valid."""
        if name not in self._at:
            names = tuple(self.model.sensors) if self.model.relinearise else (name,)  # where all will be asked for
            t = [stamps(self.flight, n) - self.terms.lateness(n) for n in names]
            ends = np.cumsum([0, *map(len, t)])
            together = self.motion.at(np.concatenate(t))
            for n, (first, last) in zip(names, pairwise(ends), strict=True):
                self._at[n] = with_covariates(self.recording, n, together.rows(slice(first, last)))
        return self._at[name]

    def finer(self, name: str) -> tuple[Motion, FloatArray, IntArray]:
        """The motion at the IMU's instants and at those of a sensor's readings, with covariates, the perfect readings
        along it, and the rows of the sensor's own.
        """
        if name not in self._finer:
            own = self.at(name).t
            t = np.unique(np.concatenate([self.motion.t, own]))
            fine = with_covariates(self.recording, name, self.motion.at(t))
            self._finer[name] = fine, self.model.sensors[name].predict(fine), np.searchsorted(t, own)
        return self._finer[name]

    @cached_property
    def table(self) -> ImuTable:
        """Of the IMU as read."""
        return imu_table(self.flight) if self.imu is None else self.imu

    @cached_property
    def corrected(self) -> ImuTable:
        """Of the IMU without the effects."""
        return replace(self.table, u=self.table.u - imu_corrections(self.flight, self.terms, self.motion, self.table))

    @cached_property
    def added(self) -> Mapping[str, StreamForm]:
        """By sensor, what the effects of its stream add to its prediction, and what a receiver does not follow."""
        return {name: stream_form(self, name) for name in self.model.sensors
                if self.terms.of_stream(name) or name == "gps"}  # fmt: skip

    @cached_property
    def without_effects(self) -> Recording:
        """The recording without the effects in what the first attitude is found from."""
        return _without_effects(self.recording, self.corrected, self.added) if self.terms else self.recording

    @cached_property
    def inputs(self) -> RunInputs:
        """Of a pass with the effects in the model."""
        linear = [name for name in self.model.sensors if self.model.relinearise or is_form_only(name)]
        forms = {**self.added, **{name: linear_form(self, name) for name in linear}}
        events = collect(self.flight, forms, {name: self.terms.lateness(name) for name in self.model.sensors})
        if "zero_rate" in self.model.sensors and self.terms.of_stream("gyro"):
            events = with_added(events, "zero_rate", self.at_zero_rate((self.corrected.u - self.table.u)[:, 3:]))
        first = first_state(self.flight.reading(self.without_effects)) if self.first is None else self.first
        return prepare(self.flight, imu=self.corrected, events=events, first=first, aligned=self.without_effects)

    def at_zero_rate(self, values: FloatArray) -> FloatArray:
        """(k, ...) means over the windows of `zero_rate` of what goes with the samples of the table, (N, ...)."""
        return self.model.rest.means(self.table.t, values)

    @cached_property
    def of_signal(self) -> Motion:
        """The motion with what of force and rate is signal: see `estimator.filter.wiener`."""
        return replace(
            self.motion,
            f_b=signal_part(self.motion.f_b, self.model.accel.sigma),
            w_ib_b=signal_part(self.motion.w_ib_b, self.model.gyro.sigma),
        )

    def seen_by(self, name: str) -> Along:
        """The same along the motion that a sensor follows: its form and the slopes of its effects are of that one.

        A receiver's is without vibration, whose velocity is another a few hundredths of a second later: it would make
        the likelihood of a lateness rough. The others read place and attitude, which vibration hardly moves.
        """
        return self.of_vehicle if name == "gps" else self

    @cached_property
    def of_vehicle(self) -> Along:
        """The same along the motion without its vibration."""
        return replace(self, motion=without_vibration(self.motion))


def _without_effects(recording: Recording, table: ImuTable, forms: Mapping[str, StreamForm]) -> Recording:
    """What the first attitude is found from, force and field, with the effects taken off."""
    streams = dict(recording.streams)
    streams["imu"] = Stream(table.t, dict(zip((*ACCEL, *GYRO), table.u.T, strict=True)))
    if "mag" in forms:
        field = streams["mag"].array(MAG) - forms["mag"].offset
        streams["mag"] = Stream(streams["mag"].t, dict(zip(MAG, field.T, strict=True)))
    return recording.replace(streams=streams)


def stream_form(along: Along, name: str) -> StreamForm:
    """What the effects of one stream do to its prediction, and what of the motion the sensor does not follow.

    Raises
    ------
    InputError : an effect needs a covariate that the recording lacks
    """
    seen, sensor, pairs = along.seen_by(name), along.model.sensors[name], along.terms.of_stream(name)
    at, there = along.at(name), seen.at(name)
    for entry, _ in pairs:
        lacking = entry.missing(at)
        if lacking:
            found = f"no {', '.join(lacking)} for {entry.name}"
            raise InputError(along.recording.where, found, "it among the streams", name)
    offset, D = effects_on(seen, name), np.zeros((len(at), sensor.size, 9))
    if seen is not along:
        offset = offset + sensor.predict(there) - sensor.predict(at)
    moving = [(e, b) for e, b in pairs
              if not e.other_instants and (e.exact is not None or not OF_STATE.isdisjoint(e.needs))]  # fmt: skip
    if moving:
        of_moving = partial(_at_one_instant, sensor, moving)
        probe = there.rows(np.unique(np.linspace(0, len(at) - 1, PROBES).astype(int)))
        slopes = _slopes(of_moving, probe, range(9))
        states = [k for k in range(9) if np.any(np.abs(slopes[k]) > 1e-12)]
        if states:
            D[:, :, states] = np.moveaxis(_slopes(of_moving, there, states), 0, -1)
    return StreamForm(
        zero_unless_finite(offset), zero_unless_finite(D), np.concatenate([at.p_n, at.v_n, at.q_nb], axis=1)
    )


def effects_on(along: Along, name: str) -> FloatArray:
    """(k, m) what the effects of one stream add to its readings, of the instants that its lateness gives.

    Parameters
    ----------
    along : the motion that the sensor follows: see `Along.seen_by`
    """
    pairs = along.terms.of_stream(name)
    now = [(entry, beta) for entry, beta in pairs if not entry.other_instants]
    total = _at_one_instant(along.model.sensors[name], now, along.at(name))
    return sum((over_time(along, name, entry, beta) for entry, beta in pairs if entry.other_instants), total)


def _at_one_instant(sensor: SensorModel, pairs: Sequence[tuple[Effect, FloatArray]], motion: Motion) -> FloatArray:
    """(n, m) what effects without a memory add to a sensor's readings along a motion."""
    plain = sensor.predict(motion)
    total = np.zeros_like(plain)
    for entry, beta in pairs:
        change = entry.change(plain, beta, motion, sensor)
        total += change if entry.exact else at_its_instant(sensor, change)
    return total


def _slopes(function: Callable[[Motion], FloatArray], motion: Motion, states: Sequence[int]) -> FloatArray:
    """(states, n, m) derivative of a function of the motion, (n, m), by components of position, velocity and attitude:
    differences over `STEPS`, so many from one call as make no more rows than `AT_ONCE`.
    """
    each = np.eye(9)[list(states)] * STEPS
    ends, together = np.concatenate([each, -each]), max(1, AT_ONCE // len(motion))
    parts = [function(displaced(motion, ends[k : k + together])) for k in range(0, len(ends), together)]
    ahead, behind = np.concatenate(parts).reshape(2, len(each), len(motion), -1)
    with np.errstate(invalid="ignore"):  # a beam above the horizon: no prediction, to which nothing is added
        return np.asarray((ahead - behind) / (2.0 * STEPS[list(states), None, None]))


def at_its_instant(sensor: SensorModel, added: FloatArray) -> FloatArray:
    """(n, m, ...) what an effect adds to a reading whose components are not all of one instant (`Gps.with_lead`)."""
    return sensor.with_lead(added) if isinstance(sensor, Gps) else added


def linear_form(along: Along, name: str) -> StreamForm:
    """Prediction and Jacobian of one sensor along a motion, with the effects of its stream."""
    at, sensor = along.at(name), along.model.sensors[name]
    plain = replace(at, m_n=along.model.m_n[None, :])  # the field's error is a state, whose part of H adds it
    z_pred, D = sensor.predict(plain), np.zeros((len(at), sensor.size, 9))
    with np.errstate(invalid="ignore"):  # a beam above the horizon: no prediction, and the reading is left out
        jacobian = sensor.jacobian(at)
    for place, block in enumerate(("position", "velocity", "attitude")):
        if block in jacobian:
            D[:, :, 3 * place : 3 * place + 3] = np.nan_to_num(jacobian[block], posinf=0.0, neginf=0.0)
    if name in along.added:
        z_pred, D = z_pred + along.added[name].offset, D + along.added[name].D
    return StreamForm(z_pred, D, np.concatenate([at.p_n, at.v_n, at.q_nb], axis=1), replaces=True)


def over_time(along: Along, name: str, entry: Effect, beta: FloatArray) -> FloatArray:
    """(k, m) what an effect with a memory adds: evaluated at the IMU's instants too: nothing is lost in between.

    Its memory is longer than the error of the reference is alike, so it adds nothing to H.
    """
    fine, plain, own = along.finer(name)
    return entry.change(plain, beta, fine, along.model.sensors[name])[own]


def displaced(motion: Motion, errors: FloatArray) -> Motion:
    """The motion (n) with each of the errors (k, 9) of position, velocity and attitude, one after the other: (k n)."""
    n = len(motion)
    if len(errors) > 1:
        motion = motion.rows(np.tile(np.arange(n), len(errors)))
    d, turn = np.repeat(errors[:, PV], n, axis=0), np.repeat(quaternion_exp(errors[:, DTHETA]), n, axis=0)
    q = quaternion_multiply(motion.q_nb, turn)
    return replace(motion, p_n=motion.p_n + d[:, DP], v_n=motion.v_n + d[:, DV], q_nb=q, m_b=rotate_back(q, motion.m_n))
