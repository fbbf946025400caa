"""Disturbances that are in nobody's catalogue: what a sensor does when its model's list of effects is not enough.

Each says which time-localised names would be true of it: a stuck echo is a transient of the sonar, if it is found while
it is stuck.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sinan.experiments.blind.maker.body import Body
from sinan.experiments.blind.maker.catalogue import ACCEL, CAMERA, FLIGHT, HAND, MAG, TURNS, log_uniform
from sinan.experiments.blind.maker.forward import Seen
from sinan.experiments.blind.maker.instruments import Instrument
from sinan.experiments.blind.maker.scene import Scene
from sinan.experiments.blind.maker.turning import random_direction
from sinan.sensors.arrays import FloatArray

Add = Callable[[str, Seen], FloatArray]
Distort = Callable[[str, FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class Outside:
    """One disturbance as drawn.

    Attributes
    ----------
    name : ours
    streams : that it enters
    acceptable : names that are true of it
    intervals : (from, to) [s] in which it acts; empty: always or often
    add : (stream, what is seen) -> what it adds before bias and noise
    distort : (stream, t, reading with noise) -> what is reported instead
    clock : the stream's clock runs faster by this share
    """

    name: str
    streams: tuple[str, ...]
    acceptable: tuple[str, ...] = ()
    intervals: tuple[tuple[float, float], ...] = ()
    add: Add | None = None
    distort: Distort | None = None
    clock: float = 0.0


@dataclass(frozen=True)
class Setting:
    """What a disturbance is drawn for: the scene, its instruments, and the motion on a coarse grid."""

    scene: Scene
    instruments: Mapping[str, Instrument]
    coarse: Body


def local_names(stream: str) -> tuple[str, ...]:
    """The time-localised effects of a stream."""
    return tuple(f"{stream}.{what}" for what in ("step", "transient", "outliers"))


def magnetic_anomaly(rng: np.random.Generator, setting: Setting) -> Outside:
    """A buried dipole m: B = (3 (m . r^) r^ - m) / |r|^3, so strong that its peak is many times the noise."""
    at = setting.coarse.p[rng.integers(len(setting.coarse.p))]
    height = setting.scene.ground_down - at[2]
    source = at + np.array([*rng.normal(0.0, 1.0, 2), height + rng.uniform(0.5, 2.0)])
    nearest = float(np.min(np.linalg.norm(setting.coarse.p - source, axis=1)))
    moment = log_uniform(rng, 8.0, 60.0) * setting.instruments["mag"].noise * nearest**3 * random_direction(rng)

    def add(stream: str, seen: Seen) -> FloatArray:
        r = seen.body.p - source
        distance = np.linalg.norm(r, axis=1, keepdims=True)
        u = r / distance
        return seen.body.to_body((3.0 * (u @ moment)[:, None] * u - moment) / distance**3)

    return Outside("magnetic_anomaly", ("mag",), local_names("mag"), add=add)


def gps_multipath(rng: np.random.Generator, setting: Setting) -> Outside:
    """Within a place the position swings as the path difference to a reflector does."""
    centre = setting.coarse.p[rng.integers(len(setting.coarse.p)), :2]
    spread = float(np.median(np.linalg.norm(setting.coarse.p[:, :2] - centre, axis=1)))
    radius = max(0.6 * spread, 0.5)
    size = log_uniform(rng, 4.0, 25.0) * setting.instruments["gps"].noise * random_direction(rng)
    wave = 2.0 * np.pi / (radius * rng.uniform(0.7, 3.0)) * random_direction(rng, 2)
    phase = rng.uniform(0.0, 6.28)

    def add(stream: str, seen: Seen) -> FloatArray:
        aside = seen.body.p[:, :2] - centre
        inside = 1.0 / (1.0 + (np.linalg.norm(aside, axis=1) / radius) ** 8)
        delta = np.zeros_like(seen.plain)
        delta[:, :3] = np.outer(inside * np.sin(aside @ wave + phase), size)
        return delta

    return Outside("gps_multipath", ("gps",), local_names("gps"), add=add)


def gyro_saturation(rng: np.random.Generator, setting: Setting) -> Outside:
    """Rates beyond the range are reported as its end."""
    limit = float(rng.uniform(0.25, 0.7) * np.max(np.abs(setting.coarse.w)))

    def distort(stream: str, t: FloatArray, reading: FloatArray) -> FloatArray:
        return np.clip(reading, -limit, limit)

    over = np.any(np.abs(setting.coarse.w) > limit, axis=1)
    return Outside("gyro_saturation", ("gyro",), local_names("gyro"), spans(setting.coarse.t, over), distort=distort)


def baro_hysteresis(rng: np.random.Generator, setting: Setting) -> Outside:
    """Play: the reading follows the height only after it has moved by the play's half width."""
    half = log_uniform(rng, 4.0, 20.0) * setting.instruments["baro"].noise
    half = min(half, 0.3 * float(np.ptp(setting.coarse.p[:, 2])))

    def add(stream: str, seen: Seen) -> FloatArray:
        height = seen.plain[:, 0]
        play = np.empty_like(height)
        state = height[0]
        for k, value in enumerate(height):
            state = min(max(state, value - half), value + half)
            play[k] = state
        return (play - height)[:, None]

    return Outside("baro_hysteresis", ("baro",), add=add)


def clock_drift(rng: np.random.Generator, setting: Setting) -> Outside:
    """One stream's clock runs fast or slow: its stamps are off by a tenth of a second or more in the end."""
    stream = str(rng.choice([s for s in ("mag", "baro", "laser", "gps") if s in setting.instruments]))
    late = log_uniform(rng, 0.15, 1.0) * float(rng.choice([-1.0, 1.0]))
    name = "gps.latency" if stream == "gps" else f"{stream}.time_offset"
    return Outside("clock_drift", (stream,), (name,), clock=late / (setting.scene.end - setting.scene.begin))


def stuck_echo(rng: np.random.Generator, setting: Setting) -> Outside:
    """A range finder that repeats its last answer for seconds."""
    stream = str(rng.choice([s for s in ("sonar", "laser") if s in setting.instruments]))
    intervals = draw_intervals(rng, setting.scene, int(rng.integers(2, 6)), (2.0, 8.0))
    return Outside("stuck_echo", (stream,), local_names(stream), intervals, distort=holding(intervals))


def frozen_fix(rng: np.random.Generator, setting: Setting) -> Outside:
    """A receiver that repeats its last fix."""
    intervals = draw_intervals(rng, setting.scene, int(rng.integers(1, 4)), (3.0, 9.0))
    return Outside("frozen_fix", ("gps",), local_names("gps"), intervals, distort=holding(intervals))


def raised_ground(rng: np.random.Generator, setting: Setting) -> Outside:
    """A roof or a box below part of the path: every range finder sees it."""
    streams = tuple(s for s in ("sonar", "laser") if s in setting.instruments)
    noise = max(setting.instruments[s].noise for s in streams)
    centre = setting.coarse.p[rng.integers(len(setting.coarse.p)), :2]
    radius = max(0.5 * float(np.median(np.linalg.norm(setting.coarse.p[:, :2] - centre, axis=1))), 0.3)
    clear = float(np.min(setting.scene.ground_down - setting.coarse.p[:, 2]))
    height = min(log_uniform(rng, 8.0, 60.0) * noise, 0.7 * clear)

    def add(stream: str, seen: Seen) -> FloatArray:
        above = np.linalg.norm(seen.body.p[:, :2] - centre, axis=1) < radius
        return np.where(above, -height / seen.body.C[:, 2, 2], 0.0)[:, None]

    above = np.linalg.norm(setting.coarse.p[:, :2] - centre, axis=1) < radius
    names = tuple(name for stream in streams for name in local_names(stream))
    return Outside("raised_ground", streams, names, spans(setting.coarse.t, above), add=add)


def turning_magnet(rng: np.random.Generator, setting: Setting) -> Outside:
    """A payload with a magnet that turns about the body's z axis."""
    size = log_uniform(rng, 3.0, 15.0) * setting.instruments["mag"].noise
    omega = 2.0 * np.pi * log_uniform(rng, 0.15, 1.0)

    def add(stream: str, seen: Seen) -> FloatArray:
        angle = omega * seen.body.t
        return size * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)

    return Outside("turning_magnet", ("mag",), add=add)


def static_port(rng: np.random.Generator, setting: Setting) -> Outside:
    """A static port on one side: height += c u |u| with the air's speed u along an axis of the body."""
    across = random_direction(rng, 2)
    seen_by = setting.coarse.to_body(setting.coarse.v - setting.coarse.wind)[:, :2] @ across
    typical = float(np.std(seen_by * np.abs(seen_by)))
    size = log_uniform(rng, 3.0, 12.0) * setting.instruments["baro"].noise / max(typical, 1e-3)

    def add(stream: str, seen: Seen) -> FloatArray:
        u = seen.body.to_body(seen.body.v - seen.body.wind)[:, :2] @ across
        return (size * u * np.abs(u))[:, None]

    return Outside("static_port", ("baro",), add=add)


def second_surface(rng: np.random.Generator, setting: Setting) -> Outside:
    """Water: at random the bottom answers instead of the surface."""
    deeper, share = log_uniform(rng, 0.3, 2.0), float(rng.uniform(0.05, 0.3))
    seed = int(rng.integers(2**31))

    def distort(stream: str, t: FloatArray, reading: FloatArray) -> FloatArray:
        other = np.random.default_rng(seed).uniform(size=len(t)) < share
        return reading + deeper * other[:, None]

    return Outside("second_surface", ("laser",), ("laser.outliers",), distort=distort)


def stuck_axis(rng: np.random.Generator, setting: Setting) -> Outside:
    """One axis of the gyroscope reports its last value for a while."""
    intervals = draw_intervals(rng, setting.scene, int(rng.integers(1, 4)), (1.0, 4.0))
    axis, hold = int(rng.integers(3)), holding(intervals)

    def distort(stream: str, t: FloatArray, reading: FloatArray) -> FloatArray:
        held = reading.copy()
        held[:, axis] = hold(stream, t, reading)[:, axis]
        return held

    return Outside("stuck_axis", ("gyro",), local_names("gyro"), intervals, distort=distort)


def clipped_axes(rng: np.random.Generator, setting: Setting) -> Outside:
    """Readings beyond the range are reported as its end: poses of the accelerometer or magnetometer.

    Of few clipped poses it is true that they are wrong readings.
    """
    stream = "mag" if "mag" in setting.instruments else "accel"
    share = float(rng.uniform(0.8, 0.97))
    axis = int(rng.integers(3))

    def distort(stream: str, t: FloatArray, reading: FloatArray) -> FloatArray:
        clipped = reading.copy()
        limit = share * np.max(np.abs(reading[:, axis]))
        clipped[:, axis] = np.clip(reading[:, axis], -limit, limit)
        return clipped

    return Outside("clipped_axes", (stream,), (f"{stream}.outliers",), distort=distort)


def remanence(rng: np.random.Generator, setting: Setting) -> Outside:
    """The reading keeps a share of the one before: magnetised parts, or a sticking proof mass."""
    stream = "mag" if "mag" in setting.instruments else "accel"
    size = log_uniform(rng, 5.0, 40.0) * setting.instruments[stream].noise

    def add(stream: str, seen: Seen) -> FloatArray:
        kept = np.concatenate([seen.plain[:1], seen.plain[:-1]])
        return size * np.sign(kept)

    return Outside("remanence", (stream,), add=add)


DRAWERS: Mapping[str, Sequence[Callable[[np.random.Generator, Setting], Outside]]] = {
    FLIGHT: (
        magnetic_anomaly, gps_multipath, gyro_saturation, baro_hysteresis, clock_drift, stuck_echo, frozen_fix,
        raised_ground, turning_magnet, static_port, second_surface, stuck_axis,
    ),
    HAND: (gyro_saturation, turning_magnet, stuck_axis),
    CAMERA: (magnetic_anomaly, gps_multipath, gyro_saturation, frozen_fix, turning_magnet, stuck_axis),
    ACCEL: (clipped_axes, remanence),
    MAG: (clipped_axes, remanence),
    TURNS: (gyro_saturation, stuck_axis),
}  # fmt: skip
#: The streams that a flight must have for a disturbance to show.
NEEDS: Mapping[str, str] = {
    "magnetic_anomaly": "mag", "gps_multipath": "gps", "baro_hysteresis": "baro", "clock_drift": "baro",
    "stuck_echo": "sonar", "frozen_fix": "gps", "raised_ground": "laser", "turning_magnet": "mag",
    "static_port": "baro", "second_surface": "laser",
}  # fmt: skip


def draw_intervals(
    rng: np.random.Generator, scene: Scene, count: int, length: tuple[float, float]
) -> tuple[tuple[float, float], ...]:
    """`count` intervals, one in each of as many equal parts of the time."""
    part = (scene.end - scene.begin) / count
    found = []
    for k in range(count):
        lasting = min(float(rng.uniform(*length)), 0.7 * part)
        start = scene.begin + k * part + float(rng.uniform(0.0, 1.0)) * (part - lasting)
        found.append((start, start + lasting))
    return tuple(found)


def holding(intervals: Sequence[tuple[float, float]]) -> Distort:
    """Within each interval, the reading before it."""

    def distort(stream: str, t: FloatArray, reading: FloatArray) -> FloatArray:
        held = reading.copy()
        for begin, end in intervals:
            inside = np.flatnonzero((t >= begin) & (t < end))
            if len(inside):
                held[inside] = reading[max(inside[0] - 1, 0)]
        return held

    return distort


def spans(t: FloatArray, on: object) -> tuple[tuple[float, float], ...]:
    """The intervals in which a mask over time is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(on, dtype=int), [0]])))
    last = len(t) - 1
    return tuple((float(t[a]), float(t[min(b, last)])) for a, b in edges.reshape(-1, 2))
