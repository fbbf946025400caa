"""Where cameras are mounted, from tables on disk: one on the body (hand-eye), several about a room (wand)."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sinan.calibration.cameras.camera import Form, form
from sinan.calibration.cameras.hand_eye import Mounting, from_poses, from_rates
from sinan.calibration.cameras.wand import WandFit, calibrate_wand
from sinan.experiments.camera.study import Study
from sinan.sensors.arrays import FloatArray, finite_or_none
from sinan.sensors.camera import Intrinsics
from sinan.sensors.errors import InputError
from sinan.sensors.recording import POSITION, QUATERNION
from sinan.sensors.rotation import quaternion_from_matrix

WAND = ("instant", "camera", "marker", "u", "v")


def mounting_from_poses(done: Study, body: Path) -> Mounting:
    """The camera's mounting from its calibration and the body's pose at each picture.

    Parameters
    ----------
    body : table `image,qw,qx,qy,qz` and perhaps `north,east,down` [m], attitude body -> NED; in any order

    Raises
    ------
    InputError : a table that cannot be read, or fewer than three pictures with a pose
    """
    rows = _table(body, ("image", *QUATERNION), POSITION)
    kept = [k for k, view in enumerate(done.found.views) if view.name in rows]
    values = _of(done, rows, kept)
    q_nb = values[:, :4]
    if len(q_nb) and not np.allclose(np.linalg.norm(q_nb, axis=1), 1.0, atol=0.01):
        raise InputError(str(body), "a quaternion whose norm is not one", "qw, qx, qy, qz, scalar first")
    q_nb = q_nb / np.linalg.norm(q_nb, axis=1, keepdims=True)
    p_n = values[:, 4:] if values.shape[1] == 7 else None
    return from_poses(q_nb, [done.found.poses[k] for k in kept], p_n)


def mounting_from_rates(done: Study, stamps: Path, t: FloatArray, w_b: FloatArray) -> Mounting:
    """The camera's rotation and lateness from its calibration, the pictures' stamps and a gyroscope.

    Parameters
    ----------
    stamps : table `image,t` [s], on any clock that runs with the gyroscope's
    t, w_b : (n,) s, (n, 3) rad/s

    Raises
    ------
    InputError : a table that cannot be read, or too few pictures within the gyroscope's log
    """
    rows = _table(stamps, ("image", "t"), ())
    kept = [k for k, view in enumerate(done.found.views) if view.name in rows]
    t_seen = _of(done, rows, kept).reshape(-1)
    order = np.argsort(t_seen)
    return from_rates(t, w_b, t_seen[order], [done.found.poses[kept[k]] for k in order])


def _of(done: Study, rows: Mapping[str, list[float]], kept: Sequence[int]) -> FloatArray:
    """(n, columns) rows of the pictures that are kept."""
    if not kept:
        names = ", ".join(view.name for view in done.found.views[:3])
        raise InputError("hand-eye", "no picture of the table is among those that fit", f"names such as {names}")
    return np.array([rows[done.found.views[k].name] for k in kept])


def _table(path: Path, needed: Sequence[str], further: Sequence[str]) -> dict[str, list[float]]:
    """Rows by the word of their first column; columns `further` all or none."""
    head, rows = _rows(path)
    lacking = [name for name in needed if name not in head]
    if lacking:
        raise InputError(str(path), f"columns {', '.join(head[:8]) or 'none'}", f"also {', '.join(lacking)}")
    names = [*needed[1:], *(further if set(further) <= set(head) else ())]
    found = {}
    for number, row in enumerate(rows, start=1):
        try:
            values = [float(row[head.index(name)]) for name in names]
        except (ValueError, IndexError):
            raise InputError(str(path), ",".join(row)[:60], "a word and numbers", f"row {number}") from None
        if not np.all(np.isfinite(values)):
            raise InputError(str(path), ",".join(row)[:60], "finite numbers", f"row {number}")
        found[row[head.index(needed[0])].strip()] = values
    return found


def _rows(path: Path) -> tuple[list[str], list[list[str]]]:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(str(path), type(error).__name__, "a table as text") from None
    rows = list(csv.reader(line for line in lines if line.strip() and not line.startswith("#")))
    return [cell.strip() for cell in rows[0]] if rows else [], rows[1:]


def read_wand(path: Path, cameras: int, markers: int) -> FloatArray:
    """(instants, cameras, markers, 2) pixels of a table `instant,camera,marker,u,v`; what has no row is NaN.

    Cameras and markers are counted from 0; instants may be any numbers, in any order.

    Raises
    ------
    InputError : a table that cannot be read, a camera or a marker that is not there, one that is read twice
    """
    head, rows = _rows(path)
    lacking = [name for name in WAND if name not in head]
    if lacking:
        raise InputError(str(path), f"columns {', '.join(head[:8]) or 'none'}", f"also {', '.join(lacking)}")
    try:
        values = np.array([[float(row[head.index(name)]) for name in WAND] for row in rows])
    except (ValueError, IndexError):
        raise InputError(str(path), "a row that is no numbers", ", ".join(WAND)) from None
    if not len(values) or not np.all(np.isfinite(values)):
        raise InputError(str(path), "no rows, or a number that is not finite", ", ".join(WAND))
    instants, t = np.unique(values[:, 0], return_inverse=True)
    j, m = values[:, 1].astype(np.int64), values[:, 2].astype(np.int64)
    for what, numbers, count in (("camera", j, cameras), ("marker", m, markers)):
        if numbers.min() < 0 or numbers.max() >= count:
            raise InputError(str(path), f"{what} {numbers.max()}", f"0 to {count - 1}")
    if len(np.unique(np.column_stack([t, j, m]), axis=0)) < len(values):
        raise InputError(str(path), "a marker twice in one picture", "one row each")
    seen = np.full((len(instants), cameras, markers, 2), np.nan)
    seen[t, j, m] = values[:, 3:]
    return seen


def read_camera(path: Path) -> Intrinsics:
    """Intrinsics of a document that `sinan camera --json` wrote.

    Raises
    ------
    InputError : no such document
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        entry = form(str(document["form"]))
        values = entry.spread @ np.array([float(document["values"][name]) for name in entry.names])
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(str(path), "no calibrated camera", "what `sinan camera --json` writes") from None
    return Intrinsics(values[:2], values[2:4], entry.lens, values[4:])


def wand(table: Path, cameras: Sequence[Path], along: Sequence[float], lens: Form | None) -> WandFit:
    """Several cameras from a wand; with `lens` their intrinsics too."""
    seen = read_wand(table, len(cameras), len(along))
    return calibrate_wand([read_camera(path) for path in cameras], seen, np.array(along), lens)


def mounting_document(found: Mounting) -> dict[str, object]:
    """The document of `sinan camera hand-eye`."""
    return {
        "format": 1,
        "mounting": quaternion_from_matrix(found.C_bc).tolist(),
        "lever_arm": found.l_b.tolist() if np.all(np.isfinite(found.l_b)) else None,
        "delay": finite_or_none(found.delay),
        "parameters": list(found.names),
        "std": [finite_or_none(value) for value in found.std],
        "noise": dict(found.sigma),
        "undetermined": list(found.undetermined),
    }


def mounting_words(found: Mounting) -> list[str]:
    """The lines for the terminal: what goes into `[sensors.camera]`, and how sure it is."""
    std = dict(zip(found.names, found.std, strict=True))
    turn = np.rad2deg([std[f"rotation {axis}"] for axis in "xyz"])
    lines = [
        "mounting = [" + ", ".join(f"{x:.6f}" for x in quaternion_from_matrix(found.C_bc)) + "]  # camera -> body",
        "  1 sigma about the camera's axes: " + ", ".join(f"{x:.3f}" for x in turn) + " deg",
    ]
    if np.all(np.isfinite(found.l_b)):
        arm = [std[f"lever arm {axis}"] for axis in "xyz"]
        lines.append("lever_arm = [" + ", ".join(f"{x:.4f}" for x in found.l_b) + "]  # m, in the body")
        lines.append("  1 sigma: " + ", ".join(f"{x:.4f}" for x in arm) + " m")
    if np.isfinite(found.delay):
        lines.append(f"stamps are late by {found.delay:.4f} ± {std['delay']:.4f} s")
    return lines + [f"not determined: {sentence}" for sentence in found.undetermined]


def wand_document(found: WandFit) -> dict[str, object]:
    """The document of `sinan camera wand`."""
    return {
        "format": 1,
        "cameras": [
            {"R": R.tolist(), "T": T.tolist(), "rms": float(rms), "lens": one.lens,
             "values": dict(zip(one.names, one.values.tolist(), strict=True))}
            for one, R, T, rms in zip(found.cameras, found.R, found.T, found.rms, strict=True)
        ],
        "parameters": list(found.names),
        "std": [finite_or_none(value) for value in found.std],
        "sigma": found.sigma,
        "instants": len(found.A),
        "undetermined": list(found.undetermined),
    }  # fmt: skip


def wand_words(found: WandFit) -> list[str]:
    """The lines for the terminal: where each camera stands in the first one's axes."""
    lines = [f"{len(found.cameras)} cameras, {len(found.A)} instants; a marker's noise is {found.sigma:.3f} pixels"]
    for j, (R, T, rms) in enumerate(zip(found.R, found.T, found.rms, strict=True)):
        place = ", ".join(f"{x:.4f}" for x in -R.T @ T)
        std = found.std[6 * j - 3 : 6 * j] if j else np.zeros(3)
        sure = f" ± {np.max(std):.4f}" if j else ""
        lines.append(f"  camera {j}: at ({place}){sure} m, {rms:.3f} pixels RMS")
    return lines + [f"not determined: {sentence}" for sentence in found.undetermined]
