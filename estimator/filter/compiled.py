"""Drives the compiled kernels: packs records into arrays, runs chunk by chunk, turns a status into an error."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sinan.estimator.filter.error_dynamics import bias_rates
from sinan.estimator.filter.flight_model import FlightModel
from sinan.estimator.filter.inputs import RANGE, RunInputs, RunOutputs, bias_block, kind_of, raise_for
from sinan.estimator.filter.layout import CAPACITY
from sinan.sensors.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from sinan.estimator.filter.engine_numba import (
        Effects,
        Imu,
        Readings,
        Sensors,
        State,
        Trail,
        Whitened,
        World,
        Written,
    )

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
    clock : (1,) s, the time of the state
    world, written : environment and process, and the outputs, as the kernels take them
    """

    inputs: RunInputs
    outputs: RunOutputs
    columns: Columns | None = None
    x: FloatArray = field(init=False)
    P: FloatArray = field(init=False)
    V: FloatArray = field(init=False)
    clock: FloatArray = field(init=False)
    world: World = field(init=False)
    written: Written = field(init=False)
    _imu: Imu = field(init=False)
    _readings: Readings = field(init=False)
    _sensors: Sensors = field(init=False)
    _state: State = field(init=False)
    _effects: Effects = field(init=False)

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
        """The records of the kernels, as far as they are the same for every chunk."""
        from sinan.estimator.filter import engine_numba as kernels

        inputs, out, c, model = self.inputs, self.outputs, self.columns, self.inputs.model
        assert c is not None
        events, imu, n = inputs.events, inputs.imu, model.layout.n
        walk2, rate = np.zeros(CAPACITY), np.zeros(CAPACITY)
        walk2[:n], rate[:n] = bias_rates(model)
        self.world = kernels.World(
            model.g_n, model.m_n, model.w_ie_n, model.ground_down, model.translation, model.averaged,
            _first(model, "field"), _first(model, "s_gyro"), _first(model, "s_mag"), 8 * -(-n // 8), walk2, rate,
        )  # fmt: skip
        self._imu = kernels.Imu(imu.t, imu.u, imu.q_accel, imu.q_gyro)
        self._readings = kernels.Readings(
            events.t, events.sensor, events.row, events.freedom, events.z, events.r, events.D, events.ref
        )
        self._sensors = self._sensors_of(model)
        self._state = kernels.State(self.clock, self.x, self.P, self.V)
        self._effects = kernels.Effects(
            c.tiles, c.a_tiles, c.g_first, c.g_tiles, c.Ga, c.Gg, c.Gz, c.at, c.first, c.count
        )
        self.written = kernels.Written(
            out.S_row, out.status, out.nu, out.white, out.S, out.nis, out.loglik, out.weight, out.x_event,
            out.var_event, out.stride, out.x_imu, out.var_imu,
        )  # fmt: skip

    def _sensors_of(self, model: FlightModel) -> Sensors:
        from sinan.estimator.filter.engine_numba import Sensors

        names = self.inputs.events.sensors
        blocks = [bias_block(name) for name in names]
        dof = 1 + np.arange(max((model.sensors[name].size for name in names), default=1))
        beams, beam_start = [np.zeros((1, 3))], np.zeros(len(names), dtype=np.int64)
        for s, name in enumerate(names):
            if kind_of(name) == RANGE:
                beam_start[s] = sum(len(b) for b in beams)
                beams.append(getattr(model.sensors[name], "beams_b", np.array([[0.0, 0.0, 1.0]])))
        return Sensors(
            kind=np.array([kind_of(name) for name in names], dtype=np.int64),
            size=np.array([model.sensors[name].size for name in names], dtype=np.int64),
            bias=np.array([_first(model, block) for block in blocks], dtype=np.int64),
            colour=np.array([_first_colour(model, name) for name in names], dtype=np.int64),
            form=self.inputs.events.has_form,
            beam_start=beam_start,
            beams=np.ascontiguousarray(np.concatenate(beams)),
            gate=np.concatenate([[0.0], model.threshold(dof)]),
            robust=np.concatenate([[0.0], model.robust_threshold(dof)]),
            tail=np.array([model.tail_of(name) or 0.0 for name in names]),
            stray=np.array([model.stray_of(name) for name in names]),
            lead=float(getattr(model.sensors.get("gps"), "lead", 0.0)),
        )

    def chunk(self, i0: int, i1: int, trail: Trail | None = None, whitened: Whitened | None = None) -> int:
        """Run from IMU sample i0 to i1; the last sample of all takes its readings along. Returns the rows of W."""
        from sinan.estimator.filter.engine_numba import NO_TRAIL, NO_WHITENED, run_chunk

        status, event, count = run_chunk(
            i0, i1, *self.inputs.events_of(i0, i1), self._imu, self._readings, self._sensors, self.world, self._state,
            self._effects, self.written, trail or NO_TRAIL, whitened or NO_WHITENED,
        )  # fmt: skip
        raise_for(int(status), int(event), self.inputs)
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


def _first(model: FlightModel, block: str) -> int:
    """First state of a block; -1: it is not there."""
    return model.layout.start(block) if model.layout.has(block) else -1
