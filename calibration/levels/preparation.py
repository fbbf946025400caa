"""A measured log made ready for the filter: what its magnetometer, its readings and its flight say of themselves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sinan.calibration.levels.assumptions import assumptions_of
from sinan.calibration.levels.compass import Compass, compass_of, corrected
from sinan.calibration.levels.fields import beforehand, fitted, not_told_late
from sinan.calibration.levels.fit import OF_NO_SENSOR, Levels, declared_lateness, first_levels, sizes_of
from sinan.calibration.levels.heading import with_heading
from sinan.calibration.levels.noise_levels import NoiseFit, first_guess, fit_noise_levels
from sinan.calibration.levels.noise_start import within_imu
from sinan.estimator.filter.flight_model import FlightModel, flight_model
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.run_filter import run_filter
from sinan.sensors.arrays import FloatArray
from sinan.sensors.geomagnetism import declination, inclination
from sinan.sensors.recording import Recording


@dataclass(frozen=True)
class Prepared:
    """A recording, its noise levels and the model made of both.

    Attributes
    ----------
    recording : without the hard iron, with the first heading; what was taken from the log is in its notes. A field
        that was found is in the model alone: what is asked against a declared field cannot be asked of it
    noise : levels, declared and found
    model : of the flight
    notes : what was taken from the log, one line each; empty where everything is declared
    """

    recording: Recording
    noise: NoiseFit
    model: FlightModel
    notes: tuple[str, ...] = ()

    def run(self) -> Journal:
        """The filter over it."""
        return run_filter(self.recording, self.model, engine="numba")


def prepared(recording: Recording, keep_shifted: bool = False) -> Prepared:
    """The same steps for every log, each only where the recording declares nothing of the kind.

    1. No magnetic field declared: hard iron, field and disturbed stretches from the log (`calibration.levels.compass`).
    2. No magnetometer, but GPS: the first heading (`calibration.levels.heading`).
    3. No noise declared: noise levels (`calibration.levels.noise_levels`); no field, but GPS: the field with them.

    What is declared stays: a recording that declares all of it comes back as it is.

    Parameters
    ----------
    keep_shifted : see `calibration.levels.compass.corrected`

    Raises
    ------
    InputError : what `flight_model` raises; readings that all lie outside the IMU's time
    """
    declared, notes = recording, list[str]()
    compass: Compass | None = None
    if "imu" not in recording.streams or len(recording.streams["imu"]) < 2:
        flight_model(recording)  # says what is missing
    if "mag" in recording.streams and recording.environment.magnetic_field is None:
        recording = within_imu(recording)
        notes += outside_notes(declared, recording)
        compass = compass_of(recording)
        sound = corrected(recording, compass)  # of which noise and heading are taken
        kept = corrected(recording, compass, keep_shifted=True) if keep_shifted else sound
        notes += kept.notes[len(declared.notes) :]
        recording = sound.replace(notes=kept.notes)
    specs, _, _ = first_guess(recording)
    headed = with_heading(recording, specs)
    heading = headed.notes[len(recording.notes) :]
    noise = fit_noise_levels(headed, seek_field=_is_field_open(declared))
    model = flight_model(headed, specs=noise.specs, magnetic_field=noise.m_n)
    if compass is not None:
        notes.append(field_note(compass, recording.origin is not None, noise.m_n))
    notes += [*heading, *noise.notes]
    if not notes:
        return Prepared(declared, noise, model)
    streams = headed.streams if compass is None else {**headed.streams, "mag": kept.streams["mag"]}
    as_declared = headed.replace(streams=streams, environment=declared.environment, notes=(*declared.notes, *notes))
    return Prepared(as_declared, noise, model, tuple(notes))


def settled(recording: Recording, late: bool = True) -> Prepared:
    """The same for an estimate: what a recording does not declare is a size with a prior, or a state.

    Readings are coloured, their innovations have a heavy tail, stamps are late by what the log shows, a field that is
    not declared is a state near that of place and log, and where no position is measured place and speed are bounded.
    A recording that declares everything comes back as it is.

    Parameters
    ----------
    late : whether the lateness of stamps is part of the model; else it is only found, so that a trace can name it, but
        for what may be the instants of the IMU's own samples

    Raises
    ------
    InputError : what `flight_model` raises; readings that all lie outside the IMU's time
    """
    if "imu" not in recording.streams or len(recording.streams["imu"]) < 2:
        flight_model(recording)  # says what is missing
    within = within_imu(recording)
    sizes = sizes_of(within)
    if not sizes:
        return prepared(recording)
    notes = outside_notes(recording, within)
    if any(size.sensor == "mag" for size in sizes):
        within, said = thinned(within, "mag", MAG_RATE)
        notes += said
    headed = with_heading(within, first_levels(within, sizes, None, None).specs)
    believed = beforehand(headed)
    sizes = sizes_of(within, believed.iron)
    notes += [*believed.notes, *headed.notes[len(recording.notes) :]]
    levels = fitted(headed, believed)
    if levels.specs["accel"].imu_samples != recording.spec("accel").imu_samples:
        notes.append("imu: samples are means over the time before their stamp, by the likelihood and what is usual")
    declared = declared_lateness(within)  # which the filter takes off by itself
    kept = frozenset(levels.latency) if late else not_told_late(headed, levels)
    levels = replace(levels, latency={k: v for k, v in levels.latency.items() if k in kept and k not in declared})
    model = levels.model(headed).replace(assumptions=assumptions_of(headed, levels, sizes))
    notes += level_notes(levels)
    estimated = tuple((size.sensor, size.key) for size in levels.found if size.sensor in model.sensors)
    noise = NoiseFit(levels.specs, estimated, (), log_likelihood=levels.log_posterior)
    as_declared = headed.replace(notes=(*recording.notes, *notes))
    return Prepared(as_declared, noise, model, tuple(notes))


#: Readings of a magnetometer a second that tell something new: what it is near changes no faster, and as many wrong
#: readings in the time of one right one would outvote the heavy tail [Hz].
MAG_RATE = 20.0


def thinned(recording: Recording, stream: str, rate: float) -> tuple[Recording, list[str]]:
    """Every so many-th reading of a stream, for about as many a second as asked for; and that in words."""
    all_of = recording.streams[stream]
    every = round(1.0 / (rate * float(np.median(np.diff(all_of.t))))) if len(all_of) > 1 else 1
    if every < 2:
        return recording, []
    some = all_of.rows(np.arange(len(all_of)) % every == 0)
    return recording.replace(streams={**recording.streams, stream: some}), [f"{stream}: one reading in {every} is used"]


def is_settled(recording: Recording) -> bool:
    """Whether a recording declares the noise of all its instruments: nothing but bounds of the motion is open."""
    if "imu" not in recording.streams or len(recording.streams["imu"]) < 2:
        return True
    return all(size.sensor == "bounds" for size in sizes_of(within_imu(recording)))


def level_notes(levels: Levels) -> list[str]:
    """One line a sensor: the sizes that were found or taken from the class of instrument."""
    lines = []
    for sensor in dict.fromkeys(size.sensor for size in levels.found if size.sensor not in OF_NO_SENSOR):
        parts = [f"{s.key} {levels.value(s):.2g}" for s in levels.found if s.sensor == sensor]
        lines.append(f"{sensor}: {', '.join(parts)}: the likeliest, near those of its class")
    for sensor, late in levels.latency.items():
        lines.append(f"{sensor}: stamps {1e3 * late:.0f} ms late, by the likelihood")
    if levels.bounds is not None:
        held = f"within {levels.bounds.place:g} m of its place, {levels.bounds.speed:g} m/s"
        lines.append(
            f"no position is measured: the body is taken to stay {held} (1 sigma), the likeliest of the bounds"
        )
    return lines


def _is_field_open(recording: Recording) -> bool:
    """Whether the recording does not say the field, but GPS can tell it."""
    return recording.environment.magnetic_field is None and {"mag", "gps"} <= set(recording.streams)


def field_note(compass: Compass, placed: bool, sought: FloatArray | None = None) -> str:
    """The field that a log shows, in words.

    Parameters
    ----------
    placed : its direction is that of the Earth's field at its place
    sought : (3,) the field in NED where GPS and gravity have shown it
    """
    m_n = compass.m_n if sought is None else sought
    norm, dip = f"{np.linalg.norm(m_n):.4g}", np.rad2deg(inclination(m_n))
    east = np.rad2deg(declination(m_n))
    if sought is not None:
        near = ", near those of the place" if placed else ""
        return (
            f"mag: field of norm {norm}, dip {dip:.1f} and declination {east:.1f} deg found from the log, with its GPS"
            + near
        )
    if placed:
        return f"mag: field of norm {norm} found from the log; dip {dip:.0f}, declination {east:.1f} deg of the place"
    return f"mag: field of norm {norm} and dip {dip:.0f} deg found from the log; north is magnetic north"


def outside_notes(recording: Recording, within: Recording) -> list[str]:
    """What lies outside the IMU's time, in words."""
    out = {name: len(stream) - len(within.streams[name]) for name, stream in recording.streams.items()}
    total = {name: len(stream) for name, stream in recording.streams.items()}
    return [f"{name}: {n} of {total[name]} readings outside the IMU's time: left out" for name, n in out.items() if n]
