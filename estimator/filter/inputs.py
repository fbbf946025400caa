"""What an engine runs on, what it fills in, and what its errors say."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from sinan.estimator.filter.alignment import first_state
from sinan.estimator.filter.events import OUTSIDE, Events, collect, with_variances
from sinan.estimator.filter.flight import Flight, OfFlight
from sinan.estimator.filter.imu import ImuTable, imu_table
from sinan.estimator.filter.layout import CAPACITY
from sinan.sensors.arrays import FloatArray, IntArray
from sinan.sensors.errors import InputError
from sinan.sensors.recording import Recording
from sinan.sensors.registry import is_sensor, sensor
from sinan.sensors.window import between, time_in_log

#: The kernels' codes of the equations of a sensor, those of `engine_numba`, GPS = 0 and on; where all of a reading is a
#: form they predict nothing.
_CODES = {"position": 0, "zero": 1, "form": 1, "field": 2, "height": 3, "range": 4, "level": 5, "speed": 6}
RANGE = _CODES["range"]
#: What is no sensor: its equations, and the state that they read besides.
_ASSUMED = {"level": ("level", "b_accel"), "place": ("position", "b_place"), "speed": ("speed", "b_speed"),
            "zero_rate": ("zero", "b_gyro")}  # fmt: skip


def kind_of(name: str) -> int:
    """The kernels' code of the equations of a sensor."""
    return _CODES[sensor(name).kernel if is_sensor(name) else _ASSUMED[name][0]]


def bias_block(name: str) -> str:
    """The state block that a sensor's own equations add to its reading."""
    return sensor(name).block if is_sensor(name) else _ASSUMED[name][1]


@dataclass(frozen=True)
class RunInputs(OfFlight):
    """What an engine runs on, and what it starts from.

    Attributes
    ----------
    flight, imu, events : see there
    x, P : (n + 1,), (n, n) the first state
    later : the same of each stretch after the first
    """

    flight: Flight
    imu: ImuTable
    events: Events
    x: FloatArray
    P: FloatArray
    later: tuple[tuple[FloatArray, FloatArray], ...] = ()

    @property
    def stretches(self) -> list[tuple[int, int, FloatArray, FloatArray]]:
        """First and last sample of each stretch, and what it starts from."""
        firsts = ((self.x, self.P), *self.later)
        return [(i0, i1, x, P) for (i0, i1), (x, P) in zip(self.imu.stretches, firsts, strict=True)]

    def events_of(self, i0: int, i1: int) -> tuple[int, int]:
        """Readings with t_i0 <= t < t_i1, and where a stretch ends with i1 all before the next; those outside of any
        ride along.
        """
        t, imu = self.events.t, self.imu
        k0 = int(np.searchsorted(t, imu.t[i0], side="left")) if i0 > 0 else 0
        if i1 == len(imu) - 1:
            return k0, len(t)
        return k0, int(np.searchsorted(t, imu.t[i1 + 1 if imu.last_of(i1) else i1], side="left"))


@dataclass
class RunOutputs:
    """What an engine fills in: see `Journal` for the meaning and `engine_numba.run_chunk` for the places."""

    nu: FloatArray
    white: FloatArray
    S_row: IntArray
    S: FloatArray
    nis: FloatArray
    loglik: FloatArray
    weight: FloatArray
    status: IntArray
    x_event: FloatArray
    var_event: FloatArray
    x_imu: FloatArray
    var_imu: FloatArray
    stride: int


def prepare(
    flight: Flight,
    *,
    imu: ImuTable | None = None,
    events: Events | None = None,
    first: tuple[FloatArray, FloatArray] | None = None,
    aligned: Recording | None = None,
) -> RunInputs:
    """Everything an engine needs of a flight. What begins after a gap that nothing bridges has the north of before, and
    biases that have walked since the log began.

    Parameters
    ----------
    imu, events, first : where they are known
    aligned : another recording from whose readings each stretch is aligned; default: that of the flight
    """
    imu = imu_table(flight) if imu is None else imu
    events = collect(flight) if events is None else with_variances(events, flight)
    from_first = flight if aligned is None else flight.reading(aligned)
    x, P = first_state(from_first) if first is None else first
    if len(imu.starts) == 1:
        return RunInputs(flight, imu, events, x, P)
    status, later = events.status.copy(), []
    for (_, end), (i0, i1) in pairwise(imu.stretches):
        status[(events.t > imu.t[end]) & (events.t < imu.t[i0])] = OUTSIDE
        stretch = between(from_first.recording, float(imu.t[i0]), float(np.nextafter(imu.t[i1], np.inf)))
        own = flight.model.own_north and float(imu.t[i0]) in from_first.recording.breaks
        model = flight.model.after(time_in_log(flight.recording, imu.t[0], imu.t[i0])).replace(own_north=own)
        later.append(first_state(Flight(stretch, model)))
    return RunInputs(flight, imu, replace(events, status=status), x, P, tuple(later))


def outputs_for(inputs: RunInputs, stride: int = 1) -> RunOutputs:
    """Empty arrays for a run; `stride` IMU samples between logged states, 0: none."""
    events, K = inputs.events, len(inputs.events)
    sizes = np.diff(events.row)
    S_row = np.concatenate([[0], np.cumsum(sizes**2)]).astype(np.int64)
    rows, logged = int(events.row[-1]), 1 + (len(inputs.imu) - 1) // stride if stride else 1
    return RunOutputs(
        nu=np.full(rows, np.nan), white=np.full(rows, np.nan), S_row=S_row, S=np.full(S_row[-1], np.nan),
        nis=np.full(K, np.nan), loglik=np.full(K, np.nan), weight=np.ones(K), status=events.status.copy(),
        x_event=np.zeros((K, CAPACITY + 1)), var_event=np.zeros((K, CAPACITY)),
        x_imu=np.zeros((logged, CAPACITY + 1)), var_imu=np.zeros((logged, CAPACITY)), stride=stride,
    )  # fmt: skip


def raise_for(status: int, event: int, inputs: RunInputs) -> None:
    """Turn a kernel's status into the error that names time and sensor."""
    if status == 0:
        return
    events = inputs.events
    last = min(event, len(events) - 1)
    at = f"t = {events.t[last]:.3f} s, sensor {events.sensors[events.sensor[last]]}" if last >= 0 else "the end"
    found = "the state is not finite" if status == 1 else "the covariance of the innovation is not positive"
    raise InputError(inputs.recording.where, found, "noise levels and a first state that fit the readings", at)
