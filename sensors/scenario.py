"""`Scenario`: what a simulated experiment is made of, in SI units. docs/scenarios.md has the TOML keys."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import STANDARD_GRAVITY
from sinan.sensors.manoeuvres import Manoeuvre
from sinan.sensors.recording import Kind, SensorSpec
from sinan.sensors.trajectory import Multicopter, Turntable, even_knots


@dataclass(frozen=True)
class Marks:
    """Known points on the ground that a camera aboard sees.

    Attributes
    ----------
    count : number of marks
    reach : they lie as far as that north, south, east and west of the start [m]
    height : and up to that above and below the ground [m]
    most : at most so many are read of one picture
    size : width and height of a picture [pixels]
    """

    count: int = 250
    reach: float = 40.0
    height: float = 0.5
    most: int = 6
    size: tuple[float, float] = (640.0, 480.0)


@dataclass(frozen=True)
class Instrument:
    """One simulated sensor: what is declared about it, and how it is read.

    Attributes
    ----------
    spec : noise and bias, drawn and declared alike
    rate : Hz
    offset : instant of its first reading [s]
    jitter : 1-sigma of the instant of a reading about the even clock [s]; the stamp is the true instant
    loss : share of readings that get lost one by one
    dropouts : (k, 2) intervals without readings [s]
    minimum, maximum : ranges between which an echo comes back [m]
    beam_angle : largest tilt at which the ground answers the sonar [rad]
    softness : share of the sonar's sound that the ground swallows
    scale_std : poses: 1-sigma of the scale of each axis
    velocity : GPS: whether it gives velocity
    place : base receiver: north, east, down [m]
    marks : camera: what it sees
    """

    spec: SensorSpec
    rate: float
    offset: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    dropouts: tuple[tuple[float, float], ...] = ()
    minimum: float = 0.0
    maximum: float = np.inf
    beam_angle: float = np.pi / 2
    softness: float = 0.0
    scale_std: float = 0.0
    velocity: bool = True
    place: tuple[float, float, float] = (100.0, 50.0, 0.0)
    marks: Marks = field(default_factory=Marks)


@dataclass(frozen=True)
class Air:
    """Rotor drag per mass [1/s], wind (north, east) [m/s], and whether `air.csv` says the wind."""

    drag: float = 0.0
    wind: tuple[float, float] = (0.0, 0.0)
    wind_known: bool = False


@dataclass(frozen=True)
class Warming:
    """Temperature of a board: ambient + rise (1 - exp(-t / time_constant)) + swing sin(2 pi t / period) [degC, s]."""

    ambient: float = 20.0
    rise: float = 12.0
    time_constant: float = 60.0
    swing: float = 1.0
    period: float = 45.0


@dataclass(frozen=True)
class Supply:
    """Battery and motors: currents [A], voltage [V] when full and after `capacity` [A s], throttle in hover."""

    hover_current: float = 12.0
    idle_current: float = 0.6
    full_voltage: float = 12.6
    empty_voltage: float = 10.8
    capacity: float = 18000.0
    hover_throttle: float = 0.5


@dataclass(frozen=True)
class Vibration:
    """Shaking by the motors: amplitude per axis at hover throttle [m/s^2], frequency at hover throttle [Hz]."""

    amplitude: tuple[float, float, float] = (0.0, 0.0, 0.0)
    frequency: float = 50.0


@dataclass(frozen=True)
class Turns:
    """How a turntable or a hand turns the body.

    Attributes
    ----------
    kind : "poses" (hold, turn, hold, ...), "sweep" (slow, through all directions) or "hand" (to and fro, with pauses)
    attitudes : (roll, pitch, yaw) [rad] of each pose; none: `poses` of them, evenly into all directions
    around : angle about the vertical that is turned through while a pose is held [rad]
    duration : s; of poses: poses x (hold + turn)
    poses : number of poses
    hold, turn : s
    sway : amplitude of the reference point's motion [m]
    """

    kind: str = "poses"
    duration: float = 120.0
    poses: int = 25
    hold: float = 4.0
    turn: float = 2.0
    sway: float = 0.0
    attitudes: tuple[tuple[float, float, float], ...] = ()
    around: float = 0.0


@dataclass(frozen=True)
class Scenario:
    """A simulated experiment.

    Attributes
    ----------
    name, kind : as of `Recording`
    sensors : by name: accel, gyro, mag, baro, sonar, laser, gps, base, camera; accel and gyro share the clock of accel
    manoeuvres : of a multicopter; empty: the body is turned by `turns`
    turns : of a turntable or a hand; None with manoeuvres
    static : poses.csv of averaged poses in place of a full-rate stream
    start : (5,) north, east, down [m], yaw [rad], lift
    smoothing : spacing of the control points [s]: commands are rounded off over about this time
    origin : latitude, longitude [deg], height [m], or None
    gravity, magnetic_field, ground_down : of the place, as of `Environment`
    covariate_rate : of power, motors and air [Hz]; 0: these streams are not there
    truth_rate : rows a second of the truth; 0: one at every IMU sample
    initial : position_std, velocity_std, attitude_std of the declared first state; None: not declared
    summary : one sentence
    """

    name: str
    sensors: Mapping[str, Instrument]
    kind: Kind = "flight"
    manoeuvres: tuple[Manoeuvre, ...] = ()
    turns: Turns | None = None
    static: bool = False
    start: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 1.0)
    smoothing: float = 0.25
    origin: tuple[float, float, float] | None = None
    gravity: float = STANDARD_GRAVITY
    magnetic_field: tuple[float, float, float] = (0.53, -0.06, 0.85)
    ground_down: float = 0.0
    air: Air = field(default_factory=Air)
    warming: Warming = field(default_factory=Warming)
    baro_warming: Warming = field(default_factory=lambda: Warming(20.0, 6.0, 25.0, 2.0, 31.0))
    supply: Supply = field(default_factory=Supply)
    vibration: Vibration = field(default_factory=Vibration)
    covariate_rate: float = 50.0
    truth_rate: float = 50.0
    initial: tuple[float, float, float] | None = (1.0, 0.2, 0.02)
    summary: str = ""

    @property
    def duration(self) -> float:
        """Length of the recording [s]."""
        if self.turns is None:
            return float(sum(manoeuvre.duration for manoeuvre in self.manoeuvres))
        if self.turns.kind == "poses":
            return (len(self.turns.attitudes) or self.turns.poses) * (self.turns.hold + self.turns.turn)
        return self.turns.duration

    def with_imu_rate(self, rate: float) -> Scenario:
        """A copy whose accelerometer and gyroscope are sampled so often [Hz]; the density of their noise stays."""
        slower = {name: replace(self.sensors[name], rate=rate) for name in ("accel", "gyro") if name in self.sensors}
        return self.replace(sensors={**self.sensors, **slower})

    def replace(self, **changes: object) -> Scenario:
        """A copy with some attributes changed."""
        return replace(self, **changes)  # type: ignore[arg-type]

    def trajectory(self) -> Multicopter | Turntable:
        """The motion that the manoeuvres or the turns command."""
        from sinan.sensors.manoeuvres import commands

        knots = even_knots(self.duration, self.smoothing)
        g_n, m_n = np.array([0.0, 0.0, self.gravity]), np.array(self.magnetic_field)
        if self.turns is not None:
            return Turntable(knots, turned(knots, self.turns), g_n, m_n, self.ground_down)
        command = commands(self.manoeuvres, np.array(self.start), knots)
        return Multicopter(knots, command, g_n, m_n, self.ground_down, self.air.drag, self.air.wind)


#: One over the powers of the plastic number's like in three dimensions: a sequence that fills the cube evenly
#: (M. Roberts, The unreasonable effectiveness of quasirandom sequences, 2018)
_FILLING = np.array([0.8191725133961645, 0.6710436067037893, 0.5497004779019703])


def pose_angles(poses: int) -> FloatArray:
    """(poses, 3) roll, pitch, yaw [rad] that point body down evenly into all directions, the first one level."""
    u = (0.5 + np.arange(poses)[:, None] * _FILLING) % 1.0
    roll, pitch, yaw = 2.0 * np.pi * (u[:, 0] - 0.5), np.arcsin(2.0 * u[:, 1] - 1.0), 2.0 * np.pi * (u[:, 2] - 0.5)
    return np.stack([roll, pitch, yaw], axis=1)


def turned(t: FloatArray, turns: Turns) -> FloatArray:
    """(n, 6) commanded roll, pitch, yaw [rad] and north, east, down [m] at the instants t."""
    out = np.zeros((len(t), 6))
    if turns.kind == "poses":
        out[:, :3] = _posed(t, turns)
    elif turns.kind == "sweep":
        phase = (
            2.0 * np.pi * np.clip(t, 0.0, turns.duration)[:, None] / (turns.duration * np.array([1 / 5, 1 / 8, 1 / 3]))
        )
        out[:, :3] = np.stack([phase[:, 0], np.deg2rad(80.0) * np.sin(phase[:, 1]), phase[:, 2]], axis=1)
    else:
        inside = np.clip(t, 0.0, turns.duration)
        fade = np.clip(np.minimum(inside - 3.0, turns.duration - 2.0 - inside) / 2.0, 0.0, 1.0)
        pause = np.clip(1.0 - 6.0 * np.maximum(np.sin(2.0 * np.pi * inside / 17.0) - 0.8, 0.0), 0.0, 1.0) * fade
        phase = 2.0 * np.pi * inside[:, None] / np.array([4.1, 5.3, 9.7])
        out[:, :3] = np.deg2rad([50.0, 35.0, 120.0]) * np.sin(phase) * pause[:, None]
    sway = 2.0 * np.pi * np.clip(t, 0.0, turns.duration)[:, None] / np.array([3.7, 4.9, 6.1])
    out[:, 3:] = turns.sway * np.sin(sway)
    return out


def _posed(t: FloatArray, turns: Turns) -> FloatArray:
    """Angles of hold, turn, hold, ...: each turn in even time from one pose to the next."""
    angles = np.array(turns.attitudes) if turns.attitudes else pose_angles(turns.poses)
    last = len(angles) - 1
    each = turns.hold + turns.turn
    k = np.clip((t / each).astype(np.int64), 0, last)
    share = np.clip((t - k * each - turns.hold) / turns.turn, 0.0, 1.0)[:, None]
    out = np.asarray(angles[k] * (1.0 - share) + angles[np.minimum(k + 1, last)] * share)
    out[:, 2] += turns.around * (k + np.clip((t - k * each) / turns.hold, 0.0, 1.0))
    return out
