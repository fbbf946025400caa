"""Measured flights through the filter: consistency, attitude against a reference, position against withheld fixes."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sinan.calibration.levels.noise_levels import OUTLIER_LEVEL
from sinan.calibration.levels.preparation import Prepared, prepared
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.flight_model import flight_model
from sinan.estimator.filter.inputs import prepare
from sinan.estimator.filter.journal import Journal
from sinan.experiments.datasets import resolve
from sinan.experiments.measured.arguments import usage
from sinan.experiments.measured.logs import FLIGHTS
from sinan.experiments.reference import errors_of, reference_of
from sinan.experiments.report.words import reference_words
from sinan.experiments.withheld import Predicted, predicted, windows
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import Recording, Stream

#: What a command takes for each flight and hand-held log, by name.
LOGS = {name: entry.input for name, entry in FLIGHTS.items()}
#: Fixes are withheld for so long, once in every so long, from the first on [s].
WITHHELD, EVERY, FIRST = 10.0, 30.0, 20.0
#: Ages of the last fix at which the prediction is scored [s], each with what lies within half a second.
AGES = (1.0, 2.0, 5.0, 10.0)
#: Delays of GPS that are tried [s].
DELAYS = np.arange(-0.1, 0.401, 0.05)
#: Growth of 2 log L from which a delay is believed: coloured readings scatter it far more than chi-square with one dof.
CONVINCING = 50.0


@dataclass(frozen=True)
class Prediction:
    """Position predicted without fixes against the fixes that were withheld.

    Attributes
    ----------
    age : s since the last fix
    rms : m, all three axes
    count : fixes
    """

    age: float
    rms: float
    count: int


def predictions(ready: Prepared) -> tuple[Prediction, ...]:
    """Withhold fixes and predict them. Levels come from the whole log, states only from the fixes that are left."""
    held = windows(ready.recording.streams["gps"].t, WITHHELD, EVERY, FIRST)
    return by_age(predicted(ready.recording, ready.model, "gps", held))


def by_age(found: Predicted) -> tuple[Prediction, ...]:
    """RMS distance of fixes about each of `AGES`."""
    near = {wanted: found.distance[np.abs(found.age - wanted) < 0.5 * min(1.0, wanted)] for wanted in AGES}
    return tuple(Prediction(wanted, rms(missed), len(missed)) for wanted, missed in near.items() if len(missed))


def rms(values: FloatArray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def earlier(recording: Recording, stream: str, delay: float) -> Recording:
    """The recording with the stamps of a stream taken back by a delay [s]."""
    late = recording.streams[stream]
    return recording.replace(streams={**recording.streams, stream: Stream(late.t - delay, late.columns)})


def likeliest_delay(ready: Prepared, stream: str = "gps") -> tuple[float, float]:
    """Delay of a stream's stamps with the largest likelihood [s], and by how much 2 log L grows over none.

    A parabola through the best of `DELAYS` and its neighbours.
    """
    gain = []
    for delay in DELAYS:
        model = flight_model(
            ready.recording, specs=ready.noise.specs, gate_level=None, robust_level=OUTLIER_LEVEL,
            magnetic_field=ready.model.m_n, latency={stream: float(delay)},
        )  # fmt: skip
        journal = run(prepare(ready.recording, model), "numba", stride=0)
        limit = np.array([model.robust_threshold(name) for name in journal.sensors])[journal.sensor]
        over = np.maximum(journal.nis / limit, 1.0)
        bounded = np.where(over > 1.0, limit * (1.0 + np.log(over)), journal.nis)
        gain.append(float(np.sum((2.0 * journal.loglik + journal.nis - bounded)[journal.accepted])))
    k = int(np.clip(np.argmax(gain), 1, len(gain) - 2))
    before, best, after = gain[k - 1 : k + 2]
    shift = 0.5 * (before - after) / (before - 2.0 * best + after)
    return float(DELAYS[k] + shift * (DELAYS[1] - DELAYS[0])), max(gain) - gain[int(np.argmin(np.abs(DELAYS)))]


def whiteness(journal: Journal) -> Mapping[str, float]:
    """Largest autocorrelation at one reading's distance over the components of each stream; 2/sqrt(n) is noise."""
    found = {}
    for name in journal.sensors:
        stream = journal.stream(name)
        white = stream.white[stream.accepted]
        if len(white) > 8:
            found[name] = float(max(np.mean(w[1:] * w[:-1]) / np.mean(w**2) for w in (white - white.mean(axis=0)).T))
    return found


def measure(name: str) -> dict[str, Any]:
    """One log: levels, NIS, refused readings, whiteness, attitude and position errors, delay of GPS.

    Where the likelihood asks for a delay of GPS, the log is prepared and predicted again with it taken off the stamps.
    """
    recording = resolve(LOGS[name])
    ready = prepared(recording)
    entry = measured(name, ready)
    if "gps" in ready.recording.streams:
        entry |= with_delay(recording, ready)
    return entry


def measured(name: str, ready: Prepared) -> dict[str, Any]:
    """The same of a log that is read and prepared already, but for the delay."""
    journal = ready.run()
    entry: dict[str, Any] = {
        "log": name, "levels": list(ready.noise.notes), "nis": dict(journal.nis_per_dof()),
        "counts": journal.counts(), "whiteness": dict(whiteness(journal)),
    }  # fmt: skip
    if "gps" in ready.recording.streams:
        entry["withheld"] = [asdict(prediction) for prediction in predictions(ready)]
    attitude = attitude_of(journal, ready)
    return entry | {"attitude": attitude} if attitude else entry


def with_delay(recording: Recording, ready: Prepared) -> dict[str, Any]:
    """Delay of GPS by the likelihood, and the errors with it taken off the stamps."""
    delay, gain = likeliest_delay(ready)
    entry: dict[str, Any] = {"gps_delay": delay, "gps_delay_gain": gain}
    if gain > CONVINCING:
        again = prepared(earlier(recording, "gps", delay))
        entry["withheld_without_delay"] = [asdict(prediction) for prediction in predictions(again)]
        attitude = attitude_of(again.run(), again)
        entry |= {"attitude_without_delay": attitude} if attitude else {}
    return entry


def attitude_of(journal: Journal, ready: Prepared) -> dict[str, Any]:
    """RMS of total error, tilt and heading [deg] as far as the reference knows them, and what that is; else nothing."""
    truth, target = ready.recording.truth, reference_of(ready.recording)
    if truth is None or target is None:
        return {}
    errors = errors_of(target, journal.imu_t, journal.imu_x, translation=False)
    found = {name.removesuffix("_rms"): float(np.rad2deg(value)) for name, value in errors.items()}
    return {**found, "against": reference_words(truth.kind)} if found else {}


def main(arguments: Sequence[str]) -> int:
    """Print the report of each log that is named, else of all; status 2 where a name is that of none."""
    if any(name not in LOGS for name in arguments):
        return usage(LOGS)
    for name in arguments or LOGS:
        for key, value in measure(name).items():
            print(f"  {key}: {value}" if key != "log" else value, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
