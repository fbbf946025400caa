"""Noise of every sensor of a log from its longest part at rest: Allan deviation, confidence, and what to declare."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sinan.calibration.levels.allan import AllanFit, fit_allan
from sinan.calibration.poses.segments import MARGIN, still_rows
from sinan.estimator.filter.imu import GAP
from sinan.sensors.arrays import FloatArray, runs_of
from sinan.sensors.errors import InputError
from sinan.sensors.recording import ACCEL, GYRO, MAG, POSITION, Recording, Stream

#: At rest is what scatters less than a table or an idle vehicle does [m/s^2], [rad/s]; more is a flight, whose quietest
#: part would be found just as well: a choice. Of scatters of 0.3 and 0.8 m/s^2 and of 0.03 and 0.08 rad/s half calls
#: all flights, twice none (`bounds_of_work rest`).
SCATTER = {"accel": 0.5, "gyro": 0.05}
#: And what turns less [rad/s]: a choice. Of 0.015 and 0.032 rad/s half calls both flights, twice none (`bounds_of_work
#: rest`).
TURN = 0.02
#: How far a height may wander in a log without an accelerometer [m], more being a flight, or weather: a choice. Of 3
#: and 8 m half calls both flights, twice none (`bounds_of_work rest`).
MOVED = 5.0
#: The least time at rest [s]: white noise of 50 readings a second is then known to 1 / sqrt(2 * 500), 3 %.
LEAST = 10.0
#: What the form of the curve may be off by, since a real sensor is no sum of four powers: a choice, half and twice of
#: which move the white noise of a table by 0.8 of its sigma (`bounds_of_work rest`).
FLOOR = 0.02
#: A term counts as seen from so many of its sigmas on, 2 norm.sf(2) = 5 %; of one that is not seen the bound of
#: norm.cdf(1.645) = 95 % is said.
SEEN, BOUND = 2.0, 1.645

#: sensor -> stream, columns, unit
CHANNELS: dict[str, tuple[str, tuple[str, ...], str]] = {
    "accel": ("imu", ACCEL, "m/s^2"),
    "gyro": ("imu", GYRO, "rad/s"),
    "mag": ("mag", MAG, ""),
    "baro": ("baro", ("height",), "m"),
    "sonar": ("sonar", ("range",), "m"),
    "laser": ("laser", ("range",), "m"),
    "gps": ("gps", POSITION, "m"),
}


@dataclass(frozen=True)
class ChannelNoise:
    """Noise of one channel at rest.

    Attributes
    ----------
    sensor, channel, unit : what it is
    rate : Hz
    count : readings
    fit : of the overlapping Allan deviation
    low, high : (m,) 95 % interval of each deviation
    """

    sensor: str
    channel: str
    unit: str
    rate: float
    count: int
    fit: AllanFit
    low: FloatArray
    high: FloatArray

    @property
    def sample_std(self) -> float:
        """Standard deviation of one reading by its white noise alone, N sqrt(rate) [unit]."""
        return float(self.fit.noise_density * np.sqrt(self.rate))

    @property
    def one_sided(self) -> float:
        """The density of data sheets, sqrt(2) N: noise in a band from 0 to F has the variance density^2 F. N itself is
        two-sided (`sensors.noise`).
        """
        return float(np.sqrt(2.0) * self.fit.noise_density)

    def seen(self, term: int) -> bool:
        """Whether N, B, w or R (0 to 3) is beyond doubt in the curve."""
        return bool(self.fit.coefficients[term] > SEEN * self.fit.std[term])

    def bound(self, term: int) -> float:
        """95 % upper bound of N, B, w or R."""
        value, sigma = self.fit.coefficients[term], float(self.fit.std[term])
        # the square is what was fitted: of a term at zero, `std` is already the root of the square's sigma
        square_sigma = 2.0 * value * sigma if value > 0.0 else sigma**2
        return float(np.sqrt(value**2 + BOUND * square_sigma))


@dataclass(frozen=True)
class Rest:
    """The part of a log that was at rest, and the noise in it.

    Attributes
    ----------
    start, stop : on the recording's clock [s]
    found : by what the part was found: "accelerometer and gyroscope", "accelerometer", or "" (all of the log; nothing
        could tell)
    channels : one for each axis of each sensor that read during it
    left_out : why a sensor of the log is not there, by name
    """

    start: float
    stop: float
    found: str
    channels: tuple[ChannelNoise, ...]
    left_out: dict[str, str]

    def of(self, sensor: str) -> tuple[ChannelNoise, ...]:
        """The channels of one sensor."""
        return tuple(channel for channel in self.channels if channel.sensor == sensor)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Those with channels."""
        return tuple(dict.fromkeys(channel.sensor for channel in self.channels))


def noise_at_rest(recording: Recording) -> Rest:
    """Find the longest part at rest and fit the noise of every sensor in it.

    Parameters
    ----------
    recording : of any kind; with an IMU the part is found, without one all of the log is taken to be at rest

    Neglects what the table itself does (wind, traffic), and the temperature, whose drift is found as ramp or walk.

    Raises
    ------
    InputError : no part at rest of `LEAST` seconds; no sensor with 16 readings in it
    """
    start, stop, found = _longest_rest(recording)
    channels: list[ChannelNoise] = []
    left_out: dict[str, str] = {}
    for sensor, (name, columns, unit) in CHANNELS.items():
        stream = recording.streams.get(name)
        if stream is None and name == "imu":
            stream = recording.streams.get("poses")
        if stream is None or not stream.has(columns):
            continue
        part = _without_gaps(stream.rows((stream.t >= start) & (stream.t <= stop)))
        if len(part) < 16 or part.t[-1] - part.t[0] < LEAST:
            left_out[sensor] = f"{len(part)} readings without a gap in this part"
            continue
        unit = recording.environment.field_unit if sensor == "mag" else unit
        made = [_channel(sensor, column, unit, part.t, part[column]) for column in columns]
        channels += [channel for channel in made if channel is not None]
        if None in made:
            left_out[sensor] = "a channel that reads one value only"
    if not channels:
        why = "; ".join(f"{name}: {text}" for name, text in left_out.items()) or "no sensor that it knows"
        raise InputError(recording.where, why, f"a sensor that reads at rest for {LEAST:.0f} s")
    return Rest(start, stop, found, tuple(channels), left_out)


def _longest_rest(recording: Recording) -> tuple[float, float, str]:
    imu = recording.streams.get("imu") or recording.streams.get("poses")
    if imu is None or not imu.has(ACCEL):
        _require_no_flight(recording)
        times = [stream.t for stream in recording.streams.values()]
        return max(float(t[0]) for t in times), min(float(t[-1]) for t in times), ""
    gyro = imu.array(GYRO) if imu.has(GYRO) else None
    if gyro is not None and not np.any(np.ptp(gyro, axis=0)):
        gyro = None
    longest, why = (0.0, 0.0), "no part that is still"
    for first, last in _still_runs(imu, gyro):
        part = imu.rows(slice(first, last))
        moves = _moves(part)
        if moves:
            why = f"the stillest parts move: {moves}"
        elif part.t[-1] - part.t[0] > longest[1] - longest[0]:
            longest = float(part.t[0]) + MARGIN, float(part.t[-1]) - MARGIN
    if longest[1] - longest[0] < LEAST:
        if longest[1] > longest[0]:
            why = f"{longest[1] - longest[0]:.1f} s at rest"
        expected = f"a part at rest of {LEAST:.0f} s or more (noise at rest takes minutes, a bias's walk an hour)"
        raise InputError(recording.where, why, expected)
    return *longest, "accelerometer and gyroscope" if gyro is not None else "accelerometer"


def _require_no_flight(recording: Recording) -> None:
    """Of a log without an accelerometer, whose heights alone can tell."""
    for name, column in (("baro", "height"), ("sonar", "range"), ("laser", "range"), ("gps", "down")):
        stream = recording.streams.get(name)
        if stream is not None and column in stream:
            low, high = np.percentile(stream[column], [2, 98])
            if high - low > MOVED:
                found = f"no accelerometer to find a rest by, and {name} moves by {high - low:.3g} m"
                raise InputError(recording.where, found, "a log at rest; --from and --to choose a part")


def _still_runs(imu: Stream, gyro: FloatArray | None) -> Iterator[tuple[int, int]]:
    """Runs of rows at rest, not over gaps of the clock."""
    t = imu.t
    step = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    ends = [0, *(np.flatnonzero(np.diff(t) > GAP * step) + 1), len(t)]
    for begin, end in pairwise(ends):
        rows = slice(begin, end)
        still = still_rows(t[rows], imu.array(ACCEL)[rows], None if gyro is None else gyro[rows])
        for first, last in runs_of(still):
            yield begin + first, begin + last


def _moves(part: Stream) -> str:
    """What says that a still part is none."""
    for sensor, columns in (("accel", ACCEL), ("gyro", GYRO)):
        if part.has(columns):
            scatter = float(np.max(np.std(part.array(columns), axis=0)))
            if scatter > SCATTER[sensor]:
                return f"{sensor} scatters by {scatter:.2g}"
    if part.has(GYRO):
        # a bias is constant, a turn is not: the mean of each tenth
        tenths = np.array([np.mean(piece, axis=0) for piece in np.array_split(part.array(GYRO), 10) if len(piece)])
        if float(np.max(np.ptp(tenths, axis=0))) > TURN:
            return f"gyro turns by {float(np.max(np.ptp(tenths, axis=0))):.2g} rad/s"
    return ""


def _without_gaps(stream: Stream) -> Stream:
    """The longest part of a stream between gaps of its clock."""
    if len(stream) < 3:
        return stream
    gaps = np.flatnonzero(np.diff(stream.t) > GAP * np.median(np.diff(stream.t))) + 1
    ends = [0, *gaps, len(stream)]
    pieces = [slice(a, b) for a, b in pairwise(ends)]
    return stream.rows(max(pieces, key=lambda piece: piece.stop - piece.start))


def _channel(sensor: str, column: str, unit: str, t: FloatArray, values: FloatArray) -> ChannelNoise | None:
    """One channel; None where it reads one value only."""
    if np.ptp(values) == 0.0:
        return None
    rate = float((len(t) - 1) / (t[-1] - t[0]))
    fit = fit_allan(values - np.mean(values), rate, ramp=True, floor=FLOOR)
    low, high = deviation_interval(fit, len(values), rate)
    axis = column.removeprefix(f"{sensor}_")
    return ChannelNoise(
        sensor, axis if axis != column or sensor == "gps" else "", unit, rate, len(values), fit, low, high
    )


def deviation_interval(fit: AllanFit, n: int, rate: float, level: float = 0.95) -> tuple[FloatArray, FloatArray]:
    """(m,), (m,) chi-square interval of each deviation, with the degrees of freedom of the noise that rules there.

    Source: C. A. Greenhall, W. J. Riley, 35th PTTI (2003) 267; NIST SP 1065, equation 45; `allantools.edf_greenhall`.
    """
    from allantools import edf_greenhall
    from scipy.stats import chi2

    N, B, w, R = np.array(fit.coefficients) ** 2
    parts = np.stack(
        [N / fit.tau, np.full_like(fit.tau, B * 2 * np.log(2) / np.pi), w * fit.tau / 3, R * fit.tau**2 / 2]
    )
    alpha = np.array([0, -1, -2, -2])[np.argmax(parts, axis=0)]
    edf = np.array([
        max(float(edf_greenhall(int(a), 2, max(round(float(tau * rate)), 1), n, overlapping=True)), 1.0)
        for a, tau in zip(alpha, fit.tau, strict=True)
    ])  # fmt: skip
    tail = (1.0 - level) / 2.0
    return fit.deviation * np.sqrt(edf / chi2.ppf(1.0 - tail, edf)), fit.deviation * np.sqrt(edf / chi2.ppf(tail, edf))


#: What is not declared from a rest: a receiver smooths its fixes, and its errors take hours to come and go.
NOT_DECLARED = ("gps",)


def declared(rest: Rest) -> dict[str, dict[str, float]]:
    """The keys of `recording.toml` by sensor: root mean square of the axes.

    `noise_density` of the IMU, `noise_std` of the others, one reading's; `bias_walk` where an axis shows one.
    """
    keys: dict[str, dict[str, float]] = {}
    for sensor in (name for name in rest.sensors if name not in NOT_DECLARED):
        channels = rest.of(sensor)
        inertial = sensor in ("accel", "gyro")
        noise = [c.fit.noise_density if inertial else c.sample_std for c in channels]
        if not any(c.seen(0) for c in channels):
            continue
        keys[sensor] = {"noise_density" if inertial else "noise_std": float(np.sqrt(np.mean(np.square(noise))))}
        if any(c.seen(2) for c in channels):
            walk = [c.fit.bias_walk for c in channels]
            keys[sensor]["bias_walk"] = float(np.sqrt(np.mean(np.square(walk))))
    return keys


def walk_bound(rest: Rest, sensor: str) -> float:
    """95 % bound of the walk of a sensor's bias, root mean square of the axes."""
    return float(np.sqrt(np.mean([c.bound(2) ** 2 for c in rest.of(sensor)])))
