"""What a log could not show, whatever is in it: effects that need what it does not hold, and those without a trace."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sinan.experiments.report.words import SENSORS
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import ACCEL, Recording

_MOST_NAMES = 12
#: What effects need that streams other than the sensor's own show, and where each comes from.
_TOLD_BY = {
    "temperature": "a temperature that varies, logged with the readings", "current": "a supply or motors that vary",
    "voltage": "a supply that varies", "airspeed": "an airspeed or a wind that varies", "wind": "a wind that varies",
    "throttle": "motors that vary", "m_n": "the field of the place, from [origin] or a GPS",
    "rotor_drag": "a declared motion.rotor_drag", "vibration": "an IMU that is fast enough",
}  # fmt: skip
_INSTEAD = {"current": ("throttle",)}


def could_see(recording: Recording) -> tuple[list[str], dict[str, list[str]]]:
    """The effects that a trace may look for, and those that it may not, by what is missing for them.

    Steps, transients and outliers are looked for in every sensor; whether the motion shows an effect is not asked.
    """
    from sinan.estimator.evidence.flights.candidates import lacks_declared_field
    from sinan.sensors.effects import effects_for

    streams = recording.streams
    sensors: set[str] = set(streams) - {"imu", "poses", "power", "motors", "air"}
    inertial = streams.get("imu") or streams.get("poses")
    for sensor in ("accel", "gyro", "mag"):
        if inertial is not None and f"{sensor}_x" in inertial:
            sensors.add(sensor)
    if recording.kind == "flight" and "imu" not in streams:
        return [], {"an accelerometer with a gyroscope": [entry.name for entry in effects_for("flight", sensors)]}
    found: list[str] = []
    missing: dict[str, list[str]] = {}
    known = {sensor: _covariates(recording, sensor) for sensor in sensors}
    for entry in effects_for(recording.kind, sensors):
        if recording.kind == "flight" and lacks_declared_field(recording, entry.name):
            missing.setdefault("a declared magnetic field", []).append(entry.name)
            continue
        have = known.get(entry.stream, set())
        if recording.environment.magnetic_field is not None or recording.origin is not None:
            have = have | {"m_n"}
        lacks = [need for need in entry.needs if need in _TOLD_BY and need not in have
                 and not any(other in have for other in _INSTEAD.get(need, ()))]  # fmt: skip
        if lacks:
            missing.setdefault(_TOLD_BY[lacks[0]], []).append(entry.name)
        else:
            found.append(entry.name)
    return found, missing


def _clock(recording: Recording, sensor: str) -> FloatArray:
    streams = recording.streams
    stream = streams.get(sensor) or streams.get("imu") or streams.get("poses")
    return stream.t if stream is not None else next(iter(streams.values())).t


def _covariates(recording: Recording, sensor: str) -> set[str]:
    """The covariates that vary; one that does not makes its effect a bias. Vibration is not computed: an IMU that is
    fast enough and reads no constant has some.
    """
    from sinan.sensors.covariates import covariates_for
    from sinan.sensors.vibration import CORNER, WINDOW

    covariates = covariates_for(recording, "gyro" if sensor == "accel" else sensor, _clock(recording, sensor))
    found = {name for name, values in covariates.items() if np.any(np.ptp(values, axis=0) > 0.0)}
    imu = recording.streams.get("imu")
    if sensor == "accel" and imu is not None and len(imu) > 1:
        rate = 1.0 / imu.step
        fast = rate >= 4.0 * CORNER and len(imu) >= 2.0 * WINDOW * rate
        if fast and np.any(np.ptp(imu.array(ACCEL), axis=0) > 0.0):
            found.add("vibration")
    return found


def not_seen(recording: Recording, document: Mapping[str, Any] | None = None) -> list[str]:
    """A sentence for each reason.

    Parameters
    ----------
    document : the report of a trace; None: nothing was traced
    """
    _, missing = could_see(recording)
    found = [f"{_listed(names)}: would need {what}" for what, names in missing.items()]
    if document is None:
        return found
    blind = [one["name"] for one in document["candidates"] if one["dof"] == 0]
    if blind:
        found.append(f"{_listed(blind)}: not visible in this motion at any size")
    return found + [f"the {SENSORS.get(one['sensor'], one['sensor'])} was not traced: {one['why']}"
                    for one in document["left_out"]]  # fmt: skip


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _MOST_NAMES
    return ", ".join(names[:_MOST_NAMES]) + (f" and {more} more" if more > 0 else "")
