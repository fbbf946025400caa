"""What a trace named, in the parameters of an autopilot: whose log it is, what to set, what has no parameter."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sinan.experiments.autopilots.ardupilot import ardupilot_params
from sinan.experiments.autopilots.findings import Findings, findings_of
from sinan.experiments.autopilots.parameter_set import ParameterSet, Setting
from sinan.experiments.autopilots.px4 import px4_params
from sinan.sensors.formats import facts_of
from sinan.sensors.formats.choice import Choice
from sinan.sensors.formats.facts import Facts
from sinan.sensors.recording import Recording

#: How each is called, and what makes its parameters.
AUTOPILOTS: Mapping[str, tuple[str, Callable[[Findings, Mapping[str, float], Path | None], ParameterSet]]] = {
    "px4": ("PX4", px4_params),
    "ardupilot": ("ArduPilot", ardupilot_params),
}


def autopilot_of(facts: Facts | None) -> str:
    """Whose log it is, by name in `AUTOPILOTS`; empty: nobody says."""
    said = "" if facts is None else facts.autopilot
    return next((name for name, (title, _) in AUTOPILOTS.items() if title == said), "")


def facts_of_log(path: Path) -> Facts | None:
    """What a log says of itself; None of a recording, a table, or what is not there."""
    return facts_of(path) if path.exists() else None


def params_for(autopilot: str, found: Findings, facts: Facts | None, log: Path | None = None) -> ParameterSet:
    """The parameters that take out what was found; what has none is said, also what is doubtful."""
    title, make = AUTOPILOTS[autopilot]
    known = autopilot_of(facts) == autopilot
    params = make(found, facts.parameters if facts is not None and known else {}, log if known else None)
    if not params.parameters:
        params.notes.append(f"no parameters of {title} are in the log: these stand for its defaults")
    done = {effect for one in params.settings for effect in one.effects}
    for effect in found.effects:
        if effect not in done | set(params.without):
            params.refuse(effect, f"{title} has no parameter that corrects it")
    for effect, why in found.doubtful.items():
        params.refuse(effect, why)
    return params


def lines_of(params: ParameterSet) -> list[str]:
    """What to set, and what has no parameter, for the terminal."""
    title = AUTOPILOTS[params.autopilot][0]
    lines = [f"{title}: {setting_line(one)}" for one in params.settings]
    lines += [f"{title}: no parameter for {effect}: {why}" for effect, why in params.without.items()]
    return [*lines, *(f"{title}: note: {note}" for note in params.notes)]


def setting_line(one: Setting) -> str:
    """A parameter, what it is to be and what it was."""
    was = "" if one.was is None else f" (was {parameter_value(one.was, one.whole)})"
    return f"{one.name} {parameter_value(one.value, one.whole)}{was}, for {', '.join(one.effects)}"


def parameter_value(value: float, whole: bool) -> str:
    """A parameter as one types it in: whole, or to five digits, which is finer than any trace knows it."""
    return f"{round(value)}" if whole else f"{value:.5g}"


def params_of_document(document: Mapping[str, Any], autopilot: str, recording: Recording, log: Path) -> ParameterSet:
    """The parameters of an autopilot that take out what a report of `sinan trace` names.

    Parameters
    ----------
    recording : that was traced
    log : where it was read
    """
    field_n, choice = document.get("magnetic_field"), Choice(**document.get("choice", {}))
    found = findings_of(document, recording, None if field_n is None else np.array(field_n), choice)
    params = params_for(autopilot, found, facts_of_log(log), log)
    if document["verdict"] == "unexplained" and params.settings:
        params.notes.append("something remains that no effect explains: sizes are doubtful, though held-out data agree")
    return params
