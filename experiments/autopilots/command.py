"""`sinan params`: a log and what a trace found in it -> the parameter file that takes it out."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from experiments.autopilots.ardupilot import ardupilot_terms
from experiments.autopilots.files import as_file
from experiments.autopilots.findings import Findings, findings_of
from experiments.autopilots.px4 import px4_terms
from experiments.autopilots.terms import Setting, Terms
from experiments.datasets import resolve
from experiments.report.made import made
from sensors.errors import InputError
from sensors.files import write_text
from sensors.formats import facts_of
from sensors.formats.choice import FIRST, Choice
from sensors.formats.facts import Facts
from sensors.recording import Recording
from sensors.window import WHOLE, Span

ALPHA = 0.01  # family-wise, as `sinan trace` has it
#: How each is called, and what makes its parameters.
AUTOPILOTS: Mapping[str, tuple[str, Callable[[Findings, Mapping[str, float], Path | None], Terms]]] = {
    "px4": ("PX4", px4_terms),
    "ardupilot": ("ArduPilot", ardupilot_terms),
}


def autopilot_of(facts: Facts | None) -> str:
    """Whose log it is, by name in `AUTOPILOTS`; empty: nobody says."""
    said = "" if facts is None else f"{facts.format} {facts.firmware}"
    return next((name for name, (title, _) in AUTOPILOTS.items() if title.lower() in said.lower()), "")


def facts_beside(path: Path) -> Facts | None:
    """What a log says of itself; None of a recording, a table, or what is not there."""
    return facts_of(path) if path.exists() else None


def terms_for(autopilot: str, found: Findings, facts: Facts | None, log: Path | None = None) -> Terms:
    """The parameters that take out what was found; what has none is said, also what is doubtful."""
    title, make = AUTOPILOTS[autopilot]
    known = autopilot_of(facts) == autopilot
    terms = make(found, facts.parameters if facts is not None and known else {}, log if known else None)
    if not terms.parameters:
        terms.notes.append(f"no parameters of {title} are in the log: these stand for its defaults")
    done = {effect for one in terms.settings for effect in one.effects}
    for effect in found.effects:
        if effect not in done | set(terms.without):
            terms.refuse(effect, f"{title} has no parameter that takes it out")
    for effect, why in found.doubtful.items():
        terms.refuse(effect, why)
    return terms


def lines_of(terms: Terms) -> list[str]:
    """What to set, and what has no parameter, for the terminal."""
    title = AUTOPILOTS[terms.autopilot][0]
    lines = [f"{title}: {setting_line(one)}" for one in terms.settings]
    lines += [f"{title}: no parameter for {effect}: {why}" for effect, why in terms.without.items()]
    return [*lines, *(f"{title}: note: {note}" for note in terms.notes)]


def setting_line(one: Setting) -> str:
    """A parameter, what it is to be and what it was."""
    was = "" if one.was is None else f" (was {one.was:.6g})"
    return f"{one.name} {one.value:.6g}{was}, for {', '.join(one.effects)}"


def terms_of_document(document: Mapping[str, Any], autopilot: str, recording: Recording, log: Path) -> Terms:
    """The parameters of an autopilot that take out what a report of `sinan trace` names.

    Parameters
    ----------
    recording : that was traced
    log : where it was read
    """
    field_n, choice = document.get("magnetic_field"), Choice(**document.get("choice", {}))
    found = findings_of(document, recording, None if field_n is None else np.array(field_n), choice)
    terms = terms_for(autopilot, found, facts_beside(log), log)
    if document["verdict"] == "unexplained" and terms.settings:
        terms.notes.append("something remains that no effect explains: sizes are doubtful, though held-out data agree")
    return terms


def run(
    input: str,
    autopilot: str | None,
    report: Path | None,
    out: Path | None,
    map_file: Path | None = None,
    span: Span = WHOLE,
    choice: Choice = FIRST,
) -> str:
    """Trace, or read what a trace wrote; write the file where one is asked for; return its text, or what is in it.

    Raises
    ------
    InputError : nobody says whose parameters, or the report is of another log
    """
    name = autopilot or autopilot_of(facts_beside(Path(input)))
    if not name:
        raise InputError("--for", f"nothing, and {input} does not say whose log it is", " or ".join(AUTOPILOTS))
    if report is None:
        from experiments.trace_command import trace_log

        recording, _, document = trace_log([input], None, ALPHA, None, map_file, span, choice)
    else:
        recording = resolve(input, map_file, span, choice)
        document = _report(report, recording.name)
    terms = terms_of_document(document, name, recording, Path(input))
    text = as_file(terms, f"{made()}: {document['verdict']}, {document['headline']}")
    if out is None:
        return text.rstrip("\n")
    write_text(out, text)
    return "\n".join([f"{document['called']}: {document['verdict']}", *(f"  {line}" for line in lines_of(terms))])


def _report(path: Path, name: str) -> dict[str, Any]:
    """The JSON of an earlier trace of a recording."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        document = None
    if not isinstance(document, dict) or not {"verdict", "effects", "choice", "recording"} <= set(document):
        raise InputError(path, "no report of a trace", "what `sinan trace --json` writes", "--trace")
    if document["recording"] != name:
        raise InputError(path, f"a report of {document['recording']}", f"one of {name}", "--trace")
    return document
