"""A compass with other axes than the IMU is told, and what else is wrong with a compass is not taken for it."""

from __future__ import annotations

from pathlib import Path
from time import process_time

import numpy as np
import pytest

from sinan.sensors.arrays import FloatArray
from sinan.sensors.formats import open_log
from sinan.sensors.formats.compass_axes import TURNS, axes_found, note_of_axes
from sinan.sensors.recording import ACCEL, GYRO, MAG, Recording, Stream
from sinan.sensors.rotation import rotate_back, turned_since_start

ALL, ONE = (1.0, 1.0, 1.0), (0.0, 0.0, 1.0)
BEIJING = (39.98, 116.34, 50.0)
#: North, east, down [gauss]: dips by 60 deg.
FIELD = np.array([0.28, -0.03, 0.48])


def log(
    S: FloatArray = TURNS[0], about: tuple[float, ...] = ALL, seconds: float = 60.0, rate: float = 50.0,
    soft: float = 0.02, hard: float = 0.2, scale: float = 0.01, late: float = 0.0, room: float = 0.0, seed: int = 1,
) -> Recording:  # fmt: skip
    """A body that turns to and fro about some axes, and a compass of `rate` Hz that reads S^T of the body's.

    Parameters
    ----------
    soft, hard, room : iron as shares of the field; that of the room changes every 2 s
    scale : of the gyroscope
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.01)
    phases = rng.uniform(0.2, 4.0, size=(3, 3)) * t[:, None, None] + rng.uniform(0.0, 6.0, size=(3, 3))
    w = np.array(about) * np.sum(0.6 * np.sin(phases), axis=2)
    q = turned_since_start(t, w)
    places = rng.normal(scale=max(room, 1e-9), size=(int(seconds / 2.0) + 2, 3))
    steel = np.stack([np.interp(t, 2.0 * np.arange(len(places)), column) for column in places.T], axis=-1)
    size = float(np.linalg.norm(FIELD))
    E = rng.uniform(-soft, soft, size=(3, 3))
    m = rotate_back(q, FIELD + size * steel) @ (np.eye(3) + 0.5 * (E + E.T)) + size * hard * np.array([0.6, -0.8, 0.0])
    at = np.arange(0.2, seconds, 1.0 / rate)
    m = np.stack([np.interp(at - late, t, column) for column in m.T], axis=-1)
    m = (m + rng.normal(scale=0.02 * size, size=m.shape)) @ S
    f = rotate_back(q, np.array([0.0, 0.0, -9.81])) + rng.normal(scale=0.1, size=w.shape)
    w = w * (1.0 + rng.uniform(-scale, scale, size=3)) + 0.03 + rng.normal(scale=0.01, size=w.shape)
    imu = Stream(t, dict(zip((*ACCEL, *GYRO), [*f.T, *w.T], strict=True)))
    return Recording("turned", "flight", {"imu": imu, "mag": Stream(at, dict(zip(MAG, m.T, strict=True)))})


def with_compass(recording: Recording, S: FloatArray) -> Recording:
    """The recording whose compass is mounted with other axes: those of the body are S times its own."""
    mag = recording.streams["mag"]
    turned = Stream(mag.t, dict(zip(MAG, (mag.array(MAG) @ S).T, strict=True)))
    return recording.replace(streams={**recording.streams, "mag": turned})


@pytest.mark.parametrize("k", [1, 5, 9, 12, 17, 20, 23])
def test_a_turned_compass_is_found(k: int) -> None:
    streams = log(TURNS[k]).streams
    found = axes_found(streams["imu"], streams["mag"])
    assert found is not None
    assert int(np.argmax(found.odds)) == k
    assert found.left[k] < 0.2 < 0.5 < found.left[0]


def test_the_sentence_says_what_a_map_should_say() -> None:
    (said,) = note_of_axes(log(np.diag([-1.0, -1.0, 1.0])))
    assert 'axes = ["-x", "-y", "z"] (of a mirror image ["x", "y", "-z"]) in a map would do: ' in said
    assert " % of the change of the field is left, as read " in said


def test_axes_of_a_map_are_counted_in() -> None:
    now = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    (said,) = note_of_axes(log(np.diag([-1.0, -1.0, 1.0])), now)
    assert 'axes = ["-y", "-x", "-z"] ' in said
    (said,) = note_of_axes(log(np.diag([-1.0, -1.0, 1.0])), np.diag([0.5, 1.0, 1.0]))
    assert "axes = [[-0.5, 0, 0], [0, -1, 0], [0, 0, 1]] " in said


@pytest.mark.parametrize(
    ("S", "says"), [((-1.0, -1.0, 1.0), "in a map would do"), ((1.0, 1.0, -1.0), ", a mirror image, in a map would do")]
)
def test_a_mirror_image_is_told_by_the_dip_of_the_place(S: tuple[float, ...], says: str) -> None:
    (said,) = note_of_axes(log(np.diag(S)).replace(origin=BEIJING))
    axes = ", ".join(f'"{"-" if sign < 0.0 else ""}{name}"' for sign, name in zip(S, "xyz", strict=True))
    assert f"axes = [{axes}]{says if says[0] == ',' else ' ' + says}: " in said


@pytest.mark.parametrize("about", [ALL, ONE])
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"soft": 0.2},
        {"hard": 1.0},
        {"scale": 0.05},
        {"room": 0.3},
        {"late": 0.1},
        {"rate": 10.0},
        {"seconds": 10.0},
    ],
    ids=lambda changes: "".join(changes),
)
def test_what_else_is_wrong_is_not_taken_for_it(changes: dict[str, float], about: tuple[float, ...]) -> None:
    assert note_of_axes(log(about=about, **changes)) == []  # type: ignore[arg-type]


def test_all_of_it_together_is_rarely_taken_for_it() -> None:
    count = 24
    everything = {"soft": 0.2, "hard": 1.0, "scale": 0.05, "room": 0.2, "late": 0.1, "rate": 10.0, "seconds": 20.0}
    told = sum(bool(note_of_axes(log(about=ALL, seed=seed, **everything))) for seed in range(count))  # type: ignore[arg-type]
    assert told <= 1  # at the prior's rate, 0.01, two and more of 24 come once in 40 times


def test_turns_about_one_axis_leave_the_axes_as_read() -> None:
    """A half turn about the axis of turning is told from none as little as iron is; a compass across it is told."""
    assert note_of_axes(log(about=ONE)) == []
    (said,) = note_of_axes(log(TURNS[2], about=ONE, seed=3))
    assert "others that such turns do not tell from it" in said


def test_a_gyroscope_of_another_log_is_no_turned_compass() -> None:
    for seed in range(1, 7):
        streams = {"imu": log(seed=seed).streams["imu"], "mag": log(seed=seed + 20).streams["mag"]}
        assert note_of_axes(Recording("two logs", "flight", streams)) == []


def test_what_says_nothing() -> None:
    whole = log()
    imu, mag = whole.streams["imu"], whole.streams["mag"]
    dead = Stream(mag.t, dict.fromkeys(MAG, np.ones(len(mag))))
    for other in (mag.rows(slice(1)), mag.rows(slice(20)), mag.rows(slice(None, None, 100)), dead):
        assert note_of_axes(whole.replace(streams={"imu": imu, "mag": other})) == []
    assert note_of_axes(whole.replace(streams={"imu": imu.rows(slice(1)), "mag": mag})) == []
    assert note_of_axes(whole.replace(streams={"mag": mag})) == []
    assert axes_found(imu, Stream(mag.t, {**mag.columns, "mag_x": np.full(len(mag), np.nan)})) is None


def test_an_hour_takes_less_than_a_second() -> None:
    part = log()
    t = np.arange(0.0, 3600.0, 0.005)
    k = np.arange(len(t)) % len(part.streams["imu"])
    imu, mag = (Stream(t, {name: c[k % len(c)] for name, c in part.streams[s].columns.items()}) for s in ("imu", "mag"))
    start = process_time()
    axes_found(imu, mag)
    assert process_time() - start < 1.5  # 0.3 s where nothing else runs


@pytest.mark.measured
@pytest.mark.parametrize(
    "name", ["broad_orientation/01_undisturbed_slow_rotation_A.mat", "inertialnav_quads/quad106.zip"]
)
def test_a_measured_compass_is_right_as_read_and_found_when_turned(name: str, measured_data: Path) -> None:
    from sinan.experiments.datasets import resolve

    recording = resolve(name)
    assert not [note for note in recording.notes if "axes of the gyroscope" in note]
    for S in (TURNS[2], TURNS[11], np.diag([1.0, -1.0, 1.0])):
        (said,) = note_of_axes(with_compass(recording, S))
        found = axes_found(with_compass(recording, S).streams["imu"], with_compass(recording, S).streams["mag"])
        assert found is not None
        assert "do not tell" not in said
        assert np.allclose(TURNS[int(np.argmax(found.odds))], S * np.linalg.det(S))


def test_open_log_says_it(tmp_path: Path) -> None:
    recording = log(np.diag([-1.0, -1.0, 1.0]))
    imu, mag = recording.streams["imu"].rows(slice(None, None, 2)), recording.streams["mag"]
    columns = {**imu.columns, **{name: np.interp(imu.t, mag.t, mag[name]) for name in MAG}}
    rows = np.column_stack([imu.t, *columns.values()])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=",".join(("t", *columns)), comments="", fmt="%.6g")
    rules = 'kind = "flight"\n[file]\nheader = true\n[streams.imu]\ntime = "t"\n'
    rules += f"accel = {list(ACCEL)}\ngyro = {list(GYRO)}\n[streams.mag]\ntime = 't'\nmag = {list(MAG)}\n"
    (tmp_path / "log.toml").write_text(rules)
    for told in (open_log(tmp_path / "log.csv", tmp_path / "log.toml"), open_log(tmp_path / "log.csv")):
        assert [note for note in told.notes if 'axes = ["-x", "-y", "z"]' in note]
