"""What a trace found, as the autopilots' corrections take it: SI, a field in gauss, without what is doubtful."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import CATALOGUE
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.recording import Recording

GAUSS = {"gauss": 1.0, "mGauss": 1e-3, "T": 1e4, "uT": 1e-2, "nT": 1e-5}


@dataclass(frozen=True)
class Findings:
    """Effects that a log has, and what of the log their parameters depend on.

    Attributes
    ----------
    effects : parameters by name; of a magnetometer in gauss
    doubtful : effects that were named but are not to be taken out yet, and why
    choice : which sensors of the log were traced, and whether without the autopilot's own corrections
    declination : of the field that the trace assumed [rad, positive to the east]; None: it assumed none
    batteries : whose current is known; 0: throttle stands for it
    temperatures : least and most of each sensor [degC], where known
    """

    effects: Mapping[str, FloatArray]
    doubtful: Mapping[str, str] = field(default_factory=dict)
    choice: Choice = FIRST
    declination: float | None = None
    batteries: int = 1
    temperatures: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def named(self, *effects: str) -> tuple[str, ...]:
        """Those of some effects that are there."""
        return tuple(effect for effect in effects if effect in self.effects)


def findings_of(
    document: Mapping[str, Any], recording: Recording, field_n: FloatArray | None, choice: Choice = FIRST
) -> Findings:
    """The effects of a report.

    Parameters
    ----------
    field_n : (3,) NED, the field that the trace assumed; None: none
    """
    doubtful = {}
    effects = {}
    for effect in document["effects"]:
        name = str(effect["name"])
        why = _doubt(document, effect)
        to_gauss = GAUSS.get(recording.environment.field_unit) if CATALOGUE[name].in_field_units else 1.0
        if not why and to_gauss is None:
            why = "the unit of the field is not known"
        if why:
            doubtful[name] = why
        elif name not in effects:
            effects[name] = np.array(effect["beta"], dtype=np.float64) * (to_gauss or 1.0)
    power = recording.streams.get("power")
    batteries = 0 if power is None else sum(name.split("_")[0] == "current" for name in power.columns)
    return Findings(
        {name: beta for name, beta in effects.items() if name not in doubtful},
        doubtful,
        choice,
        None if field_n is None else float(np.arctan2(field_n[1], field_n[0])),
        batteries,
        _temperatures(recording),
    )


def _doubt(document: Mapping[str, Any], effect: Mapping[str, Any]) -> str:
    """Why an effect is not to be taken out yet; else empty."""
    if effect.get("interval") or str(effect["name"]).endswith(".outliers"):
        return "it was temporary; no parameter corrects that"
    if effect["predicts"] is False:
        return "it does not predict the held-out data"
    if effect["confused_with"]:
        return f"these data cannot tell it from {', '.join(effect['confused_with'])}: decide that first"
    if document["verdict"] == "unexplained" and not effect["predicts"]:
        return "something remains that no effect explains, and no held-out reading can tell of it"
    return "only its least size is known" if effect.get("at_least") else ""


def _temperatures(recording: Recording) -> dict[str, tuple[float, float]]:
    """Least and most temperature of each stream that tells it [degC]; those of the IMU are its two sensors'."""
    found: dict[str, tuple[float, float]] = {}
    for name, stream in recording.streams.items():
        if "temperature" in stream and len(stream):
            span = float(np.nanmin(stream["temperature"])), float(np.nanmax(stream["temperature"]))
            found |= dict.fromkeys(("accel", "gyro") if name == "imu" else (name,), span)
    return found
