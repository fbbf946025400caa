"""Attitude against a reference: this project's filter and smoother, and VQF, in real time and with the whole log.

    python -m sinan.experiments.benchmarks.attitude [--json FILE] [NAME ...]        (BROAD: all names that begin so)

One setting for all logs: VQF has its authors', this project finds its sizes in the log. All get the same readings. The
error is that of the whole log where its reference counts; one constant heading is taken off for all alike, since the
norths of cameras, robots and compasses differ. Needs `vqf`: pip install -e '.[benchmark]' in the clone.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from sinan.calibration.levels.preparation import prepared
from sinan.estimator.filter.layout import Q_NB
from sinan.estimator.filter.smoother import smooth
from sinan.experiments.datasets import resolve
from sinan.experiments.measured.arguments import usage
from sinan.experiments.measured.logs import FLIGHTS
from sinan.experiments.reference import Mounted, attitude_error, reference_of
from sinan.experiments.report.files import write_json
from sinan.sensors.arrays import FloatArray, finite_or_none
from sinan.sensors.errors import InputError
from sinan.sensors.recording import ACCEL, GYRO, MAG, Recording
from sinan.sensors.rotation import quaternion_from_matrix, quaternion_multiply

VQF, VQF_OFFLINE, FILTER, SMOOTHER = "VQF", "VQF offline", "filter", "smoother"
ESTIMATORS = (VQF, VQF_OFFLINE, FILTER, SMOOTHER)
#: Instants (n,) [s] and attitude q_nb (n, 4) there.
Attitude = tuple[FloatArray, FloatArray]


#: Logs whose reference is a truth: cameras, a robot.
TRUTHS = tuple(name for name in FLIGHTS if name.startswith(("BROAD", "robot")))
#: Logs whose reference is an autopilot's own estimate, or the odometry of a camera on board: a comparison, no truth.
COMPARISONS = (
    "course, quadrotor", "course, turned by hand", "aeroplane", "quad, 14 m/s", "quad, slow", "quad, laser",
    "strapped to a Phantom", "strapped to a Phantom, RTK", "PX4, IMU at 10 Hz", "PX4, IMU at 200 Hz",
    "PX4 indoors", "PX4 indoors, odometry",
)  # fmt: skip
NAMES = (*TRUTHS, *COMPARISONS)
#: Forward-left-up from forward-right-down, and north-east-down from east-north-up.
FLIP = np.diag([1.0, -1.0, -1.0])
FROM_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


@dataclass(frozen=True)
class Score:
    """RMS error of an attitude [deg].

    Attributes
    ----------
    total : angle of the whole rotation; of the tilt where the reference has no heading
    heading : about the vertical, less one constant; nan where the reference has none
    tilt : of the vertical
    later : the total of the second half of the reference, with a constant heading of its own
    """

    total: float
    heading: float
    tilt: float
    later: float = np.nan


#: Of an estimator that fails.
NO_SCORE = Score(np.nan, np.nan, np.nan)


def score(t: FloatArray, q_nb: FloatArray, target: Mounted) -> Score:
    """RMS error of an estimate at the stamps of a reference that it covers.

    Parameters
    ----------
    t, q_nb : (n,) s, (n, 4) the estimate
    target : the reference, of `reference_of`
    """
    error = attitude_error(t, q_nb, target)
    middle = 0.5 * (error.t[0] + error.t[-1])
    later = replace(target, reference=target.reference.rows(target.reference.t >= middle))
    return Score(
        _rms(error.total),
        _rms(error.heading) if target.knows_heading else np.nan,
        _rms(error.tilt),
        _rms(attitude_error(t, q_nb, later).total),
    )


def _rms(angle: FloatArray) -> float:
    """Root mean square of rad in deg."""
    return float(np.rad2deg(np.sqrt(np.mean(angle**2))))


def target_of(name: str, recording: Recording) -> Mounted:
    """The reference of a log in the axes and on the clock of its recording."""
    target = reference_of(recording)
    if target is None or not target.knows_attitude:
        raise InputError(name, "no reference", "a log with an attitude to score against")
    return target


def ours(recording: Recording) -> Mapping[str, Attitude]:
    """The filter, and the smoother behind it."""
    journal = prepared(recording).run()
    smoothed = smooth(journal)
    return {FILTER: (journal.imu_t, journal.imu_x[:, Q_NB]), SMOOTHER: (smoothed.t, smoothed.x[:, Q_NB])}


def vqf(recording: Recording) -> Mapping[str, Attitude]:
    """VQF with the parameters of its paper. D. Laidig, T. Seel, Information Fusion 91 (2023) 187.

    It takes one sampling time for all; a rate times its own step over that time turns by what it turned.
    """
    from vqf import VQF as RealTime
    from vqf import offlineVQF

    t, gyro, accel, mag = readings(recording)
    step = (t[-1] - t[0]) / (len(t) - 1)
    gyro = gyro * (np.diff(t, prepend=t[0] - step) / step)[:, None]
    given = (gyro, accel) if mag is None else (gyro, accel, mag)
    found = {VQF: RealTime(step).updateBatch(*given), VQF_OFFLINE: offlineVQF(gyro, accel, mag, step)}
    return {name: (t, in_ned(states["quat6D" if mag is None else "quat9D"])) for name, states in found.items()}


def readings(recording: Recording) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray | None]:
    """t, rate, specific force and field (None: no magnetometer) at the IMU's instants, forward-left-up."""
    imu = recording.streams["imu"]
    gyro, accel = (np.ascontiguousarray(imu.array(names) @ FLIP.T) for names in (GYRO, ACCEL))
    if "mag" not in recording.streams:
        return imu.t, gyro, accel, None
    mag = recording.streams["mag"]
    field = np.stack([np.interp(imu.t, mag.t, mag[name]) for name in MAG], axis=-1)
    return imu.t, gyro, accel, np.ascontiguousarray(field @ FLIP.T)


def in_ned(q: FloatArray) -> FloatArray:
    """Forward-left-up in east-north-up -> forward-right-down in north-east-down."""
    left, right = (np.broadcast_to(quaternion_from_matrix(C), q.shape) for C in (FROM_ENU, FLIP))
    return quaternion_multiply(left, quaternion_multiply(q, right))


def compare(name: str) -> dict[str, Score]:
    """Every estimator on one log, by its name; one that fails has no score, and the reason is said."""
    recording = resolve(FLIGHTS[name].input)
    target = target_of(name, recording)
    scores = dict.fromkeys(ESTIMATORS, NO_SCORE)
    for estimate in (vqf, ours):
        try:
            scores |= {label: score(t, q, target) for label, (t, q) in estimate(recording).items()}
        except (InputError, ArithmeticError, np.linalg.LinAlgError) as error:
            sys.stderr.write(f"{name}: {estimate.__name__} fails: {error}\n")
    return scores


def ratios(scores: Mapping[str, Mapping[str, Score]], mine: str, other: str) -> tuple[float, float, str]:
    """Mean error of one estimator over the other's, the largest ratio of a log, and that log's name."""
    pairs = {name: (row[mine].total, row[other].total) for name, row in scores.items()}
    means = np.mean(list(pairs.values()), axis=0)
    worst = max(pairs, key=lambda name: pairs[name][0] / pairs[name][1])
    return float(means[0] / means[1]), pairs[worst][0] / pairs[worst][1], worst


def table(names: Iterable[str]) -> dict[str, dict[str, Score]]:
    """Score the named logs; print a row of Markdown for each as soon as it is there, at the end means and ratios."""
    scores: dict[str, dict[str, Score]] = {}
    print("| total (heading, tilt) [deg] | " + " | ".join(ESTIMATORS) + " |")
    print("| --- " * (len(ESTIMATORS) + 1) + "|")
    for name in names:
        scores[name] = compare(name)
        print(f"| {name} | " + " | ".join(_cell(scores[name][label]) for label in ESTIMATORS) + " |", flush=True)
    for title, group in (("BROAD", "BROAD"), ("every log with a truth", "")):
        rows = {name: row for name, row in scores.items() if name in TRUTHS and name.startswith(group)}
        if len(rows) > 1:
            _print_means(title, rows)
    return scores


def _cell(one: Score) -> str:
    inside = f"{one.tilt:.2f}" if np.isnan(one.heading) else f"{one.heading:.2f}, {one.tilt:.2f}"
    return "fails" if np.isnan(one.total) else f"{one.total:.2f} ({inside})"


def _print_means(title: str, rows: Mapping[str, Mapping[str, Score]]) -> None:
    later = {name: {label: replace(one, total=one.later) for label, one in row.items()} for name, row in rows.items()}
    parts = {"": rows, ", second half": later}
    for part, scores in parts.items():
        for words, middle in (("mean", np.mean), ("median", np.median)):
            cells = (f"{middle([row[label].total for row in scores.values()]):.2f}" for label in ESTIMATORS)
            print(f"| {words} of {len(rows)}, {title}{part} | " + " | ".join(cells) + " |")
    for part, scores in parts.items():
        for mine, other in ((FILTER, VQF), (SMOOTHER, VQF_OFFLINE)):
            mean, worst, name = ratios(scores, mine, other)
            each = np.mean([row[mine].total / row[other].total for row in scores.values()])
            said = f"{mean:.2f} by the means, {each:.2f} the mean of all, {worst:.2f} at worst ({name})"
            print(f"\n{title}{part}: {mine} over {other} {said}", flush=True)


def document(scores: Mapping[str, Mapping[str, Score]]) -> dict[str, dict[str, dict[str, float | None]]]:
    """The scores by log, estimator and part; null where there is none."""
    return {
        name: {label: {part: finite_or_none(v) for part, v in asdict(one).items()} for label, one in row.items()}
        for name, row in scores.items()
    }


def main(arguments: Sequence[str]) -> int:
    """Print the table of the logs whose names begin as is said, else of all; status 2 where none does."""
    parser = argparse.ArgumentParser(prog="python -m sinan.experiments.benchmarks.attitude", add_help=True)
    parser.add_argument("--json", type=Path, help="file for the numbers")
    parser.add_argument("names", nargs="*")
    given = parser.parse_args(arguments)
    if not all(any(name.startswith(begin) for name in NAMES) for begin in given.names):
        return usage(NAMES, "[--json FILE] ")
    scores = table(name for name in NAMES if not given.names or name.startswith(tuple(given.names)))
    if given.json is not None:
        write_json(given.json, document(scores))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
