"""`sinan observability`: a scenario or a recording -> which biases it shows, as text, JSON and a page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from sinan.experiments.bias_observability.case import Case, case_of_recording, case_of_scenario
from sinan.experiments.bias_observability.document import document, summary
from sinan.experiments.bias_observability.study import study
from sinan.experiments.report.console import working
from sinan.experiments.report.files import write_json
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.window import WHOLE, Span, span_words


def run(
    input: str,
    map_file: Path | None,
    json: Path | None,
    html: Path | None,
    span: Span = WHOLE,
    choice: Choice = FIRST,
) -> str:
    """Study a scenario or a recording, write what is asked for, return the summary for the terminal."""
    with working("following what every set of sensors shows", flies=True):
        result = study(case_of(input, map_file, span, choice))
    if json is not None:
        write_json(json, document(result))
    if html is not None:
        from sinan.experiments.report.observability_page import observability_page

        with working("drawing"):
            observability_page(html, result)
    return summary(result)


def case_of(text: str, map_file: Path | None = None, span: Span = WHOLE, choice: Choice = FIRST) -> Case:
    """A scenario where the text names one (or is a TOML file without a map), else a recording; or a part of it.

    Raises
    ------
    InputError : neither; a recording that is no flight; noise that nobody declared
    """
    from sinan.experiments.scenarios import load_scenario, scenario_names

    if map_file is None and (
        text in scenario_names() or (text.endswith(".toml") and Path(text).name != "recording.toml")
    ):
        scenario = load_scenario(text)
        if scenario.kind != "flight":
            raise InputError(f"scenario {text}", f'kind = "{scenario.kind}"', "a flight: poses show no filter's biases")
        case = case_of_scenario(scenario, span=span)
        return replace(case, name=f"{case.name} {span_words(span)}".rstrip())
    from sinan.experiments.datasets import called, resolve

    if map_file is None and "/" not in text and not Path(text).exists():
        names = ", ".join(scenario_names())
        raise InputError(text, "no such scenario, file or folder", f"a log, DATASET/FILE, or one of {names}")
    recording = resolve(text, map_file, span, choice)
    return replace(case_of_recording(recording), name=called(text, recording, span))
