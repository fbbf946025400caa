"""A measured log made ready for the filter: what its magnetometer, its readings and its flight say of themselves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.compass import Compass, compass_of, corrected
from calibration.heading import with_heading
from calibration.noise_levels import NoiseFit, first_guess, fit_noise_levels
from calibration.noise_start import within_imu
from estimator.filter import run_filter
from estimator.flight_model import FlightModel, flight_model
from estimator.journal import Journal
from sensors.arrays import FloatArray
from sensors.geomagnetism import declination, inclination
from sensors.recording import Recording


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

    1. No magnetic field declared: hard iron, field and disturbed stretches from the log (`calibration.compass`).
    2. No magnetometer, but GPS: the first heading (`calibration.heading`).
    3. No noise declared: noise levels (`calibration.noise_levels`); no field, but GPS: the field with them.

    What is declared stays: a recording that declares all of it comes back as it is.

    Parameters
    ----------
    keep_shifted : see `calibration.compass.corrected`

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
