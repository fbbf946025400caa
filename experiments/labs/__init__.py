"""The course's experiments, one file each: `run(out)` computes, says what it found, and writes a page."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from sinan.sensors.errors import InputError

#: name -> what it shows; the file of the same name has `run`
LABS = {
    "accelerometer": "ten poses of an accelerometer: scale and offset by the norm of gravity (basic experiment)",
    "gravity": "the same with g = 1: the scale changes, the offset and the pitch angle do not (analysis experiment)",
    "magnetometer": "240 readings of a magnetometer, and the sign of an offset decided by the data (design experiment)",
    "heading": "heading from a magnetometer: without tilt, with that of the specific force, with the true one",
    "sonar_height": "height from a sonar: time of flight, temperature, tilt, and how soft a ground may be",
    "camera": "a camera calibrated as a pinhole, what its residual field shows, and what held-out pictures gain",
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
