"""How often an upset is told from a receiver that errs: minutes of one or the other, drawn at random.

    python -m tests.calibration.upset_study MINUTES SEED

Each minute declares no noise; some have no compass, or no barometer either, and fixes at 1 to 10 Hz. What happens in it
is nothing; a receiver that drifts and comes back, tells a false velocity, is noisy, or jumps; or a shock, which turns
the gyroscope's readings by up to 2 rad, or pushes the accelerometer's by up to 20 m/s, in a tenth of a second.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sinan.calibration.levels.levels import Levels, first_levels
from sinan.calibration.levels.sizes import sizes_of
from sinan.calibration.levels.upsets import with_upsets
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.inputs import prepare
from sinan.estimator.filter.layout import P_N, Q_NB
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import Recording, Stream
from sinan.sensors.rotation import quaternion_conjugate, quaternion_log, quaternion_multiply
from tests.estimator.analytic_flight import fly

RECEIVER = ("drift", "velocity", "noise", "jump")
SHOCKS = ("turn", "push")
KINDS = ("calm", *RECEIVER, *SHOCKS)
AIDS = (("gps", "baro"), ("gps", "mag", "baro"), ("gps",))


@dataclass(frozen=True)
class Minute:
    """A minute in which something happens.

    Attributes
    ----------
    kind : of `KINDS`
    since : when [s]
    recording, truth : what was read; (N, 10) true position, velocity, quaternion
    levels : all sizes at their medians
    """

    kind: str
    since: float
    recording: Recording
    truth: FloatArray
    levels: Levels

    def errors(self, levels: Levels) -> tuple[float, float]:
        """RMS of the filter's attitude [deg] and position [m] since then."""
        journal = run(prepare(levels.flight(self.recording)), "numba", 1)
        late = journal.imu_t > self.since
        x, true = journal.imu_x[late], self.truth[late]
        turn = quaternion_log(quaternion_multiply(quaternion_conjugate(true[:, Q_NB]), x[:, Q_NB]))
        attitude, position = (np.sqrt(np.mean(np.sum(e**2, axis=1))) for e in (turn, x[:, P_N] - true[:, P_N]))
        return float(np.rad2deg(attitude)), float(position)


def minutes(count: int, rng: np.random.Generator) -> Iterator[Minute]:
    """Minutes drawn at random."""
    for _ in range(count):
        kind, since = str(rng.choice(KINDS)), float(rng.uniform(10.0, 40.0))
        sensors = AIDS[rng.integers(len(AIDS))]
        flown, truth = fly(int(rng.integers(2**31)), duration=60.0, sensors=sensors)
        streams = {**flown.streams, "gps": flown.streams["gps"].rows(slice(None, None, int(rng.choice([1, 2, 5, 10]))))}
        if kind in RECEIVER:
            streams["gps"] = _erring(streams["gps"], kind, since, rng)
        if kind in SHOCKS:
            streams["imu"] = _shaken(streams["imu"], kind, since, rng)
        recording = flown.replace(sensors={}, streams=streams)
        field = flown.environment.magnetic_field if "mag" in sensors else None
        yield Minute(kind, since, recording, truth, first_levels(recording, sizes_of(recording), field, None))


def _erring(gps: Stream, kind: str, since: float, rng: np.random.Generator) -> Stream:
    t, columns = gps.t, dict(gps.columns)
    axis, size = str(rng.choice(["north", "east", "down"])), float(np.exp(rng.uniform(np.log(5.0), np.log(80.0))))
    length = rng.uniform(3.0, 15.0)
    wave = np.interp(t, [since, since + 0.5 * length, since + length], [0.0, 1.0, 0.0])
    if kind == "drift":
        columns[axis] = columns[axis] + size * wave
        if rng.random() < 0.5:
            columns[f"vel_{axis}"] = columns[f"vel_{axis}"] + np.gradient(size * wave, t)
    elif kind == "velocity":
        columns[f"vel_{axis}"] = columns[f"vel_{axis}"] + size / 10.0 * wave
    elif kind == "noise":
        for name in ("north", "east", "down"):
            columns[name] = columns[name] + size / 5.0 * rng.standard_normal(len(t)) * (wave > 0.0)
    else:
        columns[axis] = columns[axis] + size * (t > since)
    return Stream(t, columns)


def _shaken(imu: Stream, kind: str, since: float, rng: np.random.Generator) -> Stream:
    name = ("gyro_" if kind == "turn" else "accel_") + str(rng.choice(["x", "y", "z"]))
    size = rng.uniform(0.3, 2.0) if kind == "turn" else rng.uniform(3.0, 20.0)
    pulse = ((imu.t >= since) & (imu.t < since + 0.1)).astype(float)
    pulse *= size / (np.sum(pulse) * float(np.median(np.diff(imu.t))))
    return Stream(imu.t, {**imu.columns, name: imu[name] + pulse})


def main(count: int, seed: int) -> None:
    """Print how many upsets were found, and the errors before and after."""
    found: Counter[tuple[str, int]] = Counter()
    errors: dict[str, list[tuple[float, float, float, float]]] = {kind: [] for kind in KINDS}
    for one in minutes(count, np.random.default_rng(seed)):
        levels = with_upsets(one.recording, one.levels)
        found[one.kind, len(levels.upsets)] += 1
        errors[one.kind].append((*one.errors(one.levels), *one.errors(levels)))
    print("| kind | minutes | with upsets | attitude [deg] | position [m] | attitude, worst change [deg] |")
    print("| --- | --- | --- | --- | --- | --- |")
    for kind in KINDS:
        if errors[kind]:
            e = np.array(errors[kind])
            a, p, b, q = np.median(e, axis=0)
            told = f"{len(e)} | {len(e) - found[kind, 0]} | {a:.3g} -> {b:.3g} | {p:.3g} -> {q:.3g}"
            print(f"| {kind} | {told} | {np.max(e[:, 2] - e[:, 0]):+.2g} |")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
