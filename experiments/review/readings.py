"""What the instruments of a recording read, how hard they were shaken, and at which frequencies."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sinan.experiments.review.curves import Curve, Panel, Review, Section, broken, vector_curves
from sinan.experiments.review.spectrum import amplitude_density
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import ACCEL, GYRO, MAG, Recording, Stream
from sinan.sensors.vibration import CORNER, WINDOW, vibration_power

_XYZ = ("x", "y", "z")
#: Columns with a panel of their own, beside the three-axis ones: stream, how its columns begin, title, unit.
_SINGLE = (
    ("baro", "height", "Barometer", "m"), ("baro", "pressure", "Pressure", "Pa"), ("sonar", "range", "Sonar", "m"),
    ("laser", "range", "Laser", "m"), ("power", "current", "Current", "A"), ("power", "voltage", "Voltage", "V"),
    ("motors", "motor", "Motors", ""), ("air", "airspeed", "Airspeed", "m/s"),
    ("imu", "temperature", "Temperature", "deg C"),    ("gps", "satellites", "Satellites", ""),
)  # fmt: skip
#: Curves of a panel at most: colours, and eyes, can tell so many.
_MOST = 6
#: Densities are drawn so many decades down from the largest.
_DECADES = 6.0


def clock_of(recording: Recording) -> tuple[str, FloatArray]:
    """What readings are shown over, "time" or "reading", with the stamps of the first stream."""
    for name in ("imu", "poses", *recording.streams):
        if name in recording.streams:
            t = recording.streams[name].t
            return ("reading" if np.array_equal(t, np.arange(len(t))) else "time"), t
    raise AssertionError("a recording has a stream")


def readings_review(recording: Recording) -> Review:
    """All that is drawn of a recording of which nothing was estimated."""
    axis, _ = clock_of(recording)
    first = min(float(stream.t[0]) for stream in recording.streams.values())
    last = max(float(stream.t[-1]) for stream in recording.streams.values())
    sections = [readings_section(recording), vibration_section(recording)]
    span = (first, max(last, first + 1.0))
    return Review(span, tuple(section for section in sections if section.panels), axis=axis)


def readings_section(recording: Recording) -> Section:
    """Readings as they are in the log."""
    return Section("What the instruments read", tuple(_panels(recording)), "As logged, without any correction.")


def _panels(recording: Recording) -> Iterator[Panel]:
    axis, _ = clock_of(recording)
    streams = recording.streams
    inertial = streams.get("imu") or streams.get("poses")
    field = recording.environment.field_unit or "its unit"
    for stream, columns, title, unit, factor in (
        (inertial, ACCEL, "Accelerometer", "m/s²", 1.0),
        (inertial, GYRO, "Gyroscope", "deg/s", float(np.rad2deg(1.0))),
        (streams.get("mag") or streams.get("poses"), MAG, "Magnetometer", field, 1.0),
    ):
        if stream is not None and stream.has(columns):
            yield Panel(title, unit, _three(stream, columns, factor, columns is MAG), axis)
    for name, begins, title, unit in _SINGLE:
        if name not in streams or (begins == "pressure" and "height" in streams[name]):
            continue
        wanted = [c for c in streams[name].columns if c == begins or c.startswith(f"{begins}_")][:_MOST]
        if wanted:
            said = [c.removeprefix(f"{begins}_") if len(wanted) > 1 else c for c in wanted]
            yield Panel(title, unit, vector_curves(streams[name].t, streams[name].array(wanted), said), axis)


def _three(stream: Stream, columns: tuple[str, ...], factor: float, norm: bool) -> tuple[Curve, ...]:
    values = factor * stream.array(columns)
    curves = vector_curves(stream.t, values, _XYZ)
    return (*curves, Curve("norm", *broken(stream.t, np.linalg.norm(values, axis=1)), colour=3)) if norm else curves


def vibration_section(recording: Recording) -> Section:
    """How hard the accelerometer is shaken over time, and the spectra of accelerometer and gyroscope."""
    imu = recording.streams.get("imu")
    if imu is None or not imu.has(ACCEL):
        return Section("Vibration", ())
    panels = [*_vibration(imu)]
    notes = [] if panels else [f"The IMU was logged too slowly to see vibration above {CORNER:g} Hz."]
    for columns, title, unit, factor in (
        (ACCEL, "Spectrum of the accelerometer", "m/s²/√Hz", 1.0),
        (GYRO, "Spectrum of the gyroscope", "deg/s/√Hz", float(np.rad2deg(1.0))),
    ):
        if not imu.has(columns):
            continue
        found = amplitude_density(imu.t, factor * imu.array(columns))
        if found is not None and np.any(found[1] > 0.0):
            decades, rows = np.log10(found[0]), np.maximum(found[1], float(np.max(found[1])) * 10.0**-_DECADES)
            parts = enumerate(zip(_XYZ, rows.T, strict=True))
            curves = tuple(Curve(name, decades, np.log10(row), colour=k) for k, (name, row) in parts)
            panels.append(Panel(title, unit, curves, "frequency", logarithmic=True))
    if any(panel.logarithmic for panel in panels):
        notes.append(
            "A spectrum ends at half the logging rate; faster vibration appears in it at a lower frequency (aliasing)."
        )
    return Section("Vibration and spectrum", tuple(panels), " ".join(notes))


def _vibration(imu: Stream) -> Iterator[Panel]:
    power = vibration_power(imu.t, imu.array(ACCEL), noise_std=0.0)
    if np.any(power > 0.0):
        rms = np.sqrt(np.maximum(power, 0.0))
        note = f"RMS over {WINDOW:g} s of the accelerometer above {CORNER:g} Hz, its noise included."
        yield Panel("Vibration", "m/s²", vector_curves(imu.t, rms, _XYZ), note=note)
