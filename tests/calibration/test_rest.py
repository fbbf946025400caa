"""Noise at rest: the part is found, the conventions hold, what is not seen is bounded."""

from __future__ import annotations

import tomllib
from functools import cache

import numpy as np
import pytest
from scipy.signal import welch

from sinan.calibration.levels.rest import Rest, declared, deviation_interval, noise_at_rest
from sinan.experiments.commands.allan import as_json, toml_of
from sinan.experiments.report.allan_words import summary
from sinan.sensors.errors import InputError
from sinan.sensors.noise import BiasProcess, random_walk, sample_std
from sinan.sensors.recording import ACCEL, GYRO, Recording, Stream

RATE, ACCEL_DENSITY, GYRO_DENSITY, WALK = 50.0, 2e-3, 2e-4, 1e-4
REST = (60.0, 660.0)  # s


@cache
def recording(handled: bool = True) -> Recording:
    """Ten minutes on a table between two minutes in the hand."""
    rng = np.random.default_rng(5)
    t = np.arange(0.0, 720.0, 1.0 / RATE) + 3.0
    accel = np.array([0.1, -0.2, -9.8]) + sample_std(ACCEL_DENSITY, RATE) * rng.standard_normal((len(t), 3))
    gyro = sample_std(GYRO_DENSITY, RATE) * rng.standard_normal((len(t), 3))
    gyro += random_walk(t, BiasProcess("b", 3, 0.0, WALK), rng)
    moving = ((t - 3.0 < REST[0]) | (t - 3.0 > REST[1]))[:, None]
    if handled:
        accel = accel + moving * np.sin(7.0 * t[:, None] + np.arange(3.0))
        gyro = gyro + moving * 0.5 * np.cos(5.0 * t[:, None] + np.arange(3.0))
    columns = dict(zip((*ACCEL, *GYRO), np.hstack([accel, gyro]).T, strict=True))
    return Recording("table", "flight", {"imu": Stream(t, columns)})


@cache
def rest() -> Rest:
    return noise_at_rest(recording())


def test_the_part_at_rest_is_found() -> None:
    """To the window over which scatter is measured, and what is cut off."""
    assert (rest().start - 3.0, rest().stop - 3.0) == pytest.approx(REST, abs=1.0)


def test_noise_and_walk_are_those_that_were_simulated() -> None:
    for channel in (*rest().of("accel"), *rest().of("gyro")):
        density = ACCEL_DENSITY if channel.sensor == "accel" else GYRO_DENSITY
        assert channel.fit.noise_density == pytest.approx(density, abs=3.0 * channel.fit.std[0])
        assert channel.sample_std == pytest.approx(sample_std(density, RATE), rel=0.03)
    for channel in rest().of("gyro"):
        assert channel.seen(2)
        assert channel.fit.bias_walk == pytest.approx(WALK, rel=0.4)
    for channel in rest().of("accel"):
        assert not channel.seen(2)
        assert channel.bound(2) < 3e-4


def test_data_sheets_are_one_sided() -> None:
    """Welch's density is one-sided: sqrt of its mean is what a data sheet says, and sqrt(2) times ours."""
    stream, channel = recording(False).streams["imu"], noise_at_rest(recording(False)).of("accel")[0]
    _, density = welch(stream["accel_x"] - np.mean(stream["accel_x"]), fs=RATE, nperseg=1024)
    level = float(np.sqrt(np.mean(density[10:-1])))
    assert channel.one_sided == pytest.approx(level, rel=0.03)
    assert channel.fit.noise_density == pytest.approx(level / np.sqrt(2.0), rel=0.03)


def test_the_intervals_hold_as_often_as_they_say() -> None:
    """95 % of the deviations of white noise, 40 runs: at each averaging time no less than 34 (p = 0.003)."""
    from sinan.calibration.levels.allan import fit_allan

    inside = []
    for seed in range(40):
        values = np.random.default_rng(seed).standard_normal(4000)
        fit = fit_allan(values, 1.0)
        low, high = deviation_interval(fit, len(values), 1.0)
        inside.append((low < 1.0 / np.sqrt(fit.tau)) & (1.0 / np.sqrt(fit.tau) < high))
    assert np.all(np.sum(inside, axis=0) >= 34)


def test_a_low_pass_in_the_sensor_does_not_lower_the_noise() -> None:
    """Three neighbours averaged: the shortest times are off the line of slope -1/2 and are left out."""
    known = recording(False).streams["imu"]
    smooth = {name: np.convolve(column, np.full(3, 1 / 3), "same") for name, column in known.columns.items()}
    found = noise_at_rest(recording(False).replace(streams={"imu": Stream(known.t, smooth).rows(slice(2, -2))}))
    for channel in found.of("accel"):
        assert channel.fit.first > 0
        assert channel.fit.noise_density == pytest.approx(ACCEL_DENSITY, rel=0.08)  # by the scatter alone 42 % too low


def test_what_it_prints_is_what_a_recording_reads() -> None:
    tables = tomllib.loads(toml_of(rest()))["sensors"]
    assert tables["gyro"]["bias_walk"] == pytest.approx(WALK, rel=0.3)
    assert "bias_walk" not in tables["accel"]
    for sensor, keys in declared(rest()).items():
        assert {key: float(f"{value:.3g}") for key, value in keys.items()} == tables[sensor]
    told = as_json(rest(), 3.0) | {"called": "table"}
    assert "599.1 s at rest, from 60.44 s on" in summary(told)


def test_a_flight_is_no_rest() -> None:
    known = recording(False).streams["imu"]
    shaken = dict(known.columns) | {"accel_x": known["accel_x"] + 2.0 * np.sin(40.0 * known.t)}
    with pytest.raises(InputError, match="scatters by"):
        noise_at_rest(recording(False).replace(streams={"imu": Stream(known.t, shaken)}))
