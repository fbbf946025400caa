"""What a wrong unit looks like, and that legitimate readings pass."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.plausible import check_field, check_units
from sinan.sensors.recording import ACCEL, GYRO, MAG, Environment, Recording, Stream
from sinan.sensors.rotation import quaternion_exp, quaternion_multiply, rotate_back

RATE = 100.0


def turning(sway: float = 0.6, seconds: float = 30.0, seed: int = 1) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time, rate and attitude of a body that sways about all axes, by `sway` rad/s."""
    t = np.arange(int(seconds * RATE)) / RATE
    w = sway * np.stack([np.sin(0.9 * t), np.cos(1.3 * t), np.sin(0.5 * t + 1.0)], axis=-1)
    q = np.empty((len(t), 4))
    q[0] = [1.0, 0.0, 0.0, 0.0]
    for k in range(1, len(t)):
        q[k] = quaternion_multiply(q[k - 1], quaternion_exp(0.5 * (w[k - 1] + w[k]) / RATE))
    return t, w, q


def recording(
    accel_scale: float = 1.0, gyro_scale: float = 1.0, hover: bool = False, gravity: float | None = None,
    kind: str = "flight", time_scale: float = 1.0,
) -> Recording:  # fmt: skip
    """IMU and magnetometer with noise and biases; `hover`: the thrust is the only specific force."""
    rng = np.random.default_rng(3)
    t, w, q = turning(0.3 if hover else 0.6)
    f = np.tile([0.0, 0.0, -9.81], (len(t), 1)) if hover else rotate_back(q, np.array([0.0, 0.0, -9.81]))
    f = f + rng.normal(scale=0.05, size=f.shape)
    m = rotate_back(q, np.array([0.5, 0.0, 0.8])) + 0.1 + rng.normal(scale=0.01, size=f.shape)
    w = w + 0.02 + rng.normal(scale=0.01, size=w.shape)
    columns = dict(zip((*ACCEL, *GYRO), [*(accel_scale * f).T, *(gyro_scale * w).T], strict=True))
    imu = Stream(t * time_scale, columns)
    mag = Stream(t[::10] * time_scale, dict(zip(MAG, m[::10].T, strict=True)))
    environment = Environment(gravity=gravity)
    return Recording("units", kind, {"imu": imu, "mag": mag}, environment=environment)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "looks"),
    [
        ({"accel_scale": 1.0 / 9.81}, "looks like g;"),
        ({"accel_scale": 1000.0 / 9.81}, "looks like milli-g"),
        ({"accel_scale": 16384.0 / 9.81}, "looks like raw counts"),
        ({"gyro_scale": 180.0 / np.pi}, "looks like deg/s"),
        ({"gyro_scale": 180.0 / np.pi, "hover": True}, "looks like deg/s"),
        ({"gyro_scale": 180.0 / np.pi, "kind": "poses"}, "looks like deg/s"),
        ({"gyro_scale": 2e4}, "looks like raw counts"),
        ({"accel_scale": 1.0 / 9.81, "kind": "poses", "gravity": 9.8}, "looks like g;"),
        ({"time_scale": 1e3}, "time looks like ms"),
        ({"time_scale": 1e6}, "time looks like us"),
        ({"time_scale": 1e3, "kind": "poses"}, "time looks like ms read as s, or us as ms"),
        ({"accel_scale": 1000.0, "kind": "poses"}, "1000 times gravity"),
        ({"accel_scale": 1e-3, "kind": "poses"}, "gravity / 1000"),
    ],
)
def test_wrong_unit_is_recognised(changes: dict[str, float], looks: str) -> None:
    with pytest.raises(InputError, match=looks):
        check_units(recording(**changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"hover": True},
        {"kind": "poses"},
        {"kind": "poses", "accel_scale": 1.0 / 9.81, "gravity": 1.0},
        {"kind": "poses", "gravity": 1.0},
        {"accel_scale": 1.3},
        {"accel_scale": 0.8},
        {"gyro_scale": 1.2},
    ],
)
def test_legitimate_readings_pass(changes: dict[str, float]) -> None:
    check_units(recording(**changes))  # type: ignore[arg-type]


@pytest.mark.parametrize("changes", [{}, {"hover": True}, {"kind": "poses"}])
def test_exchanged_columns_are_told_from_a_wrong_unit(changes: dict[str, bool]) -> None:
    right = recording(**changes)  # type: ignore[arg-type]
    imu = right.streams["imu"]
    swapped = dict(zip((*GYRO, *ACCEL), (imu[name] for name in (*ACCEL, *GYRO)), strict=True))
    with pytest.raises(InputError, match=r"gyroscope with a median norm of 9\.8.*look exchanged"):
        check_units(right.replace(streams={**right.streams, "imu": Stream(imu.t, swapped)}))


def test_rates_as_large_as_gravity_in_degrees_are_no_exchange() -> None:
    """Force in g, whose norm is steady, and rates in deg/s, whose norm is not."""
    imu = recording().streams["imu"]
    rates = np.linalg.norm(imu.array(GYRO), axis=1)
    scales = [*[1.0 / 9.81] * 3, *[9.81 / np.median(rates)] * 3]
    columns = {name: scale * imu[name] for name, scale in zip((*ACCEL, *GYRO), scales, strict=True)}
    with pytest.raises(InputError, match="looks like g;"):
        check_units(Recording("units", "flight", {"imu": Stream(imu.t, columns)}))


def field(scale: float) -> Recording:
    """A magnetometer that a map says is in gauss, with hard iron as large as the field."""
    readings = scale * np.random.default_rng(2).normal(scale=0.3, size=(200, 3)) + scale * np.array([0.5, 0.0, 0.0])
    return Recording("field", "poses", {"mag": Stream(np.arange(200.0), dict(zip(MAG, readings.T, strict=True)))})


@pytest.mark.parametrize(("scale", "says"), [(1000.0, "spread over"), (10.0, "spread over"), (0.01, "up to")])
def test_field_that_the_earth_has_not(scale: float, says: str) -> None:
    with pytest.raises(InputError, match=f"{says} .* gauss: looks like another unit; expected 0.2 to 0.7 gauss"):
        check_field(field(scale))


def test_field_with_large_iron_passes() -> None:
    check_field(field(1.0))


def still(w: FloatArray) -> Recording:
    """A body at rest with the given bias of the gyroscope."""
    t = np.arange(2000) / RATE
    rng = np.random.default_rng(5)
    f = np.array([0.3, -0.2, -9.8]) + rng.normal(scale=0.03, size=(len(t), 3))
    rate = w + rng.normal(scale=0.02, size=(len(t), 3))
    return Recording("still", "flight", {"imu": Stream(t, dict(zip((*ACCEL, *GYRO), [*f.T, *rate.T], strict=True)))})


def test_rest_that_turns_is_in_degrees() -> None:
    with pytest.raises(InputError, match="at rest: looks like deg/s"):
        check_units(still(np.array([4.5, 0.1, 1.1])))


def test_large_bias_and_turntable_pass() -> None:
    check_units(still(np.radians([20.0, 0.0, 10.0])))
    check_units(still(np.array([0.0, 0.0, 3.0])))


def test_pressure_in_hectopascal() -> None:
    baro = Stream(np.arange(3.0), {"pressure": np.full(3, 1013.0)})
    with pytest.raises(InputError, match="looks like hPa"):
        check_units(Recording("baro", "flight", {"baro": baro}))


@pytest.mark.parametrize("samples", [211, 421, 691, 841])
def test_log_whose_last_look_falls_past_its_end(samples: int) -> None:
    """From t = 1 s these lengths have a look at the directions, every 0.3 s, that rounds to beyond the last sample."""
    log = recording()
    imu = log.streams["imu"].rows(np.arange(3000) < samples)
    imu = Stream(1.0 + np.arange(samples) / RATE, imu.columns)
    assert np.arange(imu.t[0], imu.t[-1], 0.3)[-1] > imu.t[-1]
    check_units(log.replace(streams={"imu": imu}))
