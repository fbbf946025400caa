"""What was found or taken of a log that does not declare it, with how well it is known: one table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from math import hypot
from typing import Any

import numpy as np

from sinan.calibration.levels.levels import Levels
from sinan.calibration.levels.sizes import LATE_FIX, Size
from sinan.estimator.filter.assumption import Assumption
from sinan.sensors.arrays import FloatArray
from sinan.sensors.geomagnetism import declination, direction_at, field_along, inclination
from sinan.sensors.recording import Recording
from sinan.sensors.window import told_from

FOUND, CLASS = "log, near its class", "class of instruments"
#: What a key of a sensor is called, and what its unit has besides the sensor's own.
QUANTITIES: Mapping[str, tuple[str, str]] = {
    "noise_density": ("white noise", "/sqrt(Hz)"),
    "noise_std": ("white noise of a reading", ""),
    "velocity_noise_std": ("white noise of a velocity", ""),
    "colour_std": ("first-order noise", ""),
    "velocity_colour_std": ("first-order noise of the velocity", ""),
    "colour_time": ("time constant of that noise", ""),
    "bias_std": ("bias at the start", ""),
    "bias_walk": ("random walk of the bias", "/sqrt(s)"),
}
#: The source of bounds of a motion that nothing measures.
OF_BOUNDS = "log: likeliest of the bounds tried"
#: Of noise in step with the motion: subject, quantity, unit.
IN_STEP = {
    "accel": ("accel", "variance per mean square of second differences", ""),
    "gyro": ("gyro", "variance per mean square of second differences", ""),
    "rate": ("gyro", "white noise per rate of turn", "sqrt(s)"),
}
#: Of stamps: quantity.
STAMPS = {"latency": "lateness of its stamps", "stamps": "jitter of its stamps"}
UNITS = {"accel": "m/s^2", "gyro": "rad/s"}


def assumptions_of(recording: Recording, levels: Levels, sizes: Sequence[Size]) -> tuple[Assumption, ...]:
    """Every size that was open, found or left at what its class has, the bounds of the motion, and the field.

    Parameters
    ----------
    levels : that are in the model
    sizes : that the recording leaves open
    """
    known = levels.sigma_of
    rows = []
    for size in sizes:
        if size.is_of_position:
            what = "how much older than its position the velocity of a fix is"
            is_found = (size.sensor, size.key) in known
            sigma = levels.lead_sigma if is_found else hypot(LATE_FIX.spread, size.spread)
            rows.append(Assumption("gps", what, levels.lead, "s", sigma, False, FOUND if is_found else CLASS))
            continue
        if size.sensor == "bounds" or (size.sensor == "latency" and size.key not in levels.latency):
            continue
        key = (size.sensor, size.key)
        subject, quantity, unit = _words(recording, size)
        sigma, source = (known[key], FOUND) if key in known else (size.spread, CLASS)
        rows.append(Assumption(subject, quantity, levels.value(size), unit, sigma, not size.linear, source))
    rows += _of_the_last_digit(recording, levels)
    for upset in levels.upsets:
        for quantity, value, unit in (("attitude", upset.attitude, "rad"), ("velocity", upset.velocity, "m/s")):
            what = f"{quantity} open again at {upset.t - told_from(recording):.1f} s (1 sigma)"
            rows.append(Assumption("motion", what, value, unit, None, True, "log: likeliest of those tried"))
    if levels.bounds is not None:
        for quantity, value, unit in (
            ("distance from its place (1 sigma)", levels.bounds.place, "m"),
            ("speed (1 sigma)", levels.bounds.speed, "m/s"),
        ):
            rows.append(Assumption("motion", quantity, value, unit, None, True, OF_BOUNDS))
    if levels.m_n is not None and levels.field is not None:
        rows += _of_the_field(recording, levels.m_n, levels.field)
    if levels.tail is not None:
        what = "degrees of freedom of the Student law of innovations"
        rows.append(Assumption("all", what, levels.tail, "", None, True, CLASS))
    if levels.zero_rate is not None:
        at_rest, sigma = levels.zero_rate, float(np.sqrt(np.mean(levels.zero_rate.sigma**2)))
        begin = at_rest.begin[0] - told_from(recording)
        what = f"rate of turn in {len(at_rest.end)} windows at rest, from {begin:.0f} s on (1 sigma)"
        rows.append(Assumption("motion", what, sigma, "rad/s", None, True, "log: as quiet and white as an instrument"))
        what = "gyroscope's bias of one attitude at rest (1 sigma)"
        rows.append(Assumption("motion", what, at_rest.of_gravity.std, "rad/s", None, True, CLASS))
    if levels.axes_std:
        what = "scale and axes, each element of their matrix (1 sigma)"
        rows.append(Assumption("gyro", what, levels.axes_std, "", None, True, CLASS))
    if levels.turned_std:
        what = "turn of its axes against those of the IMU (1 sigma)"
        rows.append(Assumption("mag", what, levels.turned_std, "rad", None, True, CLASS))
    for name, stray in levels.stray.items():
        if name not in levels.specs:
            continue
        what, reach = "share of answers from what is not the ground", "reach of such answers"
        rows.append(Assumption(name, what, stray.share, "", None, True, CLASS))
        rows.append(Assumption(name, reach, stray.reach, "m", None, True, "log: its farthest answer"))
    return tuple(rows)


#: A last digit is listed from this part of the white noise on: less changes the sum by sqrt(1 + 0.01^2), 1 in 20,000.
WORTH_A_ROW = 0.01


def _of_the_last_digit(recording: Recording, levels: Levels) -> list[Assumption]:
    """Step of the numbers of each sensor, of the component whose is largest; of a receiver, of its places."""
    rows = []
    for name, variance in levels.rounding.items():
        white, places = levels.specs[name].noise_std, variance[:3] if name == "gps" else variance
        rounded = float(np.sqrt(np.max(places)))
        if white is not None and rounded > WORTH_A_ROW * white:
            step, unit = rounded * np.sqrt(12.0), _words(recording, Size(name, "noise_std", white, 1.0))[2]
            rows.append(Assumption(name, "last digit of the coarsest component", step, unit, None, True, "log"))
    return rows


def as_rows(assumptions: Sequence[Assumption]) -> list[dict[str, Any]]:
    """The same for JSON."""
    return [asdict(one) for one in assumptions]


def _words(recording: Recording, size: Size) -> tuple[str, str, str]:
    """Subject, quantity and unit of a size."""
    if size.sensor == "in_step":
        return IN_STEP[size.key]
    if size.sensor == "low_pass":
        return size.key, "time constant of the low pass of its samples", "s"
    if size.sensor in STAMPS:
        return size.key, STAMPS[size.sensor], "s"
    quantity, per = QUANTITIES[size.key]
    unit = UNITS.get(size.sensor, "m")
    if size.sensor == "mag":
        unit = recording.environment.field_unit or "of the log"
    if size.key.startswith("velocity"):
        unit = "m/s"
    return size.sensor, quantity, "s" if size.key == "colour_time" else unit + per


def _of_the_field(recording: Recording, m_n: FloatArray, covariance: FloatArray) -> list[Assumption]:
    """Norm, dip and declination of the field that the filter starts from."""
    norm, dip, east = float(np.linalg.norm(m_n)), inclination(m_n), declination(m_n)
    placed = recording.origin is not None and np.allclose((dip, east), direction_at(recording.origin))
    source = "place" if placed else "log"
    found = []
    for quantity, value, unit, gradient in (
        ("norm", norm, recording.environment.field_unit or "of the log", m_n / norm),
        ("dip", dip, "rad", field_along(1.0, dip + np.pi / 2.0, east) / norm),
        ("declination", east, "rad", np.array([-np.sin(east), np.cos(east), 0.0]) / (norm * np.cos(dip))),
    ):
        sigma = float(np.sqrt(gradient @ covariance @ gradient))
        found.append(Assumption("field", quantity, value, unit, sigma, False, "log" if quantity == "norm" else source))
    return found
