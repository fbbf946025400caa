"""Whether answers depend on what only bounds the work: numbers of rounds, lengths of lists, steps of differences.

    python -m sinan.experiments.benchmarks.bounds_of_work [CASE ...]

Each constant is halved and doubled by itself, its case is answered again, and both answers are compared with the first:
whether the words are the same, and by how much a number has moved, in its own sigma where it has one, else relative
to itself. A list of numbers is halved and doubled as a whole. What one small case shows it shows of that case.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from sinan.calibration.cameras.camera import fit, form
from sinan.calibration.cameras.views import read_corners
from sinan.calibration.levels.preparation import prepared
from sinan.estimator.evidence.intervals.outliers import wrong_among
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.layout import PV
from sinan.estimator.filter.relinearise import run_relinearised
from sinan.estimator.positioning.pseudorange_trace import trace_ranges
from sinan.experiments.bias_observability.case import case_of_recording
from sinan.experiments.bias_observability.study import study
from sinan.experiments.gnss.simulated import load
from sinan.experiments.gnss.simulated import simulate as ranges_of
from sinan.experiments.residual_loop.run import trace_recording
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.errors import InputError
from sinan.sensors.pseudorange import pseudoranges
from sinan.sensors.recording import Recording, SensorSpec
from sinan.sensors.simulate import simulate

_LOOP = "sinan.experiments.residual_loop."
_POSES = "sinan.calibration.poses.evidence."
_EVIDENCE = "sinan.estimator.evidence."
_INTERVALS = _EVIDENCE + "intervals."
_FLIGHTS = _EVIDENCE + "flights."
_LEVELS = "sinan.calibration.levels."
_RANGES = "sinan.estimator.positioning."
#: What is halved and doubled, by case: a module and its names.
BOUNDS: Mapping[str, Mapping[str, Sequence[str]]] = {
    "poses": {
        _POSES + "inversion": ("_MOST_PASSES", "_STEP", "_SETTLED"),
        _POSES + "bias_walk": ("_MOST_KNOTS",),
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
}  # fmt: skip


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


def _ranges() -> Answer:
    """A satellite walks off by half a metre a second from 300 s on."""
    simulated = ranges_of(load("static_ca"), 1)
    ranges = pseudoranges(simulated.rover, simulated.navigation)
    away = 0.5 * np.maximum(ranges.time - ranges.t[0] - 300.0, 0.0) * (ranges.satellite == "G06")
    found = trace_ranges(replace(ranges, value=ranges.value + away), np.deg2rad(10.0))
    words = tuple(f"{one.name} {one.satellite or ''}".strip() for one in found.called)
    return _relative(np.concatenate([one.full for one in found.called]), words)


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


CASES: Mapping[str, Callable[[], Answer]] = {
    "poses": _poses,
    "turns": lambda: _of_trace(_recording("gyro_poses", "gyro.g_sensitivity=" + ",".join(["0.0005"] * 9)), "gyro"),
    "flight": lambda: _of_trace(_recording("hover", "gps.transient=4,0,0@20:30")),
    "camera": _camera,
    "ranges": _ranges,
    "coarse": _coarse,
    "outliers": _outliers,
    "observability": _observability,
    "levels": _levels,
}


def scaled(value: Any, factor: float) -> Any:
    """A number or a tuple of numbers times a factor; a count stays a count, of one at least."""
    if isinstance(value, tuple):
        return tuple(scaled(one, factor) for one in value)
    return max(round(value * factor), 1) if isinstance(value, int) else value * factor


def moved(case: str, module: str, name: str, factor: float, usual: Answer) -> float:
    """How far an answer moves with one constant scaled; NaN: none could be given."""
    place = import_module(module)
    value = getattr(place, name)
    setattr(place, name, scaled(value, factor))
    try:
        return usual.apart(CASES[case]())
    except (InputError, IndexError, ValueError):
        return np.nan
    finally:
        setattr(place, name, value)


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
        for module, names in BOUNDS[case].items():
            for name in names:
                moves = moved(case, module, name, 0.5, usual), moved(case, module, name, 2.0, usual)
                found[case, module, name] = moves
                at = f"{module.removeprefix('sinan.')}.{name}"
                print(f"    {at:60} halved {moves[0]:.1e}, doubled {moves[1]:.1e}", flush=True)
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", choices=[[], *CASES])
    main(parser.parse_args().cases)
