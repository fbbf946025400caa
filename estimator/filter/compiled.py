"""Drives the compiled kernels: packs records into arrays, runs chunk by chunk, turns a status into an error."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sinan.estimator.filter.error_dynamics import bias_rates
from sinan.estimator.filter.flight_model import FlightModel
from sinan.estimator.filter.inputs import BIAS_BLOCK, KIND, RunInputs, RunOutputs, raise_for
from sinan.estimator.filter.layout import CAPACITY
from sinan.sensors.arrays import FloatArray, IntArray

TILE = 16  # = engine_numba.TILE


def is_compiled() -> bool:
    """Whether the kernels need no compiler: compiled in this process, or found in the cache on disk."""
    from sinan.estimator.filter.engine_numba import run_chunk

    if run_chunk.signatures:
        return True
    cache = run_chunk.stats.cache_path
    return cache is not None and any(Path(cache).glob("engine_numba.run_chunk-*.nbc"))


@dataclass(frozen=True)
class Columns:
    """Candidate effects as columns of V: accelerometer's first, then gyroscope's, then the other sensors'.

    Attributes
    ----------
    tiles : columns over 16; a_tiles : those of the accelerometer; g_first, g_tiles : those of the gyroscope; one tile
        may have both
    Ga, Gg : (N a_tiles, 48), (N g_tiles, 48) three rows of 16 columns: regressors at the samples of the IMU table
    Gz : flat regressors of the readings; at : (K,) first element of a reading
    first, count : (sensors,) columns of each sensor's effects
    """

    tiles: int
    a_tiles: int
    g_first: int
    g_tiles: int
    Ga: FloatArray
    Gg: FloatArray
    Gz: FloatArray
    at: IntArray
    first: IntArray
    count: IntArray


def no_columns(sensors: int, events: int) -> Columns:
    """No candidates: the plain filter."""
    none = np.zeros(sensors, dtype=np.int64)
    return Columns(
        0,
        0,
        0,
        0,
        np.zeros((1, 1)),
        np.zeros((1, 1)),
        np.zeros(1),
        np.zeros(max(events, 1), dtype=np.int64),
        none,
        none,
    )


def _first_colour(model: FlightModel, name: str) -> int:
    """Where the colour of a sensor's readings begins in the state; -1: it has none."""
    parts = model.colour_of(name)
    return model.layout.start(parts[0][1].block) if parts else -1


@dataclass
class CompiledRun:
    """One run of the compiled engine, in chunks that share its state.

    Attributes
    ----------
    inputs, outputs : of the run
    columns : candidate effects
    x, P : (CAPACITY + 1,), (1, CAPACITY^2) state and covariance as the kernels hold them
    V : (tiles, 16 CAPACITY) sensitivities of the state error
    """

    inputs: RunInputs
    outputs: RunOutputs
    columns: Columns | None = None
    x: FloatArray = field(init=False)
    P: FloatArray = field(init=False)
    V: FloatArray = field(init=False)
    clock: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        inputs = self.inputs
        self.columns = self.columns or no_columns(len(inputs.events.sensors), len(inputs.events))
        self.x, self.P = np.zeros(CAPACITY + 1), np.zeros((1, CAPACITY * CAPACITY))
        self.V = np.zeros((max(self.columns.tiles, 1), CAPACITY * TILE))
        self.clock = np.zeros(1)
        self.start(0, inputs.x, inputs.P)
        self._pack()

    def start(self, i0: int, x: FloatArray, P: FloatArray) -> None:
        """Begin a stretch at an IMU sample from a state (n + 1,) and a covariance (n, n)."""
        n, stride = len(P), self.outputs.stride
        self.x[:], self.P[:], self.V[:], self.clock[0] = 0.0, 0.0, 0.0, self.inputs.imu.t[i0]
        self.x[: n + 1] = x
        self.P.reshape(CAPACITY, CAPACITY)[:n, :n] = 0.5 * (P + P.T)
        if i0 == 0 or (stride and i0 % stride == 0):
            row = i0 // stride if stride else 0
            self.outputs.x_imu[row], self.outputs.var_imu[row] = self.x, self.P[0, :: CAPACITY + 1]

    def _pack(self) -> None:
        model, names = self.inputs.model, self.inputs.events.sensors
        sizes = [model.sensors[name].size for name in names]
        self.size = np.array(sizes, dtype=np.int64)
        self.kind = np.array([KIND[name] for name in names], dtype=np.int64)
        blocks = [BIAS_BLOCK.get(name, f"b_{name}") for name in names]
        self.bias = np.array([model.layout.start(b) if model.layout.has(b) else -1 for b in blocks], dtype=np.int64)
        beams, self.beam_start = [np.zeros((1, 3))], np.zeros(len(names), dtype=np.int64)
        for s, name in enumerate(names):
            sensor = model.sensors[name]
            if KIND[name] == 4:
                self.beam_start[s] = sum(len(b) for b in beams)
                beams.append(getattr(sensor, "beams_b", np.array([[0.0, 0.0, 1.0]])))
        self.beams = np.ascontiguousarray(np.concatenate(beams))
        self.gate = np.array([model.threshold(name) for name in names])
        self.robust = np.array([model.robust_threshold(name) for name in names])
        self.tail = np.array([model.tail_of(name) or 0.0 for name in names])
        self.colour = np.array([_first_colour(model, name) for name in names], dtype=np.int64)
        self.field = model.layout.start("field") if model.layout.has("field") else -1
        self.walk2, self.rate = np.zeros(CAPACITY), np.zeros(CAPACITY)
        n = model.layout.n
        self.walk2[:n], self.rate[:n] = bias_rates(model)
        self.states = 8 * -(-n // 8)

    def chunk(self, i0: int, i1: int, record: dict[str, Any] | None = None, rows: FloatArray | None = None,
              white: FloatArray | None = None, rows_event: IntArray | None = None) -> int:  # fmt: skip
        """Run from IMU sample i0 to i1; the last sample of all takes its readings along. Returns the rows of W."""
        from sinan.estimator.filter.engine_numba import run_chunk

        inputs, out, c, model = self.inputs, self.outputs, self.columns, self.inputs.model
        assert c is not None
        events, imu = inputs.events, inputs.imu
        k0, k1 = inputs.events_of(i0, i1)
        none, none2, index = np.zeros(1), np.zeros((1, 1)), np.zeros(1, dtype=np.int64)
        record = record or {}
        status, event, count = run_chunk(
            self.clock, imu.t, imu.u, imu.q_accel, imu.q_gyro, i0, i1, k0, k1,
            events.t, events.sensor, events.row, out.S_row, out.status,
            events.z, events.has_form, events.D, events.ref,
            self.kind, self.size, self.bias, self.colour, self.field, self.beam_start, self.beams,
            events.r, self.gate, self.robust, self.tail,
            model.g_n, model.m_n, model.w_ie_n, model.ground_down, model.translation, model.averaged, self.states,
            self.walk2, self.rate,
            self.x, self.P,
            out.nu, out.white, out.S, out.nis, out.loglik, out.weight, out.x_event, out.var_event,
            out.stride, out.x_imu, out.var_imu,
            bool(record), record.get("steps", none2), record.get("step_of_event", index),
            record.get("step_of_imu", index), record.get("U", none2), record.get("H", none2), record.get("turn", none2),
            self.V, c.tiles, c.Ga, c.Gg, c.a_tiles, c.g_first, c.g_tiles, c.Gz, c.at, c.first, c.count,
            none2 if rows is None else rows, none if white is None else white, index if rows_event is None else
            rows_event,
        )  # fmt: skip
        raise_for(int(status), int(event), inputs)
        return int(count)

    def all(self) -> tuple[FloatArray, FloatArray]:
        """The whole run, a chunk a stretch; final state (n + 1,) and covariance (n, n)."""
        for i0, i1, x, P in self.inputs.stretches:
            self.start(i0, x, P)
            self.chunk(i0, i1)
        return self.result()

    def result(self) -> tuple[FloatArray, FloatArray]:
        """State (n + 1,) and covariance (n, n) now."""
        n = self.inputs.model.layout.n
        return self.x[: n + 1].copy(), self.P.reshape(CAPACITY, CAPACITY)[:n, :n].copy()
