"""The page of many logs: vehicles and effects ranked, what changed, what could not be traced."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sinan.experiments.report.page import Page
from sinan.experiments.report.words import counted

_CHANGES = {"": "first log", "new": "new", "same": "as before", "more": "more", "less": "less", "other": "another one"}


def fleet_page(path: Path, document: Mapping[str, Any]) -> None:
    """Write it; a log's own page is one link away."""
    page = Page(title(document), "Vehicles are ranked by their last log; changes are against the log before it.")
    page.heading("Vehicles, the one with most to correct first")
    rows, links = [], []
    for one in document["vehicles"]:
        last = one["logs"][-1]
        rows.append([one["vehicle"], last["log"], f"{100.0 * last['explained']:.0f} %", last["verdict"], changes(one)])
        links.append(last["page"])
    page.table(["vehicle", "last log", "error explained", "verdict", "since the log before"], rows, (2,),
               links={1: links})  # fmt: skip
    page.text(
        "Error explained: by how much the effects that were found lower the residual of held-out data.", note=True
    )
    for effect in document["effects"]:
        page.heading(effect["name"])
        ranking = effect["ranking"]
        rows = [[one["vehicle"], one["log"], one["size"], _CHANGES[one["change"]]] for one in ranking]
        page.table(["vehicle", "log", "size", "since the log before"], rows, links={1: [r["page"] for r in ranking]})
    page.heading("All logs")
    logs = [(one["vehicle"], log) for one in document["vehicles"] for log in one["logs"]]
    page.table(["vehicle", "log", "what was found"], [[vehicle, log["log"], log["headline"]] for vehicle, log in logs],
               links={1: [log["page"] for _, log in logs]})  # fmt: skip
    if document["failed"]:
        page.heading("Not traced")
        page.table(["log", "why"], [[one["log"], one["why"]] for one in document["failed"]])
    page.write(path)


def title(document: Mapping[str, Any]) -> str:
    """How many vehicles have what most."""
    vehicles, effects = document["vehicles"], document["effects"]
    have = sum(bool(one["logs"][-1]["effects"]) for one in vehicles)
    text = f"{have} of {counted(len(vehicles), 'vehicle')} with an effect"
    return f"{text}, most often {effects[0]['name']}" if effects else text


def changes(vehicle: Mapping[str, Any]) -> str:
    """What of a vehicle is otherwise than in its log before the last."""
    if len(vehicle["logs"]) < 2:
        return "the first log"
    last = vehicle["logs"][-1]
    said = [f"{e['name']} {_CHANGES[e['change']]}" for e in last["effects"] if e["change"] not in ("", "same")]
    said += [f"{name} gone" for name in last["gone"]]
    return ", ".join(said) or "nothing changed"
