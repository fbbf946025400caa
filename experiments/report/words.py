"""Results in sentences that a student understands."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import acos, degrees, floor, log10
from pathlib import Path
from typing import Any

from sinan.sensors.effects import CATALOGUE
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.registry import BySensor
from sinan.sensors.window import Span

#: what a stream's sensor is called in a sentence
SENSORS = BySensor(lambda entry: entry.title, after={"level": "level (accelerometer)", "zero_rate": "rest (gyroscope)"})


def number(value: float) -> str:
    """Three significant digits without exponents where that is readable."""
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}"


def times(ratio: float) -> str:
    """A large factor in two digits: `15 times`, `9.3e5 times`."""
    if ratio < 1e3:
        return f"{float(f'{ratio:.2g}'):g} times"
    digits, power = f"{ratio:.1e}".split("e")
    return f"{digits}e{int(power)} times"


def counted(n: int, noun: str) -> str:
    """`1 reading`, `2 readings`."""
    return f"{n} {noun_of(n, noun)}"


def noun_of(n: int, noun: str) -> str:
    """The noun behind a number, with the s of a plural where there are several or none."""
    return noun if n == 1 else f"{noun}s"


def p_value_words(log10_p: float) -> str:
    """A p-value; beyond a hundred digits the number says nothing more."""
    if log10_p > -4.0:
        return f"p = {10.0**log10_p:.2g}"
    return f"p = 10^{log10_p:.0f}" if log10_p > -100.0 else "p < 10^-100"


def quantity(value: float | None, unit: str) -> str:
    """A number with its unit; a pure number has none."""
    if value is None:
        return "-"
    return number(value) if unit in ("1", "") else f"{number(value)} {unit}"


def length(metres: float) -> str:
    """A distance in metres or kilometres."""
    return f"{number(metres / 1000.0)} km" if metres >= 1000.0 else f"{number(metres)} m"


def trace_call(
    input: str,
    map_file: Path | None = None,
    sensor: str | None = None,
    span: Span = (None, None),
    choice: Choice = FIRST,
) -> str:
    """The command that looks for what a model lacks, as it is typed.

    Parameters
    ----------
    input : how the user calls the log
    sensor : of several that could be meant
    span : the part of it that is asked for
    choice : which of several sensors of it
    """
    words = ["sinan", "trace", input]
    words += [] if map_file is None else ["--map", str(map_file)]
    words += choice.words
    words += [] if sensor is None else ["--sensor", sensor]
    for option, value in zip(("--from", "--to"), span, strict=True):
        words += [] if value is None else [option, f"{value:g}"]
    return shlex.join(words)


def with_sigma(value: float, sigma: float | None) -> str:
    """A value with its 1-sigma, both to the second digit of the sigma: `0.0398 ± 0.0003`."""
    if sigma is None:
        return f"{number(value)} (± not determined)"
    if sigma <= 0.0:
        return number(value)
    digits = 1 - floor(log10(sigma))
    if digits > 6:  # very small: with a common power of ten
        power = floor(log10(max(abs(value), sigma)))
        scale = 10.0**-power
        return f"({with_sigma(value * scale, sigma * scale)})e{power}"
    if digits < 0:
        return f"{round(value, digits):.0f} ± {round(sigma, digits):.0f}"
    return f"{value:.{digits}f} ± {sigma:.{digits}f}"


#: Digits beyond the second that sizes before and after may need to be told apart.
_TOLD_APART = 4


def change(before: float, *after: float) -> str:
    """A size before and after, with as many digits as the smallest needs, and as it takes to tell them apart; from the
    least to the largest where there are several after it.
    """
    sizes = [before, *sorted({min(after), max(after)})]
    smallest = min(map(abs, sizes))
    digits = max(1 - floor(log10(smallest)) if smallest > 0.0 else 2, 0)
    form, least = ("e", 2) if digits > 6 else ("f", digits)
    for places in range(least, least + _TOLD_APART + 1):
        texts = [f"{size:.{places}{form}}" for size in sizes]
        if len(set(texts)) == len(set(sizes)):
            break
    return f"{texts[0]} → {' to '.join(texts[1:])}"


#: how a unit is written in a sentence
_UNIT_WORDS = {
    "1": "", "1/A": "per ampere", "1/full throttle": "per full throttle",
    "1/K": "per kelvin", "1/s": "per second", "m/s^2": "m/s²", "m/K": "m per kelvin",
    "(m/s^2)/K": "m/s² per kelvin", "(rad/s)/K": "rad/s per kelvin", "(rad/s)/(m/s^2)": "rad/s per m/s²",
    "field": "in the unit of the field",
}  # fmt: skip


def unit_words(unit: str) -> str:
    """A unit as a sentence writes it; a pure number has none."""
    for ending, words in (("/A", " per ampere"), ("/K", " per kelvin"), ("/full throttle", " per full throttle")):
        if unit not in _UNIT_WORDS and unit.endswith(ending):  # that of a magnetometer: gauss/A
            return unit.removesuffix(ending) + words
    return _UNIT_WORDS.get(unit, unit.replace("^2", "²"))


def stream_unit(stream: str, unit: str) -> str:
    """The unit of a stream's readings or residuals, behind a number: a magnetometer's are parts of the field."""
    return "of the field" if stream == "mag" and unit == "1" else unit_words(unit)


def per_unit(value: float, unit: str, effect: str = "") -> str:
    """A parameter in the unit that people use, for a sentence: `0.0030 per ampere`, `2.1 deg`, `9.3 %`."""
    if unit == "rad":
        return f"{_two_digits(57.29577951308232 * value)} deg"
    if unit == "1" and not (effect in CATALOGUE and CATALOGUE[effect].in_field_units):
        return f"{_two_digits(100.0 * value)} %"
    return f"{_two_digits(value)} {unit_words(unit)}".strip()


def _two_digits(value: float) -> str:
    if value == 0.0 or not 1e-6 < abs(value) < 1e6:
        return f"{value:.2g}"
    return f"{value:.{max(1 - floor(log10(abs(value))), 0)}f}"


#: quantity of a reference -> its unit, and the factor from SI
_REFERENCE_UNITS = {
    "position_rms": ("m", 1.0),
    "height_rms": ("m", 1.0),
    "velocity_rms": ("m/s", 1.0),
    "attitude_rms": ("deg", 57.29577951308232),
    "tilt_rms": ("deg", 57.29577951308232),
    "heading_rms": ("deg", 57.29577951308232),
}
#: What a recording is scored against, by the kind of its reference.
_REFERENCES = {
    "simulation": "the simulation", "cameras": "the cameras", "robot": "the robot", "rtk": "RTK",
    "autopilot": "the autopilot's own estimate", "other": "a reference of unknown kind",
}  # fmt: skip


def reference_change(name: str, before: float, *after: float) -> str:
    """An error against a reference before and after, in the unit that people use."""
    unit, factor = _REFERENCE_UNITS.get(name, ("", 1.0))
    return f"{change(factor * before, *(factor * one for one in after))} {unit}".strip()


def reference_value(name: str, value: float) -> str:
    """An error against a reference, in the unit that people use."""
    unit, factor = _REFERENCE_UNITS.get(name, ("", 1.0))
    return f"{number(factor * value)} {unit}".strip()


def reference_words(kind: str | None) -> str:
    """What a recording is scored against."""
    return _REFERENCES.get(kind or "", "the recording's truth")


def is_truth(kind: str | None) -> bool:
    """Whether a difference from such a reference is an error: an autopilot's own estimate errs itself."""
    return kind != "autopilot"


def reference_name(name: str, kind: str | None) -> str:
    """What an error against a reference is, and what the reference is."""
    quantity, whose = name.removesuffix("_rms"), reference_words(kind)
    if not is_truth(kind):
        return f"{quantity} difference (RMS) from {whose}, which is not a truth"
    return f"{quantity} error (RMS) against {whose}"


def reference_rows(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The errors of an estimate against its reference: name, and value with its unit; with that of the smoother."""
    truth = document.get("truth") or {}
    later, rows = truth.get("smoothed") or {}, []
    for name, value in truth.items():
        if name.endswith("_rms"):
            smoothed = f", smoothed {reference_value(name, later[name])}" if name in later else ""
            rows.append((reference_name(name, truth.get("kind")), reference_value(name, value) + smoothed))
    return rows


def reference_notes(document: Mapping[str, Any]) -> list[str]:
    """What was done to the reference of an estimate before it scored, or why there are no errors."""
    truth = document.get("truth")
    return [note] if truth and (note := reference_note(truth, truth)) else []


def reference_note(reference: Mapping[str, Any], errors: Mapping[str, Any]) -> str:
    """What was done to a reference before it scored, or why there are no errors; else empty."""
    whose = reference_words(reference.get("kind"))
    if not any(name.endswith("_rms") for name in errors):
        return f"no error: {whose} knows nothing of what is estimated at any instant of the flight"
    if "delay" not in reference:
        return ""
    angle = 2.0 * degrees(acos(min(abs(reference["mounting"][0]), 1.0)))
    found = f"its mounting ({number(angle)} deg), its delay ({reference['delay']:.2f} s) and "
    found = "" if reference.get("aligned") else found
    return f"removed before the comparison with {whose}: {found}one constant heading"


_BIAS_UNITS = {"accel": "m/s²", "gyro": "rad/s"}


def bias_unit(sensor: str, field: str | None) -> str:
    """The unit of a sensor's bias; ranges and heights are in metres.

    Parameters
    ----------
    field : unit of the magnetometer, where it is known
    """
    return field or "field" if sensor == "mag" else _BIAS_UNITS.get(sensor, "m")


#: block of states -> unit in which people read it, and the factor from SI
_STATE_UNITS = {
    "velocity": ("m/s", 1.0), "attitude": ("deg", 57.29577951308232), "accel bias": ("m/s²", 1.0),
    "gyro bias": ("deg/s", 57.29577951308232), "mag bias": ("of the field", 1.0),
}  # fmt: skip


def state_size(block: str, value: float) -> str:
    """The size of an error of a block of states, with its unit; positions and other biases are in metres."""
    unit, factor = _STATE_UNITS.get(block, ("m", 1.0))
    return f"{number(factor * value)} {unit}"


@dataclass(frozen=True)
class BiasRow:
    """One component of a bias at the end of a flight.

    Attributes
    ----------
    sensor, name : `gyro`, `gyro x`
    unit : of value, sigma and truth
    truth : None where it is not known
    """

    sensor: str
    name: str
    unit: str
    value: float
    sigma: float
    truth: float | None

    @property
    def digits(self) -> int:
        """Decimals that the sigma has with two figures."""
        return min(max(1 - floor(log10(self.sigma)), 0), 12) if self.sigma > 0.0 else 4


def bias_rows(document: Mapping[str, Any]) -> list[BiasRow]:
    """The biases of an estimate, component by component."""
    errors = (document.get("truth") or {}).get("bias_error", {})  # true minus estimate
    rows = []
    for sensor, values in document["bias"].items():
        listed, sigmas = _listed(values), _listed(document["bias_std"][sensor])
        off = errors.get(sensor, [None] * len(listed))
        for k, (b, s, e) in enumerate(zip(listed, sigmas, off, strict=True)):
            name = f"{sensor} {component_name(sensor, k, len(listed))}".strip()
            rows.append(
                BiasRow(sensor, name, bias_unit(sensor, document.get("field_unit")), b, s, None if e is None else b + e)
            )
    return rows


def off_by(row: BiasRow) -> str:
    """Estimate minus truth, in units of the sigma that the filter states."""
    if row.truth is None or row.sigma <= 0.0:
        return "-"
    return f"{(row.value - row.truth) / row.sigma:+.1f} sigma"


def _listed(values: Any) -> list[float]:
    return list(values) if isinstance(values, list | tuple) else [values]


def component_name(sensor: str, k: int, size: int) -> str:
    """What the k-th component of a bias is called."""
    if size == 1:
        return ""
    return ("north", "east", "down")[k] if sensor == "gps" else "xyz"[k]


def shown_stages(document: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The stages of a model of pseudoranges; the one without faulty satellites only where there are any."""
    return [
        stage
        for before, stage in zip([None, *document["stages"]], document["stages"], strict=False)
        if before is None or document["excluded"] or stage["effects"] != before["effects"]
    ]


def stage_names(stages: Sequence[Mapping[str, Any]]) -> list[str]:
    """What each stage adds to the one before."""
    names, before = [], None
    for stage in stages:
        added = [e.removeprefix("pseudorange.").replace("_", " ") for e in stage["effects"] if e not in (before or [])]
        same = "− faulty satellites" if before is not None else "plain model"
        names.append("+ " + ", ".join(added) if added else same)
        before = stage["effects"]
    return names


def columns_in_words(columns: Mapping[str, str]) -> str:
    """Columns with their units; three axes, and numbered ones, as one."""
    units: dict[str, str] = {}
    for column, unit in columns.items():
        base, _, end = column.rpartition("_")
        name = base if base and (end in ("x", "y", "z", "north", "east", "down") or end.isdigit()) else column
        units.setdefault(name, unit)
    return ", ".join(f"{name} [{unit}]" if unit else name for name, unit in units.items())
