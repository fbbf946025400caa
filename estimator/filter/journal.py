"""`Journal`: what the filter saw, expected and decided, reading by reading."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sinan.estimator.filter.events import ACCEPTED, GATED, STATUS
from sinan.estimator.filter.faults import Note
from sinan.estimator.filter.flight_model import FlightModel
from sinan.estimator.filter.tails import log_density
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.recording import NO_HEIGHT, Recording

#: Part of a stretch that readings are left out of at either end at most, lest of a brief one hardly any be left: a
#: choice, of half and twice `bounds_of_work brief` says nothing else.
MOST_OF_A_SPAN = 0.05


@dataclass(frozen=True)
class StreamJournal:
    """The readings of one sensor.

    Attributes
    ----------
    sensor : name
    t : (k,) s
    index : (k,) row in the recording's stream
    nu, white : (k, m) innovation, and L^-1 nu with S = L L' (unit variance if all is well)
    S : (k, m, m) covariance of the innovation, before any weight
    nis, loglik, weight, status : (k,) nu' S^-1 nu; logarithm of the normal density; 1, or less where robust weights
        reduced it; index of `STATUS`
    events : (k,) place in the journal
    """

    sensor: str
    t: FloatArray
    index: IntArray
    nu: FloatArray
    white: FloatArray
    S: FloatArray
    nis: FloatArray
    loglik: FloatArray
    weight: FloatArray
    status: IntArray
    events: IntArray

    def __len__(self) -> int:
        return len(self.t)

    @property
    def dof(self) -> int:
        """Components of a reading."""
        return self.nu.shape[1]

    @property
    def tells(self) -> BoolArray:
        """(k, m) which components are readings at all: not the height of a fix in two dimensions."""
        return ~(np.diagonal(self.S, axis1=1, axis2=2) >= NO_HEIGHT**2)

    @property
    def told(self) -> FloatArray:
        """(k, m) innovation, 0 where nothing is told: of a fix without a height `nu` has what stands in its place."""
        return np.where(self.tells, self.nu, 0.0)

    @property
    def accepted(self) -> BoolArray:
        """(k,) used by the filter."""
        return np.asarray(self.status == ACCEPTED)


@dataclass(frozen=True)
class Journal:
    """One run of the filter.

    Attributes
    ----------
    model : what the filter believed
    t : (K,) s of the readings, in the order of processing; `sensor` (K,) index into `sensors`; `index` row in it
    row : (K + 1,) first component in `nu` and `white` (rows,); S_row : (K + 1,) first element in `S`, row by row
    freedom : (K,) mean of each NIS where all is well: the components that tell something (`Events.freedom`)
    nis, loglik, weight, status : (K,); NaN where nothing was predicted
    x, var : (K, n + 1), (K, n) nominal state and variances after the reading
    imu_t, imu_x, imu_var : (N,), (N, n + 1), (N, n) at IMU samples, before readings at the same instant; decimated
    x_end, P_end : state and covariance at the end
    t_start, t_end : s
    notes : gaps, frozen and saturated stretches, what was assumed
    iterations : passes that it took to settle the exact forms of effects
    run : what is needed to smooth or to repeat the run
    """

    model: FlightModel
    sensors: tuple[str, ...]
    t: FloatArray
    sensor: IntArray
    index: IntArray
    row: IntArray
    freedom: IntArray
    nu: FloatArray
    white: FloatArray
    S_row: IntArray
    S: FloatArray
    nis: FloatArray
    loglik: FloatArray
    weight: FloatArray
    status: IntArray
    x: FloatArray
    var: FloatArray
    imu_t: FloatArray
    imu_x: FloatArray
    imu_var: FloatArray
    x_end: FloatArray
    P_end: FloatArray
    t_start: float
    t_end: float
    notes: tuple[Note | str, ...] = ()
    iterations: int = 1
    run: object = field(default=None, repr=False)

    def __len__(self) -> int:
        return len(self.t)

    @property
    def dof(self) -> IntArray:
        """(K,) components of each reading."""
        return np.diff(self.row)

    @property
    def accepted(self) -> BoolArray:
        """(K,) used by the filter."""
        return np.asarray(self.status == ACCEPTED)

    @property
    def sigma(self) -> FloatArray:
        """(K, n) 1-sigma of the error state after each reading."""
        return np.sqrt(self.var)

    @property
    def log_density(self) -> FloatArray:
        """(K,) logarithm of the density of each innovation by the law that the model gives it; `loglik` is normal."""
        return log_density(self.model, self.sensors, self.sensor, self.freedom, self.loglik, self.nis)

    def is_inside(self, margins: Mapping[str, float], spans: Sequence[tuple[float, float]]) -> BoolArray:
        """(K,) which readings are of a time with any lateness that is no larger than a margin.

        A lateness moves stamps out of the time of the IMU, or of a part of it, and a reading that goes takes its
        density along, of which log is tens where a receiver is good.

        Parameters
        ----------
        margins : by stream that may be late, how far from either end the stamps that were logged have to be [s], of a
            brief span `MOST_OF_A_SPAN` at most; of other streams the time of the journal has to be inside
        spans : begin and end of each stretch [s]
        """
        t, margin, stamps = self.t.copy(), np.zeros(len(self)), self.stamps if margins else self.t
        for number, name in enumerate(self.sensors):
            if name in margins:
                mine = np.flatnonzero(self.sensor == number)
                t[mine], margin[mine] = stamps[mine], margins[name]
        inside = np.zeros(len(self), dtype=bool)
        for start, end in spans:
            least = np.minimum(margin, MOST_OF_A_SPAN * (end - start))
            inside |= (t >= start + least) & (t <= end - least)
        return inside

    @property
    def stamps(self) -> FloatArray:
        """(K,) stamps of the readings as they were logged, whatever is late [s]; of what is no stream their times."""
        t = self.t.copy()
        for number, name in enumerate(self.sensors):
            if name in self._recording.streams:
                mine = np.flatnonzero(self.sensor == number)
                t[mine] = self._recording.streams[name].t[self.index[mine]]
        return t

    @property
    def _recording(self) -> Recording:
        """That was run."""
        from sinan.estimator.filter.inputs import RunInputs

        assert isinstance(self.run, RunInputs)
        return self.run.recording

    @property
    def log_likelihood(self) -> float:
        """Sum over the readings that were used."""
        return float(np.sum(self.log_density[self.accepted]))

    def stream(self, sensor: str) -> StreamJournal:
        """The readings of one sensor.

        Raises
        ------
        KeyError : no such sensor in this run
        """
        if sensor not in self.sensors:
            raise KeyError(f"no sensor `{sensor}` in the journal; there are {', '.join(self.sensors)}")
        events = np.flatnonzero(self.sensor == self.sensors.index(sensor))
        m = self.model.sensors[sensor].size
        rows = self.row[events][:, None] + np.arange(m)
        elements = self.S_row[events][:, None] + np.arange(m * m)
        return StreamJournal(
            sensor, self.t[events], self.index[events], self.nu[rows], self.white[rows],
            self.S[elements].reshape(-1, m, m), self.nis[events], self.loglik[events], self.weight[events],
            self.status[events], events,
        )  # fmt: skip

    def nis_per_dof(self) -> Mapping[str, float]:
        """Mean NIS over dof by sensor, of the readings that were used; NaN where none was."""
        used, dof = self.accepted, self.freedom
        mine = {name: used & (self.sensor == s) for s, name in enumerate(self.sensors)}
        return {n: float(np.sum(self.nis[k]) / np.sum(dof[k])) if np.any(k) else float("nan") for n, k in mine.items()}

    def rejected(self) -> Mapping[str, int]:
        """Readings that the gate refused, by sensor."""
        return {n: int(np.sum((self.status == GATED) & (self.sensor == s))) for s, n in enumerate(self.sensors)}

    def counts(self) -> Mapping[str, Mapping[str, int]]:
        """Readings by sensor and by what became of them."""
        table = {}
        for s, name in enumerate(self.sensors):
            status = self.status[self.sensor == s]
            table[name] = {word: int(np.sum(status == k)) for k, word in enumerate(STATUS) if np.any(status == k)}
        return table
