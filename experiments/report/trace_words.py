"""What a trace found in sentences that a student understands: effects, what would have been seen, what remains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sinan.experiments.report.words import SENSORS, number, p_value_words, per_unit, times, with_sigma
from sinan.experiments.residual_loop.trials import (
    GIVEN_ERROR,
    IMPOSSIBLE,
    NO_EVIDENCE,
    ROLLED_BACK,
    SCATTERED,
    UNLIKELY,
    UNTRIED,
)
from sinan.sensors.effects import CATALOGUE
from sinan.sensors.window import second_words

#: An excess beyond so many times the expected is said as a factor, not in per cent.
_FACTOR = 9.0
#: A parameter that is not so many sigma from zero is not known to be anything by itself.
_ALONE = 3.0
#: Why an effect that passes its test was not accepted: in a word or two beside its name, and in a sentence.
REFUSED = {
    SCATTERED: ("blocks", "parts of the recording disagree on its size, and fitted in its exact form it does not pass"),
    UNLIKELY: ("odds", "chance is unlikely to produce it, but no offset at all is likelier still"),
    NO_EVIDENCE: ("refit", "fitted in its exact form it no longer passes"),
    IMPOSSIBLE: ("size", "only an implausible size of it would explain the data"),
    UNTRIED: (
        "not tried",
        "it was not tried: stronger ones came first, or enough effects were found",
    ),
    GIVEN_ERROR: ("other error", "it does not stand out from the error that no effect of the catalogue explains"),
    ROLLED_BACK: ("held out", "held-out data do not bear it out, or do so only with a motion that is assumed"),
}
#: The mark of an effect that passes its test on all data but does not predict the held-out part.
NOT_PREDICTING = "does not predict"


def size_words(effect: Mapping[str, Any]) -> str:
    """The size of an effect in a few words: its largest parameter, or when it acted."""
    return interval_words(effect) if effect.get("interval") else _amount(effect)


def _amount(effect: Mapping[str, Any]) -> str:
    """The largest parameter of an effect."""
    if effect["name"].endswith(".outliers"):
        return f"{100 * effect['beta'][0]:.2g} % of them"
    k = int(np.argmax(np.abs(effect["beta"])))
    several = len(effect["beta"]) > 1 and len(set(effect["unit"])) == 1
    entry = CATALOGUE.get(effect["name"])
    early = entry is not None and entry.is_opposite(effect["beta"])  # its summary has the sign
    value = abs(effect["beta"][k]) if several or early else effect["beta"][k]
    bound = "at least " if effect.get("at_least") else "up to " if several else ""
    return bound + per_unit(value, effect["unit"][k], effect["name"])


def size_and_sigma(effect: Mapping[str, Any]) -> str:
    """The size of an effect with its 1-sigma where it is one number, else in a few words; and when it acted."""
    if effect["name"].endswith(".outliers") or len(effect["beta"]) > 1:
        amount = _amount(effect)
    else:
        (_, value, unit), *_ = parameter_rows(effect)
        amount = f"{value} {unit}".replace(" ", "\N{NO-BREAK SPACE}")
    return f"{amount}, {interval_words(effect)}" if effect.get("interval") else amount


def interval_words(effect: Mapping[str, Any]) -> str:
    """When a time-localised effect acted; in a log without time stamps the numbers of the readings, from 0 on."""
    start, end = effect.get("interval_after_first") or effect["interval"]
    step = str(effect["name"]).endswith(".step")
    if effect.get("interval_unit", "s") == "reading":
        first, last = int(np.ceil(start)), int(np.ceil(end)) - 1
        return f"from reading {first} on" if step else f"in readings {first} to {last}"
    begins, ends = second_words(start), second_words(end)
    return f"from {begins} s on" if step else f"from {begins} s to {ends} s"


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
    line += "; does not predict the held-out data" if effect["predicts"] is False else ""
    together = known_together(effect)
    return f"{line}\n    {together}" if together else line


def known_together(effect: Mapping[str, Any]) -> str:
    """A sentence where all components together are certain and no single one is; else empty."""
    pairs = [(b, s) for b, s in zip(effect["beta"], effect["std"], strict=True) if s]
    if len(pairs) < 2 or any(abs(b) > _ALONE * s for b, s in pairs):
        return ""
    return (
        f"Its components are known only together: p tests all {len(pairs)} at once, and they are not all zero; "
        f"taken singly, each lies within {_ALONE:g} sigma of zero, because their errors are correlated."
    )


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


def seen_up_to(candidate: Mapping[str, Any], most: float) -> bool:
    """Whether an effect would have been seen at so many times its plausible size; in the unit of the log's own field,
    at any size.
    """
    sizes = zip(CATALOGUE[candidate["name"]].parameters, candidate["detectable_from"], candidate["unit"], strict=False)
    return any(
        size is not None and (unit != parameter.unit or size <= most * parameter.plausible)
        for parameter, size, unit in sizes
    )


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


def sentence(summary: str) -> str:
    """A summary without its full stop."""
    return summary.rstrip(".")


def clause(summary: str) -> str:
    """A summary as a part of a sentence."""
    text = summary.rstrip(".")
    return text if text[1:2].isupper() else text[0].lower() + text[1:]
