"""Which effects a kind of recording can show, how large they come, and what the recording must then hold.

Sizes are drawn log-uniform between the two bounds: the lower one is what a good instrument leaves after its maker's
calibration, mostly below what a flight can show; the upper one a bad or badly mounted instrument. The size is the norm
of beta; its direction is uniform. Magnetic offsets are shares of the field's norm, steps multiples of the noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sinan.experiments.blind.maker.turning import random_direction
from sinan.sensors.arrays import FloatArray

KINDS = ("flight", "hand", "accel_poses", "mag_poses", "gyro_turns", "camera")
FLIGHT, HAND, ACCEL, MAG, TURNS, CAMERA = KINDS


@dataclass(frozen=True)
class Entry:
    """One effect of the catalogue.

    Attributes
    ----------
    low, high : bounds of the norm of beta, in the effect's own unit
    parameters : of beta
    kinds : recordings that can show it
    needs : covariates: current, motors, airspeed, temperature_imu, temperature_baro, vibration, tilt, low
    positive : beta > 0
    of_field : beta is a share of the norm of the magnetic field
    shape : by which the direction of beta is multiplied, where its components differ in size; empty: by one
    """

    low: float
    high: float
    parameters: int
    kinds: tuple[str, ...] = (FLIGHT,)
    needs: tuple[str, ...] = ()
    positive: bool = False
    of_field: bool = False
    shape: tuple[float, ...] = ()


CATALOGUE: Mapping[str, Entry] = {
    "accel.cross_axis": Entry(5e-4, 0.05, 3, (FLIGHT, ACCEL, TURNS)),  # rad
    "accel.scale": Entry(1e-3, 0.05, 3),  # 1
    "accel.scale_nonlinearity": Entry(2e-5, 3e-3, 3, (FLIGHT, ACCEL, TURNS)),  # 1/(m/s^2)
    "accel.temperature": Entry(2e-4, 0.03, 3, (FLIGHT, ACCEL), ("temperature_imu",)),  # m/s^2/K
    "accel.lever_arm": Entry(0.01, 0.6, 3),  # m
    "accel.vibration": Entry(2e-4, 0.05, 3, (FLIGHT,), ("vibration",)),  # 1/(m/s^2)
    "accel.misalignment": Entry(1e-3, 0.08, 3, (FLIGHT, HAND, CAMERA)),  # rad
    "gyro.scale": Entry(5e-4, 0.05, 3, (FLIGHT, HAND, TURNS, CAMERA)),  # 1
    "gyro.cross_axis": Entry(5e-4, 0.05, 6, (FLIGHT, HAND, TURNS)),  # rad
    "gyro.temperature": Entry(1e-5, 3e-3, 3, (FLIGHT, HAND, TURNS), ("temperature_imu",)),  # rad/s/K
    "gyro.g_sensitivity": Entry(2e-5, 4e-3, 9, (FLIGHT, HAND, TURNS)),  # rad/s/(m/s^2)
    "mag.cross_axis": Entry(2e-3, 0.15, 3, (FLIGHT, HAND, MAG)),  # 1
    "mag.scale": Entry(3e-3, 0.2, 3, (FLIGHT, HAND)),  # 1
    "mag.current": Entry(1e-4, 0.03, 3, (FLIGHT, MAG), ("current",), of_field=True),  # field/A
    "mag.temperature": Entry(1e-4, 0.015, 3, (FLIGHT, HAND, MAG), ("temperature_imu",), of_field=True),  # field/K
    "mag.declination": Entry(4e-3, 0.4, 1),  # rad
    "mag.misalignment": Entry(4e-3, 0.25, 3, (FLIGHT, HAND, CAMERA)),  # rad
    "baro.airspeed": Entry(2e-3, 0.2, 1, (FLIGHT,), ("airspeed",)),  # m/(m/s)^2
    "baro.temperature": Entry(5e-3, 0.6, 1, (FLIGHT,), ("temperature_baro",)),  # m/K
    "baro.propwash": Entry(0.2, 10.0, 1, (FLIGHT,), ("motors", "low")),  # m
    "baro.lag": Entry(0.05, 2.0, 1, positive=True),  # s
    "baro.scale": Entry(3e-3, 0.12, 1),  # 1
    "sonar.sound_speed": Entry(2e-3, 0.1, 1),  # 1
    "sonar.mount_offset": Entry(0.02, 0.6, 1),  # m
    "sonar.beam_cone": Entry(0.03, 0.5, 1, (FLIGHT,), ("tilt",), positive=True),  # rad
    "sonar.terrain_slope": Entry(3e-3, 0.2, 2),  # 1
    "laser.boresight": Entry(4e-3, 0.15, 2, (FLIGHT,), ("tilt",)),  # rad
    "laser.mount_offset": Entry(0.02, 0.6, 1),  # m
    "laser.scale": Entry(2e-3, 0.08, 1),  # 1
    "laser.terrain_slope": Entry(3e-3, 0.2, 2),  # 1
    "gps.lever_arm": Entry(0.05, 3.0, 3, (FLIGHT, CAMERA)),  # m
    "gps.latency": Entry(0.01, 0.5, 1, (FLIGHT, CAMERA), positive=True),  # s
    "mag.time_offset": Entry(2e-3, 0.2, 1),  # s
    "baro.time_offset": Entry(0.02, 0.8, 1),  # s
    "sonar.time_offset": Entry(0.01, 0.5, 1),  # s
    "laser.time_offset": Entry(0.01, 0.5, 1),  # s
    "camera.focal": Entry(5e-4, 0.05, 2, (CAMERA,)),  # 1
    "camera.principal_point": Entry(0.3, 30.0, 2, (CAMERA,)),  # pixels
    "camera.distortion": Entry(5e-3, 0.3, 4, (CAMERA,), shape=(1.0, 0.5, 0.02, 0.02)),  # 1
    "camera.misalignment": Entry(1e-3, 0.1, 3, (CAMERA,)),  # rad
    "camera.lever_arm": Entry(0.01, 0.5, 3, (CAMERA,)),  # m
    "camera.time_offset": Entry(1e-3, 0.1, 1, (CAMERA,)),  # s
}

#: Kinds whose recordings can show a step or a transient of a stream, and with how many values one reading has.
LOCAL_STREAMS: Mapping[str, tuple[int, tuple[str, ...]]] = {
    "accel": (3, (FLIGHT, ACCEL)),
    "gyro": (3, (FLIGHT, HAND, TURNS)),
    "mag": (3, (FLIGHT, HAND, MAG)),
    "baro": (1, (FLIGHT,)),
    "sonar": (1, (FLIGHT,)),
    "laser": (1, (FLIGHT,)),
    "gps": (3, (FLIGHT,)),
    "base": (3, (FLIGHT,)),
}
LOCAL_KINDS = ("step", "transient", "outliers")
#: Offset of a step or transient in standard deviations of one reading; of the accelerometer and gyroscope of a flight,
#: whose samples are integrated, in m/s^2 and rad/s.
STEP_SIZE = (0.3, 30.0)
IMU_STEP_SIZE: Mapping[str, tuple[float, float]] = {"accel": (0.01, 1.0), "gyro": (5e-4, 0.05)}
#: Share of the readings that are wrong, and by how many standard deviations.
OUTLIER_SHARE, OUTLIER_SIZE = (3e-3, 0.08), (6.0, 25.0)
#: Length of a transient [s], or share of the poses.
TRANSIENT_LENGTH, TRANSIENT_SHARE = (3.0, 20.0), (0.1, 0.3)


@dataclass(frozen=True)
class Hidden:
    """One effect that the recording has and does not declare.

    Attributes
    ----------
    name : as in docs/effects.md
    beta : its parameters; empty until a time-localised one is sized by the noise; outliers: the share of readings
    interval : (from, to) [s] of a time-localised effect, else None
    wrong : by how many sigma each reading is off that outliers have made wrong; where its norm alone is known, the norm
    """

    name: str
    beta: FloatArray
    interval: tuple[float, float] | None = None
    wrong: tuple[float, ...] = ()

    @property
    def stream(self) -> str:
        """The part of the name before the dot."""
        return self.name.split(".")[0]

    @property
    def effect(self) -> str:
        """The part of the name after the dot."""
        return self.name.split(".")[1]


def names_for(kind: str, outliers: bool = True) -> tuple[str, ...]:
    """Every effect that a kind of recording can show."""
    exact = [name for name, entry in CATALOGUE.items() if kind in entry.kinds]
    local = [
        f"{stream}.{what}" for stream, (_, kinds) in LOCAL_STREAMS.items() if kind in kinds
        for what in LOCAL_KINDS if outliers or what != "outliers"
    ]  # fmt: skip
    return (*exact, *local)


def draw_names(rng: np.random.Generator, kind: str, count: int, sensor: str, outliers: bool) -> tuple[str, ...]:
    """`count` names: time-localised ones together as likely as three of the others, sensible together.

    `sensor` restricts a recording that calibrates one instrument to the effects of that instrument.
    """
    names = [name for name in names_for(kind, outliers) if not sensor or name.startswith(sensor + ".")]
    local = [name.split(".")[1] in LOCAL_KINDS for name in names]
    weight = np.where(local, min(3.0, 0.25 * len(names)) / max(sum(local), 1), 1.0)
    chosen: list[str] = []
    for name in rng.choice(names, size=len(names), replace=False, p=weight / weight.sum()):
        if len(chosen) < count and all(compatible(str(name), other) for other in chosen):
            chosen.append(str(name))
    return tuple(chosen)


def compatible(name: str, other: str) -> bool:
    """Whether two effects have a defined sum: on one stream no delay comes with a second effect, nor two local ones.

    The exception is `gps.latency` with `gps.lever_arm`, whose sum is defined.
    """
    (stream, effect), (other_stream, other_effect) = name.split("."), other.split(".")
    if stream != other_stream or {name, other} == {"gps.latency", "gps.lever_arm"}:
        return True
    delays = {"time_offset", "lag", "latency"}
    both_local = effect in LOCAL_KINDS and other_effect in LOCAL_KINDS
    return not (both_local or effect in delays or other_effect in delays)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(low * (high / low) ** rng.uniform())


def draw_beta(rng: np.random.Generator, name: str, field: float) -> FloatArray:
    """The parameters of an effect of the catalogue; `field` is the norm of the magnetic field."""
    entry = CATALOGUE[name]
    size = log_uniform(rng, entry.low, entry.high) * (field if entry.of_field else 1.0)
    beta = size * random_direction(rng, entry.parameters) * (np.array(entry.shape) if entry.shape else 1.0)
    return np.abs(beta) if entry.positive else beta


def draw_interval(rng: np.random.Generator, what: str, begin: float, end: float, poses: bool) -> tuple[float, float]:
    """From when to when: a step in the middle 70 % of the time and to the end, a transient of some length within it."""
    length = end - begin
    if what == "outliers":
        return begin, end
    if what == "step":
        return begin + float(rng.uniform(0.15, 0.85)) * length, end
    duration = rng.uniform(*TRANSIENT_SHARE) * length if poses else log_uniform(rng, *TRANSIENT_LENGTH)
    duration = min(float(duration), 0.4 * length)
    start = begin + float(rng.uniform(0.1, 0.9 - duration / length)) * length
    return start, start + duration


def draw_local(rng: np.random.Generator, stream: str, what: str, sigma: float, poses: bool) -> FloatArray:
    """Offset of a step or transient of one stream, or the share of outliers."""
    if what == "outliers":
        return np.array([log_uniform(rng, *OUTLIER_SHARE)])
    bounds = STEP_SIZE if poses or stream not in IMU_STEP_SIZE else IMU_STEP_SIZE[stream]
    size = log_uniform(rng, *bounds)
    if poses or stream not in IMU_STEP_SIZE:
        size *= sigma
    return size * random_direction(rng, LOCAL_STREAMS[stream][0])


def needed(names: Sequence[str]) -> frozenset[str]:
    """The covariates and streams that effects need, streams by their sensor's name."""
    covariates = {need for name in names if name in CATALOGUE for need in CATALOGUE[name].needs}
    return frozenset(covariates | {name.split(".")[0] for name in names})
