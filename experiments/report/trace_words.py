"""A trace in sentences that a student understands: title, lead, effects, what would have been seen, what remains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.report.words import (
    SENSORS,
    change,
    counted,
    is_truth,
    number,
    p_value_words,
    per_unit,
    reference_change,
    reference_name,
    stream_unit,
    times,
    with_sigma,
)
from experiments.residual_loop.trials import (
    BESIDE_ERROR,
    IMPOSSIBLE,
    NO_EVIDENCE,
    ROLLED_BACK,
    SCATTERED,
    SLOW_NOISE,
    UNLIKELY,
    UNTRIED,
)
from sensors.effects import CATALOGUE

#: The error against a reference that an effect on a sensor spoils first.
_SPOILED = {
    "mag": "heading_rms", "gyro": "attitude_rms", "accel": "attitude_rms", "level": "attitude_rms",
    "baro": "height_rms", "sonar": "height_rms", "laser": "height_rms", "gps": "position_rms",
}  # fmt: skip
#: A change of that error by less than this share is no headline: the residual's is, then.
_TELLING = 0.1
_MOST_IN_TITLE = 2
#: An excess beyond so many times the expected is said as a factor, not in per cent.
_FACTOR = 9.0
#: A parameter that is not so many sigma from zero is not known to be anything by itself.
_ALONE = 3.0
#: Why an effect that passes its test was not accepted: in a word or two beside its name, and in a sentence.
REFUSED = {
    SLOW_NOISE: (
        "slow noise",
        "slow noise of a sensor, or an acceleration in step with the turning, explains it as well",
    ),
    SCATTERED: ("blocks", "parts of the recording disagree on its size, and fitted in its exact form it does not pass"),
    UNLIKELY: ("odds", "chance would hardly make it, yet no offset at all is likelier"),
    NO_EVIDENCE: ("refit", "fitted in its exact form it no longer passes"),
    IMPOSSIBLE: ("size", "no effect of that name and a plausible size explains it"),
    UNTRIED: (
        "not tried",
        "it was not tried: stronger ones came first, or enough effects were found",
    ),
    BESIDE_ERROR: ("other error", "it does not stand out beside the error that no effect of the catalogue explains"),
    ROLLED_BACK: ("held out", "the held-out part of the data does not bear it out"),
}


def title(document: Mapping[str, Any]) -> str:
    """The page's title: what the instrument does wrong, how much, and what adding it brings; or that nothing is
    missing.
    """
    effects = document["effects"]
    if not effects:
        if document["verdict"] != "no_effect":
            return "Something is missing that no effect of the catalogue explains"
        if document["remaining"]:
            return "No effect of the catalogue is seen, but the residual is not what the noise would leave"
        return "Nothing missing was found: what the model leaves looks like noise"
    first = effects[0]
    if first["confused_with"]:
        others = ", or ".join(_clause(CATALOGUE[name].summary) for name in first["confused_with"])
        return f"{_sentence(first['summary'])}, or {others}: these data cannot tell"
    if len(effects) == 1:
        rest = ", and something without a name" if document["verdict"] == "unexplained" else ""
        return f"{_sentence(first['summary'])}: {size_words(first)}{rest}; {headline_error(document)}"
    parts = [f"{_clause(e['summary'])} ({size_words(e)})" for e in effects[:_MOST_IN_TITLE]]
    more = len(effects) - _MOST_IN_TITLE
    parts += [f"{more} more {'effects' if more > 1 else 'effect'}"] if more > 0 else []
    parts += ["something without a name"] if document["verdict"] == "unexplained" else []
    text = ", ".join(parts[:-1]) + ", and " + parts[-1]
    return f"{text[0].upper()}{text[1:]}: {headline_error(document)}"


def name_of(document: Mapping[str, Any]) -> str:
    """What the user calls the recording; where nobody said so, its own name."""
    return str(document.get("called") or document["recording"])


def headline_error(document: Mapping[str, Any]) -> str:
    """The error that matters to the user, before and after on held-out data: of the states where they are known."""
    error = document["error"]
    part = f"on the {error['held_out_part']}"
    held = error.get("truth_held_out")
    name = _SPOILED.get(error["stream"], "")
    if held and is_truth(held.get("kind")) and name in held["before"] and name in held["after"]:
        before, after = held["before"][name], held["after"][name]
        if abs(after - before) > _TELLING * before:
            return f"{name.removesuffix('_rms')} error {reference_change(name, before, after)} {part}"
    return f"residual {residual_change(error)} {part}"


def residual_change(error: Mapping[str, Any]) -> str:
    """RMS of the residual before and after on held-out data, with its unit."""
    unit = stream_unit(error["stream"], error["before"]["unit"])
    return f"{change(error['before']['rms'], error['after']['rms'])} {unit}".strip()


def lead(document: Mapping[str, Any]) -> str:
    """What stands under the title: the proof on held-out data, or how near the strongest candidate came."""
    text = _proof(document) if document["effects"] else _strongest(document)
    if document["verdict"] == "ambiguous":
        text += f" That is with {document['effects'][0]['name']} in the model; the others named do as well."
        text += f" What would decide: {document['separates']}." if document.get("separates") else ""
    if document["verdict"] == "unexplained":
        text += " Something remains that no effect of the catalogue explains: see the end."
    if document["effects"] and not document["error"]["same_names_on_fitting_part"]:
        text += " The part that was used for fitting, taken alone, chooses other effects: take the names with care."
    return text


def _proof(document: Mapping[str, Any]) -> str:
    error = document["error"]
    before, after = error["before"]["rms"], error["after"]["rms"]
    sensor = SENSORS.get(error["stream"], error["stream"])
    share = 100.0 * (1.0 - after / before) if before > 0 else 0.0
    relation = f"{share:.0f} % less" if share >= 0.0 else f"{-share:.0f} % more"
    low, high = error["after"]["interval"]
    return (
        f"On the {error['held_out_part']} of the data, which took no part in the fit, the RMS of the {sensor} residual "
        f"goes {residual_change(error)}: {relation} (95 % interval of the second {number(low)} to {number(high)})."
    )


def _strongest(document: Mapping[str, Any]) -> str:
    # one that cannot be seen beside an error outside the catalogue was not judged: its place there is null
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
        text += f" It would have been seen from {per_unit(size, unit, best['name'])} on."
    if unseen:
        text += f" {counted(unseen, 'other effect')} cannot be seen in these data at any size."
    return text


def _log10_p(candidate: Mapping[str, Any]) -> float:
    """Of the p-value by which a candidate was judged in the end; of one that was not, about the plain model."""
    judged = candidate.get("judged_log10_p_value")
    return float(np.log10(max(candidate["p_value"], 1e-300))) if judged is None else float(judged)


def size_words(effect: Mapping[str, Any]) -> str:
    """The size of an effect in a few words: its largest parameter, or when it acted."""
    if effect.get("interval"):
        return interval_words(effect)
    if effect["name"].endswith(".outliers"):
        return f"{100 * effect['beta'][0]:.2g} % of them"
    k = int(np.argmax(np.abs(effect["beta"])))
    several = len(effect["beta"]) > 1 and len(set(effect["unit"])) == 1
    value = abs(effect["beta"][k]) if several else effect["beta"][k]
    bound = "at least " if effect.get("at_least") else "up to " if several else ""
    return bound + per_unit(value, effect["unit"][k], effect["name"])


def interval_words(effect: Mapping[str, Any]) -> str:
    """When a time-localised effect acted; in a log without time stamps the numbers of the readings, from 0 on."""
    start, end = effect["interval"]
    step = str(effect["name"]).endswith(".step")
    if effect.get("interval_unit", "s") == "reading":
        first, last = int(np.ceil(start)), int(np.ceil(end)) - 1
        return f"from reading {first} on" if step else f"in readings {first} to {last}"
    return f"from {start:.4g} s on" if step else f"from {start:.4g} s to {end:.4g} s"


def parameter_rows(effect: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Name, value with its sigma, and unit of every parameter of an effect, as `simulate --effect` takes them."""
    columns = zip(effect["parameters"], effect["beta"], effect["std"], effect["unit"], strict=True)
    least = bool(effect.get("at_least"))
    return [(_parameter(effect, name), _value(b, s, least), _unit(effect, unit)) for name, b, s, unit in columns]


def _value(b: float, s: float | None, least: bool) -> str:
    if s is None:
        return f"{number(b)} or {'more' if b > 0.0 else 'less'}" if least else f"{number(b)}, not determined"
    return "not seen" if b == s == 0.0 else with_sigma(b, s)


def _parameter(effect: Mapping[str, Any], name: str) -> str:
    return effect["name"].split(".")[1].replace("_", " ") if name == "b" else name


def _unit(effect: Mapping[str, Any], unit: str) -> str:
    if unit != "1":
        return unit
    return "field" if CATALOGUE[effect["name"]].in_field_units else "ratio"


def effect_line(effect: Mapping[str, Any]) -> str:
    """An effect with every parameter, for the terminal."""
    values = _listed([(name, value, unit if unit != "ratio" else "") for name, value, unit in parameter_rows(effect)])
    when = f"; {interval_words(effect)}" if effect.get("interval") else ""
    satellite = f"; satellite {effect['satellite']}" if effect.get("satellite") else ""
    line = f"{effect['name']}: {values}{when}{satellite}; {p_value_words(effect['log10_p_value'])}"
    together = known_together(effect)
    return f"{line}\n    {together}" if together else line


def known_together(effect: Mapping[str, Any]) -> str:
    """A sentence where all components together are certain and no single one is; else empty."""
    pairs = [(b, s) for b, s in zip(effect["beta"], effect["std"], strict=True) if s]
    if len(pairs) < 2 or any(abs(b) > _ALONE * s for b, s in pairs):
        return ""
    return (
        f"Its components are known only together: p is that of all {len(pairs)} at once, which are surely not all "
        f"zero; of the single ones, whose errors go together, each is within {_ALONE:g} sigma of zero."
    )


def trace_summary(document: Mapping[str, Any]) -> str:
    """The trace in a few lines for the terminal."""
    lines = [f"{name_of(document)}: {document['verdict']}", f"  {title(document)}.", f"  {lead(document)}"]
    lines += [f"  {effect_line(effect)}" for effect in document["effects"]]
    if document["effects"] and document["error"]["same_names_on_fitting_part"]:
        lines.append("  The part that was used for fitting, taken alone, chooses the same effects.")
    if document["effects"]:
        lines += [f"  {name}, all data: {change_}" for name, change_ in reference_changes(document, "truth")]
    if not document["effects"]:
        sizes = [detectable_sentence(c) for c in document["candidates"] if "interval" not in c and not c.get("refused")]
        lines += ["  What would have been seen:", *(f"    {size}" for size in sizes if size)]
    lines += [f"  remains: {remaining_sentence(item)}" for item in document["remaining"]]
    return "\n".join(lines)


def reference_changes(document: Mapping[str, Any], which: str) -> list[tuple[str, str]]:
    """Each error against the reference, with what that is, before and after.

    Parameters
    ----------
    which : "truth", of all data, or "truth_held_out"
    """
    errors = document["error"].get(which) or {"before": {}, "after": {}}
    return [
        (reference_name(name, errors.get("kind")), reference_change(name, before, errors["after"][name]))
        for name, before in errors["before"].items()
        if name in errors["after"]
    ]


def remaining_sentence(item: Mapping[str, Any]) -> str:
    """What is left in a residual, in words."""
    sensor, size = SENSORS.get(item["stream"], item["stream"]), item["excess"]
    if item.get("what"):
        return str(item["what"])
    if item["kind"] == "variance":
        if size > _FACTOR:
            return f"the variance of the {sensor} residual is {times(1.0 + size)} what was expected"
        relation = "larger" if size > 0 else "smaller"
        return f"the variance of the {sensor} residual is {abs(100 * size):.0f} % {relation} than expected"
    if item["kind"] == "colour":
        return f"neighbouring {sensor} residuals are correlated ({number(size)}; 0 would be white noise)"
    if item["follows"] != "time":
        follows = item["follows"].replace("_", " ").removeprefix("the ")
        whose = follows if follows.startswith("its ") else f"the {follows}"
        return (
            f"the {sensor} residual follows {whose} in a way that no effect of the catalogue does "
            f"({number(size)} sigma in all)"
        )
    return f"an offset of {number(size)} sigma in a stretch of the {sensor} residual"


def detectable(candidate: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Name of each parameter, from which size on it would have been seen, and its unit."""
    rows = []
    for name, size, unit in zip(
        candidate.get("parameters", []), candidate["detectable_from"], candidate.get("unit", []), strict=False
    ):
        if size is not None:
            rows.append((_parameter(candidate, name), number(size), "" if unit == "1" else unit))
    return rows


def detectable_sentence(candidate: Mapping[str, Any]) -> str:
    """The smallest size of an effect that the data would have shown."""
    sizes = detectable(candidate)
    if not sizes:
        return f"{candidate['name']}: not visible in these data"
    return f"{candidate['name']}: from {_listed(sizes)}"


def _listed(rows: Sequence[tuple[str, str, str]]) -> str:
    """Names and sizes, the unit once where all have the same."""
    units = {unit for *_, unit in rows}
    if len(units) == 1:
        values = ", ".join(size if len(rows) == 1 else f"{name} {size}" for name, size, _ in rows)
        return f"{values} {units.pop()}".rstrip()
    return ", ".join(f"{name} {size} {unit}".rstrip() for name, size, unit in rows)


def detectable_words(candidate: Mapping[str, Any]) -> str:
    """The same for a cell of a table."""
    return _listed(detectable(candidate))


def _sentence(summary: str) -> str:
    return summary.rstrip(".")


def _clause(summary: str) -> str:
    text = summary.rstrip(".")
    return text if text[1:2].isupper() else text[0].lower() + text[1:]
