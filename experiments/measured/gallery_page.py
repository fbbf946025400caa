"""The gallery as Markdown: a table of all logs, and a section for each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from sinan.experiments.measured.traced_log import TracedLog
from sinan.experiments.report.trace_words import NOT_PREDICTING, effect_line, remaining_sentence
from sinan.experiments.report.verdict_words import reported, twin_words
from sinan.experiments.report.words import number

HEAD = """# Gallery: the loop on measured logs

Written by `python -m sinan.experiments.measured.gallery docs/gallery.md`; each section has the command that repeats it.
Every log is read by its map; its noise levels, hard iron and first heading come from the log itself where nothing is
declared (what was taken is listed), and every verdict has the same error rate of 1 % over all candidates. No setting
belongs to a log.

How to read it:

- **held out** is the RMS of the residual on the part of the data that took no part in the fit, before and after.
- **reference** is what the loop was not shown: attitude of cameras, a robot or an autopilot, whose own estimate is a
  comparison and no truth (mounting, delay and one constant heading taken off); fixes that were withheld; for poses the
  spread of the norm that a published calibration leaves. "Last third" counts the held-out part alone, with parameters
  fitted on the rest.
- An effect that does not lower the held-out error is a poor explanation even where it is significant: real errors are
  coloured, and a large log makes small structure significant. It is said not to predict, and the errors are those of
  the model without it. `unexplained` says that more is there than the catalogue can name.
- Where the error against the reference grows, the names are doubtful: an error that the catalogue does not know
  is in the residual, and effects take its shape.
- **CPU** is the time of one processor for preparing and tracing the log; rows without it are of an
  earlier state of the tracer.
- `place` and `speed` are no sensors: where there is no GPS the body is taken to stay near a place, or its speed is
  bounded, as is likeliest. What is "before" is the plain model about the smoothed motion where the first attitude is
  coarse, and may differ from the plain filter's of docs/notes/measured_logs.md.
- A log decides only what its motion shows. What it cannot decide is part of the result.
"""


@dataclass(frozen=True)
class Block:
    """What a page says of one log: its row of the table, and its section."""

    row: str
    section: tuple[str, ...]


def block(one: TracedLog) -> Block:
    """The block of a log."""
    return Block(row(one), tuple(section(one)))


def blocks_of(text: str) -> dict[str, Block]:
    """The blocks of a page that was written before, by the name of the log."""
    rows = {line[2:].split(" | ")[0]: line for line in text.splitlines() if line.startswith("| ")}
    parts = [part.splitlines() for part in text.split("\n## ")[1:]]
    return {lines[0]: Block(rows[lines[0]], (f"## {lines[0]}", *lines[1:], "")) for lines in parts if lines[0] in rows}


def page(blocks: Iterable[Block]) -> str:
    """The whole page."""
    known = list(blocks)
    table = ["| log | verdict | effects | held out | reference, last third | CPU |", "| --- " * 6 + "|"]
    table += [one.row for one in known]
    text = "\n".join([HEAD, *table, "", *(line for one in known for line in one.section)])
    return text.rstrip("\n") + "\n"


def row(one: TracedLog) -> str:
    """A row of the table."""
    if not one.document:
        return f"| {one.name} | did not finish: {one.failure} | | | | {one.seconds:.0f} s |"
    effects = ", ".join(_name(effect) for effect in one.document["effects"]) or "-"
    cells = [one.name, one.document["verdict"], effects, held_out(one), first_reference(one), f"{one.seconds:.0f} s"]
    return "| " + " | ".join(cells) + " |"


def _name(effect: Mapping[str, Any]) -> str:
    return f"{effect['name']} ({NOT_PREDICTING})" if effect["predicts"] is False else str(effect["name"])


def _is_proved(one: TracedLog) -> bool:
    """Whether the held-out part speaks for an effect that is reported."""
    return any(effect["predicts"] for effect in reported(one.document))


def held_out(one: TracedLog) -> str:
    """Stream and RMS before and after."""
    error = one.document["error"]
    before, after = error["before"], error["after"]
    unit = "" if before["unit"] == "1" else f" {before['unit']}"
    change = f" -> {number(after['rms'])}" if _is_proved(one) else ""
    return f"{error['stream']} {number(before['rms'])}{change}{unit}"


def first_reference(one: TracedLog) -> str:
    """The reference that tells most, in few words: attitude, else position after 5 s, else a published calibration."""
    for wanted, part in (("attitude", "last third"), ("tilt", "last third"), ("position, 5 s", ""), ("spread", "")):
        for label, before, after, unit in one.references:
            if label.startswith(wanted) and label.endswith(part):
                changed = wanted == "spread" or bool(reported(one.document))
                numbers = f"{number(before)} -> {number(after)}" if changed else number(before)
                return f"{label.split(',')[0]} {numbers} {unit}".rstrip()
    return "-"


def section(one: TracedLog) -> list[str]:
    """One log in full."""
    lines = [f"## {one.name}", "", one.entry.about, "", f"`{one.command}`", ""]
    if not one.document:
        return [*lines, f"Did not finish after {one.seconds:.0f} s: {one.failure}.", ""]
    document = one.document
    lines += [f"- verdict: **{document['verdict']}**" + (f" ({one.failure})" if one.failure else "")]
    lines += [f"- {effect_line(effect)}" for effect in document["effects"]]
    lines.append(f"- held out: {held_out(one)}{_interval(one)}")
    lines += [f"- {twin_words(twin)}" for twin in document["twins"]]
    if document["effects"] and document["error"]["same_names_on_fitting_part"] is not None:
        same = "the same" if document["error"]["same_names_on_fitting_part"] else "other"
        lines.append(f"- the fitting part alone chooses {same} effects")
    lines += [
        f"- {name} passed the test on all data, but the held-out part speaks against it"
        for name in document["rolled_back"]
    ]
    for label, before, after, unit in one.references:
        changed = label.startswith("spread") or bool(reported(document))
        lines.append(f"- {label}: {number(before)}" + (f" -> {number(after)}" if changed else "") + f" {unit}".rstrip())
    lines += [f"- known otherwise: {one.known_otherwise}"] if one.known_otherwise else []
    lines += [f"- remains: {remaining_sentence(item)}" for item in document["remaining"]]
    lines += [f"- cannot be decided: {sentence}" for sentence in one.undecided]
    lines += [f"- taken from the log: {note}" for note in one.notes if "far from 1" not in note]
    return [*lines, ""]


def _interval(one: TracedLog) -> str:
    if not _is_proved(one):
        return ""
    low, high = one.document["error"]["after"]["interval"]
    return f" (95 % interval {number(low)} to {number(high)})"
