"""How fast the filter is: both engines, and the sensitivity pass against reruns, in one interleaved run.

    python -m sinan.experiments.benchmarks.filter_speed

Work unit: 120 s of flight, IMU 200 Hz, magnetometer 50, barometer 25, laser 20, GPS 10 Hz with velocity, 22 error
states,
journal on. Times are the smallest of several rounds in which all contestants take turns, so that a busy computer
slows them
alike; "us" is microseconds per IMU sample.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from time import perf_counter

import numpy as np

from sinan.estimator.evidence.sensitivity import accumulate, candidate_streams, pack
from sinan.estimator.filter.compiled import CompiledRun
from sinan.estimator.filter.effect_forms import Along, Terms, reference_motion
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.engine_filterpy import ReadableFilter
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.imu import imu_table
from sinan.estimator.filter.inputs import RunInputs, outputs_for, prepare
from sinan.experiments.scenarios.loader import load_scenario
from sinan.sensors.effects import Effect, effects_for
from sinan.sensors.effects.transient import for_stream
from sinan.sensors.recording import Recording
from sinan.sensors.simulate import simulate

DURATION = 120.0  # s
USED = ("gps", "mag", "baro", "laser")
READABLE_PART = 10.0  # s of flight that the readable engine is timed on
PARAMETERS = 100
ROUNDS = 7


def work_unit(duration: float = DURATION) -> RunInputs:
    """The flight: the scenario `figure_eight`, repeated manoeuvres cut to length."""
    scenario = load_scenario("figure_eight")
    recording, _ = simulate(scenario, np.random.default_rng(1))
    recording = repeated(recording, duration)
    return prepare(Flight.of(recording, use=USED))


def repeated(recording: Recording, duration: float) -> Recording:
    """The recording cut to `duration`, its readings played again where it is shorter (for speed alone)."""
    from sinan.sensors.recording import Stream

    span = float(recording.streams["imu"].t[-1]) + recording.streams["imu"].step
    streams = {}
    for name, stream in recording.streams.items():
        times = int(np.ceil(duration / span))
        t = np.concatenate([stream.t + k * span for k in range(times)])
        keep = (t <= duration) & (np.diff(t, prepend=-np.inf) > 0.0)
        streams[name] = Stream(t[keep], {c: np.tile(v, times)[keep] for c, v in stream.columns.items()})
    return recording.replace(streams=streams)


def candidates(inputs: RunInputs, parameters: int = PARAMETERS) -> tuple[Effect, ...]:
    """Effects of the catalogue that need no covariate, filled up with transients to the number of parameters."""
    plain = reference_motion(run(inputs, "numba", 0), Terms(), inputs.imu)
    chosen = [e for e in effects_for("flight", candidate_streams(inputs.model)) if not e.missing(plain)]
    k = 0
    while sum(e.size for e in chosen) < parameters:
        chosen.append(for_stream(("mag", "gps", "baro", "laser")[k % 4], 5.0 * k, 5.0 * k + 5.0))
        k += 1
    while sum(e.size for e in chosen) > parameters:
        chosen.pop()
    return tuple(chosen)


def fastest(contestants: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Smallest time of each contestant [s]; they take turns."""
    best = dict.fromkeys(contestants, np.inf)
    for _ in range(rounds):
        for name, work in contestants.items():
            start = perf_counter()
            work()
            best[name] = min(best[name], perf_counter() - start)
    return best


def main(rounds: int = ROUNDS) -> dict[str, float]:
    """Measure and print; returns microseconds per IMU sample and the ratios."""
    inputs = work_unit()
    model, samples = inputs.model, len(inputs.imu)
    part = prepare(Flight(repeated(inputs.recording, READABLE_PART), model))
    effects = candidates(inputs)
    motion = reference_motion(run(inputs, "numba", 0), Terms(), inputs.imu)
    columns, order, slices = pack(Along(Flight(inputs.recording, model), Terms(), motion, inputs.imu), effects)

    def readable() -> None:
        for _ in ReadableFilter(part).steps():
            pass

    best = fastest(
        {
            "compiled": lambda: CompiledRun(inputs, outputs_for(inputs)).all(),
            "sensitivity": lambda: accumulate(inputs, effects, slices, columns, order, 20, 0, 1),
            "prepare": lambda: (imu_table(Flight(inputs.recording, model)), prepare(Flight(inputs.recording, model))),
            "filterpy": readable,
        },
        rounds,
    )
    us = {name: 1e6 * t / (len(part.imu) if name == "filterpy" else samples) for name, t in best.items()}
    p = sum(e.size for e in effects)
    us["filterpy over compiled"] = us["filterpy"] / us["compiled"]
    us[f"pass with {p} parameters over plain"] = us["sensitivity"] / us["compiled"]
    us[f"{p} reruns over pass"] = p * us["compiled"] / us["sensitivity"]
    for name, value in us.items():
        print(f"{name:40} {value:9.3f}")
    return us


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    main(parser.parse_args().rounds)
