"""`FlightModel`: everything the filter believes about a recording before it sees the readings.

Nothing is guessed: a noise that neither the recording declares nor the caller passes is an error that names it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from dataclasses import field as default
from typing import Any, TypedDict, Unpack

import numpy as np

from sinan.estimator.filter.assumption import Assumption
from sinan.estimator.filter.field import field_of_the_log
from sinan.estimator.filter.layout import CAPACITY, StateLayout, layout_for, states_of
from sinan.estimator.filter.tails import NORMAL, spread_of, stray_over_centre
from sinan.sensors.accelerometer import Accelerometer
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.bounds import ASSUMED, Bounds
from sinan.sensors.constants import EARTH_RATE, STANDARD_GRAVITY
from sinan.sensors.covariates import camera_of
from sinan.sensors.errors import InputError
from sinan.sensors.gps import Gps
from sinan.sensors.gyroscope import Gyroscope
from sinan.sensors.level import Level
from sinan.sensors.magnetometer import Magnetometer
from sinan.sensors.model import SensorModel
from sinan.sensors.noise import BiasProcess, walked
from sinan.sensors.noise import colour as coloured
from sinan.sensors.recording import VELOCITY, Recording, SensorSpec, Stream
from sinan.sensors.registry import height_sensors, is_sensor, sensor
from sinan.sensors.registry import sensors as all_sensors
from sinan.sensors.sensor_type import Given
from sinan.sensors.zero_rate import ZeroRate

#: Streams that drive the filter, both in the table of the IMU.
DRIVERS = ("accel", "gyro")
#: False-alarm rate of the gate per reading: one good reading in a million is refused, so that no NIS is censored.
GATE_LEVEL = 1e-6
#: Mean acceleration that `level` allows over its window [m/s^2], of hand-held and multicopter motion alike: a choice.
#: Half and twice make 0.6 and 1.5 times the sigma of the tilt of a hover without a GPS (`bounds_of_work unaided`).
LEVEL_SIGMA = 1.0
#: Length of that window [s]. Only `LEVEL_SIGMA` squared times this matters, 0.1 (m/s^2)^2 s of white noise,
#: because it is shorter than a change of attitude.
LEVEL_WINDOW = 0.1


@dataclass(frozen=True)
class InStep:
    """Noise of the IMU in step with the motion: what integration between the samples misses, and errors of scale.

    Attributes
    ----------
    accel, gyro : share of the local mean square of second differences that is the variance of a sample; 1/6 where the
        samples are instants of a vibration faster than they show, whose integral is none
    rate : white noise of the rate per unit of the rate [sqrt(s)]; a scale error s of a body that turns one way for
        T makes s sqrt(T)
    """

    accel: float = 0.0
    gyro: float = 0.0
    rate: float = 0.0


@dataclass(frozen=True)
class LowPass:
    """Time constants of a low pass without delay for the samples of an IMU that shakes faster than it is logged; see
    `estimator.filter.low_pass`.

    Attributes
    ----------
    accel, gyro : s; 0: not at all
    """

    accel: float = 0.0
    gyro: float = 0.0


@dataclass(frozen=True)
class Upset:
    """An instant at which the motion is open again.

    Attributes
    ----------
    t : s
    attitude, velocity : 1-sigma about and along each axis, besides what the noise of the IMU makes [rad], [m/s]
    """

    t: float
    attitude: float
    velocity: float


@dataclass(frozen=True)
class Stray:
    """What a sensor answers that is not what it is to measure (`estimator.filter.tails`).

    Attributes
    ----------
    share : of its readings, before any is seen
    reach : such answers are as likely anywhere from zero to here, in the unit of a reading
    """

    share: float
    reach: float


@dataclass(frozen=True)
class FlightModel:
    """Layout, sensor models with their noise, environment, and how doubtful readings are treated.

    Attributes
    ----------
    layout : state blocks
    accel, gyro : the drivers of the process, with the standard deviation of one sample
    sensors : the sensors that update, by name, in the order of processing
    rate : nominal IMU rate [Hz]
    averaged : an IMU sample is the mean over the interval before its stamp
    g_n, m_n : (3,) gravity [m/s^2] and magnetic field in NED
    ground_down : down coordinate of the flat ground [m]
    w_ie_n : (3,) rate of the Earth in NED [rad/s]; zero where NED counts as inertial
    translation : position and velocity are estimated; False for an attitude estimator
    latency : by stream, how late its stamps are [s]: the reading belongs to t - latency
    gate_level : false-alarm rate of the chi-square gate on a whole reading; None: no gate
    robust_level : readings whose NIS has a smaller tail probability are given more noise, not refused; None: off
    colour : by sensor, first-order noise besides the white noise: first component of the reading, and the process
    in_step : noise of the IMU that goes with the motion
    low_pass : of the samples of an IMU that shakes faster than it is logged
    field : (3, 3) covariance of the error of the magnetic field m_n, a constant in NED; None: the field is known
    iron : (3,) hard iron from which the magnetometer's bias starts; None: from zero
    own_north : whether north is that of the first heading, since nothing but the compass tells a direction
    stamp_std : how far the stamps of the magnetometer may be off those of the gyroscope [s]
    rounding : by sensor, variance of each component's error of rounding, besides the white noise
    said : what a receiver says of its own fixes, by column the median (`eph`, `epv`, `s_variance`), where the level of
        their white noise is that of such a fix
    upsets : instants at which the motion is open again
    tail : degrees of freedom of the Student law of every innovation; None: normal
    stray : by sensor, what it answers besides, where its law is Student's
    relinearise : every reading is linear about the smoothed motion of the pass before (`estimator.filter.relinearise`)
    withheld : by stream, intervals of stamps [s] whose readings are predicted and journaled, but not used
    assumptions : what it takes of the recording without being told
    notes : what was decided while the model was made, for the report
    """

    layout: StateLayout
    accel: Accelerometer
    gyro: Gyroscope
    sensors: Mapping[str, SensorModel]
    rate: float
    averaged: bool
    g_n: FloatArray
    m_n: FloatArray
    ground_down: float
    w_ie_n: FloatArray
    translation: bool = True
    latency: Mapping[str, float] = default(default_factory=dict)
    gate_level: float | None = GATE_LEVEL
    robust_level: float | None = None
    colour: Mapping[str, tuple[tuple[int, BiasProcess], ...]] = default(default_factory=dict)
    in_step: InStep = InStep()
    low_pass: LowPass = LowPass()
    field: FloatArray | None = None
    iron: FloatArray | None = None
    own_north: bool = False
    stamp_std: float = 0.0
    rounding: Mapping[str, FloatArray] = default(default_factory=dict)
    said: Mapping[str, float] = default(default_factory=dict)
    upsets: tuple[Upset, ...] = ()
    tail: float | None = None
    stray: Mapping[str, Stray] = default(default_factory=dict)
    relinearise: bool = False
    withheld: Mapping[str, Sequence[tuple[float, float]]] = default(default_factory=dict)
    assumptions: tuple[Assumption, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def processes(self) -> tuple[BiasProcess, ...]:
        """Every bias and colour that is a state."""
        return (self.accel.bias, self.gyro.bias, *_processes(self.gyro, self.sensors, self.colour))

    def colour_of(self, sensor: str) -> tuple[tuple[int, BiasProcess], ...]:
        """Colour of one sensor's readings: first component, and the process."""
        return self.colour.get(sensor, ())

    def replace(self, **changes: object) -> FlightModel:
        """A copy with some attributes changed."""
        return replace(self, **changes)  # type: ignore[arg-type]

    def after(self, elapsed: float) -> FlightModel:
        """The model so many seconds later: biases have walked on, and nothing was read of them meanwhile."""

        def later(instrument: Any) -> Any:
            if not getattr(instrument, "bias_walk", 0.0):
                return instrument
            return replace(instrument, bias_std=walked(instrument.bias_std, instrument.bias_walk, elapsed))

        sensors = {name: later(model) for name, model in self.sensors.items()}
        return self.replace(accel=later(self.accel), gyro=later(self.gyro), sensors=sensors)

    @property
    def turn(self) -> BiasProcess | None:
        """What the compass's axes are turned by against those of the IMU; None: it is no state, or there is none."""
        return _turn(self.sensors)

    @property
    def place_is_read(self) -> bool:
        """Whether readings tell where the body is; else it is where it began, and what is assumed of its motion."""
        return bool(set(self.sensors) - set(ASSUMED) - set(height_sensors()) - {"mag", "base"})

    @property
    def height_is_read(self) -> bool:
        """Whether readings tell how high the body is."""
        return self.place_is_read or not set(self.sensors).isdisjoint(height_sensors())

    @property
    def rest(self) -> ZeroRate:
        """The pseudo-sensor `zero_rate`, of a model that has it."""
        found = self.sensors["zero_rate"]
        assert isinstance(found, ZeroRate)
        return found

    def withholds(self, sensor: str, t: FloatArray) -> BoolArray:
        """(n,) which readings of a sensor, by their stamps [s], are predicted but not used."""
        found = np.zeros(len(t), dtype=bool)
        for begin, end in self.withheld.get(sensor, ()):
            found |= (t >= begin) & (t < end)
        return found

    def threshold(self, dof: IntArray | int) -> FloatArray:
        """NIS above which a reading with so many components that tell something is refused."""
        return _quantile(self.gate_level, dof)

    def robust_threshold(self, dof: IntArray | int) -> FloatArray:
        """NIS above which a reading with so many components that tell something is given less weight."""
        return _quantile(self.robust_level, dof)

    def tail_of(self, sensor: str) -> float | None:
        """Degrees of freedom of the Student law of a sensor's innovations; of a bound on the motion none: it is met."""
        if sensor == "zero_rate" and self.tail is not None:
            return NORMAL
        return None if sensor in ASSUMED else self.tail

    def stray_of(self, sensor: str) -> float:
        """Logarithm of the density of what a sensor answers besides, over the share of its right answers."""
        stray = self.stray.get(sensor)
        if stray is None or self.tail_of(sensor) is None:
            return -np.inf
        return float(np.log(stray.share / (1.0 - stray.share)) - self.sensors[sensor].size * np.log(stray.reach))

    def spread(
        self, sensor: str, nis: FloatArray | float, dof: IntArray | int, normal: FloatArray | float
    ) -> FloatArray:
        """Factor by which the covariance of a reading's innovation grows where the reading is doubtful; else 1.

        Parameters
        ----------
        nis, dof : (k,) of readings of the sensor, and how many of their components, m, tell something
        normal : (k,) logarithm of the normal density
        """
        tail = self.tail_of(sensor)
        if tail is not None:
            return spread_of(nis, dof, tail, stray_over_centre(self.stray_of(sensor), normal, nis))
        return np.maximum(1.0, nis / self.robust_threshold(dof))


def aiding() -> tuple[str, ...]:
    """Streams that can update the filter, in the order in which equal time stamps are processed."""
    named = [entry for entry in all_sensors() if entry.kernel]
    return (*(entry.name for entry in sorted(named, key=lambda entry: entry.turn)), *ASSUMED)


def _quantile(level: float | None, dof: IntArray | int) -> FloatArray:
    if level is None:
        return np.full(np.shape(dof), np.inf)
    from scipy.special import chdtri

    return np.asarray(chdtri(dof, level))


class Beliefs(TypedDict, total=False):
    """Attributes of `FlightModel` that are taken as the caller gives them, and need nothing of the recording."""

    latency: Mapping[str, float]
    gate_level: float | None
    robust_level: float | None
    in_step: InStep
    low_pass: LowPass
    iron: FloatArray | None
    own_north: bool
    stamp_std: float
    rounding: Mapping[str, FloatArray]
    said: Mapping[str, float]
    upsets: tuple[Upset, ...]
    tail: float | None
    stray: Mapping[str, Stray]
    relinearise: bool


def flight_model(
    recording: Recording,
    *,
    specs: Mapping[str, SensorSpec] | None = None,
    use: Iterable[str] | None = None,
    level: Level | None = None,
    bounds: Bounds | None = None,
    magnetic_field: FloatArray | None = None,
    field: FloatArray | None = None,
    zero_rate: ZeroRate | None = None,
    axes_std: float = 0.0,
    turned_std: float = 0.0,
    lead: float = 0.0,
    **beliefs: Unpack[Beliefs],
) -> FlightModel:
    """The model of a recording: what it declares, completed by what the caller passes.

    Parameters
    ----------
    recording : a flight
    specs : noise estimated elsewhere, by sensor; what is set here goes before what the recording declares
    use : the aiding streams to use; default: all that are there
    level : the pseudo-sensor `level`; default: switched on, with `LEVEL_SIGMA`, where neither a GPS aids the position
        nor `bounds` are given
    bounds : of place and speed, where no GPS aids the position; see `sensors.bounds`
    magnetic_field : (3,) NED; default: the recording's, else found from the log with north meaning magnetic north
    field : see `FlightModel`; left out where no magnetometer is used
    zero_rate : windows in which the body does not turn
    axes_std : 1-sigma of what the gyroscope's scale and axes err by, see `Gyroscope`
    turned_std : 1-sigma of the turn of the compass's axes [rad], see `Magnetometer`
    lead : how much later than its velocity the position of a fix is [s], see `Gps`
    beliefs : latency, gate_level, robust_level, in_step, low_pass, iron, own_north, stamp_std, rounding, said, upsets,
        tail, stray, relinearise: see `FlightModel`

    Raises
    ------
    InputError : not a flight, no IMU, a noise that nobody declared, zero or negative noise, more states than there is
        room for
    """
    where, environment = recording.where, recording.environment
    rate = 1.0 / _imu_of(recording).step
    declared = {name: _merged(recording.spec(name), (specs or {}).get(name)) for name in (*DRIVERS, *aiding())}
    sensors, notes = _updating_sensors(recording, declared, set(aiding() if use is None else use), level, bounds)
    sensors = _as_believed(sensors, turned_std, lead) | ({} if zero_rate is None else {zero_rate.name: zero_rate})
    colour = _colours(where, declared, sensors)
    m_n, said = _field_at(recording, magnetic_field, "mag" in sensors)
    field = field if "mag" in sensors else None
    gyro = Gyroscope(*_driver(where, "gyro", declared["gyro"], rate), axes_std)
    if zero_rate is not None:
        colour = {**colour, zero_rate.name: ((0, zero_rate.of_gravity),)}
    blocks = [process.block for process in _processes(gyro, sensors, colour)]
    return FlightModel(
        layout=_layout(where, blocks if field is None else [*blocks, "field"]),
        accel=Accelerometer(*_driver(where, "accel", declared["accel"], rate)),
        gyro=gyro,
        sensors=sensors,
        rate=rate,
        averaged=_averaged(where, declared["accel"].imu_samples),
        g_n=np.array([0.0, 0.0, STANDARD_GRAVITY if environment.gravity is None else environment.gravity]),
        m_n=m_n,
        ground_down=environment.ground_down,
        w_ie_n=_earth_rate(recording),
        translation=bool(set(sensors) - {"mag", "base", "level", "zero_rate"}),
        colour=colour,
        field=field,
        notes=(*notes, *said),
        **beliefs,
    )


def _as_believed(sensors: Mapping[str, SensorModel], turned_std: float, lead: float) -> dict[str, SensorModel]:
    """The sensors with what is believed of them besides noise, see `flight_model`."""
    found = dict(sensors)
    for name, one in sensors.items():
        if isinstance(one, Magnetometer):
            found[name] = replace(one, axes_std=turned_std)
        elif isinstance(one, Gps) and one.size == 6:
            found[name] = replace(one, lead=lead)
    return found


def _layout(where: str, named: Sequence[str]) -> StateLayout:
    """Of the process and the named blocks."""
    if (wanted := states_of(named)) > CAPACITY:
        raise InputError(where, f"{wanted} states of {', '.join(named)}", f"at most {CAPACITY}: fewer streams at once")
    return layout_for(named)


def _imu_of(recording: Recording) -> Stream:
    """The IMU's stream of a flight."""
    where = recording.where
    if recording.kind != "flight" or "imu" not in recording.streams:
        found = f'kind = "{recording.kind}"' if recording.kind != "flight" else "no stream imu"
        raise InputError(where, found, "a flight with an imu stream: poses are for `sinan calibrate` and `sinan trace`")
    imu = recording.streams["imu"]
    if len(imu) < 2:
        raise InputError(where, f"{len(imu)} row", "at least 2 IMU samples", "stream imu")
    return imu


def _updating_sensors(
    recording: Recording,
    declared: Mapping[str, SensorSpec],
    wanted: Collection[str],
    level: Level | None,
    bounds: Bounds | None,
) -> tuple[Mapping[str, SensorModel], list[str]]:
    """The sensors that update the filter, with what stands for a missing GPS; and what was decided about them."""
    sensors, notes = _aiding_sensors(recording, declared, wanted)
    if "gps" not in sensors:
        more, said = _assumed(level, "level" in wanted, bounds)
        sensors, notes = {**sensors, **more}, [*notes, *said]
    if not set(sensors) - set(ASSUMED):
        notes.append("no aiding stream: heading and position drift")
    return sensors, notes


def _aiding_sensors(
    recording: Recording, declared: Mapping[str, SensorSpec], wanted: Collection[str]
) -> tuple[dict[str, SensorModel], list[str]]:
    """The sensors that are there and wanted, and what was left out."""
    named = [name for name in aiding() if name in recording.streams and name in wanted]
    found = {name: _sensor(recording.where, name, declared[name], recording) for name in named}
    why = ""
    if "base" in found and "gps" not in found:
        why = "there is no gps whose bias it could see"
    elif "base" in found and found["gps"].bias is None:
        why = "the gps is declared to have no bias that it could see"
    if why:
        del found["base"]
    return found, [f"base: left out, {why}"] if why else []


def _assumed(level: Level | None, wanted: bool, bounds: Bounds | None) -> tuple[Mapping[str, SensorModel], list[str]]:
    """What stands for a position that no GPS gives: bounds, else `level`."""
    if bounds is not None:
        return bounds.sensors, []
    if level is None and not wanted:
        return {}, []
    chosen = level or Level(LEVEL_SIGMA, LEVEL_WINDOW)
    return {"level": chosen}, [f"level: on, sigma {chosen.sigma:g} m/s^2, since no gps sees the tilt"]


def _turn(sensors: Mapping[str, SensorModel]) -> BiasProcess | None:
    """Of the compass's axes; None: it is no state, or there is none."""
    compass = sensors.get("mag")
    return compass.axes if isinstance(compass, Magnetometer) else None


def _processes(
    gyro: Gyroscope, sensors: Mapping[str, SensorModel], colour: Mapping[str, tuple[tuple[int, BiasProcess], ...]]
) -> tuple[BiasProcess, ...]:
    """Biases of the sensors, axes of gyroscope and compass, and colour."""
    coloured = (process for parts in colour.values() for _, process in parts)
    found = (*(model.bias for model in sensors.values()), gyro.axes, _turn(sensors), *coloured)
    return tuple(process for process in found if process is not None)


def _merged(declared: SensorSpec, given: SensorSpec | None) -> SensorSpec:
    """`given` where it says something, else `declared`."""
    if given is None:
        return declared
    said = {f.name: getattr(given, f.name) for f in fields(given) if getattr(given, f.name) is not None}
    if given.imu_samples == "instant":
        said.pop("imu_samples")
    return replace(declared, **said)


def _positive(where: str, sensor: str, key: str, value: float | None) -> float:
    place = f"[sensors.{sensor}] {key}"
    if value is None:
        raise InputError(
            where, "not declared", "a noise level: declare it, or estimate it from the log and pass it", place
        )
    if not np.isfinite(value) or value <= 0.0:
        raise InputError(where, f"{value:g}", "a positive number", place)
    return float(value)


def _not_negative(where: str, sensor: str, key: str, value: float | None, default: float | None = None) -> float:
    if value is None and default is not None:
        return default
    place = f"[sensors.{sensor}] {key}"
    if value is None:
        raise InputError(where, "not declared", "the size of the bias: declare it (0: none), or pass it", place)
    if not np.isfinite(value) or value < 0.0:
        raise InputError(where, f"{value:g}", "zero or a positive number", place)
    return float(value)


def _driver(where: str, name: str, spec: SensorSpec, rate: float) -> tuple[float, float, float]:
    """Standard deviation of one IMU sample, and the sizes of the bias."""
    if spec.noise_density is None and spec.noise_std is not None:
        sigma = _positive(where, name, "noise_std", spec.noise_std)
    else:
        sigma = _positive(where, name, "noise_density", spec.noise_density) * np.sqrt(rate)
    bias_std = _not_negative(where, name, "bias_std", spec.bias_std)
    return float(sigma), bias_std, _not_negative(where, name, "bias_walk", spec.bias_walk)


def _sensor(where: str, name: str, spec: SensorSpec, recording: Recording) -> SensorModel:
    entry = sensor(name)
    if entry.make is None:
        return camera_of(recording)
    sigma = _positive(where, name, "noise_std", spec.noise_std)
    std = walk = 0.0
    if entry.bias:
        optional = 0.0 if entry.bias_optional else None
        std = _not_negative(where, name, "bias_std", spec.bias_std, optional)
        walk = _not_negative(where, name, "bias_walk", spec.bias_walk, optional)
    sigma_velocity = None
    if entry.velocity and recording.streams[name].has(VELOCITY):
        sigma_velocity = _positive(where, name, "velocity_noise_std", spec.velocity_noise_std)
    angles = np.zeros(1) if spec.angles is None else np.asarray(spec.angles, dtype=np.float64)
    return entry.make(Given(sigma, std, walk, sigma_velocity, angles))


def _colour(where: str, name: str, spec: SensorSpec) -> tuple[tuple[int, BiasProcess], ...]:
    """First-order noise of one sensor, where its size and time are given."""
    parts, width = [], len(sensor(name).colour) if is_sensor(name) else 0
    for key, block, first in (("colour_std", f"c_{name}", 0), ("velocity_colour_std", f"c_{name}_velocity", 3)):
        std = getattr(spec, key)
        if std:
            time = _positive(where, name, "colour_time", spec.colour_time)
            parts.append((first, coloured(block, width, _positive(where, name, key, std), time)))
    return tuple(parts)


def _colours(
    where: str, declared: Mapping[str, SensorSpec], sensors: Mapping[str, SensorModel]
) -> dict[str, tuple[tuple[int, BiasProcess], ...]]:
    """The noise in time of each sensor that has some."""
    found = {name: _colour(where, name, declared[name]) for name in sensors if name in declared}
    return {name: parts for name, parts in found.items() if parts}


def _field_at(recording: Recording, given: FloatArray | None, needed: bool) -> tuple[FloatArray, list[str]]:
    """(3,) magnetic field in NED, given, declared or found from the log; zero where no magnetometer needs it."""
    m_n = recording.environment.magnetic_field if given is None else given
    if m_n is not None:
        return np.asarray(m_n, dtype=np.float64), []
    if not needed:
        return np.zeros(3), []
    said = "magnetic field: not declared, found from the log; north is magnetic north"
    return np.asarray(field_of_the_log(recording), dtype=np.float64), [said]


def _averaged(where: str, samples: str) -> bool:
    if samples not in ("instant", "average"):
        raise InputError(where, f'"{samples}"', '"instant" or "average"', "[sensors.accel] imu_samples")
    return samples == "average"


def _earth_rate(recording: Recording) -> FloatArray:
    """(3,) rate of the Earth in NED [rad/s]: w_e (cos lat, 0, -sin lat); zero unless the recording says it is seen."""
    if not recording.environment.earth_rotation:
        return np.zeros(3)
    if recording.origin is None:
        raise InputError(recording.where, "none", "the latitude, since earth_rotation = true", "[origin]")
    latitude = np.deg2rad(recording.origin[0])
    return EARTH_RATE * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
