"""The cases of `bounds_of_work`: small questions, each of which asks what some constants decide."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from sinan.calibration.cameras import hand_eye
from sinan.calibration.cameras.camera import CameraFit, Pose, fit, form, that_do_not_fit
from sinan.calibration.cameras.views import View, read_corners
from sinan.calibration.levels.fields import beforehand, fitted
from sinan.calibration.levels.fit import fit_levels, widest_bounds_needed, with_slow_gps
from sinan.calibration.levels.heading import with_heading
from sinan.calibration.levels.levels import Levels, first_levels
from sinan.calibration.levels.preparation import prepared
from sinan.calibration.levels.rest import noise_at_rest
from sinan.calibration.levels.sizes import CALIBRATED, sizes_of
from sinan.calibration.levels.upsets import with_upsets
from sinan.calibration.poses.evidence.bias_walk import estimated_walk
from sinan.estimator.evidence.intervals.doubted import doubted_among, explained
from sinan.estimator.evidence.intervals.outliers import wrong_among
from sinan.estimator.filter.alignment import first_state
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.inputs import prepare
from sinan.estimator.filter.layout import DP, DTHETA, P_N, PV, Q_NB
from sinan.estimator.filter.relinearise import run_relinearised
from sinan.estimator.filter.tails import spread_of
from sinan.estimator.positioning.location import locate
from sinan.estimator.positioning.noise_fit import PRIOR_SPREAD
from sinan.estimator.positioning.noise_fit import fitted as law_of
from sinan.estimator.positioning.pseudorange_trace import trace_ranges
from sinan.estimator.positioning.steady_fault import steady_fault
from sinan.experiments.bias_observability.case import case_of_recording
from sinan.experiments.bias_observability.study import study
from sinan.experiments.gnss.simulated import load
from sinan.experiments.gnss.simulated import simulate as ranges_of
from sinan.experiments.residual_loop.open_flight import flight_source, source_of
from sinan.experiments.residual_loop.remaining import remaining
from sinan.experiments.residual_loop.run import trace_recording
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.camera import LOOKS_AHEAD, Intrinsics
from sinan.sensors.errors import InputError
from sinan.sensors.geomagnetism import direction_at, field_along
from sinan.sensors.pseudorange import Pseudoranges, pseudoranges
from sinan.sensors.recording import ACCEL, GYRO, MAG, NO_HEIGHT, POSITION, Initial, Recording, SensorSpec, Stream
from sinan.sensors.rotation import (
    matrix_from_quaternion,
    quaternion_exp,
    quaternion_from_matrix,
    quaternion_log,
    right_jacobian,
    rotation_exp,
    rpy_from_quaternion,
)
from sinan.sensors.simulate import simulate
from sinan.sensors.window import between

#: Lowest elevation of a satellite [rad].
MASK = np.deg2rad(10.0)


@dataclass(frozen=True)
class Answer:
    """What a case says: its words; its numbers, each with the size by which it is known."""

    words: tuple[str, ...]
    values: np.ndarray
    sizes: np.ndarray

    def apart(self, other: Answer) -> float:
        """Largest move of a number in its own size; infinite where the words are others."""
        if self.words != other.words or self.values.shape != other.values.shape:
            return np.inf
        return float(np.max(np.abs(other.values - self.values) / self.sizes, initial=0.0))


@cache
def _recording(scenario: str, *effects: str, seed: int = 1) -> Recording:
    return simulate(load_scenario(scenario), np.random.default_rng(seed), [parse_effect(e) for e in effects])[0]


def _of_trace(recording: Recording, sensor: str | None = None) -> Answer:
    found = trace_recording(recording, sensor)
    words, values, sizes = [found.verdict.word], list[float](), list[float]()
    for part in found.parts:
        final = part.trace.final
        for term in final.terms:
            words.append(term.name)
            values += [*final.beta[term], *(term.interval or ())]
            sizes += [*final.std[term], *np.diff(term.interval or ()).repeat(2)]
    return Answer(tuple(words), np.array(values), np.array(sizes))


def _bare(recording: Recording) -> Recording:
    return recording.replace(
        sensors={n: SensorSpec(angles=s.angles, base_position=s.base_position) for n, s in recording.sensors.items()}
    )


def _relative(values: Sequence[float] | np.ndarray, words: Sequence[str] = ()) -> Answer:
    array = np.array(values, dtype=np.float64)
    return Answer(tuple(words), array, np.maximum(np.abs(array), np.finfo(float).tiny))


def _poses() -> Answer:
    """Of an accelerometer whose bias is declared to wander."""
    effects = "accel.scale_nonlinearity=0.002,0.002,0.002", "accel.transient=0.2,0,0@150:330"
    recording = _recording("accel_poses", *effects)
    spec = replace(recording.spec("accel"), bias_walk=1e-4)
    return _of_trace(recording.replace(sensors={**recording.sensors, "accel": spec}))


def _camera() -> Answer:
    seen = read_corners(Path(__file__).parents[1] / "camera" / "opencv_left.csv")
    found = fit(seen.views, form("k1 k2 p1 p2"), seen.size)
    std = np.sqrt(np.diag(found.covariance))
    values = (found.form.spread.T @ found.intrinsics.values)[: len(std)]
    return Answer(found.form.names, values, std[: len(values)])


def _off(drift: float, since: float, offset: float = 0.0) -> Pseudoranges:
    """Of a satellite that is off by an offset [m], and walks off by so much a second from an instant [s] on."""
    simulated = ranges_of(load("static_ca"), 1)
    ranges = pseudoranges(simulated.rover, simulated.navigation)
    away = offset + drift * np.maximum(ranges.time - ranges.t[0] - since, 0.0)
    return replace(ranges, value=ranges.value + away * (ranges.satellite == "G06"))


def _ranges() -> Answer:
    """It walks off by half a metre a second from 300 s on."""
    found = trace_ranges(_off(0.5, 300.0), MASK)
    words = tuple(f"{one.name} {one.satellite or ''}".strip() for one in found.called)
    return _relative(np.concatenate([one.full for one in found.called]), words)


def _steady() -> Answer:
    """It is off by 6 m all the time: which one, by how much, and the evidence."""
    location = locate(_off(0.0, 0.0, 6.0), mask=MASK)
    found = steady_fault(location, location.elevation > MASK)
    assert found is not None
    sizes = np.array([found.std, abs(found.log_bayes)])
    return Answer((found.satellite, *found.others), np.array([found.offset, found.log_bayes]), sizes)


def _law() -> Answer:
    """The law of the errors of the same ranges, in the logarithm."""
    found = law_of(locate(_off(0.0, 0.0), mask=MASK))
    values = np.log([*found.system.values(), found.elevation, found.strength, found.ray, found.field])
    return Answer((), values, np.full(len(values), PRIOR_SPREAD))


def _coarse() -> Answer:
    """Position and velocity at the end of a flight that begins with a heading that nothing shows."""
    recording = _recording("figure_eight", seed=5)
    blind = recording.replace(
        streams={name: stream for name, stream in recording.streams.items() if name != "mag"},
        initial=replace(recording.initial, quaternion=None, attitude_std=None),
    )
    journal = run_relinearised(Flight.of(blind), engine="numba", stride=0)
    return Answer((), journal.x_end[PV], np.sqrt(journal.P_end.diagonal()[PV]))


def _outliers() -> Answer:
    """Of 3000 readings with heavy tails one in a hundred is wrong: how many are found, and the rest of the law."""
    rng = np.random.default_rng(3)
    error = rng.standard_normal((3000, 3)) / np.sqrt(rng.chisquare(4.0, (3000, 1)) / 4.0)
    wrong = rng.choice(3000, 30, replace=False)
    away = rng.standard_normal((30, 3))
    error[wrong] += rng.uniform(12.0, 25.0, (30, 1)) * away / np.linalg.norm(away, axis=1, keepdims=True)
    found = wrong_among(error)
    assert found is not None
    hits = len(np.intersect1d(found.row, wrong))
    return Answer((), np.array([hits, len(found.row) - hits]), np.sqrt([30.0, 30.0]))


def _doubted() -> Answer:
    """What an offset of seven of sixty fixes explains, of which one is wrong besides, by a law with heavy tails."""
    rng, tail, m = np.random.default_rng(8), 4.0, 3
    z = rng.standard_normal((60, m)) / np.sqrt(rng.chisquare(tail, (60, 1)) / tail)
    off = np.repeat([0.0, 1.0, 0.0], [20, 7, 33])
    z += off[:, None] * np.array([8.0, -3.0, 5.0])
    z[23] += np.array([-60.0, 40.0, 0.0])
    weight = 1.0 / spread_of(np.sum(z**2, axis=1), m, tail)
    W, white = np.sqrt(weight)[:, None, None] * off[:, None, None] * np.eye(m), np.sqrt(weight)[:, None] * z
    L, b = np.einsum("nci,ncj->ij", W, W), np.einsum("nci,nc->i", W, white)
    doubted = doubted_among(weight, np.full(60, m), np.full(60, tail), np.full(60, -np.inf))
    rows = W.reshape(-1, m)[doubted.row], white.ravel()[doubted.row]
    gain, _, beta = explained(L[None], b[None], rows[0][None], rows[1], doubted, 1e-9)
    return Answer((), np.append(beta[0], gain), np.append(np.full(m, 7.0**-0.5), 1.0))


def _observability() -> Answer:
    """1-sigma of each state at the end of a hover."""
    return _relative([one.posterior for one in study(case_of_recording(_recording("hover")), False).states])


def _levels() -> Answer:
    specs = prepared(_bare(_recording("hover", seed=5))).levels.specs
    named = {f"{name} {key}": getattr(specs[name], key) for name in sorted(specs) for key in ("noise_std", "bias_walk")}
    known = {name: float(np.max(value)) for name, value in named.items() if value is not None and np.max(value) > 0.0}
    return _relative(list(known.values()), tuple(known))


def _of_20_s(recording: Recording, *sensors: str) -> Recording:
    first = recording.streams["imu"].t[0]
    streams = {name: one.rows(one.t < first + 20.0) for name, one in recording.streams.items()}
    return recording.replace(streams={n: one for n, one in streams.items() if n in ("imu", *sensors)}, truth=None)


def _brief() -> Answer:
    """A figure of eight whose GPS is late."""
    return _of_trace(_of_20_s(_recording("figure_eight", "gps.latency=0.1"), "mag", "gps"))


def _found(levels: Levels) -> Answer:
    """Its sizes, in the logarithm."""
    values = [levels.value(size) if size.linear else np.log(levels.value(size)) for size in levels.found]
    return Answer((), np.array(values), np.array(levels.sigmas))


def _sizes() -> Answer:
    """What is found of a figure of eight that declares no noise, in the logarithm."""
    return _found(fit_levels(_of_20_s(_bare(_recording("figure_eight")), "baro", "gps")))


def _beside() -> Answer:
    """The same of one whose gyroscope reads 5 % too much, beside what effects explain."""
    scaled = _of_20_s(_bare(_recording("figure_eight", "gyro.scale=0.05,0.05,0.05")), "mag", "gps")
    return _found(prepared(scaled, effects=lambda flight: source_of(flight, scaled).explained_by_all).levels)


def _long() -> Answer:
    """What is found of five and a half minutes of figures of eight that declare no noise, in the logarithm."""
    scenario = load_scenario("figure_eight").with_imu_rate(50.0)
    longer = scenario.replace(manoeuvres=4 * scenario.manoeuvres)
    flown = _bare(simulate(longer, np.random.default_rng(1))[0])
    return _found(prepared(flown.replace(streams={n: flown.streams[n] for n in ("imu", "gps")}, truth=None)).levels)


def _weak() -> Answer:
    """Two effects that are hardly more than what is noticed."""
    effects = "accel.scale_nonlinearity=0.00015,0.00015,0.00015", "accel.transient=0.015,0,0@150:330"
    return _of_trace(_recording("accel_poses", *effects))


def _walk() -> Answer:
    """White noise and walk of sixty poses whose bias wanders; a step of the grid is a quarter."""
    rng, t = np.random.default_rng(1), 10.0 * np.arange(60.0)
    offset = rng.standard_normal((60, 3))
    bias = np.cumsum(rng.standard_normal((60, 3)), axis=0)
    residual = rng.standard_normal(60) + np.sum(offset * bias, axis=1)
    return _relative(estimated_walk(residual, offset, offset, t))


@cache
def _board(off: float) -> Recording:
    """Turned about the vertical in a field whose dip is off that of its place [rad], and that nobody declares."""
    scenario = load_scenario("yaw_turns")
    assert scenario.origin is not None
    dip, east = direction_at(scenario.origin)
    north, level, down = field_along(1.0, dip - off, east)
    made = replace(scenario, magnetic_field=(float(north), float(level), float(down)))
    recording = simulate(made, np.random.default_rng(1))[0]
    return recording.replace(environment=replace(recording.environment, magnetic_field=None))


def _fields() -> Answer:
    """Which belief is likeliest, by how far the dip is off [rad]."""
    words = []
    for off in (0.04, 0.06, 0.2, 0.3):
        field = beforehand(_bare(_board(off))).field
        assert field is not None
        words.append(f"{off:.2f} {field.words}")
    return Answer(tuple(words), np.zeros(0), np.zeros(0))


def _zeros() -> Answer:
    """Height at the end of a hover over ground that is higher than declared [m]."""
    ends, sigmas = [], []
    for high in (-2.1, -1.8, -1.4, -0.9):
        recording = _bare(_recording("hover", seed=5))
        recording = recording.replace(environment=replace(recording.environment, ground_down=high))
        levels = first_levels(recording, sizes_of(recording), recording.environment.magnetic_field, None)
        journal = run(prepare(levels.flight(recording)), "numba", 0)
        ends.append(journal.x_end[P_N][2])
        sigmas.append(np.sqrt(journal.P_end.diagonal()[DP][2]))
    return Answer((), np.array(ends), np.array(sigmas))


def _beyond() -> Answer:
    """Height [m] ten times in a flight whose receiver tells none, and whose laser answers about 1.5 m to everything
    beyond 2.5 m.
    """
    streams = {n: s for n, s in _bare(_recording("takeoff_landing")).streams.items() if n != "sonar"}
    laser, gps = streams["laser"], streams["gps"]
    wrong = np.random.default_rng(1).normal(1.5, 0.2, len(laser))
    seen = {"range": np.where(laser["range"] > 2.5, wrong, laser["range"])}
    flat = {**gps.columns, "epv": np.full(len(gps), NO_HEIGHT)}
    streams |= {"laser": Stream(laser.t, seen), "gps": Stream(gps.t, flat)}
    recording = _bare(_recording("takeoff_landing")).replace(streams=streams)
    levels = fit_levels(recording, recording.environment.magnetic_field)
    journal = run(prepare(levels.flight(recording)), "numba")
    rows = np.linspace(0, len(journal.imu_t) - 1, 11).astype(np.int64)[1:]
    return Answer((), journal.imu_x[rows, P_N][:, 2], np.sqrt(journal.imu_var[rows, DP][:, 2]))


def _clipped() -> Answer:
    """Position, velocity and attitude at the end of an aerobatic flight whose rates are cut off at 70 %."""
    recording = _recording("aerobatics")
    imu = recording.streams["imu"]
    columns = {name: np.clip(imu[name], *(0.7 * np.quantile(imu[name], [0.0, 1.0]))) for name in GYRO}
    cut = recording.replace(streams={**recording.streams, "imu": Stream(imu.t, {**imu.columns, **columns})})
    inputs = prepare(Flight.of(cut))
    journal = run(inputs, "numba", 0)
    sigma = np.sqrt(journal.P_end.diagonal())
    off = inputs.model.layout.difference(journal.x_end, run(prepare(Flight.of(recording)), "numba", 0).x_end)
    kept = [*range(PV.start, PV.stop), *range(DTHETA.start, DTHETA.stop)]
    return Answer((), off[kept], sigma[kept])


def _frozen() -> Answer:
    """Whether an IMU that stands still for a while [ms] of a minute is an unexplained error."""
    words = []
    for length in (40, 80):
        recording = _recording("hover")
        imu = recording.streams["imu"]
        held = (imu.t > 30.0) & (imu.t < 30.0 + 1e-3 * length)
        columns = {name: np.where(held, imu[name][np.argmax(held)], imu[name]) for name in (*ACCEL, *GYRO)}
        stands = recording.replace(streams={**recording.streams, "imu": Stream(imu.t, {**imu.columns, **columns})})
        source = flight_source(stands, slow_gps=False)
        left = [one for one in remaining(source, source.fit(()), (), (), 0.01) if "frozen" in one.what]
        words.append(f"{length} ms {'unexplained' if any(one.in_mean for one in left) else 'told' if left else 'none'}")
    return Answer(tuple(words), np.zeros(0), np.zeros(0))


def _start() -> Answer:
    """What an offset is called that begins after a share of a hundred poses: before it the bias is free."""
    scenario = load_scenario("accel_poses")
    assert scenario.turns is not None
    scenario = replace(scenario, turns=replace(scenario.turns, poses=100))
    words = []
    for share in (0.08, 0.16, 0.3):
        effect = parse_effect(f"accel.step=0.2,0,0@{1000.0 * share}")
        said = _of_trace(simulate(scenario, np.random.default_rng(1), [effect])[0]).words
        words.append(f"{share:.2f} {' '.join(said)}")
    return Answer(tuple(words), np.zeros(0), np.zeros(0))


def _few() -> Answer:
    """In how many of 30 streams of so many readings with heavy tails any is called wrong at one in a hundred; and where
    two are.
    """
    found = []
    for n in (30, 80):
        rng = np.random.default_rng(n)
        error = rng.standard_normal((30, n, 3)) / np.sqrt(rng.chisquare(4.0, (30, n, 1)) / 4.0)
        for away in (0.0, 40.0):
            error[:, 7 :: n // 2, 0] += away
            answers = [wrong_among(one) for one in error]
            found.append(sum(one is not None and len(one.row) > 0 and one.log_p < np.log(0.01) for one in answers))
    return Answer((), np.array(found, dtype=np.float64), np.ones(4))


def _mounting() -> Answer:
    """A camera on a hand: from thirty of its poses, and from its gyroscope, of which its stamps are 37 ms late."""
    rng = np.random.default_rng(3)
    C_bc = LOOKS_AHEAD @ rotation_exp(np.array([0.05, -0.12, 0.08]))
    l_b, p_t = np.array([0.11, -0.04, 0.06]), np.array([2.0, 0.0, -1.0])
    q_nb, p_n = quaternion_exp(rng.normal(0.0, 0.5, (30, 3))), rng.normal(0.0, 0.3, (30, 3))
    C_cn = np.swapaxes(matrix_from_quaternion(q_nb) @ C_bc, 1, 2)
    R = C_cn @ rotation_exp(0.004 * rng.standard_normal((30, 3)))
    T = np.einsum("nij,nj->ni", C_cn, p_t - p_n) - C_bc.T @ l_b + 0.006 * rng.standard_normal((30, 3))
    from_places = hand_eye.from_poses(q_nb, [Pose(_log(one), at) for one, at in zip(R, T, strict=True)], p_n)

    def turn(t: np.ndarray) -> np.ndarray:
        return np.array([0.6, 0.7, 0.4]) * np.sin(np.multiply.outer(t, [2.1, 1.3, 2.9]) + np.array([0.0, 0.4, 1.0]))

    t, seen = np.arange(0.0, 20.0, 0.005), np.arange(0.4, 19.6, 0.05)
    slope = (turn(t + 1e-4) - turn(t - 1e-4)) / 2e-4
    w = np.einsum("nij,nj->ni", right_jacobian(turn(t)), slope) + 0.01 + 0.03 * rng.standard_normal((len(t), 3))
    C = rotation_exp(0.002 * rng.standard_normal((len(seen), 3))) @ np.swapaxes(rotation_exp(turn(seen)) @ C_bc, 1, 2)
    from_turns = hand_eye.from_rates(
        t, w, seen + 0.037, [Pose(_log(one), np.zeros(3)) for one in C], reach=hand_eye.REACH
    )
    both = (from_places, from_turns)
    values = [
        *_log(C_bc.T @ from_places.C_bc),
        *from_places.values,
        *_log(C_bc.T @ from_turns.C_bc),
        *from_turns.values,
    ]
    return Answer(tuple(one for found in both for one in found.undetermined), np.array(values), _stds(both))


def _log(C: np.ndarray) -> np.ndarray:
    return np.asarray(quaternion_log(quaternion_from_matrix(C)))


def _stds(found: Sequence[hand_eye.Mounting]) -> np.ndarray:
    return np.concatenate([one.std for one in found])


def _lenses() -> Answer:
    """The same pictures with lenses whose start has no closed form [pixels]."""
    seen = read_corners(Path(__file__).parents[1] / "camera" / "opencv_left.csv")
    names = ("fisheye", "unified", "omnidirectional")
    return _relative([fit(seen.views, form(name), seen.size).rms for name in names], names)


def _misfits() -> Answer:
    """Of 200 sets of so many pictures whose errors scatter by half: sets in which one is set aside, and in which the
    one that is 20 times as far off is.
    """
    rng, words = np.random.default_rng(1), []
    for n in (4, 8, 20):
        counts = np.zeros(2, dtype=np.int64)
        for _ in range(200):
            sizes = np.exp(0.5 * rng.standard_normal(n))
            for k, of in enumerate((sizes, sizes * np.where(np.arange(n) == 0, 20.0, 1.0))):
                out = that_do_not_fit(_pictures(of))
                counts[k] += "0" in out if k else bool(out)
        words.append(f"of {n}: {counts[0]} in vain, {counts[1]} found")
    return Answer(tuple(words), np.zeros(0), np.zeros(0))


def _pictures(rms: np.ndarray) -> CameraFit:
    """A fit whose pictures of 54 corners have these errors [pixels]."""
    corners = np.zeros((54, 3))
    views = tuple(View(str(k), corners, corners[:, :2]) for k in range(len(rms)))
    residual = tuple(np.tile([size, 0.0], (54, 1)) for size in rms)
    lens = Intrinsics(np.ones(2), np.zeros(2), "brown", np.zeros(5))
    return CameraFit(form("pinhole"), lens, (), views, np.eye(4), (), residual, 1.0)


def _headings() -> Answer:
    """First heading [rad] of three flights without a compass, and of one whose gyroscope is 3 deg/s off."""
    found = []
    for scenario, off in (("figure_eight", 0.0), ("square", 0.0), ("aerobatics", 0.0), ("figure_eight", 0.05)):
        recording = _recording(scenario, seed=5)
        imu = recording.streams["imu"]
        streams = {name: one for name, one in recording.streams.items() if name in ("gps", "baro")}
        streams["imu"] = Stream(imu.t, {**imu.columns, "gyro_z": imu["gyro_z"] + off})
        blind = recording.replace(
            streams=streams, initial=replace(recording.initial, quaternion=None, attitude_std=None), truth=None
        )
        headed = with_heading(blind, {})
        x, _ = first_state(Flight.of(headed))
        found.append(float(rpy_from_quaternion(x[None, Q_NB])[0, 2]))
    return Answer((), np.array(found), np.full(4, 0.05))


def _rest() -> Answer:
    """Whether logs are at rest whose force [m/s^2] and rate [rad/s] scatter, that turn [rad/s], or that are heights
    alone and wander [m]; and white noise of one axis of each kind.
    """
    words, rng = [], np.random.default_rng(1)
    t, tables = np.arange(0.0, 120.0, 0.02), []
    for accel, gyro, turned in (
        (0.1, 0.01, 0.0),
        (0.3, 0.03, 0.0),
        (0.8, 0.03, 0.0),
        (0.3, 0.08, 0.0),
        (0.1, 0.01, 0.015),
        (0.1, 0.01, 0.032),
    ):
        f = np.array([0.0, 0.0, -9.8]) + accel * rng.standard_normal((len(t), 3))
        w = gyro * rng.standard_normal((len(t), 3)) + turned * np.sin(np.pi * t / t[-1])[:, None]
        imu = Stream(t, dict(zip((*ACCEL, *GYRO), np.hstack([f, w]).T, strict=True)))
        tables.append(Recording("table", "flight", {"imu": imu}))
        words.append(f"{accel} {gyro} {turned} {_is_at_rest(tables[-1])}")
    for far in (3.0, 8.0):
        height = far / 0.96 * t / t[-1] + 0.1 * rng.standard_normal(len(t))
        words.append(f"{far} m {_is_at_rest(Recording('table', 'flight', {'baro': Stream(t, {'height': height})}))}")
    fits = [one.fit for one in noise_at_rest(tables[0]).channels]
    return Answer(tuple(words), np.array([f.coefficients[0] for f in fits]), np.array([f.std[0] for f in fits]))


def _is_at_rest(recording: Recording) -> str:
    try:
        noise_at_rest(recording)
    except InputError:
        return "a flight"
    return "at rest"


def _shock() -> Answer:
    """Position and velocity at the end of a flight whose gyroscope reads a turn of 1 rad that is none. Its fixes are
    not late; at the median of that prior, 0.1 s, quick turns of a calm flight are upsets too.
    """
    recording = _bare(_recording("figure_eight", seed=5))
    imu = recording.streams["imu"]
    pulse = (imu.t >= 30.0) & (imu.t < 30.1)
    turn = pulse / (np.sum(pulse) * imu.step)
    streams = {name: one for name, one in recording.streams.items() if name in ("gps", "baro")}
    streams["imu"] = Stream(imu.t, {**imu.columns, "gyro_z": imu["gyro_z"] + turn})
    recording = recording.replace(streams=streams, truth=None)
    levels = replace(first_levels(recording, sizes_of(recording), None, None), latency={"gps": 0.0})
    levels = with_upsets(recording, levels)
    journal = run(prepare(levels.flight(recording)), "numba", 0)
    sigma = np.sqrt(journal.P_end.diagonal())
    return Answer((f"{len(levels.upsets)} upsets",), journal.x_end[PV], sigma[PV])


def _gap() -> Answer:
    """Position and velocity at the end of a figure of eight whose IMU lacks 0.3 s, 1.5 s and twice 6 s, and how many
    stretches it has.
    """
    recording = _recording("figure_eight", seed=5)
    imu, t = recording.streams["imu"], recording.streams["imu"].t
    there = ~(
        ((t > 10.0) & (t < 10.3)) | ((t > 20.0) & (t < 21.5)) | ((t > 30.0) & (t < 36.0)) | ((t > 36.6) & (t < 42.0))
    )
    cut = recording.replace(streams={**recording.streams, "imu": imu.rows(there)}, truth=None)
    inputs = prepare(Flight.of(cut))
    journal = run(inputs, "numba", 0)
    sigma = np.sqrt(journal.P_end.diagonal())
    return Answer((f"{len(inputs.imu.starts)} stretches",), journal.x_end[PV], sigma[PV])


def _moving() -> Answer:
    """First attitude and its 1-sigma [rad] of flights that begin in the air, one with its compass, two without."""
    attitudes, sigmas = [], []
    for scenario, since, sensors in (
        ("aerobatics", 10.0, ("gps", "mag")), ("figure_eight", 15.0, ("gps",)), ("aerobatics", 12.0, ("gps",))
    ):  # fmt: skip
        recording = _recording(scenario, seed=5)
        streams = {name: one.rows(one.t >= since) for name, one in recording.streams.items()}
        begun = recording.replace(
            streams={name: one for name, one in streams.items() if name in ("imu", *sensors)},
            initial=replace(recording.initial, quaternion=None, attitude_std=None), truth=None,
        )  # fmt: skip
        x, P = first_state(Flight.of(begun))
        sigma = np.sqrt(P.diagonal()[DTHETA])
        attitudes += [*rpy_from_quaternion(x[None, Q_NB])[0], *sigma]
        sigmas += [*sigma, *sigma]
    return Answer((), np.array(attitudes), np.array(sigmas))


def _unaided() -> Answer:
    """Attitude at the end of a hover without a GPS, and the 1-sigma of place and attitude."""
    recording = _recording("hover", seed=5)
    streams = {name: one for name, one in recording.streams.items() if name in ("imu", "baro", "mag")}
    initial = replace(recording.initial, position_std=None, velocity=None, velocity_std=None)
    alone = recording.replace(streams=streams, truth=None, initial=initial)
    journal = run(prepare(Flight.of(alone)), "numba", 0)
    sigma = np.sqrt(journal.P_end.diagonal())[[*range(DP.start, DP.stop), *range(DTHETA.start, DTHETA.stop)]]
    return Answer((), np.append(journal.x_end[Q_NB], sigma), np.append(np.full(4, sigma[3:].max()), sigma))


def _declared(recording: Recording, name: str) -> float:
    """White noise of a sensor, of its worst axis."""
    return float(np.max(np.asarray(recording.spec(name).noise_std, dtype=np.float64)))


def _left() -> Answer:
    """What is said of a barometer whose noise is slow and so many times as large as declared, or is for 4 s."""
    recording, words = _recording("hover"), []
    baro, rng = recording.streams["baro"], np.random.default_rng(1)
    sigma = _declared(recording, "baro")
    slow = lfilter([0.6], [1.0, -0.8], rng.standard_normal(len(baro.t)))  # of variance 1
    some = (baro.t > 30.0) & (baro.t < 34.0)
    for factor in (1.8, 2.4):
        for noise in (slow, some * rng.standard_normal(len(baro.t))):
            stream = Stream(
                baro.t, {**baro.columns, "height": baro["height"] + sigma * np.sqrt(factor**2 - 1.0) * noise}
            )
            source = flight_source(recording.replace(streams={**recording.streams, "baro": stream}), slow_gps=False)
            left = [one for one in remaining(source, source.fit(()), (), (), 0.01) if one.stream == "baro"]
            kinds = sorted({f"{one.kind}{'!' if one.in_mean else ''}" for one in left})
            words.append(f"{factor} {' '.join(kinds)}")
    return Answer(tuple(words), np.zeros(0), np.zeros(0))


def _iron() -> Answer:
    """Whether a compass is taken for one that was never calibrated, by its hard iron as a part of the field."""
    words = []
    for size in (0.141, 0.148):
        recording = _board(0.0)
        mag = recording.streams["mag"]
        off = mag["mag_x"] + size * float(np.median(np.linalg.norm(mag.array(MAG), axis=1)))
        biased = recording.replace(streams={**recording.streams, "mag": Stream(mag.t, {**mag.columns, "mag_x": off})})
        words.append(f"{size} {'calibrated' if beforehand(_bare(biased)).iron == CALIBRATED else 'as it comes'}")
    return Answer(tuple(words), np.zeros(0), np.zeros(0))


def _slow() -> Answer:
    """What is found of a receiver's noise where it is white and so many times as large as declared, or slow."""
    words, rng = [], np.random.default_rng(1)
    recording = _of_20_s(_recording("figure_eight"), "gps", "mag")
    gps = recording.streams["gps"]
    sigma = _declared(recording, "gps")
    for factor, pole in ((1.0, 0.0), (8.0, 0.0), (1.5, 0.9)):
        noise = lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], rng.standard_normal((len(gps.t), 3)), axis=0)
        added = sigma * np.sqrt(factor**2 - 1.0) * noise
        columns = {name: gps[name] + added[:, k] for k, name in enumerate(POSITION)}
        stream = Stream(gps.t, {**gps.columns, **columns})
        levels = with_slow_gps(recording.replace(streams={**recording.streams, "gps": stream}))
        words.append(f"{factor} {pole} {', '.join(sorted(size.key for size in levels.found)) or 'as declared'}")
    return Answer(tuple(words), np.zeros(0), np.zeros(0))


def _hand() -> Answer:
    """The bounds that hover and figure of eight need where no place is measured, and the noise of the IMU found with
    them, in the logarithm.
    """
    words, values, sigmas = [], list[float](), list[float]()
    for scenario in ("hover", "figure_eight"):
        recording = _of_20_s(_bare(_recording(scenario, seed=5)), "mag", "baro")
        levels = widest_bounds_needed(recording, first_levels(recording, sizes_of(recording), None, None))
        assert levels.bounds is not None
        words.append(f"{scenario} {levels.bounds.place:g} m {levels.bounds.speed:g} m/s")
        found = fit_levels(recording)
        values += [found.value(one) if one.linear else float(np.log(found.value(one))) for one in found.found]
        sigmas += found.sigmas
    return Answer(tuple(words), np.array(values), np.array(sigmas))


def _kinds() -> Answer:
    """For which kind of samples an IMU is taken whose samples are instants, and one whose are means over a step."""
    words = []
    recording = _of_20_s(_recording("aerobatics"), "gps", "baro")
    imu = recording.streams["imu"]
    means = {name: np.convolve(imu[name], [0.5, 0.5], mode="full")[: len(imu.t)] for name in (*ACCEL, *GYRO)}
    for kind, stream in (("instants", imu), ("means", Stream(imu.t, {**imu.columns, **means}))):
        one = _bare(recording.replace(streams={**recording.streams, "imu": stream}))
        words.append(f"{kind} {fitted(one, beforehand(one)).specs['accel'].imu_samples}")
    return Answer(tuple(words), np.zeros(0), np.zeros(0))


def _magnet() -> Answer:
    """What is found of a figure of eight with a compass of 50 Hz, in the logarithm."""
    return _found(prepared(_of_20_s(_bare(_recording("figure_eight")), "mag", "gps")).levels)


def _shaky() -> Answer:
    """1-sigma of the first tilt [rad] on a table, and on one that shakes 2.5 and 6 times as much as the noise."""
    recording = _recording("no_aiding")
    imu, rng = recording.streams["imu"], np.random.default_rng(1)
    sigma, tilts = Flight.of(recording).model.accel.sigma, []
    for times in (1.0, 2.5, 6.0):
        added = sigma * np.sqrt(times**2 - 1.0) * rng.standard_normal((len(imu.t), 3))
        columns = {name: imu[name] + added[:, k] for k, name in enumerate(ACCEL)}
        shaken = recording.replace(
            streams={"imu": Stream(imu.t, {**imu.columns, **columns})}, truth=None,
            initial=replace(recording.initial, quaternion=None, attitude_std=None),
        )  # fmt: skip
        tilts.append(float(np.sqrt(first_state(Flight.of(shaken))[1].diagonal()[DTHETA][0])))
    return _relative(tilts)


def _sold() -> Answer:
    """A figure of eight whose GPS is late, and that declares no noise."""
    return _of_trace(_of_20_s(_bare(_recording("figure_eight", "gps.latency=0.15")), "mag", "gps"))


def _assumed() -> Answer:
    """What is named in a figure of eight, nothing hidden in it, whose place nothing measures."""
    whole = _bare(_recording("figure_eight")).replace(truth=None, initial=Initial(), origin=None)
    environment = replace(whole.environment, magnetic_field=None)
    streams = {name: whole.streams[name] for name in ("imu", "mag")}
    return _of_trace(between(whole.replace(streams=streams, environment=environment), 0.0, 30.0))


CASES: Mapping[str, Callable[[], Answer]] = {
    "poses": _poses,
    "turns": lambda: _of_trace(_recording("gyro_poses", "gyro.g_sensitivity=" + ",".join(["0.0005"] * 9)), "gyro"),
    "flight": lambda: _of_trace(_recording("hover", "gps.transient=4,0,0@20:30")),
    "camera": _camera,
    "ranges": _ranges,
    "steady": _steady,
    "law": _law,
    "coarse": _coarse,
    "outliers": _outliers,
    "doubted": _doubted,
    "observability": _observability,
    "levels": _levels,
    "brief": _brief,
    "sizes": _sizes,
    "beside": _beside,
    "long": _long,
    "weak": _weak,
    "walk": _walk,
    "fields": _fields,
    "zeros": _zeros,
    "beyond": _beyond,
    "clipped": _clipped,
    "shaken": lambda: _of_trace(_recording("vibration", "gps.latency=0.03")),
    "frozen": _frozen,
    "start": _start,
    "few": _few,
    "mounting": _mounting,
    "lenses": _lenses,
    "misfits": _misfits,
    "headings": _headings,
    "rest": _rest,
    "shock": _shock,
    "gap": _gap,
    "moving": _moving,
    "unaided": _unaided,
    "left": _left,
    "iron": _iron,
    "slow": _slow,
    "hand": _hand,
    "kinds": _kinds,
    "magnet": _magnet,
    "shaky": _shaky,
    "sold": _sold,
    "assumed": _assumed,
}
