"""Whether answers depend on what only bounds the work: numbers of rounds, lengths of lists, steps of differences.

    python -m sinan.experiments.benchmarks.bounds_of_work [CASE ...]

Each constant is halved and doubled by itself, its case is answered again, and both answers are compared with the first:
whether the words are the same, and by how much a number has moved, in its own sigma where it has one, else relative
to itself. A list of numbers is halved and doubled as a whole. What one small case shows it shows of that case.

So are choices: numbers that decide and that nothing gives. Their cases have examples on both sides of them, in words,
and what half and twice say otherwise is printed below.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from pathlib import Path
from sys import modules
from time import process_time
from typing import Any

import numpy as np

from sinan.calibration.cameras.camera import fit, form
from sinan.calibration.cameras.views import read_corners
from sinan.calibration.levels.fields import beforehand
from sinan.calibration.levels.fit import first_levels, fit_levels, sizes_of
from sinan.calibration.levels.preparation import prepared
from sinan.calibration.poses.evidence.bias_walk import estimated_walk
from sinan.estimator.evidence.intervals.outliers import wrong_among
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.inputs import prepare
from sinan.estimator.filter.layout import DP, DTHETA, P_N, PV
from sinan.estimator.filter.relinearise import run_relinearised
from sinan.estimator.positioning.location import locate
from sinan.estimator.positioning.pseudorange_trace import trace_ranges
from sinan.estimator.positioning.steady_fault import steady_fault
from sinan.experiments.bias_observability.case import case_of_recording
from sinan.experiments.bias_observability.study import study
from sinan.experiments.gnss.simulated import load
from sinan.experiments.gnss.simulated import simulate as ranges_of
from sinan.experiments.residual_loop.open_flight import flight_source
from sinan.experiments.residual_loop.remaining import remaining
from sinan.experiments.residual_loop.run import trace_recording
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.errors import InputError
from sinan.sensors.geomagnetism import direction_at, field_along
from sinan.sensors.pseudorange import Pseudoranges, pseudoranges
from sinan.sensors.recording import ACCEL, GYRO, Recording, SensorSpec, Stream
from sinan.sensors.simulate import simulate

_LOOP = "sinan.experiments.residual_loop."
_POSES = "sinan.calibration.poses.evidence."
_EVIDENCE = "sinan.estimator.evidence."
_INTERVALS = _EVIDENCE + "intervals."
_FLIGHTS = _EVIDENCE + "flights."
_LEVELS = "sinan.calibration.levels."
_RANGES = "sinan.estimator.positioning."
#: Lowest elevation of a satellite [rad].
MASK = np.deg2rad(10.0)
#: What is halved and doubled, by case: a module and its names.
BOUNDS: Mapping[str, Mapping[str, Sequence[str]]] = {
    "poses": {
        _POSES + "inversion": ("_MOST_PASSES", "_STEP", "_SETTLED"),
        _POSES + "bias_walk": ("_MOST_KNOTS",),
        _POSES + "gauss_newton": ("_MOST_STEPS", "_MOST_HALVINGS", "_SETTLED"),
        _POSES + "source": ("_ROWS_A_BLOCK", "_WORTH_LEAVING_OUT"),
        _LOOP + "select": ("_MOST_ROUNDS",),
        _LOOP + "trials": ("_RELOCATIONS",),
    },
    "turns": {_POSES + "inversion": ("_MOST_PASSES", "_STEP", "_SETTLED"), _LOOP + "trials": ("_AHEAD",)},
    "flight": {
        _FLIGHTS + "passes": ("_MOST_STEPS", "_MOST_HALVINGS"),
        _EVIDENCE + "noise_left": ("_LAGS",),
        _INTERVALS + "onsets": ("_ONSETS", "_FINER", "_FURTHER"),
        _EVIDENCE + "probes": ("_PLACES", "_FEW"),
        _INTERVALS + "sudden": ("_MOST", "_SHORTEST_ANSWER"),
        _LOOP + "trace": ("_MOST_FALLS",),
        _LOOP + "trials": ("_AHEAD", "_RELOCATIONS"),
        _LOOP + "select": ("MOST_GIVEN_ERROR", "_MOST_ROUNDS"),
        _EVIDENCE + "sensitivity": ("_AS_ONE",),
        "sinan.estimator.filter.effect_forms": ("INVERTED",),
    },
    "camera": {
        "sinan.calibration.cameras.camera": ("_LONGEST",),
        "sinan.calibration.cameras.damped": ("_ROUNDS", "_SETTLED", "_DAMPING", "_LEAST", "_MOST"),
    },
    "ranges": {
        _RANGES + "pseudorange_trace": ("MOST_FAULTS",),
        _RANGES + "pseudoranges": ("SHORTLIST",),
        _RANGES + "location": ("MOST_PASSES", "MOST_EXCLUDED", "COARSE"),
        _RANGES + "noise_fit": ("NEAREST", "FARTHEST"),
        _RANGES + "integrity": ("LEAST_REDUNDANCY",),
        _RANGES + "steady_fault": ("SHORTLIST",),
    },
    "coarse": {"sinan.estimator.filter.relinearise": ("PASSES",)},
    "outliers": {_INTERVALS + "outliers": ("_NEAR", "_USUAL", "_LEAST_USUAL", "_FACTOR")},
    "observability": {_EVIDENCE + "observability": ("SHARED", "SMALL", "PROBES", "BATCH")},
    "levels": {_LEVELS + "fit": ("MOST",)},
    "sizes": {_LEVELS + "fit": ("MOST", "GAINED", "SETTLED")},
    "brief": {_FLIGHTS + "passes": ("_SETTLED", "_SETTLED_DEVIANCE")},
    "weak": {_LOOP + "select": ("_PREDICTED",)},
    "walk": {_POSES + "bias_walk": ("_WALKS",)},
}  # fmt: skip
#: Choices, by case.
CHOICES: Mapping[str, Mapping[str, Sequence[str]]] = {
    "brief": {_EVIDENCE + "noise_left": ("_SLOW",), _EVIDENCE + "source": ("LINEAR",)},
    "fields": {_LEVELS + "fields": ("BESIDE_STEEL", "ELSEWHERE")},
    "zeros": {_LEVELS + "fit": ("SAME_ZERO",)},
    "clipped": {"sinan.estimator.filter.imu": ("_SLOPE",)},
    "shaken": {"sinan.estimator.filter.wiener": ("VEHICLE_BANDWIDTH",)},
    "frozen": {_LOOP + "remaining": ("_LEAST_FAULT",)},
    "start": {_INTERVALS + "localise": ("_START_UP",)},
    "few": {_INTERVALS + "outliers": ("_LEAST",)},
    "ranges": {_RANGES + "pseudoranges": ("CHANGING_NOISE",)},
    "steady": {_RANGES + "steady_fault": ("SIZES",)},
}


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


def _sizes() -> Answer:
    """What is found of a figure of eight that declares no noise, in the logarithm."""
    levels = fit_levels(_of_20_s(_bare(_recording("figure_eight")), "baro", "gps"))
    values = [levels.value(size) if size.linear else np.log(levels.value(size)) for size in levels.found]
    return Answer((), np.array(values), np.array(levels.sigmas))


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


CASES: Mapping[str, Callable[[], Answer]] = {
    "poses": _poses,
    "turns": lambda: _of_trace(_recording("gyro_poses", "gyro.g_sensitivity=" + ",".join(["0.0005"] * 9)), "gyro"),
    "flight": lambda: _of_trace(_recording("hover", "gps.transient=4,0,0@20:30")),
    "camera": _camera,
    "ranges": _ranges,
    "steady": _steady,
    "coarse": _coarse,
    "outliers": _outliers,
    "observability": _observability,
    "levels": _levels,
    "brief": _brief,
    "sizes": _sizes,
    "weak": _weak,
    "walk": _walk,
    "fields": _fields,
    "zeros": _zeros,
    "clipped": _clipped,
    "shaken": lambda: _of_trace(_recording("vibration", "gps.latency=0.03")),
    "frozen": _frozen,
    "start": _start,
    "few": _few,
}


def scaled(value: Any, factor: float) -> Any:
    """A number or a tuple of numbers times a factor; a count stays a count, of one at least."""
    if isinstance(value, tuple):
        return tuple(scaled(one, factor) for one in value)
    return max(round(value * factor), 1) if isinstance(value, int) else value * factor


def answered(case: str, module: str, name: str, factor: float) -> Answer | None:
    """What a case says with one constant scaled; None: no answer could be given."""
    place = import_module(module)
    value = getattr(place, name)
    # modules that import a float by its name have the same object
    places = [one for one in modules.values() if isinstance(value, float) and vars(one).get(name) is value] or [place]
    for one in places:
        setattr(one, name, scaled(value, factor))
    try:
        return CASES[case]()
    except (InputError, IndexError, ValueError):
        return None
    finally:
        for one in places:
            setattr(one, name, value)


def moved(case: str, module: str, name: str, factor: float, usual: Answer) -> float:
    """How far an answer moves with one constant scaled; NaN: none could be given."""
    other = answered(case, module, name, factor)
    return np.nan if other is None else usual.apart(other)


def main(cases: Sequence[str] = ()) -> dict[tuple[str, str, str], tuple[float, float]]:
    """Print a line a constant; returns the moves at half and at twice the value."""
    found = {}
    for case in cases or CASES:
        CASES[case]()  # compiles
        start = process_time()
        usual = CASES[case]()
        print(
            f"{case}: {', '.join(usual.words)}; {len(usual.values)} numbers, {process_time() - start:.1f} s", flush=True
        )
        for table in (BOUNDS, CHOICES):
            for module, names in table.get(case, {}).items():
                for name in names:
                    others = [answered(case, module, name, factor) for factor in (0.5, 2.0)]
                    half, twice = (np.nan if other is None else usual.apart(other) for other in others)
                    found[case, module, name] = half, twice
                    at = f"{module.removeprefix('sinan.')}.{name}"
                    print(f"    {at:60} halved {half:.1e}, doubled {twice:.1e}", flush=True)
                    for word, other in zip(("halved", "doubled"), others, strict=True):
                        if other is not None and other.words != usual.words:
                            print(f"        {word}: {', '.join(other.words)}", flush=True)
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", choices=[[], *CASES])
    main(parser.parse_args().cases)
