"""Noise levels of a log that declares none: first guesses from the readings, then the levels that make it likeliest.

The likelihood of the filter's innovations is the one criterion: it is largest where they are white and as large as the
filter says. Vibration, aliasing and colour then count as noise where they act, as they must.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from sinan.calibration.levels.compass import DIRECTION_STD, LEAST_READINGS, compass_of
from sinan.calibration.levels.noise_start import (
    aiding_sensors,
    datum,
    height_sensors,
    imu_density,
    reading_noise,
    readings_of,
    rounding,
    scatter,
    within_imu,
)
from sinan.estimator.filter.alignment import first_state
from sinan.estimator.filter.effect_forms import Along, declared_terms, reference_motion, run_with_effects
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.events import Events, collect
from sinan.estimator.filter.flight_model import GATE_LEVEL, FlightModel, flight_model
from sinan.estimator.filter.imu import imu_table
from sinan.estimator.filter.inputs import prepare
from sinan.estimator.filter.journal import Journal
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.geomagnetism import declination, field_along, inclination
from sinan.sensors.recording import GYRO, MAG, VELOCITY, Recording, SensorSpec
from sinan.sensors.registry import BySensor, where

#: Noise below this, in SI units, is that of numbers which nobody has measured.
NO_NOISE = 1e-15
#: What is believed of the biases of consumer instruments where nothing is declared: 1-sigma at the start [unit].
BIAS_STD: Mapping[str, float] = BySensor(lambda entry: entry.believed_bias)
#: The same for a magnetometer, over the median norm of its readings: hard iron of a mounted, calibrated compass.
MAG_BIAS_STD = 0.15
#: A hard iron that the log shows counts from so many of its sigmas on: as often as 5 % by chance, as `FIELD_GAIN`.
BEYOND_DOUBT = 2.0
#: First guess of a bias walk: the noise density, or one reading's noise, times this a sqrt(s).
WALK_START = 0.05
#: How far a level may move from its first guess, as a factor. Upwards a noise ends where it would be all that was read.
#: A walk ends where the bias would wander by its own 1-sigma in this time [s]: what moves faster is no bias.
NOISE_DOWN = {"accel": 0.5, "gyro": 0.5}
AIDING_DOWN = 0.05
WALK_DOWN = 0.1
LEAST_WANDER = 60.0
#: Zeros of two height sensors that differ by more than this are taken as a bias of the one that is not the GPS [m].
SAME_ZERO = 1.0
#: A walk is taken at the upper end of what the log allows: where 2 log L has fallen by this much, one sigma.
#: Too large a walk loses power, too small a one blames effects that are not there.
WALK_SLACK = 1.0
#: Readings whose NIS has a smaller tail probability count as outliers: less weight in the filter and in the likelihood.
OUTLIER_LEVEL = 1e-3
#: A NIS off one by this factor, at levels that were found from the log, is said in the notes.
FAR = 1.25
#: The fit ends when an iteration gains less than this in log L over log L: half of it moves a level by up to 7 %
#: (`bounds_of_work levels`), twice none.
GAIN = 1e-7
#: Iterations of the fit: bound of work (`bounds_of_work levels`).
MOST_ITERATIONS = 40
#: How far the field's declination and dip [rad] and the logarithm of its norm may be off what the compass alone shows,
#: and the unit in which they are sought: a few sigmas of a flight.
FIELD_RANGE, FIELD_UNIT = (0.6, 0.6, 0.3), 0.02
#: What the three have to gain of 2 log L: the 5 % point of chi-square.
FIELD_GAIN = 7.8
#: Passes that bring the NIS of each stream to one, and how near: bound of work; half and twice move a level by up to
#: 1 % (`bounds_of_work levels`).
POLISH_PASSES, POLISHED = 20, 0.02

#: Walk of a consumer gyroscope's bias that nothing but a magnetometer or `level` watches [rad/s/sqrt(s)]: what its
#: scale and its g-sensitivity make of turns moves the bias far more than the walk of a data sheet does (1e-5).
UNWATCHED_WALK = 1e-4
#: Scale error of a trimmed consumer gyroscope (data sheets allow 3 %), and how long a body turns one way [s]: what the
#: two make of the turns of a log counts there as white noise of the rate.
SCALE_ERROR, TURN = 0.005, 0.5

Key = tuple[str, str]
_PART = {"noise_std": slice(0, 3), "velocity_noise_std": slice(3, 6)}  # of a GPS reading


@dataclass(frozen=True)
class NoiseFit:
    """Noise levels of a recording, and how they were found.

    Attributes
    ----------
    specs : by sensor, complete: what was declared and what was estimated
    estimated : (sensor, key) of what the log gave
    assumed : (sensor, key) of what neither the recording nor the log says and the class of instrument gives
    nis : mean NIS over dof by sensor at these levels
    log_likelihood : of the innovations at these levels, with what the place says of a field that was sought
    runs : of the filter
    by_rule : of `estimated`, what a rule gives and not the likelihood
    m_n : (3,) the field at which they were found, where it was sought as well
    """

    specs: Mapping[str, SensorSpec]
    estimated: tuple[Key, ...]
    assumed: tuple[Key, ...]
    nis: Mapping[str, float] = field(default_factory=dict)
    log_likelihood: float = float("nan")
    runs: int = 0
    by_rule: tuple[Key, ...] = ()
    m_n: FloatArray | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """One line a sensor of which something was not declared, and one a sensor that its levels do not fit."""
        lines = []
        for sensor in dict.fromkeys(name for name, _ in (*self.estimated, *self.assumed)):
            parts = [
                ", ".join(f"{key} {getattr(self.specs[sensor], key):.3g}" for name, key in keys if name == sensor) + how
                for keys, how in (
                    (self.estimated, " estimated from the log"),
                    (self.assumed, " assumed for an instrument of its class"),
                )
                if any(name == sensor for name, _ in keys)
            ]
            lines.append(f"{sensor}: {'; '.join(parts)}")
        return (*lines, *self.doubts)

    @property
    def doubts(self) -> tuple[str, ...]:
        """The sensors whose NIS stays far from one at their estimated levels, and what that means."""
        found = []
        for sensor, nis in self.nis.items():
            if (sensor, "noise_std") not in self.estimated or 1.0 / FAR < nis < FAR:
                continue
            if (sensor, "noise_std") in self.by_rule:
                why = "by intent: its errors are colour, and must not average out faster than they do"
            elif nis > 1.0:
                why = "its errors are not white noise: no level makes them so large and so slow"
            else:
                why = "its noise is at the least that is believed (rounding), or what it reads is smoothed already"
            found.append(f"{sensor}: NIS {nis:.2g} a degree of freedom, far from 1; {why}")
        return tuple(found)


def noise_levels(recording: Recording) -> Mapping[str, SensorSpec]:
    """`SensorSpec` of every sensor of a flight: what the recording declares, completed from the log itself.

    Parameters
    ----------
    recording : a flight

    Returns
    -------
    by sensor; ready for `flight_model(recording, specs=...)`. `fit_noise_levels` also says how each was found.

    Raises
    ------
    InputError : what `flight_model` raises
    """
    return fit_noise_levels(recording).specs


def fit_noise_levels(recording: Recording, seek_field: bool = False) -> NoiseFit:
    """Noise levels of a flight by maximum likelihood of its innovations; see `noise_levels`.

    Readings outside the IMU's time have no part in it.

    Parameters
    ----------
    seek_field : seek the magnetic field as well, where the recording does not say it: its norm, and its declination and
        dip, which a place says as well as they are known there. A compass alone does not know true north, and a body
        that stays near level shows of vertical field and vertical hard iron only the sum; GPS and gravity see both.
        What is off there would count as a walk of the bias, or as crooked axes
    """
    specs, missing, assumed = first_guess(recording)
    if not missing and not seek_field:
        return NoiseFit(specs, (), assumed)
    inside = within_imu(recording)
    if inside is not recording:
        recording = inside
        specs, missing, assumed = first_guess(recording)
    sought = tuple(key for key in missing if "gps" in recording.streams or key[0] in height_sensors())
    ruled = tuple(key for key in missing if key not in sought)
    if not sought and not seek_field:
        model = flight_model(recording, specs=specs)
        journal = _Ready.of(recording, model).run(model)
        return NoiseFit(specs, tuple(missing), assumed, journal.nis_per_dof(), journal.log_likelihood, 1, ruled)
    problem = _Problem(recording, specs, sought, seek_field)
    theta = problem.maximise(problem.first)
    if seek_field and not problem.field_gains(theta):
        problem = _Problem(recording, specs, sought)
        theta = problem.maximise(theta[: len(sought)])
    theta = problem.upper_walks(theta)
    theta = problem.polished(theta)
    journal = problem.journal(theta, gate_level=GATE_LEVEL, robust_level=None)
    return NoiseFit(
        problem.specs_of(theta), tuple(missing), assumed, journal.nis_per_dof(), problem.log_likelihood(theta),
        problem.runs, ruled, problem.field_of(theta) if problem.seek_field else None,
    )  # fmt: skip


def first_guess(recording: Recording) -> tuple[dict[str, SensorSpec], list[Key], tuple[Key, ...]]:
    """Complete specs from the readings alone, the keys that the likelihood is to find, and those that were assumed."""
    found = _noise_of_readings(recording)
    believed = _class_biases(recording)
    for name in where(lambda entry: bool(entry.believed_bias) or entry.kernel == "field"):
        if (name, "bias_std") in believed:
            noise = found.get((name, "noise_density")) or found[name, "noise_std"]
            found[name, "bias_walk"] = min(WALK_START * noise, 0.3 * BIAS_STD.get(name, np.inf) / np.sqrt(LEAST_WANDER))
            believed.pop((name, "bias_walk"), None)
    specs = {name: recording.spec(name) for name in {key[0] for key in found}}
    missing = [key for key in found if getattr(specs[key[0]], key[1]) is None]
    assumed = [key for key in believed if getattr(specs[key[0]], key[1]) is None]
    for name, key in [*missing, *assumed]:
        specs[name] = _with(specs[name], key, {**believed, **found}[name, key])
    if "gps" not in recording.streams:
        return _without_position(recording, specs, missing, assumed)
    return specs, missing, tuple(assumed)


def _noise_of_readings(recording: Recording) -> dict[Key, float]:
    """White noise by sensor and key, from how the readings scatter."""
    streams = recording.streams
    if "imu" not in streams:
        raise InputError(recording.where, "no stream imu", "accelerometer and gyroscope, which a flight needs")
    found: dict[Key, float] = {}
    found["accel", "noise_density"] = imu_density(recording)
    found["gyro", "noise_density"] = imu_density(recording, GYRO)
    for name in aiding_sensors():
        if name in streams:
            found[name, "noise_std"] = reading_noise(readings_of(recording, name))
    if "gps" in streams and streams["gps"].has(VELOCITY):
        found["gps", "velocity_noise_std"] = reading_noise(readings_of(recording, "gps", "velocity_noise_std"))
    for (name, key), noise in found.items():
        if noise < NO_NOISE and getattr(recording.spec(name), key) is None:
            n = len(streams["imu" if name in ("accel", "gyro") else name])
            what = "1 reading" if n == 1 else f"{n} readings without any noise"
            wanted = f"{key} declared, or readings to find it in"
            raise InputError(recording.where, f"{what} and no {key}", wanted, f"sensor {name}")
    return found


def _class_biases(recording: Recording) -> dict[Key, float]:
    """Sizes of the biases: of the class of instrument, a compass's by the log, a height's by how far zeros differ."""
    believed: dict[Key, float] = {}
    for name in ("accel", "gyro"):
        believed[name, "bias_std"] = BIAS_STD[name]
    if "mag" in recording.streams:
        believed["mag", "bias_std"] = _hard_iron(recording)
    for name, std in BIAS_STD.items():
        if name in recording.streams:
            believed[name, "bias_std"] = std
    for name in height_sensors():
        off = datum(recording, name) if name in recording.streams else 0.0
        if off > SAME_ZERO:
            believed[name, "bias_std"] = float(np.hypot(BIAS_STD.get(name, 0.0), off))
            believed[name, "bias_walk"] = 0.0
    return believed


def _hard_iron(recording: Recording) -> float:
    """1-sigma of a magnetometer's bias: that of a mounted, calibrated compass, or what the log shows beyond doubt."""
    mounted = MAG_BIAS_STD * float(np.median(np.linalg.norm(recording.streams["mag"].array(MAG), axis=1)))
    few = len(recording.streams["mag"]) < LEAST_READINGS
    if recording.spec("mag").bias_std is not None or few:
        return mounted
    compass = compass_of(within_imu(recording))
    return max(mounted, *np.abs(compass.offset[np.abs(compass.offset) > BEYOND_DOUBT * compass.std]), 0.0)


def _without_position(
    recording: Recording, specs: dict[str, SensorSpec], missing: list[Key], assumed: list[Key]
) -> tuple[dict[str, SensorSpec], list[Key], tuple[Key, ...]]:
    """Levels of a log whose tilt only `level` sees, and whose heading only the magnetometer.

    The errors of both are colour: accelerations, and what the field of the room and the soft iron do. Whitened
    innovations would there mean a gyroscope so noisy that it follows them. So the IMU's noise is that at rest, the
    magnetometer's what leaves its averages as uncertain as they are (its NIS is then far below one), and the likelihood
    finds the height sensors' alone. A bias of the accelerometer cannot be told from the mean acceleration in the body,
    which a circling hand makes: it counts as known, and `level` bears it, unless a height sensor shows it.
    """
    given: dict[Key, float] = {}
    if not any(name in recording.streams for name in height_sensors()):
        given |= {("accel", key): 0.0 for key in ("bias_std", "bias_walk")}
    given["gyro", "bias_walk"] = UNWATCHED_WALK
    rate_rms = float(np.sqrt(np.mean(np.square(recording.streams["imu"].array(GYRO)))))
    white = specs["gyro"].noise_density or 0.0
    given["gyro", "noise_density"] = float(np.hypot(white, SCALE_ERROR * rate_rms * np.sqrt(TURN)))
    if "mag" in recording.streams:
        compass = compass_of(recording)
        given["mag", "noise_std"] = compass.noise_std
        given["mag", "bias_std"] = float(np.max(np.hypot(compass.offset, compass.std)))
        given["mag", "bias_walk"] = 0.0
    for (name, key), value in given.items():
        if (name, key) in missing or (name, key) in assumed:
            specs[name] = _with(specs[name], key, value)
    by_rule = [key for key in missing if key in given and key[1] not in ("noise_std", "noise_density")]
    return specs, [key for key in missing if key not in by_rule], (*assumed, *by_rule)


def _with(spec: SensorSpec, key: str, value: float) -> SensorSpec:
    return replace(spec, **{key: value})  # type: ignore[arg-type]


@dataclass(frozen=True)
class _Ready:
    """What the filter runs on at any levels: effects that the recording declares are taken off, they are no noise.

    They are evaluated along the motion that the filter finds with the first guess of the levels.

    Attributes
    ----------
    recorded : as it is
    recording : without the effects in what the first attitude is found from
    u : (N, 6) readings of the IMU table without them; None: as they are. The noise of its steps goes with the levels.
    events : without them; the events still have the model's own form of each reading
    """

    recorded: Recording
    recording: Recording
    u: FloatArray | None
    events: Events

    @classmethod
    def of(cls, recording: Recording, model: FlightModel) -> _Ready:
        """Of a recording, along the motion found with these levels."""
        terms, table = declared_terms(recording), imu_table(recording, model)
        if not terms:
            return cls(recording, recording, None, collect(recording, model))
        journal = run_with_effects(recording, model, terms, engine="numba", stride=0)
        motion = reference_motion(recording, journal, terms, table)
        along = Along(recording, model, terms, motion, table)
        return cls(recording, along.without_effects, along.corrected.u, along.inputs.events)

    def run(self, model: FlightModel) -> Journal:
        """One pass with other levels, or another field."""
        table, first = imu_table(self.recorded, model), first_state(self.recording, model)
        if self.u is not None:
            table = replace(table, u=self.u)
        return run(prepare(self.recording, model, imu=table, events=self.events, first=first), "numba", stride=0)


@dataclass
class _Problem:
    """Log-likelihood over theta: the logarithms of the levels over their first guess and, where the field is sought
    too, how far its declination, dip and logarithm of the norm are off the model's, in `FIELD_UNIT`.
    """

    recording: Recording
    start: Mapping[str, SensorSpec]
    keys: tuple[Key, ...]
    seek_field: bool = False
    runs: int = 0

    def __post_init__(self) -> None:
        self.model = flight_model(self.recording, specs=self.start, gate_level=None, robust_level=OUTLIER_LEVEL)
        self._ready = _Ready.of(self.recording, self.model)
        levels = np.log(np.array([self._range(*key) for key in self.keys]).reshape(-1, 2))
        fields = np.array([(-most / FIELD_UNIT, most / FIELD_UNIT) for most in FIELD_RANGE if self.seek_field])
        self.bounds = np.concatenate([levels, fields.reshape(-1, 2)])

    @property
    def first(self) -> FloatArray:
        """Where the search begins."""
        return np.zeros(len(self.bounds))

    def field_of(self, theta: FloatArray) -> FloatArray:
        """(3,) field at theta."""
        if not self.seek_field:
            return self.model.m_n
        east, down, larger = FIELD_UNIT * theta[len(self.keys) :]
        m_n = self.model.m_n
        norm = float(np.linalg.norm(m_n) * np.exp(larger))
        return field_along(norm, inclination(m_n) + down, declination(m_n) + east)

    def _said_by_the_place(self, theta: FloatArray) -> float:
        """Logarithm of what is believed of the field's direction before the readings, over its largest value."""
        if not self.seek_field or self.recording.origin is None:
            return 0.0
        off = FIELD_UNIT * theta[len(self.keys) :][:2]
        return -0.5 * float(np.sum((off / DIRECTION_STD) ** 2))

    def field_gains(self, theta: FloatArray) -> bool:
        """Whether the data call for another field than the first."""
        first = np.concatenate([theta[: len(self.keys)], np.zeros(len(theta) - len(self.keys))])
        return 2.0 * (self.log_likelihood(theta) - self.log_likelihood(first)) > FIELD_GAIN

    def _range(self, name: str, key: str) -> tuple[float, float]:
        spec = self.start[name]
        if key == "bias_walk":
            assert spec.bias_walk is not None
            assert spec.bias_std is not None
            size = min(spec.bias_std, BIAS_STD.get(name, np.inf))
            return WALK_DOWN, max(size / np.sqrt(LEAST_WANDER) / spec.bias_walk, 2.0 * WALK_DOWN)
        start = getattr(self.start[name], key)
        low = max(NOISE_DOWN.get(name, AIDING_DOWN), rounding(self.recording, name, key) / start)
        return low, max(scatter(self.recording, name, key) / start, 2.0 * low)

    def specs_of(self, theta: FloatArray) -> dict[str, SensorSpec]:
        """Specs at theta."""
        specs = dict(self.start)
        for (name, key), shift in zip(self.keys, theta[: len(self.keys)], strict=True):
            specs[name] = _with(specs[name], key, getattr(specs[name], key) * float(np.exp(shift)))
        return specs

    def journal(self, theta: FloatArray, *, gate_level: float | None = None,
                robust_level: float | None = OUTLIER_LEVEL) -> Journal:  # fmt: skip
        """One pass of the filter."""
        self.runs += 1
        model = flight_model(self.recording, specs=self.specs_of(theta), gate_level=gate_level,
                             robust_level=robust_level, magnetic_field=self.field_of(theta))  # fmt: skip
        return self._ready.run(model)

    def log_likelihood(self, theta: FloatArray) -> float:
        """Of the innovations and, where it is sought, of the field at its place.

        An outlier counts with the logarithm of its NIS (the tail that its weight belongs to).
        """
        journal = self.journal(theta)
        used = journal.accepted
        limit = np.array([journal.model.robust_threshold(name) for name in journal.sensors])[journal.sensor]
        over = np.maximum(journal.nis / limit, 1.0)
        bounded = np.where(over > 1.0, limit * (1.0 + np.log(over)), journal.nis)
        return float(np.sum((journal.loglik + 0.5 * (journal.nis - bounded))[used])) + self._said_by_the_place(theta)

    def maximise(self, theta: FloatArray) -> FloatArray:
        """Quasi-Newton from the first guess; slopes by forward differences, since a pass is cheap."""
        from scipy.optimize import minimize

        if not len(theta):
            return theta
        step = 0.02

        def slope(x: FloatArray) -> tuple[float, FloatArray]:
            here = self.log_likelihood(x)
            gradient = [(self.log_likelihood(x + step * axis) - here) / step for axis in np.eye(len(x))]
            return -here, -np.array(gradient)

        found = minimize(slope, theta, jac=True, method="L-BFGS-B", bounds=self.bounds,
                         options={"maxiter": MOST_ITERATIONS, "ftol": GAIN})  # fmt: skip
        return np.asarray(found.x)

    def upper_walks(self, theta: FloatArray) -> FloatArray:
        """Every walk at the upper end of what the log allows."""
        best, moved = self.log_likelihood(theta), theta.copy()
        for i, (_, key) in enumerate(self.keys):
            if key != "bias_walk":
                continue
            low, high = theta[i], self.bounds[i, 1]
            for _ in range(8):
                middle = 0.5 * (low + high)
                trial = theta.copy()
                trial[i] = middle
                if 2.0 * (best - self.log_likelihood(trial)) < WALK_SLACK:
                    low = middle
                else:
                    high = middle
            moved[i] = low
        return moved

    def polished(self, theta: FloatArray) -> FloatArray:
        """The noise of each stream so that its NIS is one with the filter's own gate and no weights."""
        speed, before = np.ones(len(theta)), np.zeros(len(theta))
        for _ in range(POLISH_PASSES):
            journal, step = self.journal(theta, gate_level=GATE_LEVEL, robust_level=None), np.zeros(len(theta))
            for i, (name, key) in enumerate(self.keys):
                if name in journal.sensors and key in _PART:
                    step[i] = self._excess(journal, name, key)
            if np.max(np.abs(step), initial=0.0) < POLISHED:
                break
            speed = np.where(step * before < 0.0, 0.5 * speed, np.minimum(1.2 * speed, 2.0))  # they pull at each other
            theta, before = np.clip(theta + 0.5 * speed * step, *self.bounds.T), step
        return theta

    @staticmethod
    def _excess(journal: Journal, name: str, key: str) -> float:
        """Logarithm of the mean of nu^2 over its variance; what the gate refuses counts with the gate's limit."""
        stream, part = journal.stream(name), _PART[key] if name == "gps" else slice(None)
        seen = np.isfinite(stream.nis)
        if not np.any(seen):
            return 0.0
        squares = stream.nu[seen][:, part] ** 2 / np.einsum("kii->ki", stream.S[seen])[:, part]
        limit = journal.model.threshold(name) / stream.dof
        return float(np.clip(np.log(np.mean(np.minimum(np.mean(squares, axis=1), limit))), -1.0, 1.0))
