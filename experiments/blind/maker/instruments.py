"""Instruments from good to poor: rates, noise and wandering biases, and the noise itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sinan.experiments.blind.maker.catalogue import log_uniform
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import SensorSpec


@dataclass(frozen=True)
class Instrument:
    """One stream of one sensor as it really is; the recording's header may say otherwise.

    Attributes
    ----------
    rate : readings a second [Hz]
    noise : standard deviation of one reading [unit]
    walk : random walk of its bias [unit/s/sqrt(Hz)]
    bias : 1-sigma of the bias at the start [unit]
    velocity_noise : of GPS velocity [m/s]; zero: it gives none
    """

    rate: float
    noise: float
    walk: float
    bias: float
    velocity_noise: float = 0.0

    def spec(self) -> SensorSpec:
        """What an honest header declares of a sensor with noise per reading."""
        speed = self.velocity_noise if self.velocity_noise > 0.0 else None
        return SensorSpec(noise_std=self.noise, velocity_noise_std=speed, bias_walk=self.walk, bias_std=self.bias)

    def density_spec(self) -> SensorSpec:
        """What an honest header declares of an accelerometer or gyroscope: N = sigma / sqrt(rate)."""
        return SensorSpec(noise_density=self.noise / np.sqrt(self.rate), bias_walk=self.walk, bias_std=self.bias)


def draw_imu(rng: np.random.Generator, rate: float) -> dict[str, Instrument]:
    """Accelerometer and gyroscope, from phone parts to good MEMS (densities of data sheets)."""
    accel_density, gyro_density = log_uniform(rng, 6e-4, 5e-3), log_uniform(rng, 5e-5, 5e-4)
    return {
        "accel": Instrument(
            rate, accel_density * np.sqrt(rate), log_uniform(rng, 4e-5, 6e-4), log_uniform(rng, 0.02, 0.15)
        ),
        "gyro": Instrument(
            rate, gyro_density * np.sqrt(rate), log_uniform(rng, 2e-6, 4e-5), log_uniform(rng, 1e-3, 0.015)
        ),
    }


def draw_mag(rng: np.random.Generator, field: float) -> Instrument:
    """A magnetometer; noise and bias go with the field's unit."""
    return Instrument(
        float(rng.choice([20.0, 25.0, 50.0, 75.0])),
        field * log_uniform(rng, 2.5e-3, 0.015),
        field * log_uniform(rng, 1e-5, 3e-4),
        field * log_uniform(rng, 0.005, 0.04),
    )


def draw_baro(rng: np.random.Generator) -> Instrument:
    """A barometric altimeter."""
    return Instrument(
        float(rng.choice([10.0, 20.0, 25.0, 40.0])),
        log_uniform(rng, 0.08, 0.5),
        log_uniform(rng, 3e-3, 0.05),
        log_uniform(rng, 0.3, 2.0),
    )


def draw_ranger(rng: np.random.Generator, laser: bool) -> Instrument:
    """A sonar or a laser; half of them have no bias state."""
    bias = log_uniform(rng, 0.005, 0.03) if rng.uniform() < 0.5 else 0.0
    walk = bias * log_uniform(rng, 0.003, 0.03)
    noise = log_uniform(rng, 0.008, 0.03) if laser else log_uniform(rng, 0.01, 0.05)
    return Instrument(float(rng.choice([10.0, 15.0, 20.0, 25.0])), noise, walk, bias)


def draw_gps(rng: np.random.Generator) -> Instrument:
    """A receiver: every fifth with carrier phase and so without a wandering bias, every fifth without velocity."""
    rate = float(rng.choice([5.0, 8.0, 10.0]))
    speed = log_uniform(rng, 0.03, 0.2) if rng.uniform() < 0.8 else 0.0
    if rng.uniform() < 0.2:
        return Instrument(rate, log_uniform(rng, 0.015, 0.08), 0.0, 0.0, speed)
    return Instrument(rate, log_uniform(rng, 0.25, 1.2), log_uniform(rng, 0.01, 0.1), log_uniform(rng, 0.3, 2.0), speed)


def random_walk(rng: np.random.Generator, t: FloatArray, instrument: Instrument, size: int) -> FloatArray:
    """(n, size) a bias: its first value has the variance bias^2, which then grows by walk^2 t."""
    step = np.sqrt(np.diff(t, prepend=t[0]))[:, None] * instrument.walk
    first = instrument.bias * rng.normal(size=size)
    return np.asarray(first + np.cumsum(step * rng.normal(size=(len(t), size)), axis=0))


def white(rng: np.random.Generator, n: int, sigma: FloatArray) -> FloatArray:
    """(n, k) independent noise with standard deviation sigma (k,)."""
    return rng.normal(size=(n, len(sigma))) * sigma


def specs(instruments: Mapping[str, Instrument]) -> dict[str, SensorSpec]:
    """The honest header of all instruments."""
    return {
        name: instrument.density_spec() if name in ("accel", "gyro") else instrument.spec()
        for name, instrument in instruments.items()
    }
