"""The page of what is in a log: streams with rates, gaps and units, what a trace could see, parameters, topics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sinan.experiments.report.page import Page
from sinan.experiments.report.words import SENSORS, columns_in_words, reference_words


def info_page(
    path: Path, document: Mapping[str, Any], logs: Sequence[Mapping[str, str | None]], next_call: str
) -> None:
    """Write it.

    Parameters
    ----------
    document : as `sinan info --json` writes it
    logs : what it is of, with checksums
    next_call : the command to go on with
    """
    read = document.get("recording") is not None
    page = Page(f"{Path(str(document['log'])).name}: what is in it", _lead(document))
    if read:
        page.numbers(_numbers(document))
        _streams(page, document)
        for warning in document["warnings"]:
            page.text(f"Warning: {warning}.")
        _effects(page, document["effects"], next_call)
        if document["notes"]:
            page.heading("Notes")
            page.items(document["notes"])
    else:
        page.text(f"Nothing can be estimated from it: {document['why_not']}")
    _of_the_log(page, document)
    page.heading("Where this comes from")
    page.rests_on(logs)
    page.write(path)


def _lead(document: Mapping[str, Any]) -> str:
    format_, firmware = document["format"] or "a recording", document.get("firmware")
    return f"{format_}, written by {firmware}." if firmware else f"{format_}."


def _numbers(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    streams, effects = document["streams"], document["effects"]
    silent = sum(stream["gaps"]["count"] for stream in streams.values())
    pairs = [(f"{len(effects['could_see'])}", "effects that a trace could find"), (f"{len(streams)}", "streams"),
             (f"{silent}", "gaps")]  # fmt: skip
    return pairs if "poses" in streams else [(f"{document['duration']:.4g} s", document["kind"]), *pairs]


def _streams(page: Page, document: Mapping[str, Any]) -> None:
    page.heading("Streams")
    rows = []
    for name, stream in document["streams"].items():
        lost, rate = stream["gaps"], stream["rate_hz"]
        holes = (
            f"{lost['count']}, the longest {lost['longest']:.2g} s at {lost['at']:.4g} s" if lost["count"] else "none"
        )
        called = "IMU" if name == "imu" else SENSORS.get(name, name)
        rows.append([called, f"{stream['rows']}", f"{rate:.4g}" if rate else "", f"{stream['from']:.4g}",
                     f"{stream['to']:.4g}", columns_in_words(stream["columns"]), holes])  # fmt: skip
    page.table(["stream", "rows", "rate / Hz", "from / s", "to / s", "columns", "gaps"], rows, (1, 2, 3, 4))
    page.text(
        "The rate is one over the median step. A gap is where three or more readings in a row are missing at that "
        "rate.",
        note=True,
    )
    known = document["reference"]
    if known:
        page.text(f"Reference: {', '.join(known['known'])} by {reference_words(known['kind'])}, {known['rows']} rows.")


def _effects(page: Page, effects: Mapping[str, Any], next_call: str) -> None:
    page.heading("Effects that a trace could find in it")
    page.text(", ".join(effects["could_see"]) or "Nothing.")
    if effects["missing"]:
        page.table(
            ["if the log also had", "a trace could find"],
            [[what, ", ".join(names)] for what, names in effects["missing"].items()],
        )
    if effects["could_see"]:
        page.text(f"Next: `{next_call}`")


def _of_the_log(page: Page, document: Mapping[str, Any]) -> None:
    """What the log says of itself."""
    if document.get("messages"):
        page.heading("What the autopilot said")
        page.items(document["messages"])
    if document.get("tables"):
        page.heading("All that is in the log")
        with page.folded(f"{len(document['tables'])} kinds of messages"):
            rows = [[one["name"], f"{one['rows']}", f"{one['rate_hz']:.3g}" if one["rate_hz"] else "",
                     ", ".join(one["fields"])] for one in document["tables"]]  # fmt: skip
            page.table(["message", "rows", "rate / Hz", "fields"], rows, (1, 2))
    if document.get("parameters"):
        page.heading("Parameters")
        with page.folded(f"{len(document['parameters'])} parameters"):
            rows = [[name, "" if value is None else f"{value:.9g}"] for name, value in document["parameters"].items()]
            page.table(["parameter", "value"], sorted(rows), (1,))
