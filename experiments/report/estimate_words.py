"""What an estimate says: biases with their uncertainty, innovations, warnings, as text."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from sinan.estimator.filter.journal import Journal
from sinan.experiments.report.refused_words import refused
from sinan.experiments.report.words import (
    SENSORS,
    bias_rows,
    bias_unit,
    counted,
    number,
    off_by,
    reference_notes,
    reference_rows,
    with_sigma,
)
from sinan.sensors.window import GOES_BACK, second_words

#: NIS outside its 99 % interval and outside these bounds is remarked upon: a declared noise is rarely known to a tenth.
_NIS_LOW, _NIS_HIGH = 0.8, 1.25


def warnings_of(
    document: Mapping[str, Any], call: str = "sinan trace INPUT", undeclared: Collection[str] = ()
) -> list[str]:
    """A sentence for each sensor that the filter refuses, then for each whose innovations are not as large as expected;
    not for what nobody declared: levels from the log, of which its notes speak, and the level's sigma, an assumption.

    Parameters
    ----------
    call : the command that looks for what is missing
    undeclared : sensors whose noise the recording does not declare
    """
    not_used = refused(document.get("doubted", {}))
    found = list(not_used.values())
    for sensor, nis in document["nis"].items():
        if sensor in not_used:
            continue
        low, high = document["nis_interval"][sensor]
        if sensor in document.get("assumed", ()) or sensor in document.get("estimated", ()):
            continue
        if nis is None or low is None or low <= nis <= high or _NIS_LOW <= nis <= _NIS_HIGH:
            continue
        if sensor in undeclared and nis < 1.0:  # room for the motion and the iron that no position shows
            continue
        than = "than the model expects" if sensor in undeclared else "than declared"
        relation, why = (
            ("larger", f"its model lacks something, or the noise is larger {than}: `{call}` looks for it")
            if nis > 1.0
            else ("smaller", "there is less noise than declared")
        )
        found.append(
            f"the {SENSORS.get(sensor, sensor)} innovations are {relation} than the filter expects (NIS {number(nis)}, "
            f"not 1): {why}"
        )
    return found


def coarse_note(journal: Journal) -> list[str]:
    """What to do where the attitude was known too coarsely for a filter that linearises at its estimates."""
    from sinan.estimator.filter.relinearise import COARSE_ATTITUDE, coarsest_attitude

    worst = coarsest_attitude(journal)
    if journal.model.relinearise or worst < COARSE_ATTITUDE:
        return []
    return [
        f"the attitude was at one time known to {np.rad2deg(worst):.0f} deg only, where the filter's linear sigmas may "
        "be too small: compare --relinearise"
    ]


def summary(name: str, document: Mapping[str, Any]) -> str:
    """Biases with their uncertainty, NIS, and errors against the reference where there is one."""
    not_used = refused(document.get("doubted", {})).values()
    first = [one for one in document["warnings"] if one in not_used or one.startswith(GOES_BACK)]
    silent = f", {silence}" if (silence := gaps_in_words(document)) else ""
    lines = [f"{name}: {number(document['duration'])} s{silent}", *(f"  warning: {warning}" for warning in first)]
    lines += _biases(document)
    lines.append("  innovations: NIS a degree of freedom (1: as large as the filter expects), readings refused")
    for sensor, nis in document["nis"].items():
        size = "no reading" if nis is None else f"{nis:.3f}" if nis < 1e4 else f"{nis:.3g}"
        assumed = " (an assumption of the filter, no sensor)" if sensor in document.get("assumed", ()) else ""
        lines.append(f"    {sensor:6} {size}, {document['rejected'].get(sensor, 0)} refused{assumed}")
    lines += [f"  {name}: {value}" for name, value in reference_rows(document)]
    notes = [*reference_notes(document), *document["noise"], *document.get("notes", [])]
    lines += [f"  note: {note}" for note in notes]
    lines += [f"  warning: {warning}" for warning in document["warnings"] if warning not in first]
    return "\n".join([*lines, f"  {size_of_innovations(document)}", f"  next: {what_next(document)}"])


def gaps_in_words(document: Mapping[str, Any]) -> str:
    """How long the IMU was silent, and when for longest; empty where it never was."""
    gaps = document.get("gaps") or {"count": 0}
    if not gaps["count"]:
        return ""
    start, stop = map(second_words, gaps["longest"])
    if gaps["count"] == 1:
        return f"without IMU from {start} s to {stop} s"
    return f"{number(gaps['total'])} s of it in {gaps['count']} gaps of the IMU, the longest from {start} s to {stop} s"


def _biases(document: Mapping[str, Any]) -> list[str]:
    """The biases at the end: a line a sensor; with a known truth a line a component, and how far off it is."""
    rows = bias_rows(document)
    if all(row.truth is None for row in rows):
        lines = ["  biases at the end ± 1 sigma"]
        for sensor in document["bias"]:
            text = ", ".join(with_sigma(row.value, row.sigma) for row in rows if row.sensor == sensor)
            known = all(row.sigma == 0.0 for row in rows if row.sensor == sensor)
            held = sensor == "accel" and known and "gps" not in document["nis"]
            why = " (held: without GPS it cannot be told from the tilt)" if held else ""
            lines.append(f"    {sensor:6} {text} {bias_unit(sensor, document.get('field_unit'))}{why}")
        return lines
    cells = [("biases at the end", "± 1 sigma", "truth", "off by", "")]
    for row in rows:
        truth = "-" if row.truth is None else f"{row.truth:.{row.digits}f}"
        cells.append((f"  {row.name}", with_sigma(row.value, row.sigma), truth, off_by(row), row.unit))
    widths = [max(len(cell[k]) for cell in cells) for k in range(4)]
    return [
        f"  {name:{widths[0]}}  {value:>{widths[1]}}  {truth:>{widths[2]}}  {off:>{widths[3]}}  {unit}".rstrip()
        for name, value, truth, off, unit in cells
    ]


def what_next(document: Mapping[str, Any]) -> str:
    """What to do about innovations of another size than expected: a trace finds what makes them larger, not smaller."""
    looks, outside = f"`{document.get('call', 'sinan trace')}` looks for", not_as_expected(document)
    if not outside:
        return f"{looks} smaller effects and says how small one could have hidden."
    if all(innovations(document, sensor) == "smaller" for sensor in outside):
        named = ", ".join(SENSORS.get(sensor, sensor) for sensor in outside if sensor not in document["undeclared"])
        if not named:
            return f"{looks} smaller effects; no effect makes innovations smaller than the filter expects."
        return f"declare less noise ({named}), since the filter expects more than there is; no effect does that."
    return f"{looks} the cause of those that are larger."


def innovations(document: Mapping[str, Any], sensor: str) -> str:
    """Whether a sensor's innovations are as large as the filter expects: by the interval of its NIS."""
    if sensor in document.get("assumed", ()):
        return "assumed, no sensor"
    nis, (low, high) = document["nis"][sensor], document["nis_interval"][sensor]
    if nis is None or low is None:
        return ""
    return "larger" if nis > high else "smaller" if nis < low else "as expected"


def not_as_expected(document: Mapping[str, Any]) -> list[str]:
    """The sensors whose innovations are not as large as expected."""
    return [sensor for sensor in document["nis"] if innovations(document, sensor) in ("larger", "smaller")]


def size_of_innovations(document: Mapping[str, Any]) -> str:
    """How many sensors' innovations are larger and how many smaller than expected, as the table marks them."""
    marks = {sensor: innovations(document, sensor) for sensor in document["nis"]}
    asked = [sensor for sensor, mark in marks.items() if mark in ("larger", "smaller", "as expected")]
    outside = [
        f"{mark} than the filter expects in {len(named)} ({', '.join(named)})"
        for mark in ("larger", "smaller")
        if (named := [SENSORS.get(sensor, sensor) for sensor in asked if marks[sensor] == mark])
    ]
    if not asked and any(nis is not None and not marks[sensor] for sensor, nis in document["nis"].items()):
        return "How large innovations are says nothing against a model whose noise was found from them."
    if not outside:
        return "The innovations are as large as the filter expects: nothing speaks against its model."
    return f"Of {counted(len(asked), 'sensor')}, the innovations are {' and '.join(outside)}."
