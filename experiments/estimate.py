"""`sinan estimate`: the filter over a flight, and what it found, as the JSON that the documentation describes."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from estimator.consistency import BLOCK_NAMES, nees, nees_by_block, nis
from estimator.filter import Engine, choose_engine, prepare, run_filter
from estimator.flight_model import FlightModel, flight_model
from estimator.journal import Journal
from experiments.refused import doubted_shares
from sensors.arrays import FloatArray, finite_or_none
from sensors.files import new_file
from sensors.recording import POSITION, VELOCITY, Recording, SensorSpec, Stream
from sensors.rotation import quaternion_interpolate
from sensors.simulate import BIAS_COLUMNS

QUATERNION = ("qw", "qx", "qy", "qz")
STATE_LOG_STEP = 0.02  # s between rows of the table of states, at least


def run(
    recording: Recording,
    engine: Engine = "auto",
    *,
    specs: Mapping[str, SensorSpec] | None = None,
    truth: Stream | None = None,
    states: Path | None = None,
    model: FlightModel | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Run the filter and report.

    Parameters
    ----------
    recording : a flight
    engine : see `run_filter`
    specs : noise that was estimated for what the recording does not declare
    truth : from `read_truth`; read after the filter has run, for scoring alone
    states : CSV to write: t, the nominal state, and the 1-sigma of the error state
    model : in place of the one made from the recording
    options : further options of `flight_model`

    Returns
    -------
    the keys of `sinan estimate --json`, with further ones: `interval` of each NIS, `accepted`, `notes`,
    `log_likelihood`
    """
    return estimated(recording, engine, specs=specs, truth=truth, states=states, model=model, **options)[1]


def estimated(
    recording: Recording,
    engine: Engine = "auto",
    *,
    specs: Mapping[str, SensorSpec] | None = None,
    truth: Stream | None = None,
    states: Path | None = None,
    model: FlightModel | None = None,
    **options: Any,
) -> tuple[Journal, dict[str, Any]]:
    """The journal of the run and its report; parameters as for `run`."""
    model = flight_model(recording, specs=specs, **options) if model is None else model
    journal = run_filter(recording, model, engine=engine)
    if states is not None:
        write_states(journal, states)
    report = report_of(journal)
    report["engine"] = choose_engine(engine, prepare(recording, model)) if engine == "auto" else engine
    if truth is not None:
        report["truth"] = score(journal, truth)
    return journal, report


@dataclass(frozen=True)
class BiasCourse:
    """One bias over time: estimate, 1-sigma, and the truth where it is known.

    Attributes
    ----------
    name : of the sensor
    t : (m,) s
    value, sigma : (m, components)
    truth : (m, components), or empty
    """

    name: str
    t: FloatArray
    value: FloatArray
    sigma: FloatArray
    truth: FloatArray


def bias_courses(journal: Journal, truth: Stream | None, most: int = 600) -> list[BiasCourse]:
    """Every bias of a run over time, at most `most` instants."""
    layout = journal.model.layout
    step = max(1, len(journal.imu_t) // most)
    t, x, var = journal.imu_t[::step], journal.imu_x[::step], journal.imu_var[::step]
    true, known = true_states(journal, truth, t) if truth is not None else (np.zeros((len(t), layout.n + 1)), set())
    courses = []
    for name in layout.names:
        if name.startswith("b_"):
            there = true[:, layout.nominal(name)] if name in known else np.empty((0, 0))
            sigma = np.sqrt(var[:, layout.slice(name)])
            courses.append(BiasCourse(name[2:], t, x[:, layout.nominal(name)], sigma, there))
    return courses


def report_of(journal: Journal) -> dict[str, Any]:
    """What one run says of itself."""
    layout, end = journal.model.layout, journal.x_end
    sigma = np.sqrt(np.diag(journal.P_end))
    biases = {name[2:]: name for name in layout.names if name.startswith("b_")}
    consistency = nis(journal)
    return {
        "format": 1,
        "recording": journal.run.recording.name,  # type: ignore[attr-defined]
        "duration": journal.t_end - journal.t_start,
        "bias": {sensor: end[layout.nominal(block)].tolist() for sensor, block in biases.items()},
        "bias_std": {sensor: sigma[layout.slice(block)].tolist() for sensor, block in biases.items()},
        "nis": {name: finite_or_none(value.mean) for name, value in consistency.items()},
        "nis_interval": {name: [finite_or_none(v) for v in value.interval] for name, value in consistency.items()},
        "rejected": dict(journal.rejected()),
        "doubted": doubted_shares(journal),
        "readings": {name: dict(row) for name, row in journal.counts().items()},
        "log_likelihood": journal.log_likelihood,
        "estimates": "position, velocity and attitude" if journal.model.translation else "attitude",
        "final": {
            "position": end[0:3].tolist(), "velocity": end[3:6].tolist(), "quaternion": end[6:10].tolist(),
            "position_std": sigma[0:3].tolist(), "velocity_std": sigma[3:6].tolist(),
            "attitude_std": sigma[6:9].tolist(),
        },
        "notes": [str(note) for note in journal.notes],
    }  # fmt: skip


def score(journal: Journal, truth: Stream) -> dict[str, Any]:
    """Error against the truth over the whole flight, and NEES at its end.

    Parameters
    ----------
    truth : columns of `truth.csv`; biases and quaternion where they are known
    """
    layout, x, t = journal.model.layout, journal.imu_x, journal.imu_t
    inside = (t >= truth.t[0]) & (t <= truth.t[-1])
    true, known = true_states(journal, truth, t[inside])
    error, sigma = layout.difference(true, x[inside]), np.sqrt(journal.imu_var[inside])
    result: dict[str, Any] = {}
    if journal.model.translation:
        result["position_rms"] = _rms(error[:, 0:3])
        result["velocity_rms"] = _rms(error[:, 3:6])
    result["attitude_rms"] = _rms(error[:, 6:9])
    result["within"] = {
        BLOCK_NAMES[name]: {str(k): float(np.mean(np.abs(error[:, part]) <= k * sigma[:, part])) for k in (1, 2, 3)}
        for name, part in ((name, layout.slice(name)) for name in layout.names if name in known)
    }
    result["bias_error"] = {
        n[2:]: error[-1, layout.slice(n)].tolist() for n in layout.names if n[:2] == "b_" and n in known
    }
    if set(layout.names) <= known and inside[-1]:
        final = nees_by_block(error[-1], journal.P_end, layout, journal.model.translation)
        rows = np.arange(0 if journal.model.translation else 6, layout.n)
        result["nees_per_dof"] = nees(error[-1][rows], journal.P_end[np.ix_(rows, rows)]) / len(rows)
        result["nees"] = dict(final)
    return result


def true_states(journal: Journal, truth: Stream, t: FloatArray) -> tuple[FloatArray, set[str]]:
    """(m, n + 1) true nominal states at the instants t, and the blocks of which the truth is known."""
    layout = journal.model.layout
    true, known = np.zeros((len(t), layout.n + 1)), set()
    kinematics: tuple[tuple[str, tuple[str, ...]], ...] = (("position", POSITION), ("velocity", VELOCITY))
    for name, columns in kinematics:
        if truth.has(columns):
            true[:, layout.nominal(name)] = _at(t, truth, columns)
            known.add(name)
    true[:, 6] = 1.0
    if truth.has(QUATERNION):
        true[:, 6:10] = quaternion_interpolate(t, truth.t, truth.array(QUATERNION))
        known.add("attitude")
    for sensor, columns in BIAS_COLUMNS.items():
        if layout.has(f"b_{sensor}") and truth.has(columns):
            true[:, layout.nominal(f"b_{sensor}")] = _at(t, truth, columns)
            known.add(f"b_{sensor}")
    return true, known


def write_states(journal: Journal, path: Path) -> None:
    """Table of states and sigmas as CSV, a row every `STATE_LOG_STEP` or more."""
    layout = journal.model.layout
    step = max(1, round(STATE_LOG_STEP / float(np.median(np.diff(journal.imu_t)))))
    labels = [f"{label}_std" for label in layout.labels]
    nominal = [*layout.labels[:6], *QUATERNION, *layout.labels[9:]]
    with new_file(path) as file:
        writer = csv.writer(file)
        writer.writerow(["t", *nominal, *labels])
        for t, x, var in zip(journal.imu_t[::step], journal.imu_x[::step], journal.imu_var[::step], strict=True):
            writer.writerow([f"{t:.6f}", *(f"{v:.9g}" for v in x), *(f"{v:.6g}" for v in np.sqrt(var))])


def _at(t: FloatArray, stream: Stream, columns: tuple[str, ...]) -> FloatArray:
    return np.stack([np.interp(t, stream.t, stream[name]) for name in columns], axis=-1)


def _rms(error: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))
