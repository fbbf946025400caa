"""`sinan params`: a log and what a trace found in it -> the parameter file that takes it out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from sinan.estimator.evidence.alpha import ALPHA
from sinan.experiments.autopilots.files import as_file
from sinan.experiments.autopilots.parameters import AUTOPILOTS, autopilot_of, facts_of_log, lines_of, params_of_document
from sinan.experiments.commands.trace import trace_log
from sinan.experiments.datasets import log_of, resolve
from sinan.experiments.report.made import made
from sinan.sensors.errors import InputError
from sinan.sensors.files import write_text
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.window import WHOLE, Span


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
    InputError : no such input, nobody says whose parameters, or the report is of another log
    """
    log = log_of(input)
    name = autopilot or autopilot_of(facts_of_log(log))
    if not name:
        if not log.exists():
            resolve(input, map_file, span, choice)  # which says so, unless it is none of a log
        raise InputError("--for", f"nothing, and {input} does not say whose log it is", " or ".join(AUTOPILOTS))
    if report is None:
        answer = trace_log([input], None, ALPHA, None, map_file, span, choice)
        recording, document = answer.recording, answer.document
    else:
        recording = resolve(input, map_file, span, choice)
        document = _report(report, recording.name)
    params = params_of_document(document, name, recording, log)
    text = as_file(params, f"{made()}: {document['verdict']}, {document['headline']}")
    if out is None:
        return text.rstrip("\n")
    write_text(out, text)
    lines = (
        lines_of(params) if params.settings else ["nothing to set: the file changes no parameter", *lines_of(params)]
    )
    return "\n".join([f"{document['called']}: {document['verdict']}", *(f"  {line}" for line in lines)])


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
