"""Measured flights through the filter: consistency, attitude against a reference, position against withheld fixes."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sinan.calibration.levels.preparation import Prepared, prepared
from sinan.estimator.evidence.flights.withheld import Predicted, predicted, windows
from sinan.estimator.filter.journal import Journal
from sinan.experiments.datasets import resolve
from sinan.experiments.measured.arguments import usage
from sinan.experiments.measured.logs import FLIGHTS
from sinan.experiments.reference import errors_of, reference_of
from sinan.experiments.report.words import reference_words
from sinan.sensors.arrays import FloatArray

#: What a command takes for each flight and hand-held log, by name.
LOGS = {name: entry.input for name, entry in FLIGHTS.items()}
#: Fixes are withheld for so long, once in every so long, from the first on [s].
WITHHELD, EVERY, FIRST = 10.0, 30.0, 20.0
#: Ages of the last fix at which the prediction is scored [s], each with what lies within half a second.
AGES = (1.0, 2.0, 5.0, 10.0)


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
    return by_age(predicted(ready.flight, "gps", held))


def by_age(found: Predicted) -> tuple[Prediction, ...]:
    """RMS distance of fixes about each of `AGES`."""
    near = {wanted: found.distance[np.abs(found.age - wanted) < 0.5 * min(1.0, wanted)] for wanted in AGES}
    return tuple(Prediction(wanted, rms(missed), len(missed)) for wanted, missed in near.items() if len(missed))


def rms(values: FloatArray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def whiteness(journal: Journal) -> Mapping[str, float]:
    """Largest autocorrelation at one reading's distance over the components of each stream; 2/sqrt(n) is noise."""
    found = {}
    for name in journal.sensors:
        stream = journal.stream(name)
        white = stream.white[stream.accepted]
        if len(white) > 8:
            found[name] = float(max(np.mean(w[1:] * w[:-1]) / np.mean(w**2) for w in (white - white.mean(axis=0)).T))
    return found


def measured(name: str, ready: Prepared) -> dict[str, Any]:
    """One log: levels, NIS, refused readings, whiteness, attitude and position errors."""
    journal = ready.run()
    entry: dict[str, Any] = {
        "log": name, "levels": list(ready.notes), "nis": dict(journal.nis_per_dof()),
        "counts": journal.counts(), "whiteness": dict(whiteness(journal)),
    }  # fmt: skip
    if "gps" in ready.recording.streams:
        entry["withheld"] = [asdict(prediction) for prediction in predictions(ready)]
    attitude = attitude_of(journal, ready)
    return entry | {"attitude": attitude} if attitude else entry


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
        for key, value in measured(name, prepared(resolve(LOGS[name]))).items():
            print(f"  {key}: {value}" if key != "log" else value, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
