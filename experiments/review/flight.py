"""A flight over time: path, height, attitude, speeds, what the instruments read, vibration, innovations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sinan.estimator.filter.events import GATED
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.layout import P_N, Q_NB, V_N
from sinan.experiments.reference import Mounted
from sinan.experiments.report.words import SENSORS, reference_words
from sinan.experiments.review.curves import BOUND, COMPARED, DOTS, Curve, Event, Panel, Plan, Review, Section, broken
from sinan.experiments.review.curves import vector_curves as vector
from sinan.experiments.review.readings import readings_section, vibration_section
from sinan.sensors.arrays import FloatArray
from sinan.sensors.bounds import ASSUMED
from sinan.sensors.recording import POSITION, QUATERNION, VELOCITY, Recording, tells_height
from sinan.sensors.rotation import rpy_from_quaternion

#: A normal innovation is outside in one case of twenty.
BOUND_SIGMA = 1.96
_NED = ("north", "east", "down")
_XYZ = ("x", "y", "z")
_REFERENCE = "reference"


@dataclass(frozen=True)
class Flown:
    """What an estimator says of a flight.

    Attributes
    ----------
    recording : as it was read
    t, x : (n,) s, (n, 10 or more) nominal states: position, velocity, quaternion, further ones
    journal : whose innovations are shown
    translation : position and velocity are estimated
    target : what it is compared with, in its axes and on its clock; None: nothing
    events : that are known besides those of the journal
    """

    recording: Recording
    t: FloatArray
    x: FloatArray
    journal: Journal
    translation: bool
    target: Mounted | None = None
    events: tuple[Event, ...] = ()


def flight_review(flown: Flown) -> Review:
    """All that is drawn of a flight."""
    t = flown.t
    motion = tuple(panel for panel in (*_motion(flown), *_attitude(flown)) if panel.curves)
    sections = [
        Section("Motion, as the filter estimates it", motion, _reference_note(flown)),
        readings_section(flown.recording),
        vibration_section(flown.recording),
        Section(
            "Innovations: reading minus prediction",
            tuple(_innovations(flown.journal)),
            "If the filter's model is right, 95 of 100 readings lie between the thin lines. Readings that it refused "
            "are among the events.",
        ),
    ]
    kept = tuple(section for section in sections if section.panels)
    return Review((float(t[0]), float(t[-1])), kept, (*flown.events, *refused_events(flown.journal)), _plan(flown))


def _reference_note(flown: Flown) -> str:
    if flown.target is None or flown.recording.truth is None:
        return ""
    which = reference_words(flown.recording.truth.kind)
    return f"The reference is {which}{', which is not a truth' if flown.recording.truth.kind == 'autopilot' else ''}."


def _compared(flown: Flown, columns: Sequence[str]) -> tuple[FloatArray, FloatArray] | None:
    """Stamps and values of a reference that has the recording's own axes; None: it does not know them."""
    target = flown.target
    if target is None or flown.recording.truth is None or not target.reference.has(columns):
        return None
    truth = flown.recording.truth
    if not (truth.is_own or (truth.aligned and columns is QUATERNION)):
        return None
    return target.reference.t, target.reference.array(columns)


def _plan(flown: Flown) -> Plan | None:
    """The path from above; None: no position is estimated, or none is measured."""
    gps = flown.recording.streams.get("gps")
    if not flown.translation or (gps is None and "base" not in flown.recording.streams):
        return None
    fixes = gps.array(POSITION[:2]) if gps is not None and gps.has(POSITION) else np.empty((0, 2))
    known = _compared(flown, POSITION)
    north, east, _ = flown.x[:, P_N].T
    t, north = broken(flown.t, north)
    compared = np.empty((0, 2)) if known is None else known[1][:, :2]
    said = "" if known is None or flown.recording.truth is None else reference_words(flown.recording.truth.kind)
    return Plan(t, north, broken(flown.t, east)[1], fixes, compared, said)


def _motion(flown: Flown) -> Iterator[Panel]:
    if not flown.translation:
        return
    note = "Above the recording's origin. Barometer and ranges are shifted to match the filter's median."
    yield Panel("Height", "m", tuple(_heights(flown)), note=note)
    velocity = vector(flown.t, flown.x[:, V_N], _NED)
    gps = flown.recording.streams.get("gps")
    if gps is not None and gps.has(VELOCITY):
        velocity += vector(gps.t, gps.array(VELOCITY), _NED, DOTS, "GPS ")
    if (known := _compared(flown, VELOCITY)) is not None:
        velocity += vector(*known, _NED, COMPARED, f"{_REFERENCE} ")
    yield Panel("Velocity", "m/s", velocity)
    speed = [Curve("over ground", *broken(flown.t, np.hypot(*flown.x[:, V_N].T[:2])))]
    air = flown.recording.streams.get("air")
    if air is not None and "airspeed" in air:
        speed.append(Curve("airspeed", *broken(air.t, air["airspeed"]), colour=1))
    yield Panel("Speed", "m/s", tuple(speed))


def _heights(flown: Flown) -> Iterator[Curve]:
    height = -flown.x[:, P_N][:, 2]
    yield Curve("filter", *broken(flown.t, height))
    streams = flown.recording.streams
    if "gps" in streams and "down" in streams["gps"]:
        fixes = streams["gps"].rows(tells_height(streams["gps"]))
        if len(fixes):
            yield Curve("GPS", fixes.t, -fixes["down"], DOTS, 1)
    for k, (name, column) in enumerate((("baro", "height"), ("sonar", "range"), ("laser", "range")), 2):
        if name in streams and column in streams[name] and len(streams[name]):
            stream = streams[name]
            own = stream[column]
            shift = float(np.median(np.interp(stream.t, flown.t, height)) - np.median(own))
            yield Curve(SENSORS.get(name, name), *broken(stream.t, own + shift), colour=k)
    if (known := _compared(flown, POSITION)) is not None:
        yield Curve(_REFERENCE, *broken(known[0], -known[1][:, 2]), COMPARED, 5)


def _attitude(flown: Flown) -> Iterator[Panel]:
    rpy = np.rad2deg(rpy_from_quaternion(flown.x[:, Q_NB]))
    known = _compared(flown, QUATERNION)
    theirs = None if known is None else np.rad2deg(rpy_from_quaternion(known[1]))
    for title, which in (("Roll and pitch", (0, 1)), ("Yaw", (2,))):
        names = ("roll", "pitch", "yaw")
        curves = [Curve(names[k], *_unwound(flown.t, rpy[:, k]), colour=k) for k in which]
        if known is not None and theirs is not None:
            for k in which:
                curves.append(Curve(f"{_REFERENCE} {names[k]}", *_unwound(known[0], theirs[:, k]), COMPARED, k))
        yield Panel(title, "deg", tuple(curves))


def _unwound(t: FloatArray, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """An angle that jumps from 180 to -180 deg, broken there."""
    after = np.flatnonzero(np.abs(np.diff(angle)) > 180.0) + 1
    return broken(np.insert(t, after, t[after]), np.insert(angle, after, np.nan)) if len(after) else broken(t, angle)


def _innovations(journal: Journal) -> Iterator[Panel]:
    """A panel for each quantity of each sensor: innovations that were used, and the filter's own bounds of them."""
    unit_of_field = journal.run.recording.environment.field_unit or "field"  # type: ignore[attr-defined]
    for sensor in journal.sensors:
        if sensor in ASSUMED or sensor == "camera":
            continue
        one = journal.stream(sensor)
        keep = one.accepted
        if not np.any(keep):
            continue
        t, nu, tells = one.t[keep], one.told[keep], np.any(one.tells[keep], axis=0)
        bound = BOUND_SIGMA * np.sqrt(np.einsum("kii->ki", one.S[keep]))
        name = SENSORS.get(sensor, sensor)
        parts = {
            "mag": (("", unit_of_field, slice(0, 3), _XYZ),),
            "gps": ((" position", "m", slice(0, 3), _NED), (" velocity", "m/s", slice(3, 6), _NED)),
        }.get(sensor, (("", "m", slice(0, min(nu.shape[1], 1)), ("innovation",)),))
        for what, unit, part, names in parts:
            shown = np.flatnonzero(tells[part])  # none of the heights of fixes in two dimensions
            if len(shown) == 0:
                continue
            nu_of, bound_of, called = nu[:, part][:, shown], bound[:, part][:, shown], [names[k] for k in shown]
            curves = [*vector(t, bound_of, called, BOUND), *vector(t, -bound_of, called, BOUND)]
            curves += vector(t, nu_of, called, DOTS)
            yield Panel(f"{name}{what}"[:1].upper() + f"{name}{what}"[1:], unit, tuple(curves), robust=True)


def refused_events(journal: Journal) -> tuple[Event, ...]:
    """Readings that the gate refused."""
    found = []
    for sensor in journal.sensors:
        one = journal.stream(sensor)
        found += [Event("refused", float(t), float(t), f"{SENSORS.get(sensor, sensor)} reading refused")
                  for t in one.t[one.status == GATED]]  # fmt: skip
    return tuple(found)
