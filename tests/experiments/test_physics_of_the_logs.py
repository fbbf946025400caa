"""Every measured log that moves, against physics that no reader knows: gravity, turns, the Earth's field, motion.

A wrong unit, axis, sign, clock or frame of a map shows here. What a log cannot show is left out, with the reason.
"""

from __future__ import annotations

from datetime import date
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from sinan.experiments.datasets import dataset_names, load_dataset, resolve
from sinan.experiments.measured.logs import COMPASSES, FLIGHTS
from sinan.experiments.reference import without_jumps
from sinan.sensors.formats.map_file import read_map
from sinan.sensors.geomagnetism import earth_field, inclination
from sinan.sensors.recording import ACCEL, FIX_QUALITY, GYRO, MAG, POSITION, QUATERNION, VELOCITY, Recording, Stream
from sinan.sensors.rotation import (
    matrix_from_quaternion,
    quaternion_conjugate,
    quaternion_interpolate,
    quaternion_log,
    quaternion_multiply,
    rotate,
)

GRAVITY = 9.81
DEGREE = np.radians(1.0)
#: Windows over which rates and accelerations are averaged before they are compared [s].
TURN, PUSH = 0.2, 2.0
#: No rate is taken across a longer gap of the reference [s].
GAP = 0.15
#: A second reading of a recording that has a name already.
SAME = {"boulder_walk_imu_2025/imu_1730.csv": "boulder_walk_imu_2025/gnss_1730.ubx"}


def test_every_log_with_an_imu_is_among_them() -> None:
    """By the maps of the registry: a new data set cannot be forgotten here, in the gallery or the benchmarks."""
    moving = set()
    for name in dataset_names():
        dataset = load_dataset(name)
        for log in dataset.logs():
            kept = dataset.map_of(log)
            rules = read_map(kept) if kept is not None else None
            if rules is None or (rules.kind == "flight" and any(stream.name == "imu" for stream in rules.streams)):
                moving.add(name if log == "." else f"{name}/{log}")
    assert moving - set(SAME) == {entry.input for entry in FLIGHTS.values()}


@pytest.fixture
def measured(measured_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SINAN_DATA", str(measured_data))


@cache
def read(name: str) -> Recording:
    return resolve({**COMPASSES, **FLIGHTS}[name].input)


@cache
def reference(name: str) -> Stream:
    truth = read(name).truth
    assert truth is not None
    return without_jumps(truth.stream) if truth.stream.has(QUATERNION) else truth.stream


def named(*beginnings: str) -> list[str]:
    """The names that begin so; each beginning is that of one at least."""
    names = [*FLIGHTS, *COMPASSES]
    assert all(any(name.startswith(begin) for name in names) for begin in beginnings)
    return [name for name in names if name.startswith(beginnings)]


def mean_between(t: np.ndarray, x: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(m, k) means of x (n, k) over intervals, from its integral by trapezoids."""
    area = np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(0.5 * np.diff(t)[:, None] * (x[1:] + x[:-1]), axis=0)])
    at = [np.stack([np.interp(s, t, column) for column in area.T], axis=-1) for s in (start, end)]
    return np.asarray((at[1] - at[0]) / (end - start)[:, None])


def slopes(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(k,) slope of y over x and their correlation, column by column."""
    x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    xy, xx, yy = (np.sum(a * b, axis=0) for a, b in ((x, y), (x, x), (y, y)))
    return np.asarray(xy / xx), np.asarray(xy / np.sqrt(xx * yy))


# --- gravity ---------------------------------------------------------------------------------------------


def stillest(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Mean specific force and mean rate of the second in which the gyroscope varies least."""
    imu = recording.streams["imu"]
    f, w = imu.array(ACCEL), imu.array(GYRO)
    n = max(int(1.0 / np.median(np.diff(imu.t))), 5)
    starts = range(0, len(imu) - n, n // 2)
    best = min(starts, key=lambda k: float(np.sum(np.std(w[k : k + n], axis=0))))
    return f[best : best + n].mean(axis=0), w[best : best + n].mean(axis=0)


@pytest.mark.measured
@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize("name", [name for name in FLIGHTS if name != "course, quadrotor"])  # never at rest
def test_where_it_rests_it_feels_gravity_and_no_turn(name: str) -> None:
    """(0, 0, -g) within 15 deg for what stands on feet, wheels or a table; a cheap gyroscope's bias is 2 deg/s."""
    f, w = stillest(read(name))
    assert np.linalg.norm(f) == pytest.approx(GRAVITY, rel=0.07)
    assert -f[2] > np.cos(15.0 * DEGREE) * np.linalg.norm(f)
    assert np.linalg.norm(w) < 2.5 * DEGREE


# --- turns -----------------------------------------------------------------------------------------------

#: How far each axis of the gyroscope may be off the reference's rate, and what another axis may show of it.
TURNS = {
    **dict.fromkeys(named("BROAD"), (0.08, 0.07)),
    **dict.fromkeys(named("aeroplane", "quad, 14 m/s", "quad, laser"), (0.05, 0.03)),
    "quad, slow": (0.13, 0.03),  # hovers: hardly more rate than the estimate's lag
    "robot, MPU-9150": (0.05, 0.08),
    "robot, LSM9DS0": (0.17, 0.08),  # reads 14 % too little
    "robot fast, LSM9DS0": (0.40, 0.15),
    "PX4, IMU at 10 Hz": (0.20, 0.15),  # vibration, aliased
    "PX4, IMU at 200 Hz": (0.08, 0.05),  # the heading of its estimate is reset
    "PX4 indoors": (0.15, 0.08),  # vibration, aliased
}


def turns(name: str) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) mean rates of the reference and of the gyroscope over `TURN`, where the reference has no gap."""
    imu, known = read(name).streams["imu"], reference(name)
    middle = np.arange(max(imu.t[0], known.t[0]) + 0.5, min(imu.t[-1], known.t[-1]) - 0.5, 0.05)
    start, end = middle - 0.5 * TURN, middle + 0.5 * TURN
    holes = known.t[:-1][np.diff(known.t) > GAP], known.t[1:][np.diff(known.t) > GAP]
    whole = np.all(
        [(end < left) | (start > right) for left, right in zip(*holes, strict=True)] or [start < end], axis=0
    )
    start, end = start[whole], end[whole]
    before, after = (quaternion_interpolate(t, known.t, known.array(QUATERNION)) for t in (start, end))
    turned = quaternion_log(quaternion_multiply(quaternion_conjugate(before), after)) / TURN
    return turned, mean_between(imu.t, imu.array(GYRO), start, end)


@pytest.mark.measured
@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize("name", TURNS)
def test_gyroscope_turns_axis_by_axis_as_the_reference_does(name: str) -> None:
    """w_gyro = M w_reference + bias: M is one, to within the instrument's scale and the reference's own errors."""
    turned, felt = turns(name)
    M = np.linalg.lstsq(np.hstack([turned, np.ones((len(turned), 1))]), felt, rcond=None)[0][:3].T
    along, across = TURNS[name]
    np.testing.assert_allclose(np.diag(M), 1.0, atol=along)
    np.testing.assert_allclose(M - np.diag(np.diag(M)), 0.0, atol=across)


@pytest.mark.measured
@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize("name", ["course, quadrotor", "course, turned by hand"])
def test_gyroscope_turns_the_vertical_of_a_reference_without_heading(name: str) -> None:
    """d(down)/dt = -w x down, over half a second."""
    imu, known = read(name).streams["imu"], reference(name)
    roll, pitch = known["roll"], known["pitch"]
    down = np.stack([-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)], axis=-1)
    start = np.arange(max(imu.t[0], known.t[0]), min(imu.t[-1], known.t[-1]) - 0.5, 0.1)
    w = np.stack([np.interp(known.t, imu.t, imu[axis]) for axis in GYRO], axis=-1)
    expected = mean_between(known.t, -np.cross(w, down), start, start + 0.5) * 0.5
    ends = [np.stack([np.interp(t, known.t, column) for column in down.T], axis=-1) for t in (start, start + 0.5)]
    slope, correlation = slopes(expected[:, :2], (ends[1] - ends[0])[:, :2])
    np.testing.assert_allclose(slope, 1.0, atol=0.1)
    assert np.all(correlation > 0.95)


@pytest.mark.measured
@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize(("stream", "triad", "explained"), [("mag", MAG, 0.95), ("imu", ACCEL, 0.8)])
def test_what_a_hand_turns_is_seen_to_turn(stream: str, triad: tuple[str, ...], explained: float) -> None:
    """A log without a reference: du = -s int w x u dt + int w dt x b, s = 1, b an offset, while the hand turns it."""
    recording = read("x-io, hand and turntable")
    imu, seen = recording.streams["imu"], recording.streams[stream]
    seen = seen.rows(seen.t < 58.0)
    w = np.stack([np.interp(seen.t, imu.t, imu[axis]) for axis in GYRO], axis=-1)
    start = np.arange(0.0, 57.0, 0.3)
    turn, swept = (mean_between(seen.t, x, start, start + 0.3) * 0.3 for x in (w, np.cross(w, seen.array(triad))))
    ends = [np.stack([np.interp(t, seen.t, seen[c]) for c in triad], axis=-1) for t in (start, start + 0.3)]
    A = np.concatenate([-swept[:, :, None], np.moveaxis(np.cross(turn[:, None, :], np.eye(3)), 1, 2)], axis=2)
    x, left, _, _ = np.linalg.lstsq(A.reshape(-1, 4), (ends[1] - ends[0]).ravel(), rcond=None)
    assert x[0] == pytest.approx(1.0, abs=0.1)
    assert 1.0 - left[0] / np.sum((ends[1] - ends[0]) ** 2) > explained


# --- the Earth's field -----------------------------------------------------------------------------------

_BERLIN, _LEIRIA, _MELBOURNE = (52.5, 13.3, 50.0), (39.7, -8.8, 50.0), (-37.86, 144.76, 20.0)
_HAIFA, _ZURICH, _MINNESOTA, _INCHEON = (
    (32.8, 35.0, 10.0),
    (47.4, 8.5, 480.0),
    (45.3, -93.2, 280.0),
    (37.2, 126.7, 20.0),
)
#: Place, date, how far the dip may be off [deg], and how far the norm (None: another unit than gauss).
FIELDS = {
    **{name: (_BERLIN, date(2020, 1, 1), 4.0, 0.15) for name in named("BROAD")},  # a room
    **{name: (_LEIRIA, date(2015, 1, 1), 8.0, None) for name in named("robot")},  # a hall, steel
    "quad, 14 m/s": (_MELBOURNE, date(2014, 6, 1), 2.0, 0.1),
    "quad, laser": (_MELBOURNE, date(2014, 6, 1), 2.0, 0.1),
    "quad, slow": (_MELBOURNE, date(2014, 6, 1), 4.0, 0.1),  # hardly turns
    "strapped to a Phantom": (_HAIFA, date(2022, 7, 7), 3.0, None),
    "PX4, IMU at 10 Hz": (_ZURICH, date(2019, 6, 1), 3.0, 0.1),
    "PX4, IMU at 200 Hz": ((41.9, -87.7, 150.0), date(2026, 3, 20), 2.0, 0.06),
    "aeroplane": (_MINNESOTA, date(2012, 10, 10), 2.0, 0.05),
    "PX4 with 64 A": (_INCHEON, date(2019, 11, 26), 3.0, 0.2),  # its x and y read 20 % more than its z
}


def along(name: str, current: bool = False) -> np.ndarray:
    """Field in NED, iron in the body and, where asked, field per ampere in the body, along the reference attitude."""
    mag, known = read(name).streams["mag"], reference(name)
    mag = mag.rows((mag.t > known.t[0]) & (mag.t < known.t[-1]))
    q = quaternion_interpolate(mag.t, known.t, known.array(QUATERNION))
    C_bn = matrix_from_quaternion(quaternion_conjugate(q))
    parts = [C_bn, np.broadcast_to(np.eye(3), C_bn.shape)]
    if current:
        power = read(name).streams["power"]
        parts.append(np.interp(mag.t, power.t, power["current"])[:, None, None] * np.eye(3))
    return np.linalg.lstsq(np.concatenate(parts, axis=2).reshape(len(mag) * 3, -1), mag.array(MAG).ravel(), rcond=None)[
        0
    ]


@pytest.mark.measured
@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize("name", FIELDS)
def test_magnetometer_sees_the_field_of_the_place(name: str) -> None:
    """m = C_bn m_n + iron along the reference attitude: m_n has the dip and the norm of the model of place and date.

    The quadrotor that flew indoors shows its current and the building: no field of the Earth.
    """
    place, day, dip_off, norm_off = FIELDS[name]
    m_n = along(name)[:3]
    expected = 1e4 * earth_field(*place, day)
    assert np.degrees(inclination(m_n)) == pytest.approx(np.degrees(inclination(expected)), abs=dip_off)
    if norm_off is not None:
        assert np.linalg.norm(m_n) == pytest.approx(np.linalg.norm(expected), rel=norm_off)


@pytest.mark.measured
@pytest.mark.usefixtures("measured")
def test_one_compass_follows_its_current_and_one_beside_64_amperes_does_not() -> None:
    """A tenth of the Earth's field an ampere, where the other has a thousandth."""
    follows, does_not = (np.linalg.norm(along(name, current=True)[6:]) for name in ("PX4 indoors", "PX4 with 64 A"))
    assert 0.03 < follows < 0.06
    assert does_not < 6e-4


# --- motion ----------------------------------------------------------------------------------------------

#: Axes of the velocity that are looked at: north and east; down where the receiver's height is its own and it climbs.
LEVEL, ALL_AXES = 2, 3
MOVES = {
    "walk, RTK": LEVEL, "quad, 14 m/s": LEVEL, "quad, laser": LEVEL, "F450": LEVEL, "PX4, IMU at 10 Hz": ALL_AXES,
    "PX4, IMU at 200 Hz": ALL_AXES,
    "strapped to a Phantom, RTK": ALL_AXES, "aeroplane": ALL_AXES, "PX4 with 64 A": ALL_AXES,
}  # fmt: skip


@pytest.mark.measured
@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize("name", MOVES)
def test_velocity_of_the_receiver_is_the_change_of_its_position(name: str) -> None:
    """Over 3 s. The slow quadrotor drifts less than its longitude is rounded."""
    gps, axes = read(name).streams["gps"], slice(0, MOVES[name])
    start = np.arange(gps.t[0], gps.t[-1] - 3.0, 1.0)
    speed = mean_between(gps.t, gps.array(VELOCITY), start, start + 3.0)[:, axes]
    ends = [np.stack([np.interp(t, gps.t, gps[c]) for c in POSITION], axis=-1)[:, axes] for t in (start, start + 3.0)]
    slope, correlation = slopes(speed, (ends[1] - ends[0]) / 3.0)
    np.testing.assert_allclose(slope, 1.0, atol=0.1)
    assert np.all(correlation > 0.93)


@pytest.mark.measured
@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize("name", ["quad, 14 m/s", "quad, laser", "strapped to a Phantom, RTK", "aeroplane"])
def test_force_in_the_world_less_gravity_changes_the_velocity(name: str) -> None:
    """dv/dt = C_nb f + g in north and east, over 2 s; the receiver may be late by up to 0.5 s."""
    recording, known = read(name), reference(name)
    imu, gps = recording.streams["imu"], recording.streams["gps"]
    inside = imu.rows((imu.t > known.t[0]) & (imu.t < known.t[-1]))
    f_n = rotate(quaternion_interpolate(inside.t, known.t, known.array(QUATERNION)), inside.array(ACCEL))
    start = np.arange(max(inside.t[0], gps.t[0]) + 1.0, min(inside.t[-1], gps.t[-1]) - PUSH - 1.0, 0.5)
    pushed = mean_between(inside.t, f_n, start, start + PUSH)[:, :2]
    found = []
    for late in np.arange(0.0, 0.51, 0.1):
        ends = [
            np.stack([np.interp(t + late, gps.t, gps[c]) for c in VELOCITY[:2]], axis=-1) for t in (start, start + PUSH)
        ]
        found.append(slopes(pushed, (ends[1] - ends[0]) / PUSH))
    slope, correlation = max(found, key=lambda one: float(np.sum(one[1])))
    np.testing.assert_allclose(slope, 1.0, atol=0.15)
    assert np.all(correlation > 0.95)


@pytest.mark.measured
@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize(("name", "off"), [("PX4, IMU at 10 Hz", 0.1), ("aeroplane", 0.1), ("PX4 with 64 A", 0.25)])
def test_barometer_climbs_with_the_receiver(name: str, off: float) -> None:
    """Those whose GPS has a height of its own, and that climb by 10 m and more; that of the last wanders by 3 m."""
    baro, gps = (read(name).streams[stream] for stream in ("baro", "gps"))
    t = np.arange(max(baro.t[0], gps.t[0]), min(baro.t[-1], gps.t[-1]), 1.0)
    up = [np.interp(t, baro.t, baro["height"])[:, None], -np.interp(t, gps.t, gps["down"])[:, None]]
    slope, correlation = slopes(up[1], up[0])
    assert slope[0] == pytest.approx(1.0, abs=off)
    assert correlation[0] > 0.85


@pytest.mark.measured
@pytest.mark.usefixtures("measured")
def test_laser_climbs_with_the_odometry_indoors() -> None:
    """Above the floor, in the air: a metre of the camera's is a metre of the laser's."""
    streams = read("PX4 indoors, odometry").streams
    laser, gps = streams["laser"].rows(streams["laser"].t > 215.0), streams["gps"]
    slope, correlation = slopes(-np.interp(laser.t, gps.t, gps["down"])[:, None], laser["range"][:, None])
    assert slope[0] == pytest.approx(1.0, abs=0.05)
    assert correlation[0] > 0.98


#: What each receiver says of its fix.
SAID = {
    "walk, RTK": ("eph", "epv", "s_variance", "pdop", "satellites"),
    "PX4, IMU at 10 Hz": ("eph", "epv", "s_variance", "hdop", "vdop", "satellites"),
    "PX4, IMU at 200 Hz": ("eph", "epv", "s_variance", "hdop", "vdop", "satellites"),
    "PX4 with 64 A": ("eph", "epv", "s_variance", "hdop", "vdop", "satellites"),
    "strapped to a Phantom, RTK": ("satellites",),
    "aeroplane": ("satellites",),
}
#: What consumer receivers and RTK say under an open sky: m, m/s, 1, 1.
SIZES = {"eph": (0.005, 5.0), "epv": (0.005, 10.0), "s_variance": (0.005, 2.0), "satellites": (4.0, 40.0)}


@pytest.mark.measured
@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize("name", SAID)
def test_what_a_receiver_says_of_its_fix_is_kept(name: str) -> None:
    gps = read(name).streams["gps"]
    assert tuple(column for column in FIX_QUALITY if column in gps) == SAID[name]
    for column in SAID[name]:
        low, high = SIZES.get(column, (0.4, 5.0))  # dilutions of precision
        assert low <= np.median(gps[column]) <= high
