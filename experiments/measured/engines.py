"""Both engines over a whole measured log: every state at every step, and every gate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from sinan.calibration.levels.preparation import Prepared, prepared
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.layout import D_BIASES, DTHETA, PV
from sinan.estimator.filter.run_filter import run_filter
from sinan.experiments.datasets import resolve
from sinan.experiments.measured.arguments import usage
from sinan.experiments.measured.flights import LOGS
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import Recording
from sinan.sensors.window import between, start_of

#: Largest difference of the engines, in sigma + |value|.
AGREEMENT = 1e-9


@dataclass(frozen=True)
class Agreement:
    """How far two engines are apart on one recording.

    Attributes
    ----------
    steps, readings : of the run
    difference : largest of any state after any step or reading, in sigma + |value|; nominal states, and sigmas over
        themselves
    gates : readings that one engine used and the other refused
    seconds : of the compiled and of the readable engine
    """

    steps: int
    readings: int
    difference: float
    gates: int
    seconds: tuple[float, float]

    @property
    def holds(self) -> bool:
        """Whether they are the same filter."""
        return self.difference < AGREEMENT and self.gates == 0


def agreement(ready: Prepared) -> Agreement:
    """Run both engines on a prepared log and compare them at every step."""
    run_filter(ready.flight, engine="numba")  # compile outside the clock
    journals, seconds = [], []
    for engine in ("numba", "filterpy"):
        start = perf_counter()
        journals.append(run_filter(ready.flight, engine=engine))
        seconds.append(perf_counter() - start)
    fast, slow = journals
    gates = int(np.sum(fast.status != slow.status))
    return Agreement(len(fast.imu_t), len(fast.t), difference(fast, slow), gates, (seconds[0], seconds[1]))


def difference(a: Journal, b: Journal) -> float:
    """Largest difference of two journals' states and sigmas, in sigma + |value|; nan counts as infinite."""
    worst = 0.0
    for x, y, var, other in ((a.x, b.x, a.var, b.var), (a.imu_x, b.imu_x, a.imu_var, b.imu_var)):
        sigma, another = np.sqrt(var), np.sqrt(other)
        for off, scale in ((np.abs(x - y), nominal_sigma(var) + np.abs(x)), (np.abs(sigma - another), sigma)):
            apart = np.where(off == 0.0, 0.0, off / np.maximum(scale, np.finfo(float).tiny))
            worst = max(worst, float(np.max(np.nan_to_num(apart, nan=np.inf), initial=0.0)))
    return worst


def nominal_sigma(var: FloatArray) -> FloatArray:
    """(k, n + 1) sigma of the nominal state from the variance of the error state: the quaternion has the attitude's."""
    s = np.sqrt(var)
    return np.concatenate([s[:, PV], s[:, DTHETA].max(axis=1, keepdims=True).repeat(4, axis=1), s[:, D_BIASES]], axis=1)


def shortened(recording: Recording, seconds: float) -> Recording:
    """The first part of a recording."""
    return between(recording, -np.inf, start_of(recording) + seconds)


def main(arguments: Sequence[str]) -> int:
    """Print how the engines agree on each log that is named, else on all; status 2 where a name is that of none."""
    if any(name not in LOGS for name in arguments):
        return usage(LOGS)
    for name in arguments or LOGS:
        one = agreement(prepared(resolve(LOGS[name])))
        print(
            f"{name}: {one.steps} steps, {one.readings} readings, difference {one.difference:.1e}, "
            f"{one.gates} gates differ, {one.seconds[0]:.2f} s and {one.seconds[1]:.1f} s",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    import sys

    sys.exit(main(sys.argv[1:]))
