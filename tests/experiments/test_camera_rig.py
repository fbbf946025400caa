"""`sinan camera hand-eye` and `sinan camera wand`, against mountings that are known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from sinan.calibration.cameras.views import View, write_corners
from sinan.experiments.camera.rig import read_wand
from sinan.experiments.commands.cli import app
from sinan.sensors.arrays import FloatArray
from sinan.sensors.camera import Intrinsics
from sinan.sensors.errors import InputError
from sinan.sensors.formats.plain import write_recording
from sinan.sensors.recording import ACCEL, GYRO, Recording, Stream
from sinan.sensors.rotation import (
    matrix_from_quaternion,
    quaternion_conjugate,
    quaternion_from_matrix,
    quaternion_log,
    quaternion_multiply,
    rotation_exp,
)
from tests.calibration.test_camera import BOARD, SIZE
from tests.calibration.test_hand_eye import C_BC, C_NT, L_B, P_T
from tests.calibration.test_wand import ALONG, CAMERAS, PLACES, waved

CAMERA = Intrinsics(np.array([420.0, 424.0]), np.array([325.0, 243.0]), "brown", np.array([-0.2, 0.08]))
NOISE, DELAY = 0.1, 0.02  # pixels, s
DEGREE = np.deg2rad(1.0)


def body_at(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """A hand that holds a camera before a board: R, T of the board in the camera, C_nb and p_n of the body."""
    size, rates = np.array([0.3, 0.35, 0.4]), np.array([1.3, 0.9, 1.7])
    R = rotation_exp(size * np.sin(np.multiply.outer(t, rates) + np.array([0.0, 0.4, 1.0])))
    sway = np.sin(np.multiply.outer(t, [0.7, 1.1, 0.5])) * [0.06, 0.05, 0.08] + np.array([0.0, 0.0, 0.42])
    T = sway - R @ BOARD.points.mean(axis=0)
    C_nc = C_NT @ np.swapaxes(R, 1, 2)
    C_nb = C_nc @ C_BC.T
    return R, T, C_nb, P_T - np.einsum("nij,nj->ni", C_nc, T) - C_nb @ L_B


def seen(folder: Path, t: FloatArray) -> list[View]:
    """The pictures at these instants, as a table of corners."""
    rng, views = np.random.default_rng(0), []
    for k, (R, T) in enumerate(zip(*body_at(t)[:2], strict=True)):
        uv = CAMERA.pixels(BOARD.points @ R.T + T)
        inside = np.all((uv > 0.0) & (uv < np.array(SIZE)), axis=1)
        noisy = uv + NOISE * rng.standard_normal(uv.shape)
        views.append(View(f"{k:03d}.png", BOARD.points[inside], noisy[inside]))
    write_corners(folder / "corners.csv", views, SIZE)
    return views


def told(*arguments: str | Path) -> dict[str, object]:
    """The document of a command that has to succeed."""
    out = Path(arguments[2]).parent / "told.json"
    result = CliRunner().invoke(app, [*map(str, arguments), "--json", str(out)])
    assert result.exit_code == 0, result.output
    return json.loads(out.read_text())


def turned_by(document: dict[str, object]) -> float:
    """Angle between the mounting that was found and the true one [rad]."""
    q = quaternion_multiply(quaternion_conjugate(quaternion_from_matrix(C_BC)), np.array(document["mounting"]))
    return float(np.linalg.norm(quaternion_log(q)))


def test_the_mounting_is_found_from_pictures_and_poses(tmp_path: Path) -> None:
    t = np.linspace(0.0, 12.0, 14)
    seen(tmp_path, t)
    _, _, C_nb, p_n = body_at(t)
    rows = np.column_stack([quaternion_from_matrix(C_nb), p_n])[::-1]  # in another order than the pictures
    lines = [f"{13 - k:03d}.png," + ",".join(f"{x:.9f}" for x in row) for k, row in enumerate(rows)]
    (tmp_path / "body.csv").write_text("\n".join(["image,qw,qx,qy,qz,north,east,down", *lines]) + "\n")
    found = told("camera", "hand-eye", tmp_path / "corners.csv", "--body", tmp_path / "body.csv", "--lens", "k1 k2")
    assert turned_by(found) < 0.1 * DEGREE
    np.testing.assert_allclose(found["lever_arm"], L_B, atol=2e-3)
    assert found["undetermined"] == []


def test_rotation_and_lateness_are_found_from_pictures_and_a_gyroscope(tmp_path: Path) -> None:
    t_seen, t = np.arange(0.5, 15.5, 0.3), np.arange(0.0, 16.0, 0.005)
    views = seen(tmp_path, t_seen)
    lines = [f"{view.name},{late:.6f}" for view, late in zip(views, t_seen + DELAY, strict=True)]
    (tmp_path / "stamps.csv").write_text("\n".join(["image,t", *lines]) + "\n")
    q = quaternion_from_matrix(body_at(np.append(t, 16.0) - 0.0025)[2])
    w = quaternion_log(quaternion_multiply(quaternion_conjugate(q[:-1]), q[1:])) / 0.005
    f = -np.einsum("nji,j->ni", matrix_from_quaternion(quaternion_from_matrix(body_at(t)[2])), [0.0, 0.0, 9.8])
    columns = dict(zip((*ACCEL, *GYRO), np.column_stack([f, w]).T, strict=True))
    write_recording(Recording("hand", "flight", {"imu": Stream(t, columns)}), tmp_path / "hand")
    corners, stamps = tmp_path / "corners.csv", tmp_path / "stamps.csv"
    found = told("camera", "hand-eye", corners, "--body", stamps, "--gyro", tmp_path / "hand", "--lens", "k1 k2")
    assert turned_by(found) < 0.2 * DEGREE
    assert found["delay"] == pytest.approx(DELAY, abs=1e-3)
    assert found["lever_arm"] is None


def as_camera(path: Path, camera: Intrinsics) -> None:
    """The part of `sinan camera --json` that a wand needs."""
    name = "fisheye" if camera.lens == "fisheye" else "k1 k2 p1 p2 k3"
    values = dict(zip(camera.names, camera.values.tolist(), strict=True))
    path.write_text(json.dumps({"form": name, "values": values}))


def wand_table(path: Path, pixels: FloatArray) -> None:
    rows = ["instant,camera,marker,u,v"]
    for (i, j, m), there in np.ndenumerate(np.isfinite(pixels[..., 0])):
        if there:
            rows.append(f"{0.1 * i:.1f},{j},{m},{pixels[i, j, m, 0]:.6f},{pixels[i, j, m, 1]:.6f}")
    path.write_text("\n".join(rows) + "\n")


def test_cameras_about_a_room_are_found_from_a_wand(tmp_path: Path) -> None:
    wand_table(tmp_path / "wand.csv", waved(0))
    names = [tmp_path / f"{j}.json" for j in range(3)]
    for name, camera in zip(names, CAMERAS, strict=True):
        as_camera(name, camera)
    along = ",".join(map(str, ALONG))
    found = told("camera", "wand", tmp_path / "wand.csv", "--cameras", ",".join(map(str, names)), "--along", along)
    for one, place in zip(found["cameras"], PLACES, strict=True):  # type: ignore[call-overload]
        np.testing.assert_allclose(-np.array(one["R"]).T @ one["T"], place, atol=0.02)
    assert found["sigma"] == pytest.approx(0.3, rel=0.1)


def test_what_is_lacking_is_said(tmp_path: Path) -> None:
    wand_table(tmp_path / "wand.csv", waved(0, instants=12))
    with pytest.raises(InputError, match="camera 2; expected 0 to 1"):
        read_wand(tmp_path / "wand.csv", 2, 3)
    (tmp_path / "twice.csv").write_text("instant,camera,marker,u,v\n0,0,0,1,1\n0,0,0,2,2\n")
    with pytest.raises(InputError, match="twice"):
        read_wand(tmp_path / "twice.csv", 2, 3)
    seen(tmp_path, np.linspace(0.0, 5.0, 4))
    (tmp_path / "body.csv").write_text("image,qw,qx,qy,qz\nother.png,1,0,0,0\n")
    corners, body = str(tmp_path / "corners.csv"), str(tmp_path / "body.csv")
    for arguments, says in (
        (["hand-eye"], "--body"),
        (["hand-eye", corners, "--body", body, "--lens", "k1"], "no picture of the table"),
        (["wand", corners], "--cameras"),
        ([corners, corners], "two inputs"),
        (["wand", corners, "--html", str(tmp_path / "page.html")], "no page"),
    ):
        result = CliRunner().invoke(app, ["camera", *arguments])
        assert result.exit_code != 0
        assert says in result.output + str(result.exception), (arguments, result.output)
