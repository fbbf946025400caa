"""Heights of sonar, laser, barometer and GPS, with the tilt taken out, against each other and against the filter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from sinan.calibration.levels.preparation import prepared
from sinan.estimator.filter.smoother import estimated_motion
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray, runs_of
from sinan.sensors.errors import InputError
from sinan.sensors.laser import scan_height
from sinan.sensors.motion import Motion
from sinan.sensors.ranging import tilt_compensated_height
from sinan.sensors.recording import Recording, Stream, tells_height
from sinan.sensors.rotation import cos_tilt, rpy_from_quaternion

HEIGHT_SENSORS = ("sonar", "laser", "baro", "gps")
#: A step of the sonar's clock longer than this many usual ones has lost echoes in it.
LOST = 1.6
#: An echo is wrong when it leaves the filter's range by so many robust sigmas, and by this much at least [m].
WRONG, LEAST_WRONG = 6.0, 0.15
#: The longest reading is what a sonar says where it hears nothing, when it comes so often in a row.
STUCK = 4
#: Up to what range and tilt echoes came back is read off those that did, but for this share of them.
RARE = 0.002


@dataclass(frozen=True)
class HeightCourse:
    """One sensor's height over time.

    Attributes
    ----------
    t, height : (n,) s, height above the flat ground or above the zero of the sensor [m]
    filtered : (n,) the filter's height above the ground at the same instants [m]; empty without an IMU
    used : (n,) false where a sonar's echo is wrong
    """

    t: FloatArray
    height: FloatArray
    filtered: FloatArray
    used: BoolArray

    @property
    def against_filter(self) -> tuple[float, float, float] | None:
        """Median difference [m], robust sigma about it [m], and slope of the height over the filter's."""
        if not len(self.filtered):
            return None
        return _compared(self.height[self.used], self.filtered[self.used])


@dataclass(frozen=True)
class SonarFailure:
    """A stretch without a good echo.

    Attributes
    ----------
    start, stop : s
    lost : readings that are missing or wrong
    kind : "none" (no reading, or the longest one again and again) or "wrong" (an echo of something else)
    cause : "beyond its range", "beyond its beam angle", "soft target", "something nearer", "something further" or
        "unknown" (no filter)
    """

    start: float
    stop: float
    lost: int
    kind: str
    cause: str


@dataclass(frozen=True)
class Heights:
    """What `heights_of` finds.

    Attributes
    ----------
    courses : by sensor
    motion : smoothed, at the IMU's samples; None without an IMU
    ground_down : of the flat ground [m]
    failures : of the sonar, in order
    heard : shortest and longest range [m] and largest tilt [rad] from which echoes came; NaN: not known
    pairs : by two sensors: median difference, robust sigma [m], slope
    """

    courses: Mapping[str, HeightCourse]
    motion: Motion | None
    ground_down: float
    failures: tuple[SonarFailure, ...]
    heard: tuple[float, float, float]
    pairs: Mapping[tuple[str, str], tuple[float, float, float]]


def heights_of(recording: Recording) -> Heights:
    """Heights of every sensor that has one.

    Of a receiver the fixes that tell one. A range becomes a height by the smoothed attitude: h = range cos(pitch)
    cos(roll), a scan by least squares over its beams. Without an IMU ranges stay as they are.

    Neglects the sonar's and the laser's mounting and the slope of the ground (`sinan trace` looks for those), and that
    the filter has seen the very readings that it is compared with.

    Raises
    ------
    InputError : no sensor with a height
    """
    there = [name for name in HEIGHT_SENSORS if _column(recording, name)]
    if not there:
        raise InputError(recording.where, f"streams {', '.join(recording.streams)}", "one of sonar, laser, baro, gps")
    motion = estimated_motion(prepared(recording).run()) if "imu" in recording.streams else None
    streams = dict(recording.streams)
    if "gps" in there:
        streams["gps"] = streams["gps"].rows(tells_height(streams["gps"]))
    if motion is not None:  # beyond the IMU there is no attitude
        begin, end = motion.t[0], motion.t[-1]
        streams |= {name: streams[name].rows((streams[name].t >= begin) & (streams[name].t <= end)) for name in there}
    recording = recording.replace(streams={k: v for k, v in streams.items() if len(v)})
    there = [name for name in there if name in recording.streams]
    courses = {name: _course(recording, name, motion) for name in there}
    failures: tuple[SonarFailure, ...] = ()
    heard = (np.nan, np.nan, np.nan)
    if "sonar" in courses:
        courses["sonar"], failures, heard = _sonar(recording.streams["sonar"], courses["sonar"], motion)
    return Heights(courses, motion, recording.environment.ground_down, failures, heard, _pairs(courses))


def _column(recording: Recording, name: str) -> str:
    """The column that holds a height or a range; empty: there is none."""
    stream = recording.streams.get(name)
    columns = {"baro": ("height",), "gps": ("down",)}.get(name, ("range", "range_0"))
    if stream is None or (name == "gps" and not np.any(tells_height(stream))):
        return ""
    return next((column for column in columns if column in stream), "")


def _course(recording: Recording, name: str, motion: Motion | None) -> HeightCourse:
    stream, ground = recording.streams[name], recording.environment.ground_down
    if motion is None:
        height, filtered = _untilted(stream, name, ground), np.empty(0)
    else:
        at = motion.at(stream.t)
        roll, pitch, _ = rpy_from_quaternion(at.q_nb).T
        filtered = at.height
        if name in ("baro", "gps"):
            height = _untilted(stream, name, ground)
        elif "range" in stream:
            height = tilt_compensated_height(stream["range"], roll, pitch)
        else:
            angles = recording.spec(name).angles
            assert angles is not None  # a scan without angles is refused where it is read
            ranges = stream.array([f"range_{k}" for k in range(len(angles))])
            height = scan_height(ranges, angles, roll, pitch)
    return HeightCourse(stream.t, height, filtered, np.ones(len(stream), dtype=bool))


def _untilted(stream: Stream, name: str, ground: float) -> FloatArray:
    if name == "gps":
        return ground - stream["down"]
    if name == "baro":
        return stream["height"] + ground
    return stream["range"] if "range" in stream else stream["range_0"]


def _compared(height: FloatArray, other: FloatArray) -> tuple[float, float, float]:
    """Median difference, robust sigma, slope of one height over the other (NaN where that one hardly changes)."""
    difference = height - other
    middle = float(np.median(difference))
    sigma = 1.4826 * float(np.median(np.abs(difference - middle)))
    keep = np.abs(difference - middle) < max(WRONG * sigma, LEAST_WRONG)
    varies = float(np.std(other[keep])) > 3.0 * max(sigma, 1e-9) if np.any(keep) else False
    slope = float(np.polyfit(other[keep], height[keep], 1)[0]) if varies else float("nan")
    return middle, sigma, slope


def _pairs(courses: Mapping[str, HeightCourse]) -> dict[tuple[str, str], tuple[float, float, float]]:
    """Each pair at the instants of the one with fewer readings, the other in between its own."""
    found = {}
    for first, second in combinations(courses, 2):
        few, many = sorted((courses[first], courses[second]), key=lambda course: len(course.t))
        inside = few.used & (few.t >= many.t[0]) & (few.t <= many.t[-1])
        if np.count_nonzero(inside) < 3:
            continue
        between = np.interp(few.t[inside], many.t[many.used], many.height[many.used])
        a, b = (few.height[inside], between) if few is courses[first] else (between, few.height[inside])
        found[first, second] = _compared(a, b)
    return found


def _sonar(
    stream: Stream, course: HeightCourse, motion: Motion | None
) -> tuple[HeightCourse, tuple[SonarFailure, ...], tuple[float, float, float]]:
    """The sonar's course with its wrong echoes marked, the failures, and from where echoes came."""
    reading, t = stream["range"], stream.t
    step = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    none = _no_echo(reading)
    expected, tilt = np.full(len(t), np.nan), np.full(len(t), np.nan)
    wrong = np.zeros(len(t), dtype=bool)
    if motion is not None and np.any(~none):
        at = motion.at(t)
        cosine = cos_tilt(at.q_nb)
        expected, tilt = at.height / cosine, np.arccos(np.clip(cosine, -1.0, 1.0))
        middle, sigma, _ = _compared(reading[~none], expected[~none])
        wrong = ~none & (np.abs(reading - expected - middle) > max(WRONG * sigma, LEAST_WRONG))
    good = ~none & ~wrong
    heard = _heard(reading[good], tilt[good])
    failures = [*_lost(t, step, heard, motion), *_marked(t, none, "none", expected, tilt, heard)]
    for first, last in runs_of(wrong):
        nearer = float(np.median(reading[first:last] - expected[first:last])) < 0.0
        cause = "something nearer" if nearer else "something further"
        failures.append(SonarFailure(float(t[first]), float(t[last - 1]), last - first, "wrong", cause))
    failures.sort(key=lambda failure: failure.start)
    return HeightCourse(t, course.height, course.filtered, good), tuple(failures), heard


def _no_echo(reading: FloatArray) -> BoolArray:
    """Readings that are the longest one, again and again: what many sonars say where they hear nothing."""
    longest = reading == np.max(reading)
    none = np.zeros(len(reading), dtype=bool)
    for first, last in runs_of(longest):
        if last - first >= STUCK:
            none |= longest
            break
    return none if not np.all(none) else np.zeros(len(reading), dtype=bool)


def _heard(reading: FloatArray, tilt: FloatArray) -> tuple[float, float, float]:
    if not len(reading):
        return np.nan, np.nan, np.nan
    low, high = np.quantile(reading, [RARE, 1.0 - RARE])
    return float(low), float(high), float(np.quantile(tilt, 1.0 - RARE)) if np.all(np.isfinite(tilt)) else float("nan")


def _cause(expected: float, tilt: float, heard: tuple[float, float, float]) -> str:
    """Why no echo came from a ground at that range, seen at that tilt."""
    if not np.isfinite(expected):
        return "unknown"
    if tilt > heard[2]:
        return "beyond its beam angle"
    return "soft target" if heard[0] <= expected <= heard[1] else "beyond its range"


def _lost(t: FloatArray, step: float, heard: tuple[float, float, float], motion: Motion | None) -> list[SonarFailure]:
    """Gaps of the sonar's clock; the cause is that of most of the instants at which an echo is missing."""
    failures = []
    ends = [(t[k], t[k + 1]) for k in np.flatnonzero(np.diff(t) > LOST * step)]
    if motion is not None:
        ends = [(motion.t[0] - step, t[0]), *ends, (t[-1], motion.t[-1] + step)]
    for before, after in ends:
        count = round((after - before) / step) - 1
        if count < 1:
            continue
        instants = before + step * np.arange(1, count + 1)
        causes = ["unknown"]
        if motion is not None:
            at = motion.at(instants)
            cosine = np.maximum(cos_tilt(at.q_nb), 1e-6)
            causes = [
                _cause(h / c, float(np.arccos(min(c, 1.0))), heard) for h, c in zip(at.height, cosine, strict=True)
            ]
        cause = max(dict.fromkeys(causes), key=causes.count)
        failures.append(SonarFailure(float(instants[0]), float(instants[-1]), count, "none", cause))
    return failures


def _marked(
    t: FloatArray, rows: BoolArray, kind: str, expected: FloatArray, tilt: FloatArray, heard: tuple[float, float, float]
) -> list[SonarFailure]:
    """Runs of readings that stand for no echo."""
    failures = []
    for first, last in runs_of(rows):
        run: IntArray = np.arange(first, last)
        causes = [_cause(float(expected[k]), float(tilt[k]), heard) for k in run]
        cause = max(dict.fromkeys(causes), key=causes.count)
        failures.append(SonarFailure(float(t[first]), float(t[last - 1]), last - first, kind, cause))
    return failures
