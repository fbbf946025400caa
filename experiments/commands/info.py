"""`sinan info`: what is in a log, before anything is estimated from it, as text and JSON."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from sinan.experiments.datasets import called, kept_map_of, log_of, resolve
from sinan.experiments.report.words import columns_in_words, counted, reference_words, trace_call
from sinan.experiments.review.unseen import could_see
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.formats.facts import Facts
from sinan.sensors.recording import Recording, Stream
from sinan.sensors.window import WHOLE, Span, clock_warnings, end_of, start_of

WIDTH = 100  # characters a line
#: A gap is a step in which this many readings are missing at the median rate, or more.
_MISSING = 3
#: Units of columns; of a magnetometer the recording says it.
_UNITS = {
    "accel": "m/s^2", "gyro": "rad/s", "temperature": "degC", "height": "m", "pressure": "Pa", "range": "m",
    "north": "m", "east": "m", "down": "m", "vel": "m/s", "latitude": "deg", "longitude": "deg", "eph": "m", "epv": "m",
    "s_variance": "m/s", "current": "A", "voltage": "V", "airspeed": "m/s", "wind": "m/s",
}  # fmt: skip


def run(
    input: str, map_file: Path | None, json: Path | None, span: Span = WHOLE, choice: Choice = FIRST,
    html: Path | None = None,
) -> str:  # fmt: skip
    """Read a log, write what is asked for, return what is in it.

    A log that describes itself but is no recording (without an IMU, for one) is told as far as it goes.

    Raises
    ------
    InputError : what cannot be read at all
    """
    from sinan.sensors.formats import facts_of

    path = log_of(input)
    facts = facts_of(path) if map_file is None and path.exists() and kept_map_of(path) is None else None
    try:
        recording = resolve(input, map_file, span, choice)
    except InputError as error:
        if facts is None:
            raise
        document = {"log": input, **_said(facts), "recording": None, "why_not": str(error)}
    else:
        document = {"log": called(input, recording, span), **_said(facts), **recorded(recording)}
    if json is not None:
        from sinan.experiments.report.files import write_json

        write_json(json, document)
    next_call = trace_call(input, map_file, None, span, choice)
    if document.get("kind") != "flight":
        next_call = _calibration(input, map_file, span)
    if html is not None:
        from sinan.experiments.report.info_page import info_page
        from sinan.experiments.report.made import checksums

        info_page(html, document, checksums([input]), next_call)
    return summary(document, next_call)


def _calibration(input: str, map_file: Path | None, span: Span) -> str:
    """The command that calibrates all that there is, as it is typed."""
    return trace_call(input, map_file, None, span).replace("sinan trace", "sinan calibrate all", 1)


def _said(facts: Facts | None) -> dict[str, Any]:
    """What a log says of itself, for the document."""
    if facts is None:
        return {"format": None}
    tables = [{**asdict(table), "rate_hz": table.rate} for table in facts.tables]
    parameters = {name: value if np.isfinite(value) else None for name, value in facts.parameters.items()}
    return {
        "format": facts.format, "firmware": facts.firmware, "parameters": parameters, "tables": tables,
        "instances": dict(facts.instances), "messages": list(facts.messages),
    }  # fmt: skip


def recorded(recording: Recording) -> dict[str, Any]:
    """What of a log is a recording: streams, clocks, units, reference, and what a trace could look for."""
    found, missing = _could_see(recording)
    begin = start_of(recording)
    return {
        "recording": recording.name,
        "kind": recording.kind,
        "duration": end_of(recording) - begin,
        "origin": list(recording.origin) if recording.origin else None,
        "streams": {name: _stream(recording, name, stream, begin) for name, stream in recording.streams.items()},
        "reference": {"kind": recording.truth.kind, "known": list(recording.truth.known),
                      "rows": len(recording.truth.stream)} if recording.truth else None,
        "declared": {name: [key for key, value in asdict(spec).items() if value is not None and key != "imu_samples"]
                     for name, spec in recording.sensors.items()},
        "imu_samples": recording.spec("accel").imu_samples,
        "effects": {"could_see": found, "missing": missing},
        "notes": list(recording.notes),
        "warnings": clock_warnings(recording),
    }  # fmt: skip


def _could_see(recording: Recording) -> tuple[list[str], dict[str, list[str]]]:
    """As `could_see`; those of a sensor whose poses let nothing be fitted may not be looked for."""
    from sinan.experiments.calibrate import not_calibrated

    found, missing = could_see(recording)
    for sensor, why in not_calibrated(recording).items() if recording.kind == "poses" else ():
        names = [name for name in found if name.startswith(f"{sensor}.")]
        if names:
            missing.setdefault(f"other poses ({why.found}; expected {why.expected})", []).extend(names)
            found = [name for name in found if name not in names]
    return found, missing


def _stream(recording: Recording, name: str, stream: Stream, begin: float) -> dict[str, Any]:
    """Rows, rate (one over the median step, which no gap changes), gaps and units of a stream."""
    t = np.unique(stream.t)  # the points of one picture have one instant
    count, longest, at = gaps(t)
    return {
        "rows": len(stream),
        "rate_hz": 1.0 / float(np.median(np.diff(t))) if len(t) > 1 else None,
        "from": float(stream.t[0]) - begin,
        "to": float(stream.t[-1]) - begin,
        "gaps": {"count": count, "longest": longest, "at": None if at is None else at - begin},
        "columns": {column: unit_of(recording, column) for column in stream.columns},
    }


def gaps(t: FloatArray) -> tuple[int, float, float | None]:
    """How many gaps a clock has, the longest [s], and when it begins [s]; None: there is none.

    A step is a gap where `_MISSING` readings or more are missing at the median rate.
    """
    if len(t) < 3:
        return 0, 0.0, None
    step = np.diff(t)
    wide = step > (_MISSING + 0.5) * np.median(step)
    k = int(np.argmax(step))
    return int(np.sum(wide)), float(step[k]) if np.any(wide) else 0.0, float(t[k]) if np.any(wide) else None


def unit_of(recording: Recording, column: str) -> str:
    """The unit of a column; empty: a number, or unknown."""
    base = column.split("_")[0]
    if base == "mag":
        return recording.environment.field_unit
    return _UNITS.get(column, _UNITS.get(base, ""))


def summary(document: Mapping[str, Any], next_call: str) -> str:
    """The document as text; `next_call`: the command to go on with."""
    lines = [f"{document['log']}: " + ", ".join(_head(document))]
    if document.get("recording") is None:
        lines.append(f"  nothing can be estimated from it: {document['why_not']}")
    else:
        lines += _stream_lines(document["streams"])
        reference = document["reference"]
        if reference:
            lines.append(f"  reference: {', '.join(reference['known'])} by {reference_words(reference['kind'])}, "
                         f"{reference['rows']} rows")  # fmt: skip
    several = {name: count for name, count in document.get("instances", {}).items() if count > 1}
    if several:
        options = ", ".join(f"--{name} 0 to {count - 1}" for name, count in several.items())
        lines.append(f"  several of a kind: choose by {options}")
    if document.get("recording") is not None:
        effects = document["effects"]
        lines += [f"  warning: {warning}" for warning in document["warnings"]]
        lines.append(_filled("a trace could see", effects["could_see"]))
        lines += [_filled(f"and with {what}", names) for what, names in effects["missing"].items()]
        lines += [f"  note: {note}" for note in document["notes"]]
    if document.get("tables"):
        lines.append(_filled("in the log", [_table_in_words(table) for table in document["tables"]]))
    if document.get("recording") is not None and document["effects"]["could_see"]:
        lines.append(f"  next: `{next_call}`")
    return "\n".join(lines)


def _head(document: Mapping[str, Any]) -> list[str]:
    parts = [document["format"] or "a recording"]
    if document.get("firmware"):
        parts.append(document["firmware"])
    if document.get("parameters"):
        parts.append(f"{len(document['parameters'])} parameters")
    if document.get("recording") is not None:
        lasts = "" if "poses" in document["streams"] else f" of {document['duration']:.4g} s"
        parts.append(document["kind"] + lasts)
    return parts


def _stream_lines(streams: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """A line a stream."""
    cells = []
    for name, stream in streams.items():
        rate = f"{stream['rate_hz']:.4g} Hz" if stream["rate_hz"] else ""
        lost = stream["gaps"]
        holes = (
            f"{counted(lost['count'], 'gap')}, the longest {lost['longest']:.2g} s at {lost['at']:.4g} s"
            if lost["count"]
            else ""
        )
        cells.append((name, f"{stream['rows']} rows", rate, columns_in_words(stream["columns"]), holes))
    widths = [max(len(cell[k]) for cell in cells) for k in range(3)]
    return [
        f"  {name:{widths[0]}}  {rows:>{widths[1]}}  {rate:>{widths[2]}}  {columns}{'; ' + holes if holes else ''}"
        for name, rows, rate, columns, holes in cells
    ]


def _table_in_words(table: Mapping[str, Any]) -> str:
    rate = f" {table['rate_hz']:.3g} Hz" if table["rate_hz"] else f" {table['rows']}"
    return f"{table['name']}{rate}"


def _filled(what: str, names: Sequence[str] | Collection[str]) -> str:
    """A list within the width."""
    text = f"{what}: {', '.join(names) or 'nothing'}".replace(" Hz", "\N{NO-BREAK SPACE}Hz")
    filled = fill(text, WIDTH, initial_indent="  ", subsequent_indent="    ", break_on_hyphens=False)
    return filled.replace("\N{NO-BREAK SPACE}", " ")
