"""A long run in pieces: each piece is a run of its own that starts where the one before it ended, to the same bits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from sinan.estimator.filter.engine import Engine, run
from sinan.estimator.filter.events import Events
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.imu import ImuTable
from sinan.estimator.filter.inputs import RunInputs, outputs_for, prepare
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.layout import CAPACITY
from sinan.sensors.arrays import FloatArray

if TYPE_CHECKING:
    from sinan.estimator.filter.compiled import CompiledRun
    from sinan.estimator.filter.engine_numba import Trail

PIECE = 40.0  # s, of a journal in memory: bound of work (`test_pieces`)


def journal_pieces(
    flight: Flight, engine: Engine = "auto", stride: int = 1, seconds: float = PIECE
) -> Iterator[Journal]:
    """Journals of one run, piece after piece: besides the readings, only one piece is in memory.

    Parameters
    ----------
    flight, engine, stride : as for `run_filter`; declared effects are not modelled
    seconds : length of a piece
    """
    inputs = prepare(flight)
    t = inputs.imu.t
    for i0, last, x, P in inputs.stretches:
        while i0 < last:
            i1 = max(i0 + 1, min(last, int(np.searchsorted(t, t[i0] + seconds))))
            journal = run(part_of(inputs, i0, i1, x, P), engine, stride)
            yield journal
            x, P, i0 = journal.x_end, journal.P_end, i1


@dataclass(frozen=True)
class Part:
    """Some IMU samples of a run, and the state and covariance at the first of them.

    Attributes
    ----------
    i0, i1 : first and last sample
    inputs : of a run over them
    begins : whether a stretch begins with it
    """

    i0: int
    i1: int
    inputs: RunInputs
    begins: bool


def parts_of(inputs: RunInputs, length: int) -> list[Part]:
    """A run in parts of at most so many samples, from one forward pass: what is to be gone through backwards."""
    from sinan.estimator.filter.compiled import CompiledRun

    found = []
    for first, last, x, P in inputs.stretches:
        edges = [*range(first, max(last, first + 1), length), last]
        for i0, i1 in pairwise(edges):
            part = part_of(inputs, i0, i1, x, P)
            found.append(Part(i0, i1, part, i0 == first))
            if i1 < last:
                x, P = CompiledRun(part, outputs_for(part, 0)).all()
    return found


def part_of(inputs: RunInputs, i0: int, i1: int, x: FloatArray, P: FloatArray) -> RunInputs:
    """The part of a run between two IMU samples of a stretch; readings at the last belong to the next part, unless the
    stretch ends.
    """
    imu, events = inputs.imu, inputs.events
    k0, k1 = inputs.events_of(i0, i1)
    rows = slice(i0, i1 + 1)
    table = ImuTable(imu.t[rows], imu.u[rows], imu.q_accel[i0:i1], imu.q_gyro[i0:i1], imu.row[rows])
    return replace(inputs, imu=table, events=_events_between(events, k0, k1), x=x, P=P, later=())


def recorded(part: RunInputs, stride: int, times: bool = False) -> tuple[CompiledRun, Trail]:
    """A part run forwards, and what going through it backwards needs: all steps, where readings and samples are.

    Parameters
    ----------
    times : whether it is asked for time constants, too
    """
    from sinan.estimator.filter.compiled import CompiledRun
    from sinan.estimator.filter.engine_numba import Trail

    engine = CompiledRun(part, outputs_for(part, stride))
    K, samples, rows = len(part.events), len(part.imu), int(part.events.row[-1])
    coloured = np.flatnonzero(engine.world.rate) if times else np.zeros(0, dtype=np.int64)
    trail = Trail(
        kept=True,
        steps=np.zeros((K + samples, 61)),
        step_of_event=np.zeros(max(K, 1), dtype=np.int64),
        step_of_imu=np.zeros(samples, dtype=np.int64),
        U=np.zeros((max(rows, 1), CAPACITY)),
        H=np.zeros((max(rows, 1), CAPACITY)),
        turn=np.zeros((max(K, 1), 3)),
        coloured=coloured,
        after=np.zeros((K + samples if len(coloured) else 1, len(coloured), CAPACITY + 1)),
    )
    engine.chunk(0, samples - 1, trail)
    steps = max(int(trail.step_of_imu[-1]), int(trail.step_of_event.max()))
    return engine, trail._replace(steps=trail.steps[:steps], step_of_event=trail.step_of_event[:K])


def _events_between(events: Events, k0: int, k1: int) -> Events:
    row = events.row[k0 : k1 + 1]
    components = slice(row[0], row[-1])
    formed = len(events.ref) == len(events) and len(events) > 1
    return replace(
        events, t=events.t[k0:k1], sensor=events.sensor[k0:k1], index=events.index[k0:k1], row=row - row[0],
        z=events.z[components], r=events.r[components], status=events.status[k0:k1],
        D=events.D[components] if formed else events.D, ref=events.ref[k0:k1] if formed else events.ref,
    )  # fmt: skip
