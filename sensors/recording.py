"""`Recording`: time-stamped streams in SI units, what is declared about them, and the truth or reference, if any."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.errors import InputError
from sinan.sensors.registry import BySensor, sensor

Kind = Literal["flight", "poses"]

ACCEL, GYRO, MAG = (sensor(name).named(3) for name in ("accel", "gyro", "mag"))
POSITION = ("north", "east", "down")
VELOCITY = ("vel_north", "vel_east", "vel_down")
GEODETIC = ("latitude", "longitude", "height")
QUATERNION = ("qw", "qx", "qy", "qz")
#: What a receiver says of its own fix: 1-sigma of the position, horizontal and down [m], and of the velocity [m/s] (a
#: standard deviation, whatever the name says: it is PX4's); dilutions of precision; satellites used.
FIX_QUALITY = ("eph", "epv", "s_variance", "hdop", "vdop", "pdop", "satellites")
#: `epv` of a fix in two dimensions, which tells no height [m]: no height on the Earth is known worse beforehand.
NO_HEIGHT = 1e4

#: The columns that a stream must have; where several alternatives exist, one of them.
REQUIRED_COLUMNS: Mapping[str, tuple[tuple[str, ...], ...]] = BySensor(
    lambda entry: entry.columns,
    before={"imu": ((*ACCEL, *GYRO),)},
    after={
        "power": (("current",), ("voltage",)),
        "motors": (("motor_1",),),
        "air": (("airspeed",), ("wind_north", "wind_east"), ("temperature",)),
        "poses": (ACCEL, MAG),
    },
)
#: The largest reading: beyond every unit and clock, and its powers stay finite.
LARGEST_READING = 1e30
#: The most columns of a stream beyond the format's own, numbered ones aside.
MOST_COVARIATES = 64
_NUMBERED = ("range_", "motor_")
#: Streams that carry covariates, not measurements.
COVARIATE_STREAMS = ("power", "motors", "air")


@dataclass(frozen=True)
class Stream:
    """One stream: n rows on the recording's clock.

    Attributes
    ----------
    t : (n,) s, strictly increasing
    columns : each (n,), SI units; columns that the format does not define are covariates
    """

    t: FloatArray
    columns: Mapping[str, FloatArray]

    def __len__(self) -> int:
        return len(self.t)

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __getitem__(self, name: str) -> FloatArray:
        return self.columns[name]

    @property
    def step(self) -> float:
        """Median time from one row to the next [s]; NaN where there is one row."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else float("nan")

    def has(self, names: Sequence[str]) -> bool:
        """Whether all the named columns are there."""
        return all(name in self.columns for name in names)

    def array(self, names: Sequence[str]) -> FloatArray:
        """(n, k) the named columns side by side."""
        return np.stack([self.columns[name] for name in names], axis=-1)

    def rows(self, keep: BoolArray | IntArray | slice) -> Stream:
        """The rows that a mask, slice or index array names."""
        return Stream(self.t[keep], {name: column[keep] for name, column in self.columns.items()})


@dataclass(frozen=True)
class SensorSpec:
    """What is declared about one instrument; None: nothing was declared.

    Attributes
    ----------
    noise_density : continuous white noise N [unit/sqrt(Hz)]: a sample taken at rate f has standard deviation N sqrt(f)
    noise_std : white noise of one reading [unit]
    velocity_noise_std : the same for GPS velocity [m/s]
    bias_walk : random walk of the bias w [unit/s/sqrt(Hz)]: its variance grows by w^2 t
    bias_std : 1-sigma of the bias at the start [unit]
    colour_std : standard deviation of first-order Gauss-Markov noise, in addition to the white noise [unit]
    velocity_colour_std : the same of GPS velocity [m/s]
    colour_time : its time constant [s]
    average_time : time over which one pose was averaged [s]
    imu_samples : "instant" (the value at the stamp) or "average" (over the interval before it)
    angles : (beams,) angles of a scanning laser [rad]
    base_position : of a reference receiver, [latitude, longitude, height] (deg, deg, m) or NED [m] without an origin
    focal, centre : (2,) of a camera: f / dX, f / dY and u0, v0 [pixels]
    lens, coefficients : a model of `sensors.lenses` and its coefficients k; missing ones are zero
    mounting : (4,) q_bc, camera axes -> body, scalar first; None: it looks forward
    lever_arm : (3,) the camera's centre in the body [m]
    """

    noise_density: float | None = None
    noise_std: float | None = None
    velocity_noise_std: float | None = None
    bias_walk: float | None = None
    bias_std: float | None = None
    colour_std: float | None = None
    velocity_colour_std: float | None = None
    colour_time: float | None = None
    average_time: float | None = None
    imu_samples: str = "instant"
    angles: FloatArray | None = None
    base_position: FloatArray | None = None
    focal: FloatArray | None = None
    centre: FloatArray | None = None
    lens: str = ""
    coefficients: FloatArray | None = None
    mounting: FloatArray | None = None
    lever_arm: FloatArray | None = None

    @property
    def says_noise(self) -> bool:
        """Whether white noise is declared, as a density or as that of one reading."""
        return self.noise_density is not None or self.noise_std is not None


@dataclass(frozen=True)
class Environment:
    """Where the recording was made; None: not declared.

    Attributes
    ----------
    gravity : m/s^2
    magnetic_field : (3,) NED, in the unit of the magnetometer
    ground_down : down coordinate of the flat ground [m]
    earth_rotation : whether the rotation of the Earth is modelled in the angular rate
    field_unit : unit of the magnetometer and of `magnetic_field`: gauss, mGauss, T, uT or nT; empty: not declared
    """

    gravity: float | None = None
    magnetic_field: FloatArray | None = None
    ground_down: float = 0.0
    earth_rotation: bool = False
    field_unit: str = ""


@dataclass(frozen=True)
class Initial:
    """Mean and 1-sigma of the state at the first IMU sample; None: estimated from the data.

    Attributes
    ----------
    position, velocity : (3,) NED [m], [m/s]
    quaternion : (4,) q_nb, scalar first
    position_std, velocity_std, attitude_std : 1-sigma of each axis [m], [m/s], [rad]
    """

    position: FloatArray | None = None
    velocity: FloatArray | None = None
    quaternion: FloatArray | None = None
    position_std: float | None = None
    velocity_std: float | None = None
    attitude_std: float | None = None


#: What a reference may be. An autopilot's own estimate is a comparison, not a truth; of `other` nobody says what it is.
TRUTH_KINDS = ("simulation", "cameras", "robot", "rtk", "autopilot", "other")
#: What a reference may know, and the columns that hold it: any of the alternatives.
KNOWN_BY: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "position": (POSITION,),
    "velocity": (VELOCITY,),
    "attitude": (QUATERNION, ("roll", "pitch")),
}


@dataclass(frozen=True)
class Truth:
    """True or reference motion, for scoring an estimate. No estimator may read it.

    Attributes
    ----------
    stream : columns of `truth.csv`, only those that are known; attitude as a quaternion, or as `roll, pitch` if the
        reference has no heading; biases if simulated
    kind : one of `TRUTH_KINDS`; empty: not declared
    aligned : it uses the same axes and clock as the instrument, because its makers say so or one board recorded both;
        its north may still differ
    """

    stream: Stream
    kind: str = ""
    aligned: bool = False

    @property
    def known(self) -> tuple[str, ...]:
        """Which of position, velocity and attitude are known."""
        return tuple(name for name, columns in KNOWN_BY.items() if any(map(self.stream.has, columns)))

    @property
    def is_own(self) -> bool:
        """Whether it has the recording's own axes, clock and north, which another instrument's has not."""
        return self.kind in ("", "simulation")

    @classmethod
    def of(cls, stream: Stream, kind: str = "", known: Sequence[str] | None = None, aligned: bool = False) -> Truth:
        """Of a stream with columns that may hold more than is known; None: what the columns hold."""
        unknown = {
            column
            for name, alternatives in KNOWN_BY.items()
            if known is not None and name not in known
            for columns in alternatives
            for column in columns
        }
        columns = {name: values for name, values in stream.columns.items() if name not in unknown}
        return cls(Stream(stream.t, columns), kind, aligned)


@dataclass(frozen=True)
class Recording:
    """Time-stamped streams of one experiment in SI units, validated, with what is declared about them.

    Attributes
    ----------
    name : of the recording
    kind : "flight" (moving, feeds the filter) or "poses" (static or slowly turned, feeds a calibration)
    streams : by name: imu, those of the sensors (`sensors.registry`), power, motors, air, poses
    sensors : what is declared about each sensor: noise, bias, mounting
    environment : gravity [m/s^2], magnetic field NED, height of the ground
    initial : what is known of the state at the start, with its sigmas
    origin : (latitude deg, longitude deg, ellipsoidal height m) of the NED frame, or None
    effects : declared effects by name, with their parameters; all estimators include them in their model
    source : where it was read from, for messages
    notes : what the reader of the file chose or left out, for reports
    truth : true or reference motion, or None; no estimator may read it
    breaks : stamps of the IMU [s] at which another log of the same vehicle begins, unrelated to what was before
    points : (k, 4) known points that a camera sees: number, north, east, down [m]; None: there are none
    log_start : clock of the original log at t = 0 [s]; None: not known
    first_sample : of a part, t of the first sample of the whole log [s]; None: it is the whole
    goes_back : (from, to) [s] each, times that the log's clock has passed twice, since it has gone back by them; the
        rows of one passage, or the end of one and the begin of the other, are left out
    """

    name: str
    kind: Kind
    streams: Mapping[str, Stream]
    sensors: Mapping[str, SensorSpec] = field(default_factory=dict)
    environment: Environment = field(default_factory=Environment)
    initial: Initial = field(default_factory=Initial)
    origin: tuple[float, float, float] | None = None
    effects: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    source: str = ""
    notes: tuple[str, ...] = ()
    truth: Truth | None = None
    breaks: tuple[float, ...] = ()
    points: FloatArray | None = None
    log_start: float | None = None
    first_sample: float | None = None
    goes_back: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        if not self.streams:
            raise InputError(self.where, "no stream", "at least one of " + ", ".join(REQUIRED_COLUMNS))
        for name, stream in self.streams.items():
            check_stream(self.where, name, stream)

    @property
    def where(self) -> str:
        """How messages call the recording: its file, else its name."""
        return self.source or self.name

    def spec(self, sensor: str) -> SensorSpec:
        """What is declared about a sensor; an empty `SensorSpec` where nothing is.

        Parameters
        ----------
        sensor : its name, such as "gps"
        """
        return self.sensors.get(sensor, SensorSpec())

    def replace(self, **changes: object) -> Recording:
        """A copy with some attributes changed, checked again.

        Parameters
        ----------
        changes : attributes by name
        """
        return replace(self, **changes)  # type: ignore[arg-type]


def tells_height(fixes: Stream) -> BoolArray:
    """(n,) whether a fix has three dimensions, by the receiver's own word.

    Parameters
    ----------
    fixes : of a receiver; without `epv` all have
    """
    return fixes["epv"] < NO_HEIGHT if "epv" in fixes else np.ones(len(fixes), dtype=bool)


def check_stream(where: str | Path, name: str, stream: Stream) -> None:
    """Check one stream: known name, required columns and not too many more, at least one row, numbers, rising time.

    Raises
    ------
    InputError : names the stream, the row (1 = first row of data), what was found and what was expected
    """
    place = f"stream {name}"
    if name not in REQUIRED_COLUMNS:
        raise InputError(where, f"unknown stream `{name}`", "one of " + ", ".join(REQUIRED_COLUMNS))
    alternatives = REQUIRED_COLUMNS[name]
    if not any(stream.has(columns) for columns in alternatives):
        expected = " or ".join(", ".join(columns) for columns in alternatives)
        nearest = max(alternatives, key=lambda columns: sum(column in stream for column in columns))
        missing = ", ".join(column for column in nearest if column not in stream)
        found = f"no column {missing} (there are {', '.join(stream.columns) or 'none'})"
        raise InputError(where, found, f"columns {expected}", place)
    for triad in (ACCEL, GYRO, MAG, POSITION, VELOCITY):
        missing = ", ".join(column for column in triad if column not in stream)
        if missing and any(column in stream for column in triad):
            raise InputError(where, f"no column {missing}", f"all of {', '.join(triad)}, or none", place)
    known = {column for columns in alternatives for column in columns} | {*ACCEL, *GYRO, *MAG, *VELOCITY}
    further = [column for column in stream.columns if column not in known and not column.startswith(_NUMBERED)]
    if len(further) > MOST_COVARIATES:
        found = f"{len(further)} further columns ({', '.join(further[:3])}, ...)"
        raise InputError(where, found, f"at most {MOST_COVARIATES} besides the format's own", place)
    for column in stream.columns:
        if not column.isprintable():
            raise InputError(where, f"column {column!r}", "a name that prints", place)
    check_rows(where, stream, place, together=name == "camera")


def check_rows(where: str | Path, stream: Stream, place: str = "", together: bool = False) -> None:
    """Check the rows of a stream: at least one, finite numbers, time increasing.

    Parameters
    ----------
    together : rows of one instant may follow each other, as the points of one picture do; else time is strictly so

    Raises
    ------
    InputError : names the row (1 = first row of data), what was found and what was expected
    """
    if len(stream) == 0:
        raise InputError(where, "no rows", "at least one row", place)
    prefix = f"{place}, " if place else ""
    for column, values in {"t": stream.t, **stream.columns}.items():
        if len(values) != len(stream):
            raise InputError(where, f"column {column} has {len(values)} rows", f"{len(stream)} as in t", place)
        bad = np.flatnonzero(~(np.abs(values) <= LARGEST_READING))
        if len(bad):
            value = values[bad[0]]
            expected = f"at most {LARGEST_READING:g}" if np.isfinite(value) else "a number"
            raise InputError(where, f"{value} in column {column}", expected, f"{prefix}row {bad[0] + 1}")
    steps = np.diff(stream.t)
    back = np.flatnonzero(steps < 0.0 if together else steps <= 0.0)
    if len(back):
        k = int(back[0]) + 1
        raise InputError(
            where,
            f"t goes from {stream.t[k - 1]:.6g} to {stream.t[k]:.6g} s",
            "increasing time" if together else "strictly increasing time",
            f"{prefix}row {k + 1}",
        )
