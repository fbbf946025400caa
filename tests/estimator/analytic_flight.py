"""A small smooth flight in closed form, and plain recordings of it: what the estimator's tests fly."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sinan.estimator.filter.layout import P_N, Q_NB, V_N
from sinan.sensors.arrays import FloatArray
from sinan.sensors.barometer import Barometer
from sinan.sensors.gps import Gps
from sinan.sensors.laser import Laser
from sinan.sensors.magnetometer import Magnetometer
from sinan.sensors.motion import Motion
from sinan.sensors.noise import BiasProcess, random_walk
from sinan.sensors.recording import (
    ACCEL,
    GYRO,
    MAG,
    POSITION,
    VELOCITY,
    Environment,
    Initial,
    Recording,
    SensorSpec,
    Stream,
)
from sinan.sensors.rotation import (
    matrix_from_quaternion,
    quaternion_exp,
    quaternion_from_rpy,
    quaternion_multiply,
    rotate_back,
)
from sinan.sensors.sonar import Sonar

GRAVITY = np.array([0.0, 0.0, 9.8012])
FIELD = np.array([0.53, -0.06, 0.85])
SPECS: Mapping[str, SensorSpec] = {
    "accel": SensorSpec(noise_density=2e-3, bias_walk=3e-4, bias_std=0.1),
    "gyro": SensorSpec(noise_density=2e-4, bias_walk=1e-5, bias_std=5e-3),
    "mag": SensorSpec(noise_std=0.01, bias_walk=1e-4, bias_std=0.02),
    "baro": SensorSpec(noise_std=0.3, bias_walk=0.02, bias_std=2.0),
    "sonar": SensorSpec(noise_std=0.03, bias_walk=0.0, bias_std=0.0),
    "laser": SensorSpec(noise_std=0.02, bias_walk=0.0, bias_std=0.0),
    "gps": SensorSpec(noise_std=0.5, velocity_noise_std=0.1, bias_walk=0.05, bias_std=1.0),
}
RATES = {"imu": 200.0, "mag": 50.0, "baro": 25.0, "laser": 20.0, "gps": 10.0}
SLOW_IMU = {**RATES, "imu": 100.0}
INITIAL_STD = {"position": 1.0, "velocity": 0.2, "attitude": 0.02}


def analytic_motion(t: FloatArray) -> Motion:
    """A figure of eight with climbs and a yaw that sways; attitude is free of the thrust, as a gimbal would allow."""
    wave = lambda a, w, p, k: a * w**k * np.sin(w * t + p + 0.5 * np.pi * k)  # noqa: E731
    p = [np.stack([wave(6, 0.5, 0, k), wave(4, 0.9, 0.4, k), wave(1.5, 0.4, 1.0, k)], -1) for k in range(3)]
    p[0] = p[0] + np.array([0.0, 0.0, -8.0])
    rpy = [np.stack([wave(0.25, 1.1, 0.3, k), wave(0.2, 0.8, 1.2, k), wave(1.4, 0.45, 0.1, k)], -1) for k in range(3)]
    w, dw = _body_rate(rpy[0], rpy[1], rpy[2])
    q = quaternion_from_rpy(rpy[0])
    return Motion(
        t=t, p_n=p[0], v_n=p[1], a_n=p[2], q_nb=q, f_b=rotate_back(q, p[2] - GRAVITY), w_ib_b=w, dw_b=dw,
        m_b=rotate_back(q, np.broadcast_to(FIELD, (len(t), 3))), m_n=FIELD[None, :], g_n=GRAVITY,
    )  # fmt: skip


def _body_rate(rpy: FloatArray, d: FloatArray, dd: FloatArray) -> tuple[FloatArray, FloatArray]:
    (r, p, _), (dr, dp, dy), (ddr, ddp, ddy) = rpy.T, d.T, dd.T
    sr, cr, sp, cp = np.sin(r), np.cos(r), np.sin(p), np.cos(p)
    w = np.stack([dr - dy * sp, dp * cr + dy * sr * cp, -dp * sr + dy * cr * cp], -1)
    dw = np.stack(
        [
            ddr - ddy * sp - dy * dp * cp,
            ddp * cr - dp * dr * sr + ddy * sr * cp + dy * (dr * cr * cp - dp * sr * sp),
            -ddp * sr - dp * dr * cr + ddy * cr * cp + dy * (-dr * sr * cp - dp * cr * sp),
        ],
        -1,
    )
    return w, dw


def fly(
    seed: int, duration: float = 30.0, sensors: tuple[str, ...] = ("mag", "baro", "laser", "gps"), noise: float = 1.0,
    specs: Mapping[str, SensorSpec] = SPECS, rates: Mapping[str, float] = RATES, jitter: float = 0.0,
) -> tuple[Recording, FloatArray]:  # fmt: skip
    """A recording and its true states at the IMU samples: p, v, q and the biases that the filter has."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(duration * rates["imu"]) + 1) / rates["imu"]
    motion = analytic_motion(t)
    streams, biases = {}, {}

    def bias_of(name: str, size: int) -> FloatArray:
        spec = specs[name]
        process = BiasProcess(f"b_{name}", size, noise * (spec.bias_std or 0.0), noise * (spec.bias_walk or 0.0))
        biases[name] = random_walk(t, process, rng)
        return biases[name]

    def at(stamps: FloatArray, values: FloatArray) -> FloatArray:
        return np.stack([np.interp(stamps, t, column) for column in values.T], -1)

    sigma = {n: noise * (specs[n].noise_density or 0.0) * np.sqrt(rates["imu"]) for n in ("accel", "gyro")}
    accel = motion.f_b + bias_of("accel", 3) + sigma["accel"] * rng.standard_normal((len(t), 3))
    gyro = motion.w_ib_b + bias_of("gyro", 3) + sigma["gyro"] * rng.standard_normal((len(t), 3))
    streams["imu"] = Stream(t, dict(zip((*ACCEL, *GYRO), np.concatenate([accel, gyro], 1).T, strict=True)))
    names = {"mag": MAG, "baro": ("height",), "sonar": ("range",), "laser": ("range",), "gps": (*POSITION, *VELOCITY)}
    models = {
        "mag": lambda: Magnetometer(1.0), "baro": lambda: Barometer(1.0), "sonar": lambda: Sonar(1.0),
        "laser": lambda: Laser(1.0), "gps": lambda: Gps(1.0, 1.0),
    }  # fmt: skip
    for name in sensors:
        stamps = np.arange(0.5 / rates[name], duration, 1.0 / rates[name]) + 1.3e-4
        stamps = stamps + jitter / rates[name] * rng.uniform(-0.5, 0.5, len(stamps))
        reading = models[name]().predict(analytic_motion(stamps))
        spec, size = specs[name], reading.shape[1]
        scale = np.full(size, noise * (spec.noise_std or 0.0))
        if name == "gps":
            scale[3:] = noise * (spec.velocity_noise_std or 0.0)
        bias = at(stamps, bias_of(name, 3 if name in ("mag", "gps") else 1))
        reading[:, : bias.shape[1]] += bias
        reading += scale * rng.standard_normal(reading.shape)
        streams[name] = Stream(stamps, dict(zip(names[name], reading.T, strict=True)))
    states = [
        motion.p_n,
        motion.v_n,
        motion.q_nb,
        *(biases[n] for n in ("accel", "gyro", "mag", "gps", "baro") if n in biases),
    ]
    truth = np.concatenate(states, axis=1)
    std = {key: noise * value for key, value in INITIAL_STD.items()}
    initial = Initial(
        position=truth[0, P_N] + std["position"] * rng.standard_normal(3),
        velocity=truth[0, V_N] + std["velocity"] * rng.standard_normal(3),
        quaternion=quaternion_multiply(truth[0, Q_NB], quaternion_exp(-std["attitude"] * rng.standard_normal(3))),
        position_std=INITIAL_STD["position"], velocity_std=INITIAL_STD["velocity"],
        attitude_std=INITIAL_STD["attitude"],
    )  # fmt: skip
    environment = Environment(gravity=float(GRAVITY[2]), magnetic_field=FIELD)
    return Recording("analytic", "flight", streams, dict(specs), environment, initial), truth


def turned(q: FloatArray) -> FloatArray:
    """C_nb of q_nb."""
    return matrix_from_quaternion(q)
