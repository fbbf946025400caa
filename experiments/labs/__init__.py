"""The course's experiments, one file each: `run(out)` computes, says what it found, and writes a page."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from sinan.sensors.errors import InputError

#: name -> what it shows; the file of the same name has `run`
LABS = {
    "spring_mass": "a mass on a spring: specific force, zero in free fall, tilt, vibration (figures 7.1 to 7.3)",
    "coriolis": "two masses that swing against each other: a rate is read, an acceleration is not (7.6, 7.7)",
    "magneto_bridge": "a magneto-resistive bridge, its offset and the flip that takes it out; Lorentz "
    "force (7.9, 7.10)",
    "sonar_echo": "time of flight, the air's temperature, and when no echo comes back (7.12, 7.13)",
    "barometer": "from pressure to the height above the start, compared with GPS",
    "tilt": "tilt of the accelerometer, free of drift, compared with the integrated gyroscope",
    "accelerometer": "ten poses of an accelerometer: scale and offset by the norm of gravity (basic experiment)",
    "gravity": "the same with g = 1: the scale changes, the offset and the pitch angle do not (analysis experiment)",
    "magnetometer": "240 readings of a magnetometer, and the sign of an offset decided by the data (design experiment)",
    "iterations": "figures 7.5, 7.8, 7.11: errors before and after, and the index over the iterations",
    "printed": "the lecture's printed T, K, b held against the course's data",
    "three_angles": "the antisymmetric T as a form of fit: unseen by norms, found by known angles",
    "attitudes": "the ten attitudes and six faces: what each subset determines",
    "reference": "calibration by an attitude that the log gives, compared with self-calibration",
    "heading": "heading from a magnetometer: without tilt, with that of the specific force, with the true one",
    "sonar_height": "height from a sonar: time of flight, temperature, tilt, and how soft a ground may be",
    "codes": "C/A and P code: classes of receivers, and both codes of measured RINEX",
    "camera": "a camera calibrated as a pinhole, what its residual field shows, and what held-out pictures gain",
    "laser_map": "laser, DGPS and IMU make a map; its strips show how the laser is mounted (7.15)",
    "scan_height": "height from a laser scan: the course's mean against the exact formula",
}


def run(name: str, out: Path, say: Callable[[str], None] = print) -> None:
    """Run one experiment.

    Raises
    ------
    InputError : no such experiment, or its measured data are not here
    """
    if name not in LABS:
        raise InputError("lab", f"no experiment `{name}`", "one of " + ", ".join(LABS))
    import_module(f"sinan.experiments.labs.{name}").run(out, say)
    say(f"page: {(out / f'{name}.html').resolve()}")
