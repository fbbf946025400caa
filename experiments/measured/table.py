"""Every measured log with IMU and aiding through the filter: one table, written as a note of the documentation.

python -m sinan.experiments.measured.table OUT.md [NAME ...]
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sinan.calibration.levels.preparation import Prepared, prepared
from sinan.estimator.filter.journal import Journal
from sinan.experiments.datasets import resolve
from sinan.experiments.measured.arguments import usage
from sinan.experiments.measured.engines import AGREEMENT, Agreement, agreement, shortened
from sinan.experiments.measured.flights import LOGS, measured
from sinan.experiments.report.words import number
from sinan.sensors.files import write_text
from sinan.sensors.window import start_of

#: Part of a log over which the engines are compared [s]; `experiments.measured.engines`: all of it.
COMPARED = 30.0
#: A bias whose sigma at the end is more than this share of its first one was not seen.
UNSEEN = 0.7

HEAD = f"""# Measured logs through the filter

Written by `python -m sinan.experiments.measured.table docs/notes/measured_logs.md`; with the name of a log behind it,
that row alone. `sinan estimate INPUT` shows a run in full. What a map does not declare of noise, field, hard iron and
lateness comes from the log ([noise levels](noise_levels.md)).

- **attitude**: RMS of tilt and heading [deg] against the reference that is named; mounting, delay and one constant
  heading taken off. An autopilot's own estimate is a comparison, not a truth.
- **position**: RMS [m] of what the filter predicts 1, 5 and 10 s after the last fix, where ten seconds of fixes are
  withheld in every thirty.
- **NIS**: a degree of freedom, at the noise levels found, by a law with heavy tails; `place` and `speed` bound the
  motion where no position is measured.
- **engines**: largest difference of the compiled and the readable engine, of any state and sigma at any step and
  reading until {COMPARED:g} s after the last stream has begun, in sigma + |value| ({AGREEMENT:g} is asked for), and the
  readings that one used and the other refused. `python -m sinan.experiments.measured.engines` compares whole logs.
"""


@dataclass(frozen=True)
class Row:
    """One log.

    Attributes
    ----------
    name, input : what it is called; what `sinan estimate` is given
    duration, rates : s; Hz by stream
    reference : in words
    entry : of `flights.measured`
    engines : how they agree
    undecided : sentences
    """

    name: str
    input: str
    duration: float
    rates: Mapping[str, float]
    reference: str
    entry: Mapping[str, Any]
    engines: Agreement
    undecided: tuple[str, ...]


def row_of(name: str) -> Row:
    """Run everything on one log."""
    recording = resolve(LOGS[name])
    ready = prepared(recording)
    journal = ready.run()
    read = [name for name in journal.sensors if name in recording.streams]  # not what is assumed of the motion
    streams = {name: recording.streams[name] for name in ("imu", *read)}
    entry, words = measured(name, ready), list[str]()
    late = max(float(stream.t[0]) for stream in ready.recording.streams.values() if len(stream))
    shorter = shortened(ready.recording, late - start_of(ready.recording) + COMPARED)
    begun = replace(ready, flight=ready.flight.reading(shorter))
    if attitude := entry.get("attitude"):
        words.append(f"{'attitude' if 'heading' in attitude else 'roll, pitch'} of {attitude['against']}")
    if "gps" in journal.sensors:
        words.append("withheld fixes")
    return Row(
        name, LOGS[name], journal.t_end - journal.t_start,
        {n: 1.0 / float(np.median(np.diff(s.t))) for n, s in streams.items()}, ", ".join(words) or "none",
        entry, agreement(begun), undecided(ready, journal, recording.notes),
    )  # fmt: skip


def undecided(ready: Prepared, journal: Journal, notes: Sequence[str]) -> tuple[str, ...]:
    """What a log cannot decide: biases that it hardly narrows, levels that do not fit, what is assumed instead."""
    layout, lines = journal.model.layout, []
    before = np.sqrt(np.diag(journal.run.P))  # type: ignore[attr-defined]
    after = np.sqrt(np.diag(journal.P_end))
    weak = []
    for name in layout.names:
        if not name.startswith("b_"):
            continue
        part = layout.slice(name)
        axes = ("north", "east", "down") if name == "b_gps" else ("x", "y", "z")
        seen = before[part] > 0.0
        unseen = seen & (after[part] > UNSEEN * np.where(seen, before[part], 1.0))
        if np.all(unseen) and np.any(seen):
            weak.append(name[2:])
        elif np.any(unseen):
            weak.append(f"{name[2:]} {' '.join(a for a, u in zip(axes, unseen, strict=False) if u)}")
    if weak:
        lines.append(f"bias of {', '.join(weak)}: no narrower than what was assumed")
    if not journal.model.translation:
        lines.append("position and velocity; an accelerometer bias against the mean acceleration")
    if "mag" not in journal.sensors and "gps" not in journal.sensors:
        lines.append("heading")
    lines += [note for note in notes if "no independent" in note]
    return tuple(lines)


def page(rows: Sequence[Row]) -> str:
    """The whole note."""
    heads = ["log", "length", "streams [Hz]", "reference", "attitude", "position", "NIS", "engines"]
    lines = [HEAD, "| " + " | ".join(heads) + " |", "| --- " * len(heads) + "|"]
    lines += ["| " + " | ".join(cells(row)) + " |" for row in rows]
    lines += ["", "## Command and what the log cannot decide", ""]
    for row in rows:
        quoted = f"'{row.input}'" if " " in row.input else row.input
        lines.append(f"- **{row.name}**: `sinan estimate {quoted}`")
        lines += [f"  - {sentence}" for sentence in row.undecided]
    return "\n".join([*lines, ""])


def cells(row: Row) -> list[str]:
    """The cells of a row."""
    attitude = row.entry.get("attitude")
    tilt = "-" if attitude is None else f"{attitude['tilt']:.2f}"
    if attitude is not None and "heading" in attitude:
        tilt += f", {attitude['heading']:.2f}"
    refused = {name: count.get("gated", 0) for name, count in row.entry["counts"].items()}
    nis = ", ".join(f"{n} {v:.2g}" + (f" ({refused[n]} refused)" if refused.get(n) else "")
                    for n, v in row.entry["nis"].items())  # fmt: skip
    rates = ", ".join(f"{n} {number(rate)}" for n, rate in row.rates.items())
    engines = f"{row.engines.difference:.0e}, {row.engines.gates}"
    return [
        row.name,
        f"{row.duration:.0f} s",
        rates,
        row.reference,
        tilt,
        at_ages(row.entry.get("withheld", ())),
        nis,
        engines,
    ]


def at_ages(predictions: Sequence[Mapping[str, float]]) -> str:
    """The errors 1, 5 and 10 s after the last fix."""
    return ", ".join(f"{p['rms']:.2g}" for p in predictions if p["age"] != 2.0) or "-"


def main(arguments: Sequence[str]) -> int:
    """Write the note after every log; status 1 where the engines are not the same filter."""
    if not arguments or any(name not in LOGS for name in arguments[1:]):
        return usage(LOGS, "OUT.md ")
    out, rows = Path(arguments[0]), list[Row]()
    for name in arguments[1:] or LOGS:
        rows.append(row_of(name))
        write_text(out, page(rows))
        sys.stderr.write(f"{name}: {', '.join(cells(rows[-1])[1:])}\n")
    return int(not all(row.engines.holds for row in rows))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
