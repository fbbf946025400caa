"""A long run in pieces: the same bits, and memory that does not grow with the journal."""

from __future__ import annotations

import tracemalloc

import numpy as np

from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import flight_model
from sinan.estimator.filter.pieces import PIECE, journal_pieces
from sinan.estimator.filter.run_filter import run_filter
from sinan.experiments.benchmarks.long_log import long_recording, size_of
from tests.estimator.analytic_flight import fly

MEGABYTE = 2**20


def test_pieces_end_where_the_whole_ends() -> None:
    recording, _ = fly(41, duration=30.0)
    model = flight_model(recording)
    whole = run_filter(Flight(recording, model), engine="numba")
    parts = list(journal_pieces(Flight(recording, model), "numba", seconds=PIECE / 8.0))
    assert len(parts) == 240.0 / PIECE
    np.testing.assert_array_equal(parts[-1].x_end, whole.x_end)
    np.testing.assert_array_equal(parts[-1].P_end, whole.P_end)
    np.testing.assert_array_equal(np.concatenate([part.nu for part in parts]), whole.nu)


def test_a_quarter_of_an_hour_needs_no_more_than_its_readings_do() -> None:
    """Three times the recording; the whole journal would be ten times."""
    recording = long_recording(0.25)
    model = flight_model(recording, use=("gps", "mag", "baro", "laser"), gate_level=None)
    tracemalloc.start()
    try:
        samples = sum(len(journal.imu_t) - 1 for journal in journal_pieces(Flight(recording, model), "numba"))
        peak = tracemalloc.get_traced_memory()[1] / MEGABYTE
    finally:
        tracemalloc.stop()
    assert samples == len(recording.streams["imu"]) - 1
    assert peak < 3.0 * size_of(recording) + 10.0
