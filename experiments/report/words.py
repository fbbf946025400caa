"""Results in sentences that a student understands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

_VERDICTS = {
    "no_effect": "The plain model explains the data as far as they can tell.",
    "effects": "The data show what the plain model lacks.",
    "ambiguous": "Something is missing, but the data cannot tell which of several effects it is.",
    "unexplained": "Structure remains in the residual that no effect of the catalogue explains.",
}
_SENSORS = {
    "accel": "accelerometer",
    "gyro": "gyroscope",
    "mag": "magnetometer",
    "baro": "barometer",
    "gps": "GPS",
}


def number(value: float) -> str:
    """Three significant digits without exponents where that is readable."""
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}"


def p_value_words(log10_p: float) -> str:
    """A p-value; beyond a hundred digits the number says nothing more."""
    return f"p = 10^{log10_p:.0f}" if log10_p > -100.0 else "p < 10^-100"


def quantity(value: float | None, unit: str) -> str:
    """A number with its unit; a pure number has none."""
    if value is None:
        return "-"
    return number(value) if unit in ("1", "") else f"{number(value)} {unit}"


def effect_sentence(effect: Mapping[str, Any]) -> str:
    """What an effect is, its size with uncertainty, and when it acted."""
    parts = [
        f"{number(beta)}" + (f" ± {number(std)}" if std is not None else "")
        for beta, std in zip(effect["beta"], effect["std"], strict=True)
    ]
    units = dict.fromkeys(unit for unit in effect["unit"] if unit != "1")
    text = f"{effect['summary']} ({', '.join(parts)}{' ' + ', '.join(units) if units else ''})"
    if effect.get("interval"):
        start, end = effect["interval"]
        text += f", from {number(start)} s to {number(end)} s"
    if effect.get("satellite"):
        text += f", satellite {effect['satellite']}"
    return text


def error_sentence(error: Mapping[str, Any]) -> str:
    """The error before and after on held-out data."""
    before, after = error["before"], error["after"]
    sensor = _SENSORS.get(error["stream"], error["stream"])
    unit = before["unit"]
    share = 100.0 * (1.0 - after["rms"] / before["rms"]) if before["rms"] > 0 else 0.0
    low, high = after["interval"]
    return (
        f"RMS of the {sensor} residual on data that took no part in the fit: {quantity(before['rms'], unit)} -> "
        f"{quantity(after['rms'], unit)} (95 % interval {number(low)} to {number(high)}; {share:.0f} % less)"
    )


#: quantity of a reference -> its unit, and the factor from SI
_REFERENCE_UNITS = {
    "position_rms": ("m", 1.0),
    "velocity_rms": ("m/s", 1.0),
    "attitude_rms": ("deg", 57.29577951308232),
}


def reference_change(name: str, before: float, after: float) -> str:
    """An error against a reference before and after, in the unit that people use."""
    unit, factor = _REFERENCE_UNITS.get(name, ("", 1.0))
    return f"{number(factor * before)} → {number(factor * after)} {unit}".strip()


def reference_value(name: str, value: float) -> str:
    """An error against a reference, in the unit that people use."""
    unit, factor = _REFERENCE_UNITS.get(name, ("", 1.0))
    return f"{number(factor * value)} {unit}".strip()


def reference_name(name: str) -> str:
    """What an error against a reference is."""
    return f"{name.removesuffix('_rms')} error (RMS) against the reference"


#: sensor -> unit of its bias; ranges and heights are in metres
BIAS_UNITS = {"accel": "m/s²", "gyro": "rad/s", "mag": "field"}


def component_name(sensor: str, k: int, size: int) -> str:
    """What the k-th component of a bias is called."""
    if size == 1:
        return ""
    return ("north", "east", "down")[k] if sensor == "gps" else "xyz"[k]


def verdict_sentence(document: Mapping[str, Any]) -> str:
    """The verdict with the effects it names, and how many could not have been seen."""
    text = _VERDICTS[document["verdict"]]
    asked = [c for c in document["candidates"] if "interval" not in c]
    unseen = [c for c in asked if all(size is None for size in c["detectable_from"])]
    if document["verdict"] == "no_effect" and unseen:
        text += f" {len(unseen)} of {len(asked)} effects could not have been seen in them at any size."
    if document["verdict"] == "no_effect" and not asked:
        text += " There are too few readings to look for any effect."
    if document["verdict"] == "ambiguous":
        first = document["effects"][0]
        text += f" {first['name']} or {', '.join(first['confused_with'])}."
        if document.get("separates"):
            text += f" What would decide: {document['separates']}."
    return text


def headline(document: Mapping[str, Any]) -> str:
    """The page's title: what the instrument does wrong and what adding it brings, or that nothing is missing."""
    if not document["effects"]:
        if document["verdict"] != "no_effect":
            return "Something is missing that has no name"
        return "No effect is seen in these data"
    error = document["error"]
    change = f"{quantity(error['before']['rms'], error['before']['unit'])} → {number(error['after']['rms'])}"
    return f"{document['effects'][0]['summary'].rstrip('.')}: residual {change} on held-out data"


def trace_summary(document: Mapping[str, Any]) -> str:
    """The trace in a few lines for the terminal."""
    lines = [f"{document['recording']}: {document['verdict']}", f"  {verdict_sentence(document)}"]
    for effect in document["effects"]:
        lines.append(f"  {effect['name']}: {effect_sentence(effect)}; {p_value_words(effect['log10_p_value'])}")
    if document["effects"]:
        lines.append(f"  {error_sentence(document['error'])}")
        same = "chooses the same names" if document["error"]["same_names_on_fitting_part"] else "chooses other names"
        lines.append(f"  The fitting part alone {same}.")
    truth = document["error"].get("truth") or {"before": {}, "after": {}}
    for name, before in truth["before"].items():
        lines.append(f"  {reference_name(name)}: {reference_change(name, before, truth['after'][name])}")
    if not document["effects"]:
        sizes = [detectable_sentence(c) for c in document["candidates"] if "interval" not in c]
        lines += ["  What would have been seen:", *(f"    {size}" for size in sizes if size)]
    lines += [f"  remains: {remaining_sentence(item)}" for item in document["remaining"]]
    return "\n".join(lines)


def remaining_sentence(item: Mapping[str, Any]) -> str:
    """What is left in a residual, in words."""
    sensor, size = _SENSORS.get(item["stream"], item["stream"]), item["excess"]
    if item["kind"] == "variance":
        relation = "larger" if size > 0 else "smaller"
        return f"the variance of the {sensor} residual is {abs(100 * size):.0f} % {relation} than declared"
    if item["kind"] == "colour":
        return f"neighbouring {sensor} residuals are correlated ({number(size)})"
    return f"an offset of {number(size)} sigma in a stretch of the {sensor} residual"


def detectable_sentence(candidate: Mapping[str, Any]) -> str:
    """The smallest size of an effect that the data would have shown."""
    sizes = [s for s in candidate["detectable_from"] if s is not None]
    if not sizes:
        return f"{candidate['name']}: not visible in these data"
    return f"{candidate['name']}: from {', '.join(number(s) for s in sizes)}"


def stage_names(stages: Sequence[Mapping[str, Any]]) -> list[str]:
    """What each stage adds to the one before."""
    names, before = [], None
    for stage in stages:
        added = [e.removeprefix("pseudorange.").replace("_", " ") for e in stage["effects"] if e not in (before or [])]
        same = "− faulty satellites" if before is not None else "plain model"
        names.append("+ " + ", ".join(added) if added else same)
        before = stage["effects"]
    return names
