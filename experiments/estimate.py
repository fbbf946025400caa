"""`sinan estimate`: the filter over a flight, and what it found, as the JSON that the documentation describes."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sinan.estimator.evidence.consistency import BLOCK_NAMES, Statistic, nees, nees_by_block, nis
from sinan.estimator.filter.engine import Engine, choose_engine
from sinan.estimator.filter.faults import Note
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.inputs import prepare
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.layout import DP, DTHETA, DV, P_N, Q_NB, V_N, StateLayout
from sinan.estimator.filter.run_filter import run_filter
from sinan.estimator.filter.smoother import SmoothedStates, smooth
from sinan.estimator.filter.tails import NORMAL
from sinan.experiments.reference import Mounted, covered, described, errors_of, states_at, told_of
from sinan.experiments.refused import doubted_shares
from sinan.sensors.arrays import FloatArray, finite_or_none
from sinan.sensors.files import new_file
from sinan.sensors.recording import POSITION, QUATERNION, VELOCITY, Stream, Truth
from sinan.sensors.simulate import BIAS_COLUMNS
from sinan.sensors.window import told_from

STATE_LOG_STEP = 0.02  # s between rows of the table of states, at least


def estimated(
    flight: Flight,
    engine: Engine = "auto",
    states: Path | None = None,
    smoothed: bool = False,
) -> tuple[Journal, SmoothedStates | None, dict[str, Any]]:
    """Run the filter and report.

    Parameters
    ----------
    flight : readings and model
    engine : see `run_filter`
    states : CSV to write: t, the nominal state, and the 1-sigma of the error state
    smoothed : the states of the fixed-interval smoother, which knows all readings, are written, and reported besides

    Returns
    -------
    the journal of the run, the smoothed states if asked for, and the keys of `sinan estimate --json` that need no
    reference
    """
    journal = run_filter(flight, engine=engine)
    later = smooth(journal, sigmas=True) if smoothed else None
    if states is not None:
        write_states(journal, states, later)
    report = report_of(journal)
    if later is not None:
        report["smoothed"] = smoothed_report(journal.model.layout, later)
    report["engine"] = choose_engine(engine, prepare(flight)) if engine == "auto" else engine
    return journal, later, report


@dataclass(frozen=True)
class BiasCourse:
    """One bias over time: estimate, 1-sigma, and the truth where it is known.

    Attributes
    ----------
    name : of the sensor
    t : (m,) s
    value, sigma : (m, components); NaN in the middle of a gap of the IMU that is long enough to be seen
    truth : (m, components), or empty
    field_unit : of the log's magnetometer; empty: not known
    """

    name: str
    t: FloatArray
    value: FloatArray
    sigma: FloatArray
    truth: FloatArray
    field_unit: str = ""


def bias_courses(journal: Journal, target: Mounted | None, most: int = 600) -> list[BiasCourse]:
    """Every bias of a run over time, at most `most` instants, with that of a reference where it knows it."""
    truth = Stream(np.empty(0), {}) if target is None else target.reference
    layout = journal.model.layout
    step = max(1, len(journal.imu_t) // most)
    t, x, var = _broken(gaps_of(journal), journal.imu_t[::step], journal.imu_x[::step], journal.imu_var[::step])
    courses = []
    for name in layout.names:
        if name.startswith("b_"):
            columns = BIAS_COLUMNS[name[2:]]
            there = _at(t, truth.t, truth.array(columns)) if truth.has(columns) else np.empty((0, 0))
            sigma = np.sqrt(var[:, layout.slice(name)])
            courses.append(BiasCourse(name[2:], t, x[:, layout.nominal(name)], sigma, there, field_unit_of(journal)))
    return courses


def gaps_of(journal: Journal) -> list[tuple[float, float]]:
    """From when to when the IMU was silent [s], in order."""
    notes = [note for note in journal.notes if isinstance(note, Note)]
    return sorted((note.start, note.stop) for note in notes if (note.stream, note.kind) == ("imu", "gap"))


def _broken(
    gaps: Sequence[tuple[float, float]], t: FloatArray, x: FloatArray, var: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Instants, states and variances without those inside a gap that is longer than a usual step of these; NaN in the
    middle of it, which breaks a line.
    """
    least = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    for start, stop in gaps:
        if stop - start > least:
            keep = (t <= start) | (t >= stop)
            t, x, var = t[keep], x[keep], var[keep]
            at = np.searchsorted(t, start, side="right")
            t = np.insert(t, at, 0.5 * (start + stop))
            x, var = (np.insert(values, at, np.nan, axis=0) for values in (x, var))
    return t, x, var


def _gaps_told(journal: Journal, zero: float) -> dict[str, Any]:
    """How many gaps the IMU has, how long all are [s], and from when to when the longest lasts."""
    gaps = gaps_of(journal)
    longest = max(gaps, key=lambda gap: gap[1] - gap[0], default=None)
    return {
        "count": len(gaps),
        "total": sum(stop - start for start, stop in gaps),
        "longest": None if longest is None else [at - zero for at in longest],
    }


def field_unit_of(journal: Journal) -> str:
    """The unit of the log's magnetometer; empty where nobody says it."""
    return str(journal.run.recording.environment.field_unit)  # type: ignore[attr-defined]


def _interval_of(journal: Journal, sensor: str, found: Statistic) -> list[float | None]:
    """Where a mean NIS lies by chance; unknown where innovations have the law of Student, whose squares are larger."""
    known = journal.model.tail_of(sensor) in (None, NORMAL)
    return [finite_or_none(value) if known else None for value in found.interval]


def report_of(journal: Journal) -> dict[str, Any]:
    """What one run says of itself."""
    layout, end = journal.model.layout, journal.x_end
    sigma = np.sqrt(np.diag(journal.P_end))
    biases = {name[2:]: name for name in layout.names if name.startswith("b_")}
    consistency = nis(journal)
    recording = journal.run.recording  # type: ignore[attr-defined]
    return {
        "format": 1,
        "recording": recording.name,
        "field_unit": field_unit_of(journal) or None,
        "duration": journal.t_end - journal.t_start,
        "gaps": _gaps_told(journal, told_from(recording)),
        "bias": {sensor: end[layout.nominal(block)].tolist() for sensor, block in biases.items()},
        "bias_std": {sensor: sigma[layout.slice(block)].tolist() for sensor, block in biases.items()},
        "nis": {name: finite_or_none(value.mean) for name, value in consistency.items()},
        "nis_interval": {name: _interval_of(journal, name, value) for name, value in consistency.items()},
        "rejected": dict(journal.rejected()),
        "doubted": doubted_shares(journal),
        "readings": {name: dict(row) for name, row in journal.counts().items()},
        "log_likelihood": journal.log_likelihood,
        "estimates": "position, velocity and attitude" if journal.model.translation else "attitude",
        "final": {
            "position": end[P_N].tolist(), "velocity": end[V_N].tolist(), "quaternion": end[Q_NB].tolist(),
            "position_std": sigma[DP].tolist(), "velocity_std": sigma[DV].tolist(),
            "attitude_std": sigma[DTHETA].tolist(),
        },
        "notes": [note.told(told_from(recording)) if isinstance(note, Note) else note for note in journal.notes],
    }  # fmt: skip


def smoothed_report(layout: StateLayout, smoothed: SmoothedStates) -> dict[str, Any]:
    """What the smoother says of the biases and of the motion where it begins: there it knows the most that the filter
    does not.
    """
    x, sigma = smoothed.x[0], smoothed.sigma[0]
    biases = {name[2:]: name for name in layout.names if name.startswith("b_")}
    return {
        "bias_at_start": {sensor: x[layout.nominal(block)].tolist() for sensor, block in biases.items()},
        "bias_at_start_std": {sensor: sigma[layout.slice(block)].tolist() for sensor, block in biases.items()},
        "start": {
            "position": x[P_N].tolist(), "velocity": x[V_N].tolist(), "quaternion": x[Q_NB].tolist(),
            "position_std": sigma[DP].tolist(), "velocity_std": sigma[DV].tolist(),
            "attitude_std": sigma[DTHETA].tolist(),
        },
    }  # fmt: skip


def score(journal: Journal, truth: Truth, target: Mounted, smoothed: SmoothedStates | None = None) -> dict[str, Any]:
    """Errors against a reference, of what it knows and at its stamps, with what it is.

    Of a reference with the recording's own axes and north also how often the filter's sigmas hold (`within`), the
    errors of the biases, and the NEES where it lasts to the end.

    Parameters
    ----------
    truth : of the recording
    target : the same as brought to its axes and clock
    smoothed : states whose errors are told as well
    """
    result: dict[str, Any] = {
        **described(truth, target),
        **errors_of(target, journal.imu_t, journal.imu_x, *told_of(journal.model)),
    }
    if smoothed is not None:
        result["smoothed"] = errors_of(target, smoothed.t, smoothed.x, *told_of(journal.model))
    stamps = target.reference.rows(covered(target.reference.t, journal.imu_t))
    return result | _held(journal, stamps) if target.same_north and len(stamps) else result


def _held(journal: Journal, truth: Stream) -> dict[str, Any]:
    """How the errors compare with the filter's sigmas, at the stamps of a truth in the recording's own axes."""
    model, layout = journal.model, journal.model.layout
    true, known = true_states(journal, truth)
    error = layout.difference(true, states_at(truth.t, journal.imu_t, journal.imu_x))
    sigma = np.sqrt(_at(truth.t, journal.imu_t, journal.imu_var))
    asked = [name for name in layout.names if model.translation or name not in ("position", "velocity")]
    parts = {name: layout.slice(name) for name in asked if name in known}
    result: dict[str, Any] = {
        "within": {
            BLOCK_NAMES[name]: {str(k): float(np.mean(np.abs(error[:, part]) <= k * sigma[:, part])) for k in (1, 2, 3)}
            for name, part in parts.items()
        },
        "bias_error": {name[2:]: error[-1, part].tolist() for name, part in parts.items() if name.startswith("b_")},
    }
    step = float(np.median(np.diff(journal.imu_t)))
    if set(asked) <= known and journal.t_end - truth.t[-1] < 1.5 * step:
        rows = np.concatenate([np.arange(layout.n)[part] for part in parts.values()])
        result["nees_per_dof"] = nees(error[-1][rows], journal.P_end[np.ix_(rows, rows)]) / len(rows)
        result["nees"] = dict(nees_by_block(error[-1], journal.P_end, layout, model.translation))
    return result


def true_states(journal: Journal, truth: Stream) -> tuple[FloatArray, set[str]]:
    """(m, n + 1) nominal states at the stamps of a truth, and the blocks of which it is known."""
    layout = journal.model.layout
    true = np.zeros((len(truth), layout.n + 1))
    true[:, 6] = 1.0
    columns = {"position": POSITION, "velocity": VELOCITY, "attitude": QUATERNION}
    columns |= {f"b_{sensor}": names for sensor, names in BIAS_COLUMNS.items()}
    known = {name for name, names in columns.items() if layout.has(name) and truth.has(names)}
    for name in known:
        true[:, layout.nominal(name)] = truth.array(columns[name])
    return true, known


def state_table(journal: Journal, smoothed: SmoothedStates | None = None) -> tuple[list[str], FloatArray]:
    """Names, and (rows, columns) t, the nominal state and the sigmas, a row every `STATE_LOG_STEP` or more; of smoothed
    states the sigmas lie between those that the smoother gives, some hundred samples apart.
    """
    layout = journal.model.layout
    t_all, x_all, var_all = journal.imu_t, journal.imu_x, journal.imu_var
    if smoothed is not None:
        t_all, x_all = smoothed.t, smoothed.x
        var_all = _at(t_all, smoothed.t_sigma, smoothed.sigma**2)
    step = max(1, round(STATE_LOG_STEP / float(np.median(np.diff(journal.imu_t)))))
    nominal = [*layout.labels[:6], *QUATERNION, *layout.labels[9:]]
    names = ["t", *nominal, *(f"{label}_std" for label in layout.labels)]
    return names, np.concatenate([t_all[::step, None], x_all[::step], np.sqrt(var_all[::step])], axis=1)


def write_states(journal: Journal, path: Path, smoothed: SmoothedStates | None = None) -> None:
    """The table of `state_table` as CSV."""
    names, rows = state_table(journal, smoothed)
    n = journal.model.layout.n
    with new_file(path) as file:
        writer = csv.writer(file)
        writer.writerow(names)
        for row in rows:
            x, sigma = row[1 : n + 2], row[n + 2 :]
            writer.writerow([f"{row[0]:.6f}", *(f"{v:.9g}" for v in x), *(f"{v:.6g}" for v in sigma)])


def _at(t: FloatArray, known: FloatArray, values: FloatArray) -> FloatArray:
    """(m, k) values (n, k) between the instants at which they are known."""
    return np.stack([np.interp(t, known, column) for column in values.T], axis=-1)
