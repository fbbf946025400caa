"""The verdict of a trace in words: head line, sentence, proof, what to do next; the same everywhere."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sinan.calibration.levels.assumptions import OF_BOUNDS
from sinan.experiments.report.trace_words import (
    NOT_PREDICTING,
    REFUSED,
    clause,
    detectable_sentence,
    effect_line,
    interval_words,
    remaining_sentence,
    seen_up_to,
    sentence,
    size_words,
)
from sinan.experiments.report.words import (
    SENSORS,
    change,
    counted,
    is_truth,
    number,
    p_value_words,
    per_unit,
    reference_change,
    reference_name,
    reference_words,
    stream_unit,
)
from sinan.experiments.residual_loop.report import PREDICTED
from sinan.sensors.effects import CATALOGUE
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.registry import BySensor

#: The error against a reference that an effect on a sensor spoils first.
_SPOILED = BySensor(lambda entry: entry.spoils, after={"level": "attitude_rms"})
#: A change of that error by less than this share is no headline: the residual's is, then.
_TELLING = 0.1
_MOST_IN_TITLE = 2
#: Parameters of a flight controller that are named in a sentence.
_MOST_NAMES = 4


def worded(document: Mapping[str, Any], called: str = "", log: Log | None = None) -> dict[str, Any]:
    """The report with its words: `headline`, `says` (the verdict in a sentence), `next` (what to do).

    Terminal, JSON and page show these very words.

    Parameters
    ----------
    called : what the user calls the recording; empty: its own name
    log : which log was traced; None: an INPUT
    """
    known = {**document, "called": called or document["recording"]}
    return {**known, "headline": title(known), "says": says(known), "next": what_next(known, log or Log())}


@dataclass(frozen=True)
class Log:
    """A log as the user names it, the map that reads it, which of several sensors are read, whether sizes of
    what adds to the field are parts of it, as of poses that do not declare theirs, how many are traced with it, and
    whether it is of poses.
    """

    input: str = "INPUT"
    map_file: Path | None = None
    choice: Choice = FIRST
    in_parts: bool = False
    others: int = 0
    poses: bool = False


def reported(document: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The effects of the head line: all that were found but those that do not predict the held-out data."""
    return [effect for effect in document["effects"] if effect["predicts"] is not False]


def not_predicting(document: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The effects that pass their test on all data but do not predict."""
    return [effect for effect in document["effects"] if effect["predicts"] is False]


def title(document: Mapping[str, Any]) -> str:
    """The head line: what the instrument does wrong, how much, what adding it brings; or that nothing is missing."""
    effects = reported(document)
    if not effects:
        return _title_without_names(document)
    rest = ["something that no known effect explains"] if document["verdict"] == "unexplained" else []
    if len(effects) == 1:
        first = sentence(effects[0]["summary"])
        if _named_together(document, effects[0]):
            return (
                f"{first}, or {_rivals(document, effects[0])}: these data cannot tell which; {headline_error(document)}"
            )
        also = "".join(f", and {one}" for one in rest)
        return f"{first}: {size_words(effects[0])}{also}; {headline_error(document)}"
    parts = [_part(document, effect) for effect in effects[:_MOST_IN_TITLE]]
    for unsure, which in ((False, ""), (True, " that these data cannot tell from others")):
        names = [effect["name"] for effect in effects[_MOST_IN_TITLE:] if bool(effect["confused_with"]) is unsure]
        more = f"{counted(len(names), 'more effect')}{which} ({', '.join(dict.fromkeys(names))})"
        parts += [more] if names else []
    parts += rest
    text = ", ".join(parts[:-1]) + ", and " + parts[-1]
    return f"{text[0].upper()}{text[1:]}: {headline_error(document)}"


def _title_without_names(document: Mapping[str, Any]) -> str:
    if not_predicting(document):
        return "The model misses something, and no effect of the catalogue predicts it"
    if document["verdict"] != "no_effect":
        return "The model misses something that no effect of the catalogue explains"
    if shows_nothing(document):
        left = [item for item in document["remaining"] if not _is_less_than_expected(item)]
        but = "; but the residual is not pure noise" if left else ""
        lasting = "no lasting effect of a size that occurs shows in this log"
        return f"Nothing was found, and nothing could have been: {lasting}{but}"
    if document["remaining"]:
        return "No effect of the catalogue was found, but the residual is not pure noise"
    return "Nothing wrong was found: the residual looks like pure noise"


def _is_less_than_expected(item: Mapping[str, Any]) -> bool:
    return item["kind"] == "variance" and item["excess"] is not None and item["excess"] < 0.0


def _part(document: Mapping[str, Any], effect: Mapping[str, Any]) -> str:
    """An effect among several of a head line, with what it cannot be told from."""
    text = f"{clause(effect['summary'])} ({size_words(effect)})"
    return f"{text} or {_rivals(document, effect)}" if _named_together(document, effect) else text


def _named_together(document: Mapping[str, Any], effect: Mapping[str, Any]) -> list[str]:
    """The rivals of an effect that the head line names with it: those that predict, as far as that was asked."""
    failed = {twin["name"] for twin in document["twins"] if twin["predicts"] is False}
    return [name for name in effect["confused_with"] if name not in failed]


def _rivals(document: Mapping[str, Any], effect: Mapping[str, Any]) -> str:
    return ", or ".join(clause(CATALOGUE[name].summary) for name in _named_together(document, effect))


def says(document: Mapping[str, Any]) -> str:
    """The verdict in a sentence."""
    known = reported(document)
    if document["verdict"] == "ambiguous":
        text = "an effect is present, but these data cannot tell which of the named ones it is"
        if not known:
            return f"{text}, and none of them predicts the {_part_of_data(document)}"
        return text if document["effects"][0]["confused_with"] else _later_rivals(document)
    if document["verdict"] == "unexplained":
        names = "; the effects that are named are doubtful" if document["effects"] else ""
        if not_predicting(document) and not document["remaining"]:
            return f"an effect passes the test on all data, but does not predict the {_part_of_data(document)}"
        return f"the residual has structure that no effect of the catalogue explains{names}"
    if document["verdict"] == "no_effect":
        would = ", nor would one of a size that occurs" if shows_nothing(document) else ""
        return f"no effect passes the test{would}"
    if _cannot_tell(known):
        return "what is named passes the test on all data; the held-out part holds nothing that could confirm it"
    untold = _names([effect for effect in known if effect["predicts"] is None])
    if not untold:
        return f"what is named passes the test on all data, and predicts the {_part_of_data(document)}"
    told = [effect for effect in known if effect["predicts"] is not None]
    return (
        f"what is named passes the test on all data; {_names(told)} {'predict' if len(told) > 1 else 'predicts'} the "
        f"{_part_of_data(document)}, which cannot tell of {untold}"
    )


def _names(effects: Sequence[Mapping[str, Any]]) -> str:
    """The names of effects as a list in a sentence, of an interval with when it is."""
    whens = [f" {interval_words(effect)}" if effect.get("interval") else "" for effect in effects]
    *first, last = [f"{effect['name']}{when}" for effect, when in zip(effects, whens, strict=True)] or [""]
    return f"{', '.join(first)} and {last}" if first else last


def _later_rivals(document: Mapping[str, Any]) -> str:
    """An effect after the first is not to be told from others."""
    effect = next(effect for effect in document["effects"] if effect["confused_with"])
    sure = [one for one in document["effects"] if not one["confused_with"]]
    there = f"{_names(sure)} {'are' if len(sure) > 1 else 'is'}"
    others = " or ".join(effect["confused_with"])
    return f"{there} there; these data cannot tell whether {effect['name']} is, or {others}"


def what_next(document: Mapping[str, Any], log: Log) -> str:
    """What to do, a sentence or two."""
    if document["verdict"] == "no_effect":
        shown = _would_be_seen(document)
        seen = f"{sum(shown)} of {len(shown)} effects would have been seen at sizes that occur"
        where = '"What would have been seen" lists from where on'
        if shows_nothing(document):
            return f"record {_MORE_POSES if log.poses else _LONGER}, and trace that: of this log {seen} ({where})"
        return f"nothing that this log shows needs correcting; {seen} ({where})"
    if document["verdict"] == "ambiguous":
        measure = "measure one of them yourself, such as a lever arm with a ruler, and declare it"
        return f"{document['separates']}; or {measure}" if document["separates"] else measure
    if worse := _worse_reference(document):
        return f"the {worse} grows with it: check axes, units and clocks of log and reference before you use the effect"
    if document["verdict"] == "unexplained":
        longer = [
            f"record a longer log, and see whether {e['name']} then predicts" for e in not_predicting(document)[:1]
        ]
        remains = (
            ["read what remains, and cut out stretches with a stuck or saturated sensor (`--from`, `--to`)"]
            if document["remaining"]
            else []
        )
        place = ["log a position (GPS) too, or stay near one place: where it was is only assumed"]
        is_bounded = any(one["source"] == OF_BOUNDS for one in document.get("assumptions", ()))
        return "; ".join([*longer, *remains, *(place if is_bounded else []), "check axes, units and clocks"])
    lines = declared_lines(document, log.in_parts)
    return "; ".join(_use(effect, lines, log) for effect in _kinds(reported(document)))


#: Plausible sizes up to which an effect occurs: two sigma of what is sold.
_OCCURS = 2.0


#: What shows the effects that another log could not.
_LONGER = "a longer log, a minute or more, that turns about all three axes"
_MORE_POSES = "more poses, with each axis up, down and between"


def shows_nothing(document: Mapping[str, Any]) -> bool:
    """Whether nothing was found where no effect that lasts would have been at a size that occurs."""
    seen = _would_be_seen(document)
    return document["verdict"] == "no_effect" and bool(seen) and not any(seen)


def _would_be_seen(document: Mapping[str, Any]) -> list[bool]:
    """Whether each effect that lasts would have been found at a size that occurs."""
    return [seen_up_to(candidate, _OCCURS) for candidate in document["candidates"] if _may_last(candidate)]


def _may_last(candidate: Mapping[str, Any]) -> bool:
    return candidate["name"] in CATALOGUE and "interval" not in candidate and not candidate.get("refused")


def _kinds(effects: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The first effect that lasts, the first wrong readings, and the first effect of an interval."""
    local = [effect for effect in effects if effect.get("interval")]
    wrong = [effect for effect in effects if effect not in local and _is_wrong_readings(effect)]
    lasting = [effect for effect in effects if effect not in local and effect not in wrong]
    return [*lasting[:1], *wrong[:1], *local[:1]]


def declared_lines(document: Mapping[str, Any], in_parts: bool = False) -> list[str]:
    """What `[effects]` of a recording says of the effects that last, in quotes; with `in_parts` of what is a part of
    the field also what to multiply it by.
    """
    lasting = [effect for effect in reported(document) if not effect.get("interval") and not _is_wrong_readings(effect)]
    return [
        f'`"{effect["name"]}" = [{", ".join(f"{value:.4g}" for value in effect["beta"])}]`'
        + (" times the mean norm of the readings" if in_parts and _is_part_of_field(effect) else "")
        for effect in lasting
    ]


def _is_wrong_readings(effect: Mapping[str, Any]) -> bool:
    return str(effect["name"]).endswith(".outliers")


def _is_part_of_field(effect: Mapping[str, Any]) -> bool:
    """Whether the size of an effect is told in the catalogue's unit, of a field of norm one."""
    entry = CATALOGUE[effect["name"]]
    return entry.in_field_units and list(effect["unit"]) == [parameter.unit for parameter in entry.parameters]


def _use(effect: Mapping[str, Any], lines: Sequence[str], log: Log) -> str:
    """How an effect that was found is used from now on, given the lines that declare all that last."""
    if effect.get("interval"):
        return f"{effect['name']}: look for what disturbed the sensor {interval_words(effect)}, or cut that part out"
    if _is_wrong_readings(effect):
        return f"{effect['name']}: look for the cause of single wrong readings"
    then = "`estimate` and `trace` then correct for it"
    found = " and ".join(lines)
    declares = Path(log.input) / "recording.toml"
    if declares.is_file():
        each = " and of each other log" if log.others else ""
        return f"write {found} into `[effects]` of `{declares}`{each}: {then}"
    map_file = ["--map", str(log.map_file)] if log.map_file else []
    convert = shlex.join(["sinan", "convert", log.input, "run", *map_file, *log.choice.words])
    return f"`{convert}`, and write {found} into `[effects]` of `run/recording.toml`: {then}"


def next_with_parameters(document: Mapping[str, Any]) -> str:
    """What to do where the flight controller has parameters that correct what was found."""
    terms = document["autopilot"]
    if document["verdict"] != "effects" or not terms["parameters"]:
        return str(document["next"])
    names = ", ".join(one["name"] for one in terms["parameters"][:_MOST_NAMES])
    more = " and others" if len(terms["parameters"]) > _MOST_NAMES else ""
    file = f" (`{terms['call']}` writes a file)" if terms["call"] else ""
    return f"set {names}{more} as listed{file}, fly again, and trace the new log"


def name_of(document: Mapping[str, Any]) -> str:
    """What the user calls the recording; where nobody said so, its own name."""
    return str(document.get("called") or document["recording"])


def headline_error(document: Mapping[str, Any]) -> str:
    """The error that matters to the user, before and after on held-out data: of the states where they are known, and
    of both where only the residual falls.
    """
    error, effects = errors(document)[0]
    if _cannot_tell(effects):
        return _without_proof(error, effects)
    part = f"on the {error['held_out_part']}"
    if document["twins"]:
        return f"{_error_of_twins(document)} {part}, depending on which it is"
    sensor = f"{_sensor(error['stream'])} " if document["sensors"] else ""
    residual = f"{sensor}residual {residual_change(error)}"
    change_ = _state_change(error)
    if change_ is None:
        return f"{residual} {part}"
    name, before, after = change_
    state = (
        f"{name.removesuffix('_rms')} error {reference_change(name, before, after)} on the {part_of_reference(error)}"
    )
    return state if after < before else f"{residual}, but {state}"


def _error_of_twins(document: Mapping[str, Any]) -> str:
    """The error that matters to the user, before, and after from the least to the largest with each that is named: of
    the states where they are known, else of the first one's stream.
    """
    twins = [twin for twin in document["twins"] if twin["predicts"] is not False]
    changes = [_state_change({**document["error"], "truth_held_out": twin["truth_held_out"]}) for twin in twins]
    if any(changes):
        name = next(change_[0] for change_ in changes if change_)
        held = [twin["truth_held_out"] for twin in twins]
        sizes = reference_change(name, held[0]["before"][name], *(one["after"][name] for one in held))
        return f"{name.removesuffix('_rms')} error {sizes}"
    of_stream = [one for twin in twins for one in twin["errors"] if one["stream"] == document["error"]["stream"]]
    unit = stream_unit(of_stream[0]["stream"], of_stream[0]["unit"])
    return f"residual {change(of_stream[0]['before'], *(one['after'] for one in of_stream))} {unit}".strip()


def _without_proof(error: Mapping[str, Any], effects: Sequence[Mapping[str, Any]]) -> str:
    """The end of a head line of which the held-out part can tell nothing."""
    wrong = all(_is_wrong_readings(effect) for effect in effects)
    return "left out of every number" if wrong else f"not confirmed: the {error['held_out_part']} cannot show it"


def _state_change(error: Mapping[str, Any]) -> tuple[str, float, float] | None:
    """Name of the error against a truth that the effect spoils first, before and after; None where it is not known or
    hardly changes.
    """
    held, name = error.get("truth_held_out"), _SPOILED.get(error["stream"], "")
    if not held or not is_truth(held.get("kind")) or name not in held["before"] or name not in held["after"]:
        return None
    before, after = held["before"][name], held["after"][name]
    return (name, before, after) if abs(after - before) > _TELLING * before else None


def _worse_reference(document: Mapping[str, Any]) -> str:
    """The error against the reference that grows with what is reported, in words; else empty."""
    change_ = _state_change(document["error"]) if reported(document) else None
    if change_ is None or change_[2] < change_[1]:
        return ""
    whose = reference_words(document["error"]["truth_held_out"].get("kind"))
    return f"{change_[0].removesuffix('_rms')} error against {whose}"


def part_of_reference(error: Mapping[str, Any]) -> str:
    """On which part of the data a reference is asked: what was held out, or where seconds were withheld all over, the
    last third.
    """
    return "last third" if error["held_out_part"] == PREDICTED else str(error["held_out_part"])


def _part_of_data(document: Mapping[str, Any]) -> str:
    return f"{document['error']['held_out_part']} of the data"


def _sensor(stream: str) -> str:
    return SENSORS.get(stream, stream)


def residual_change(error: Mapping[str, Any]) -> str:
    """RMS of the residual before and after on held-out data, with its unit."""
    unit = stream_unit(error["stream"], error["before"]["unit"])
    return f"{change(error['before']['rms'], error['after']['rms'])} {unit}".strip()


def stream_change(error: Mapping[str, Any]) -> str:
    """RMS of one stream's residual before and after, with sensor and unit, as a clause."""
    return f"{_sensor(error['stream'])} residual goes {sizes(error)}"


def sizes(error: Mapping[str, Any]) -> str:
    """RMS of a residual before and after, with its unit."""
    return f"{change(error['before'], error['after'])} {stream_unit(error['stream'], error['unit'])}".strip()


def lead(document: Mapping[str, Any]) -> str:
    """What stands under the title: the proof on held-out data, or how near the strongest candidate came."""
    sentences = [_proof(*pair) for pair in errors(document)] if reported(document) else []
    sentences += [] if document["effects"] else [_strongest(document)]
    sentences += [not_predicting_sentence(document, effect) for effect in not_predicting(document)]
    if document["twins"] and reported(document):
        first, *others = [twin["name"] for twin in document["twins"]]
        sentences.append(f"These numbers are with {first} in the model; those with {' or '.join(others)} are below.")
    if not document["twins"] and (worse := _worse_reference(document)):
        sentences.append(f"The {worse} grows: treat the named effects with caution.")
    if document["verdict"] == "unexplained" and document["remaining"]:
        sentences.append('Something remains that no effect of the catalogue explains: see "What remains".')
    if document["effects"] and document["error"]["same_names_on_fitting_part"] is False:
        sentences.append(
            "Fitted to one part of the data alone, the search chooses other effects: treat the names with caution."
        )
    return " ".join(sentences)


def errors(document: Mapping[str, Any]) -> list[tuple[Mapping[str, Any], list[Mapping[str, Any]]]]:
    """The errors before and after with the effects that are reported of them: of every sensor of poses that has any,
    those first whose held-out readings can tell; else of the recording.
    """
    of_sensor = {one["sensor"]: one["error"] for one in document["sensors"]}
    if not of_sensor or not reported(document):
        return [(document["error"], reported(document))]
    effects: dict[str, list[Mapping[str, Any]]] = {}
    for effect in reported(document):
        effects.setdefault(effect["name"].split(".")[0], []).append(effect)
    found = [(of_sensor[sensor], those) for sensor, those in effects.items()]
    return sorted(found, key=lambda pair: _cannot_tell(pair[1]))


def _cannot_tell(effects: Sequence[Mapping[str, Any]]) -> bool:
    """Whether no held-out reading tells anything of some effects."""
    return all(effect["predicts"] is None for effect in effects)


def _proof(error: Mapping[str, Any], effects: Sequence[Mapping[str, Any]]) -> str:
    if _cannot_tell(effects):
        if all(_is_wrong_readings(effect) for effect in effects):
            return "Wrong readings are left out of every number here: nothing can predict them."
        unit = stream_unit(error["stream"], error["before"]["unit"])
        whole = change(*(error["in_sample"][key]["rms"] for key in ("before", "after")))
        return (
            f"The {error['held_out_part']} of the data holds nothing that could confirm it: only the evidence speaks "
            f"for it. On all data the RMS of the {_sensor(error['stream'])} residual goes {f'{whole} {unit}'.strip()}."
        )
    share = 100.0 * (1.0 - error["after"]["rms"] / error["before"]["rms"])
    low, high = error["after"]["interval"]
    return (
        f"On the {error['held_out_part']} of the data, which took no part in the fit, the RMS of the "
        f"{_sensor(error['stream'])} residual (reading minus prediction) goes {residual_change(error)}: "
        f"{f'{share:.0f}' if share >= 2.0 else f'{share:.1g}'} % less (95 % interval of the second value: "
        f"{number(low)} to {number(high)})."
    )


def not_predicting_sentence(document: Mapping[str, Any], effect: Mapping[str, Any]) -> str:
    """That an effect passes its test on all data but does not predict, with the errors that show it."""
    return (
        f"{effect['name']} passes the test on all data ({p_value_words(effect['log10_p_value'])}) but does not "
        f"predict: with it in the model the {stream_change(effect['held_out'])} on the {_part_of_data(document)}."
    )


def twin_words(twin: Mapping[str, Any]) -> str:
    """One of the effects that explain the data equally well: its size, and what the held-out errors are with it."""
    held = twin["truth_held_out"] or {"before": {}, "after": {}}
    residuals = [f"{_sensor(error['stream'])} residual {sizes(error)}" for error in twin["errors"]]
    against = [
        f"{name.removesuffix('_rms')} {reference_change(name, before, held['after'][name])}"
        for name, before in held["before"].items()
        if name in held["after"]
    ]
    text = ", ".join(residuals)
    text += f"; against {reference_words(held.get('kind'))}: {', '.join(against)}" if against else ""
    failed = f"; {NOT_PREDICTING}" if twin["predicts"] is False else ""
    return f"with {twin['name']} ({size_words(twin)}), held out: {text}{failed}"


def twin_errors(twin: Mapping[str, Any]) -> dict[str, str]:
    """The held-out errors, and those against a reference, without and with one of several effects in the model."""
    found = {f"{_sensor(error['stream'])} residual": sizes(error) for error in twin["errors"]}
    return found | reference_changes(twin["truth_held_out"])


def reference_changes(errors: Mapping[str, Any] | None) -> dict[str, str]:
    """Each error against the reference, by its name with what the reference is: before and after."""
    known = errors or {"before": {}, "after": {}}
    return {
        reference_name(name, known.get("kind")): reference_change(name, before, known["after"][name])
        for name, before in known["before"].items()
        if name in known["after"]
    }


def errors_against_a_truth(error: Mapping[str, Any]) -> dict[str, str]:
    """The held-out errors against a reference that is a truth; none against an autopilot's own estimate."""
    held = error.get("truth_held_out")
    return reference_changes(held) if held and is_truth(held.get("kind")) else {}


def _strongest(document: Mapping[str, Any]) -> str:
    # one that cannot be seen given an error outside the catalogue was not judged: its place there is null
    asked = [c for c in document["candidates"] if c["dof"] > 0 and c.get("judged_log10_p_value", 0.0) is not None]
    unseen = sum(c["dof"] == 0 for c in document["candidates"])
    if not asked:
        return "There are too few readings to look for any effect."
    best = min(asked, key=_log10_p)
    who = f"The strongest of {counted(len(asked), 'candidate')}, {best['name']},"
    needed = f"p < {document['p_value_needed']:.2g}"
    if best.get("refused"):
        return (
            f"{who} has {p_value_words(_log10_p(best))}, where {needed} is needed, but it was not accepted: "
            f"{REFUSED[best['refused']][1]}."
        )
    text = f"{who} has {p_value_words(_log10_p(best))}; {needed} would be needed."
    sizes = [(s, unit) for s, unit in zip(best["detectable_from"], best.get("unit", []), strict=False) if s is not None]
    if sizes:
        size, unit = min(sizes)
        text += f" It would have been found from {per_unit(size, unit, best['name'])} upwards."
    if unseen:
        text += f" {counted(unseen, 'other effect')} cannot be seen in these data at any size."
    return text


def _log10_p(candidate: Mapping[str, Any]) -> float:
    """Of the p-value by which a candidate was judged in the end; of one that was not, about the plain model."""
    judged = candidate.get("judged_log10_p_value")
    return float(np.log10(max(candidate["p_value"], 1e-300))) if judged is None else float(judged)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def trace_summary(document: Mapping[str, Any]) -> str:
    """The trace in a few lines for the terminal."""
    lines = [f"{name_of(document)}: {document['verdict']}", f"  {_capital(document['says'])}."]
    lines += [f"  {document['headline']}.", f"  {lead(document)}"]
    lines += [f"  {effect_line(effect)}" for effect in document["effects"]]
    if document["effects"] and document["error"]["same_names_on_fitting_part"]:
        lines.append("  Fitted to one part of the data alone, the search chooses the same effects.")
    lines += [f"  {twin_words(twin)}" for twin in document["twins"]]
    if reported(document) and not document["twins"]:
        changes = reference_changes(document["error"].get("truth"))
        lines += [f"  {name}, all data: {change_}" for name, change_ in changes.items()]
    if not document["effects"]:
        sizes = [detectable_sentence(c) for c in document["candidates"] if "interval" not in c and not c.get("refused")]
        lines += ["  What would have been seen:", *(f"    {size}" for size in sizes if size)]
    lines += [f"  remains: {remaining_sentence(item)}" for item in document["remaining"]]
    lines += [f"  not traced: {one['sensor']}, {one['why']}" for one in document["left_out"]]
    return "\n".join([*lines, f"  next: {document['next']}"])
