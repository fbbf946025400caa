"""Blind recordings with a camera: the maker's own equations against the sensor's, and what its recordings hold."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from sinan.experiments.blind.maker.body import Body
from sinan.experiments.blind.maker.catalogue import CAMERA, Hidden, names_for
from sinan.experiments.blind.maker.filming import LOOKS_DOWN, reading
from sinan.experiments.blind.maker.forward_camera import Pinhole
from sinan.experiments.blind.maker.make import make
from sinan.experiments.blind.maker.turning import exp_rotation, quaternion
from sinan.experiments.datasets import resolve
from sinan.sensors.camera import Camera, Intrinsics
from sinan.sensors.effects import effect as effect_of
from sinan.sensors.motion import Motion

RNG = np.random.default_rng(3)
ROWS = 40
SIZES = {
    "camera.focal": [0.03, -0.02],
    "camera.principal_point": [7.0, -4.0],
    "camera.distortion": [-0.2, 0.05, 1e-3, -2e-3],
    "camera.misalignment": [0.05, -0.08, 0.1],
    "camera.lever_arm": [0.3, -0.2, 0.1],
}


def above_marks() -> tuple[Body, np.ndarray]:
    """Bodies that lean by some tenths of a radian, 10 m above marks."""
    C = exp_rotation(0.2 * RNG.normal(size=(ROWS, 3)))
    zero = np.zeros((ROWS, 3))
    p = np.column_stack([RNG.normal(size=(ROWS, 2)), np.full(ROWS, -10.0)])
    body = Body(np.arange(float(ROWS)), p, zero, zero, C, zero, zero, zero, zero, np.zeros(ROWS))
    return body, RNG.normal(size=(ROWS, 3)) * [2.0, 2.0, 0.3]


@pytest.mark.parametrize("name", ["", *SIZES])
def test_the_maker_s_camera_reads_what_the_sensor_does(name: str) -> None:
    body, marks = above_marks()
    pinhole = Pinhole(np.array([500.0, 510.0]), np.array([640.0, 480.0]), LOOKS_DOWN, np.array([0.1, 0.0, -0.05]))
    camera = Camera(1.0, Intrinsics(pinhole.focal, pinhole.middle), LOOKS_DOWN, pinhole.place)
    motion = Motion(body.t, p_n=body.p, q_nb=quaternion(body.C)).with_covariates(
        point_n=marks, camera=camera.covariate(ROWS)
    )
    expected = camera.predict(motion)
    if name:
        expected = expected + effect_of(name).change(expected, np.array(SIZES[name]), motion, camera)
    hidden = [Hidden(name, np.array(SIZES[name]))] if name else []
    np.testing.assert_allclose(reading(pinhole, hidden, body, marks), expected, atol=1e-6)


def test_recordings_have_what_a_camera_needs_and_hide_its_effects(tmp_path: Path) -> None:
    recordings = tmp_path / "recordings"
    names = set()
    for folder in make(recordings, 3, 6, [CAMERA], "mixed", ["one"]):
        recording = resolve(str(folder), None)
        stream, points = recording.streams["camera"], recording.points
        assert points is not None
        assert set(stream["point"]) <= set(points[:, 0])
        assert recording.sensors["camera"].mounting is not None
        answer = json.loads((tmp_path / "recordings.answers" / folder.name / "answer.json").read_text())
        names |= {one["name"] for one in answer["effects"]}
    assert names <= set(names_for(CAMERA))
    assert any(name.startswith("camera.") for name in names)
