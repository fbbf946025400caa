"""`sinan camera hand-eye` and `sinan camera wand`: where cameras are mounted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sinan.calibration.cameras.camera import form
from sinan.calibration.cameras.views import Board, views_of
from sinan.experiments.camera import rig
from sinan.experiments.camera.study import AUTO, study
from sinan.experiments.report.console import progress, working
from sinan.experiments.report.files import write_json
from sinan.sensors.errors import InputError
from sinan.sensors.recording import GYRO


@dataclass(frozen=True)
class Given:
    """What these need besides the pictures: `--body`, `--gyro`, `--along`, `--cameras`."""

    body: Path | None
    gyro: Path | None
    along: str
    cameras: str


def hand_eye(place: Path | None, given: Given, board: Board | None, lens: str, json: Path | None) -> str:
    """The mounting of a camera on the body; from poses, or with a gyroscope's log from rates.

    Raises
    ------
    InputError : no pictures or no table named, or what they lack
    """
    if place is None or given.body is None:
        raise InputError("camera hand-eye", "no pictures or no --body", "sinan camera hand-eye INPUT --body body.csv")
    with progress("looking for corners") as step:
        views = views_of(place, board, step)
    with working("calibrating"):
        done = study(views, lens)
        if given.gyro is None:
            found = rig.mounting_from_poses(done, given.body)
        else:
            from sinan.experiments.datasets import resolve

            imu = resolve(str(given.gyro)).streams.get("imu")
            if imu is None or not set(GYRO) <= set(imu.columns):
                raise InputError(str(given.gyro), "no gyroscope", "a recording with gyro_x, gyro_y, gyro_z")
            found = rig.mounting_from_rates(done, given.body, imu.t, imu.array(GYRO))
    if json is not None:
        write_json(json, rig.mounting_document(found))
    return "\n".join(rig.mounting_words(found))


def wand(table: Path | None, given: Given, lens: str, json: Path | None) -> str:
    """Where several cameras stand.

    Raises
    ------
    InputError : no table, cameras or distances named, or what they lack
    """
    cameras = [Path(name.strip()) for name in given.cameras.split(",") if name.strip()]
    if table is None or len(cameras) < 2 or not given.along:
        wanted = "sinan camera wand TABLE --cameras left.json,right.json --along 0,0.2,0.5"
        raise InputError("camera wand", "no table, cameras or distances", wanted)
    try:
        along = [float(x) for x in given.along.split(",")]
    except ValueError:
        raise InputError("--along", given.along, "distances of the markers from the first, such as 0,0.2,0.5") from None
    with working("calibrating"):
        found = rig.wand(table, cameras, along, None if lens == AUTO else form(lens))
    if json is not None:
        write_json(json, rig.wand_document(found))
    return "\n".join(rig.wand_words(found))
