"""The page of pseudoranges: stages from the plain model to the full one, excluded satellites, DGPS."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sinan.experiments.report.figures import stage_bars
from sinan.experiments.report.page import Page
from sinan.experiments.report.words import change, counted, length, number, shown_stages, stage_names


def gnss_page(path: Path, document: Mapping[str, Any]) -> None:
    """Write the page."""
    stages = shown_stages(document)
    first, last = stages[0], stages[-1]
    names = ", ".join(effect["name"].removeprefix("pseudorange.").replace("_", " ") for effect in document["effects"])
    page = Page(
        _title(document, first, last),
        f"{document['recording']}: {counted(document['epochs'], 'epoch')} of {', '.join(document['systems'])}. "
        + (f"The ranges call for, in the order of evidence: {names}." if names else "The ranges call for no effect."),
    )
    page.numbers(
        [
            (
                f"{change(first['residual_rms'], last['residual_rms'])} m",
                "RMS residual of the ranges, plain to full model",
            ),
            *_errors(first, last),
        ]
    )
    page.heading("Stage by stage")
    page.figure(
        stage_bars(stages),
        "RMS of the ranges' residuals and, where the position is known, mean distance of the fixes from it, each with "
        "the effects down to that line in the model.",
    )
    _stage_table(page, stages, document.get("reference") or "as it was given")
    if document.get("noise"):
        _noise(page, document["noise"])
    if document.get("dgps"):
        _dgps(page, document["dgps"])
    if document["excluded"] or document["journal"]:
        page.heading("What was left out, and what cannot be seen")
    for item in document["excluded"]:
        page.text(f"Satellite {item['satellite']} was left out in {counted(item['epochs'], 'epoch')}.")
    for note in document["journal"]:
        page.text(note, note=True)
    page.write(path)


def _title(document: Mapping[str, Any], first: Mapping[str, Any], last: Mapping[str, Any]) -> str:
    count = len({effect["name"] for effect in document["effects"]})
    if not count:
        return "The pseudoranges call for no effect"
    effects = f"{count} effects" if count > 1 else "one effect"
    before, after = first.get("position_error"), last.get("position_error")
    if before and after:
        return f"{effects[0].upper()}{effects[1:]} in the pseudoranges: position error {_change(before, after)}"
    residual = f"{change(first['residual_rms'], last['residual_rms'])} m"
    return f"{effects[0].upper()}{effects[1:]} in the pseudoranges: residual {residual}"


def _stage_table(page: Page, stages: Sequence[Mapping[str, Any]], reference: str) -> None:
    known = any(stage.get("position_error") for stage in stages)
    head = ["model", "RMS residual / m"]
    head += ["mean error / m", "95 % are below / m", "east / m", "north / m", "up / m"] if known else []
    rows = []
    for name, stage in zip(stage_names(stages), stages, strict=True):
        error = stage.get("position_error") or {}
        values = [error.get("mean"), error.get("p95"), *(error.get("enu") or [None] * 3)] if known else []
        rows.append([name, *("-" if v is None else f"{v:.2f}" for v in [stage["residual_rms"], *values])])
    page.table(head, rows, numeric=range(1, len(head)))
    if known:
        page.text(f"East, north and up: the mean of the fixes minus the known position ({reference}).", note=True)


def _change(before: Mapping[str, Any], after: Mapping[str, Any]) -> str:
    return f"{change(before['mean'], after['mean'])} m"


def _errors(first: Mapping[str, Any], last: Mapping[str, Any]) -> list[tuple[str, str]]:
    before, after = first.get("position_error"), last.get("position_error")
    if not before or not after:
        return []
    return [(_change(before, after), "mean position error, plain to full model")]


def _noise(page: Page, noise: Mapping[str, Any]) -> None:
    page.heading("How wrong a range is")
    nis = noise["nis_per_dof"]
    page.numbers(
        [(change(nis["fixed"], nis["fitted"]), "normalised squared residual, fixed to fitted law; one is right")]
    )
    rows = [[name, f"{size:.2f} m"] for name, size in noise["system"].items()]
    rows += [["multipath at the zenith, grows as 1 / sin E", f"{noise['elevation']:.2f} m"]]
    rows += [["code noise at 45 dB-Hz", f"{noise['strength']:.2f} m"]]
    rows += [["ionosphere of a ray, of its delay", f"{noise['ionosphere_ray']:.2f}"]]
    rows += [["ionosphere in common, of its delay", f"{noise['ionosphere_field']:.2f}"]]
    page.table(["", "1-sigma"], rows, (1,))
    page.text("Fitted to this log by likelihood, with priors from other sites; docs/gnss.md has the law.", note=True)


def _dgps(page: Page, dgps: Mapping[str, Any]) -> None:
    page.heading("With the base receiver's corrections")
    pairs = [
        (length(dgps["baseline"]), "distance to the base"),
        (f"{number(dgps['age']['mean'])} s", "mean age of the corrections"),
    ]
    error = dgps.get("position_error")
    if error:
        pairs.append((f"{number(error['mean'])} m", "mean position error"))
    page.numbers(pairs)
