"""A measured log made ready for the filter: what its magnetometer, its readings and its flight say of themselves."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

from sinan.calibration.levels.assumptions import assumptions_of
from sinan.calibration.levels.beside_effects import Explained, beside_effects
from sinan.calibration.levels.excerpts import EXCERPTS, SECONDS
from sinan.calibration.levels.fields import beforehand, fitted, not_told_late
from sinan.calibration.levels.fit import with_slow_gps
from sinan.calibration.levels.heading import beside_iron, with_heading
from sinan.calibration.levels.instants import at_regular_instants
from sinan.calibration.levels.levels import Levels, first_levels
from sinan.calibration.levels.noise_start import aiding_sensors, readings_of, within_imu
from sinan.calibration.levels.sizes import OF_NO_SENSOR, sizes_of
from sinan.calibration.levels.upsets import with_upsets
from sinan.estimator.filter.flight import Flight, OfFlight
from sinan.estimator.filter.flight_model import flight_model
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.run_filter import run_filter
from sinan.sensors.arrays import FloatArray
from sinan.sensors.bounds import ASSUMED
from sinan.sensors.formats.plausible import EARTH_FIELD
from sinan.sensors.formats.units import FIELD_UNIT
from sinan.sensors.held import held, interpolated
from sinan.sensors.recording import ACCEL, GYRO, VELOCITY, Recording, Stream
from sinan.sensors.settling import unsettled
from sinan.sensors.window import told_from


@dataclass(frozen=True)
class Prepared(OfFlight):
    """A recording, opened.

    Attributes
    ----------
    flight : its recording has the first heading, and what was taken from the log in its notes
    levels : every size, declared and found
    notes : what was taken from the log, one line each; empty where everything is declared
    """

    flight: Flight
    levels: Levels
    notes: tuple[str, ...] = ()

    def run(self) -> Journal:
        """The filter over it."""
        return run_filter(self.flight, engine="numba")


def as_declared(recording: Recording, slow_gps: bool = False) -> Prepared:
    """A recording that declares everything; the first heading where no magnetometer shows it but GPS does.

    Parameters
    ----------
    slow_gps : whether the receiver may err for seconds besides its declared noise
    """
    recording, unsaid = without_still_velocity(recording)
    levels = first_levels(recording, (), None, None)
    headed = with_heading(recording, levels.specs)
    notes, flight = (*unsaid, *headed.notes[len(recording.notes) :]), Flight.of(headed)
    if slow_gps and "gps" in headed.streams:
        levels = with_slow_gps(headed)
        flight = Flight.of(headed, specs=levels.specs)
    return Prepared(flight, levels, notes)


def prepared(recording: Recording, late: bool = True, effects: Callable[[Flight], Explained] | None = None) -> Prepared:
    """A recording with the likeliest model of what it does not declare: sizes with priors, and states.

    Readings are coloured, their innovations have a heavy tail, stamps are late by what the log shows, a field that is
    not declared is a state near that of place and log, and where no position is measured place and speed are bounded.
    A recording that declares everything comes back as it is.

    Parameters
    ----------
    late : whether the lateness of stamps is part of the model; else it is only found, so that a trace can name it, but
        for what may be the instants of the IMU's own samples
    effects : what they explain of a flight, if sizes are to be those beside effects; see `beside_effects`

    Raises
    ------
    InputError : what `flight_model` raises; readings that all lie outside the IMU's time
    """
    if "imu" not in recording.streams or len(recording.streams["imu"]) < 2:
        flight_model(recording)  # says what is missing
    inside = within_imu(recording)
    within, unsaid = without_still_velocity(inside)
    within, held_back = with_readings_alone(within)
    sizes = sizes_of(within)
    if not sizes and not is_field_open(within):
        return as_declared(recording)
    notes = outside_notes(recording, inside) + unsaid + held_back
    within, said = settled(within, {size.sensor for size in sizes if size.key == "noise_std"})
    notes += said
    if any(size.sensor == "mag" for size in sizes):
        within, said = thinned(within, "mag", MAG_RATE)
        notes += said
    if any(size.sensor == "gps" for size in sizes):
        within, said = at_regular_instants(within)
        notes += said
    headed = with_heading(within, first_levels(within, sizes, None, None).specs)
    believed = beforehand(headed)
    sizes = sizes_of(within, believed.compass)
    levels = first_levels(headed, sizes, believed.m_n, believed.covariance)
    turned = beside_iron(replace(levels, iron=believed.compass.taken).flight(headed))
    if turned is not headed:
        headed, believed = turned, beforehand(turned)
        sizes = sizes_of(within, believed.compass)
    notes += [*believed.notes, *not_of_the_earth(within, believed.m_n), *headed.notes[len(recording.notes) :]]
    levels = with_upsets(headed, fitted(headed, believed))
    if effects is not None:
        levels = beside_effects(levels, levels.flight(headed), effects)
    if levels.in_excerpts:
        told = f"{EXCERPTS} excerpts of {SECONDS:g} s"
        notes.append(f"noise and lateness: sought in {told}, spread over the log, then from there in the whole")
    if levels.specs["accel"].imu_samples != recording.spec("accel").imu_samples:
        notes.append("imu: samples are means over the time before their stamp, by the likelihood and what is usual")
    kept = frozenset(levels.latency) if late else not_told_late(headed, levels)
    levels = replace(levels, latency={k: v for k, v in levels.latency.items() if k in kept})
    flight = levels.flight(headed).believing(assumptions=assumptions_of(headed, levels, sizes))
    notes += level_notes(levels, told_from(recording)) + low_pass_notes(levels, recording.streams["imu"].step)
    if not flight.model.height_is_read:
        notes.append("where the body is, and how fast, is no more than such an assumption and the IMU tell")
    return Prepared(flight.reading(headed.replace(notes=(*recording.notes, *notes))), levels, tuple(notes))


def not_of_the_earth(recording: Recording, m_n: FloatArray | None) -> list[str]:
    """A sentence where the field that a log in gauss has, without what its turns show of hard iron, is none of the
    Earth's.
    """
    least, most = EARTH_FIELD
    if recording.environment.field_unit != FIELD_UNIT or m_n is None or least <= np.linalg.norm(m_n) <= most:
        return []
    found = f"a field of {np.linalg.norm(m_n):.2g} gauss is none of the Earth ({least} to {most} gauss)"
    return [f"mag: {found}: its unit or scale is another, or iron is near"]


#: Readings of a magnetometer a second that tell something new [Hz], since what it is near changes no faster, and as
#: many wrong readings in the time of one right one would outvote the heavy tail: a choice. Of a compass of 50 Hz half
#: and twice move a size by 2.5 and 2.4 of its sigma (`bounds_of_work magnet`).
MAG_RATE = 20.0


def thinned(recording: Recording, stream: str, rate: float) -> tuple[Recording, list[str]]:
    """Every so many-th reading of a stream, for about as many a second as asked for; and that in words."""
    all_of = recording.streams[stream]
    every = round(1.0 / (rate * float(np.median(np.diff(all_of.t))))) if len(all_of) > 1 else 1
    if every < 2:
        return recording, []
    some = all_of.rows(np.arange(len(all_of)) % every == 0)
    return recording.replace(streams={**recording.streams, stream: some}), [f"{stream}: one reading in {every} is used"]


def with_readings_alone(recording: Recording) -> tuple[Recording, list[str]]:
    """Without the rows that hold a slower sensor's last reading, or interpolate to its next, of streams whose noise
    nobody declared; and that in words.
    """
    streams, notes = dict(recording.streams), []
    for name in ("imu", *aiding_sensors()):
        if name not in streams or any(recording.spec(one).says_noise for one in of_stream(name)):
            continue
        readings = all_readings(recording, name)
        old, what = held(readings), "hold the reading of the row before"
        if not np.any(old):
            old, what = interpolated(streams[name].t, readings), "are on a straight line from one reading to the next"
        if count := int(np.sum(old)):
            streams[name] = streams[name].rows(~old)
            notes.append(f"{name}: {count} of {len(old)} rows {what}: left out")
    return recording.replace(streams=streams) if notes else recording, notes


def of_stream(name: str) -> tuple[str, ...]:
    """The sensors whose readings a stream has."""
    return ("accel", "gyro") if name == "imu" else (name,)


def all_readings(recording: Recording, name: str) -> FloatArray:
    """(n, k) what one row of a stream reads; of a receiver place and velocity."""
    if name == "imu":
        return recording.streams[name].array((*ACCEL, *GYRO))
    parts = [readings_of(recording, name)]
    if recording.streams[name].has(VELOCITY):
        parts.append(recording.streams[name].array(VELOCITY))
    return np.concatenate(parts, axis=1)


def without_still_velocity(recording: Recording) -> tuple[Recording, list[str]]:
    """Without velocities of a receiver that never change, zeros most often: it tells none; and that in words. Where
    their noise is declared they stay.
    """
    gps = recording.streams.get("gps")
    if gps is None or len(gps) < 2 or not gps.has(VELOCITY) or recording.spec("gps").velocity_noise_std is not None:
        return recording, []
    if np.any(np.diff(gps.array(VELOCITY), axis=0)):
        return recording, []
    columns = {name: column for name, column in gps.columns.items() if name not in VELOCITY}
    note = "gps: its velocity never changes: it tells none, left out"
    return recording.replace(streams={**recording.streams, "gps": Stream(gps.t, columns)}), [note]


def settled(recording: Recording, sensors: Collection[str]) -> tuple[Recording, list[str]]:
    """Without the fixes of a receiver and the heights of a barometer from before they had settled; and that in words.

    Parameters
    ----------
    sensors : whose noise nobody declared
    """
    streams, notes = dict(recording.streams), []
    for name in ("gps", "baro"):
        if name not in streams or name not in sensors:
            continue
        stream = streams[name]
        velocity = stream.array(VELOCITY) if name == "gps" and stream.has(VELOCITY) else None
        logs = np.split(np.arange(len(stream)), np.searchsorted(stream.t, recording.breaks))
        values = readings_of(recording, name)
        early = [
            rows[: unsettled(stream.t[rows], values[rows], None if velocity is None else velocity[rows])]
            for rows in logs
        ]
        if count := sum(map(len, early)):
            streams[name] = stream.rows(np.isin(np.arange(len(stream)), np.concatenate(early), invert=True))
            words = "first reading" if count == 1 else f"first {count} readings"
            notes.append(f"{name}: the {words}, far from what follows as no motion is, left out: it had not settled")
    return recording.replace(streams=streams) if notes else recording, notes


def is_field_open(recording: Recording) -> bool:
    """Whether a magnetometer reads a field that the recording does not say."""
    return "mag" in recording.streams and recording.environment.magnetic_field is None


def is_declared(recording: Recording) -> bool:
    """Whether a recording declares noise and field: nothing but bounds of the motion is open."""
    if "imu" not in recording.streams or len(recording.streams["imu"]) < 2:
        return True
    within, _ = without_still_velocity(within_imu(recording))
    return not is_field_open(within) and all(size.sensor == "bounds" for size in sizes_of(within))


def near_level(recording: Recording) -> Prepared:
    """A recording as `prepared` has it, but that the accelerometer shows the vertical on average (`level`) where no
    position is measured: what looks at the accelerometer's biases, of which bounds of the motion say next to nothing.
    """
    ready = prepared(recording)
    if "gps" in recording.streams:
        return ready
    return replace(ready, flight=replace(ready.levels, bounds=None).flight(ready.recording))


def near_level_or_a_place(recording: Recording) -> Prepared:
    """A recording that declares everything but measures no position: its accelerometer shows the vertical on average
    (`level`), or the body stays near a place; the likelier by what its instruments read.
    """

    def log_likelihood(ready: Prepared) -> float:
        journal = ready.run()
        read = np.isin(np.array(journal.sensors)[journal.sensor], ASSUMED, invert=True)
        return float(np.sum(journal.log_density[read & journal.accepted]))

    return max((as_declared(recording), prepared(recording, late=False)), key=log_likelihood)


#: A time of fewer sigma than this may be none, and is not told: by chance alone 2 norm.sf(2) = 4.6 % have more.
_TOLD = 2.0


def _in_ms(time: float, sigma: float | None) -> str:
    """How long a time is, with its 1-sigma where that is known, to one digit of it."""
    if not sigma:
        return f"{abs(1e3 * time):.0f} ms"
    digits = max(-int(np.floor(np.log10(1e3 * sigma))), 0)
    return f"{abs(1e3 * time):.{digits}f} ± {1e3 * sigma:.{digits}f} ms"


def low_pass_notes(levels: Levels, step: float) -> list[str]:
    """One line for each instrument that shakes faster than it is logged, every `step` [s]."""
    lines = []
    for size in levels.found:
        if size.sensor != "low_pass":
            continue
        time, sigma = levels.value(size), levels.sigma_of.get(("low_pass", size.key), 0.0)
        if time > max(_TOLD * sigma, 0.5 * step):
            most = ", the longest that is sought" if time > 0.99 * size.at(size.bounds[1]) else ""
            lines.append(f"{size.key}: low pass of {_in_ms(time, sigma)}{most}: it shakes faster than it is logged")
    return lines


def level_notes(levels: Levels, zero: float = 0.0) -> list[str]:
    """One line a sensor: the sizes that were found or taken from the class of instrument; times from `zero` [s] on."""
    lines = []
    for sensor in dict.fromkeys(size.sensor for size in levels.found if size.sensor not in OF_NO_SENSOR):
        parts = [f"{s.key} {levels.value(s):.2g}" for s in levels.found if s.sensor == sensor]
        lines.append(f"{sensor}: {', '.join(parts)}: the likeliest, near those of its class")
    sought = {size.key: size for size in levels.found if size.sensor == "latency"}
    sigmas = {key: sigma for (sensor, key), sigma in levels.sigma_of.items() if sensor == "latency"}
    for sensor, late in levels.latency.items():
        sigma = sigmas.get(sensor)
        if sigma is not None and abs(late) < _TOLD * sigma:
            continue
        when = "late" if late >= 0.0 else "early"
        size = sought.get(sensor)
        most = size is not None and abs(size.theta(late)) > 0.99 * size.bounds[1]
        found = "the most that is sought here; a trace names what is later" if most else "by the likelihood"
        lines.append(f"{sensor}: stamps {_in_ms(late, sigma)} {when}, {found}")
    if any(size.is_of_position for size in levels.found) and abs(levels.lead) >= _TOLD * levels.lead_sigma:
        age = "older" if levels.lead >= 0.0 else "younger"
        ms = _in_ms(levels.lead, levels.lead_sigma)
        lines.append(f"gps: velocities {ms} {age} than the places of fixes, by the likelihood")
    for upset in levels.upsets:
        grown = f"attitude by {upset.attitude:g} rad, of the velocity by {upset.velocity:g} m/s"
        lines.append(f"upset at {upset.t - zero:.1f} s: 1-sigma of the {grown} larger; fixes in a row were doubted")
    if levels.bounds is not None:
        held = f"within {levels.bounds.place:g} m of its place, {levels.bounds.speed:g} m/s"
        lines.append(
            f"no position is measured: the body is taken to stay {held} (1 sigma), the likeliest of the bounds"
        )
    return lines


def outside_notes(recording: Recording, within: Recording) -> list[str]:
    """What lies outside the IMU's time, in words."""
    out = {name: len(stream) - len(within.streams[name]) for name, stream in recording.streams.items()}
    total = {name: len(stream) for name, stream in recording.streams.items()}
    return [f"{name}: {n} of {total[name]} readings outside the IMU's time: left out" for name, n in out.items() if n]
