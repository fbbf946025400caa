"""The page of a trace: verdict, error before and after, residual, candidates, what could not be seen."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.report import figures, words
from experiments.report.page import Page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from experiments.residual_loop.source import Source
    from experiments.residual_loop.trace import Trace


def trace_figures(source: Source, result: Trace, document: Mapping[str, Any]) -> dict[str, tuple[Figure, str]]:
    """The figures of a trace by name, each with its caption."""
    stream = result.proof.stream
    before = next(r for r in source.residuals(result.selection.plain) if r.stream == stream)
    after = next(r for r in source.residuals(result.selection.final) if r.stream == stream)
    intervals = [e["interval"] for e in document["effects"] if e.get("interval")]
    found = [e["name"] for e in document["effects"]]
    made: dict[str, tuple[Figure, str]] = {
        "residuals": (
            figures.residuals_over_time(before, after, intervals),
            f"Residual of the {stream} before and after. Shaded: held out from the fit for the proof."
            + (" Yellow: the disturbed interval." if intervals else ""),
        )
    }
    if document["effects"]:
        made["errors"] = (
            figures.error_bars(document["error"]["before"], document["error"]["after"]),
            "Error on data that took no part in the fit, with 95 % intervals.",
        )
    signature = None
    if found:
        first = result.selection.findings[0]
        signature = source.signature(result.selection.plain, first.term, first.beta)
    if signature is not None:
        predicted, residual, unit = signature.predicted, signature.residual, signature.unit
        made["suspect"] = (
            figures.residual_against_suspect(predicted, residual, found[0], unit),
            f"The plain model's residual against what {found[0]} predicts for it: points on the line are explained.",
        )
    if document["candidates"]:
        needed = -np.log10(result.alpha / max(source.families, 1))
        made["candidates"] = (
            figures.candidates_bars(document["candidates"], found, float(needed)),
            "Evidence for each candidate before anything was added. Blue: found.",
        )
    return made


def trace_page(path: Path, source: Source, result: Trace, document: Mapping[str, Any]) -> None:
    """Write the page of a trace."""
    page = Page(words.headline(document), f"{document['recording']}. {words.verdict_sentence(document)}")
    error = document["error"]
    if document["effects"]:
        page.numbers(
            [
                (words.quantity(error["before"]["rms"], error["before"]["unit"]), f"{error['stream']} residual before"),
                (words.quantity(error["after"]["rms"], error["after"]["unit"]), "after, on held-out data"),
                *_truth_numbers(error.get("truth")),
            ]
        )
        for effect in document["effects"]:
            page.text(f"{effect['name']}: {words.effect_sentence(effect)}.")
        page.text(words.error_sentence(error) + ".")
    made = trace_figures(source, result, document)
    page.heading("What the model leaves")
    for name in ("residuals", "errors", "suspect"):
        if name in made:
            page.figure(*made[name])
    if document["candidates"]:
        page.heading("Which effect")
        page.figure(*made["candidates"])
        _candidate_table(page, document)
    _honesty(page, document)
    page.write(path)


def _truth_numbers(truth: Mapping[str, Any] | None) -> list[tuple[str, str]]:
    if not truth:
        return []
    shown = []
    for name, before in truth["before"].items():
        after = truth["after"].get(name)
        if after is not None:
            shown.append(
                (f"{words.number(before)} → {words.number(after)}", name.replace("_", " ") + " against the reference")
            )
    return shown


def _candidate_table(page: Page, document: Mapping[str, Any]) -> None:
    rows = []
    for c in sorted(document["candidates"], key=lambda c: c["p_value"]):
        sizes = [s for s in c["detectable_from"] if s is not None]
        size = (
            ", ".join(words.number(s) for s in sizes)
            if sizes
            else "searched"
            if "interval" in c
            else "not visible here"
        )
        rows.append([c["name"], words.number(c["statistic"]), str(c["dof"]), f"{c['p_value']:.2g}", size])
    page.table(["effect", "statistic", "dof", "p", "would be seen from"], rows, numeric=(1, 2, 3))


def _honesty(page: Page, document: Mapping[str, Any]) -> None:
    """What could not be seen, and why."""
    page.heading("What remains, and what could not be seen")
    error = document["error"]
    same = "chooses the same effects" if error["same_names_on_fitting_part"] else "chooses other effects"
    page.text(f"The part of the data that was used for fitting, taken alone, {same}.")
    for name in error["untested"]:
        page.text(f"{name} acts on no held-out reading: only the evidence speaks for it, not the held-out error.")
    for name in document["rolled_back"]:
        page.text(f"{name} passed the test but did not lower the held-out error; it was rolled back.")
    for item in document["remaining"]:
        sentence = words.remaining_sentence(item)
        page.text(f"{sentence[0].upper()}{sentence[1:]}.")
    if not document["remaining"]:
        page.text("The remaining residual is white and as large as the declared noise.")
