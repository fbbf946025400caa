"""A long log in pieces: time, and memory in addition to the recording itself.

    python -m sinan.experiments.benchmarks.long_log [--hours 10]

The flight of `filter_speed`, played again and again. Each piece is journalled in full and dropped; what stays in memory
in addition to the recording are its table of IMU samples and its readings in the order of time.
"""

from __future__ import annotations

import argparse
import resource
from time import process_time

import numpy as np

from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import flight_model
from sinan.estimator.filter.pieces import journal_pieces
from sinan.experiments.benchmarks.filter_speed import USED, repeated
from sinan.experiments.scenarios.loader import load_scenario
from sinan.sensors.recording import Recording
from sinan.sensors.simulate import simulate

HOURS = 10.0
MEGABYTE = 2**20


def peak() -> float:
    """Largest memory of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / MEGABYTE


def size_of(recording: Recording) -> float:
    """Memory of its columns [MB]."""
    columns = [v for s in recording.streams.values() for v in (s.t, *s.columns.values())]
    return sum(v.nbytes for v in columns) / MEGABYTE


def long_recording(hours: float) -> Recording:
    """IMU, GPS, magnetometer, barometer and laser for so many hours."""
    recording, _ = simulate(load_scenario("figure_eight"), np.random.default_rng(1))
    streams = {name: recording.streams[name] for name in ("imu", *USED)}
    return repeated(recording.replace(streams=streams), 3600.0 * hours)


def main(hours: float = HOURS) -> dict[str, float]:
    """Measure and print."""
    recording = long_recording(hours)
    model = flight_model(recording, use=USED, gate_level=None)
    for _ in journal_pieces(Flight(repeated(recording, 120.0), model), "numba"):
        pass  # compiles
    before, start, readings, samples = peak(), process_time(), 0, 0
    for journal in journal_pieces(Flight(recording, model), "numba"):
        assert np.all(np.isfinite(journal.x_end))
        readings, samples = readings + len(journal), samples + len(journal.imu_t) - 1
    seconds = process_time() - start
    figures = {
        "hours": hours,
        "IMU samples": float(samples),
        "readings": float(readings),
        "CPU seconds": seconds,
        "us an IMU sample": 1e6 * seconds / samples,
        "recording, MB": size_of(recording),
        "peak beside it, MB": peak() - before,
    }
    for name, value in figures.items():
        print(f"{name:24} {value:12.2f}")
    return figures


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=HOURS)
    main(parser.parse_args().hours)
