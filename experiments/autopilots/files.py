"""Parameter files as ground stations load them: QGroundControl's `.params`, Mission Planner's `.param`."""

from __future__ import annotations

from textwrap import wrap

import numpy as np

from sinan.experiments.autopilots.parameter_set import ParameterSet, Setting
from sinan.sensors.errors import printable

_WIDTH = 100
#: What its ground station expects a file to be called.
FILES = {"px4": "flight.params", "ardupilot": "flight.param"}
#: MAV_PARAM_TYPE of a whole number (INT32) and of another (REAL32).
_INT32, _REAL32 = 6, 9


def as_file(params: ParameterSet, said: str = "") -> str:
    """The file's text: what is set, and as remarks what is not and why.

    Parameters
    ----------
    said : what made it
    """
    remarks = [said] if said else []
    remarks += [f"note: {note}" for note in params.notes]
    remarks += [f"not set: {effect}: {why}" for effect, why in params.without.items()]
    lines = [f"# {line}".rstrip() for text in remarks for line in wrap(printable(text), _WIDTH)]
    if params.autopilot == "px4":
        lines = ["# Onboard parameters for Vehicle 1", "#", *lines, "#"]
        lines += ["# Vehicle-Id Component-Id Name Value Type", *map(_qgroundcontrol, params.settings)]
    else:
        lines += [f"{one.name},{_value(one)}" for one in params.settings]
    return "\n".join(lines) + "\n"


def _qgroundcontrol(one: Setting) -> str:
    return f"1\t1\t{one.name}\t{_value(one)}\t{_INT32 if one.whole else _REAL32}"


def _value(one: Setting) -> str:
    """As an autopilot holds it: whole, or a float of 32 bits."""
    return f"{round(one.value)}" if one.whole else f"{np.float32(one.value):.9g}"
