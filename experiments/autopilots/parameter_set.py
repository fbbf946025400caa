"""Parameters of an autopilot, one by one: what each is to be, what it was in the log, and what has no parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sinan.sensors.arrays import FloatArray

AXES = "XYZ"


@dataclass(frozen=True)
class Setting:
    """One parameter to be set.

    Attributes
    ----------
    was : in the log; None: the log does not say
    effects : that it takes out, by name
    whole : a whole number
    """

    name: str
    value: float
    was: float | None
    effects: tuple[str, ...]
    whole: bool = False


@dataclass
class ParameterSet:
    """The parameters of one autopilot that take out what was found, filled effect by effect.

    Attributes
    ----------
    autopilot : its name in `AUTOPILOTS`
    parameters : of the log
    settings : in the order in which they were found
    without : effects that no parameter takes out, and why
    notes : what the user should know before these are loaded
    """

    autopilot: str
    parameters: Mapping[str, float]
    settings: list[Setting] = field(default_factory=list)
    without: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def get(self, name: str, default: float = 0.0) -> float:
        """A parameter of the log, or its default."""
        return float(self.parameters.get(name, default))

    def three(self, form: str, default: float = 0.0) -> FloatArray:
        """(3,) the parameters of three axes; `form` has `{}` where the axis stands."""
        return np.array([self.get(form.format(axis), default) for axis in AXES])

    def put(self, name: str, value: float, *effects: str, whole: bool = False) -> None:
        """Set one; what several effects set to the same is set once."""
        was = self.parameters.get(name)
        value = round(value) if whole else float(value)
        before = next((one for one in self.settings if one.name == name), None)
        both = effects if before is None else tuple(dict.fromkeys((*before.effects, *effects)))
        new = Setting(name, value, None if was is None else float(was), both, whole)
        if before is None:
            self.settings.append(new)
        elif before.value == value:
            self.settings[self.settings.index(before)] = new
        else:
            raise ValueError(f"{name} is to be {before.value:g} and {value:g}")

    def has(self, name: str) -> bool:
        """Whether one is set already."""
        return any(one.name == name for one in self.settings)

    def put_three(self, form: str, values: Sequence[float] | FloatArray, *effects: str) -> None:
        """Set those of three axes."""
        for axis, value in zip(AXES, values, strict=True):
            self.put(form.format(axis), float(value), *effects)

    def refuse(self, effect: str, why: str) -> None:
        """Say why an effect has no parameter here."""
        self.without[effect] = why

    def as_table(self) -> dict[str, Any]:
        """The same for a JSON document."""
        return {
            "autopilot": self.autopilot,
            "parameters": [
                {"name": s.name, "value": s.value, "was": s.was, "effects": list(s.effects), "whole": s.whole}
                for s in self.settings
            ],
            "without": [{"effect": effect, "why": why} for effect, why in self.without.items()],
            "notes": list(self.notes),
        }
