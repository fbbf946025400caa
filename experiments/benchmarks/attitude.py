"""Attitude from IMU and magnetometer: this filter, VQF, Madgwick, Mahony and an EKF on measured logs with a reference.

Every estimator has one setting for all logs, its authors'. All get the same readings; in the second table all get them
with the hard iron taken off and the disturbed stretches left out that this project finds in the log itself.
Needs `vqf` and `ahrs`: pip install '.[benchmark]' in the clone.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from calibration.compass import compass_of, corrected
from experiments.datasets import resolve
from experiments.measured.preparation import prepared
from experiments.measured.reference import AttitudeError, attitude_error, reference_of
from experiments.report.words import reference_words
from sensors.arrays import FloatArray
from sensors.recording import ACCEL, GYRO, MAG, Recording
from sensors.rotation import quaternion_from_matrix, quaternion_multiply

LOGS = {
    "hand, undisturbed": "broad_orientation/02_undisturbed_slow_rotation_B.mat",
    "hand, magnet": "broad_orientation/32_disturbed_attached_magnet_1cm.mat",
    "robot, MPU-9150": "robot_arm_marg/eV50p/Sequencia1/MPU9150.mat",
    "robot, LSM9DS0": "robot_arm_marg/eV50p/Sequencia1/LSM9DS0.mat",
    "robot fast, LSM9DS0": "robot_arm_marg/V_800/Sequencia3/LSM9DS0.mat",
    "quadrotor": "rfly_course/attitude_logdata.mat",
    "turned by hand": "rfly_course/e4_A.bin",
}
OURS = "this filter"
#: Length of the blocks that are drawn: longer than the errors' memory in the best of the estimators [s].
BLOCK = 5.0
DRAWS = 2000
#: Forward-left-up from forward-right-down, and north-east-down from east-north-up and from north-west-up.
FLIP = np.diag([1.0, -1.0, -1.0])
FROM_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])

Estimator = Callable[[Recording], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class Comparison:
    """One log.

    Attributes
    ----------
    against : what the reference is
    errors : by estimator
    worse : by other estimator, the mean squared error of this filter minus the other's, over the other's, with its
        interval of 95 %: this filter is significantly worse where the interval lies above zero
    """

    against: str
    errors: Mapping[str, AttitudeError]
    worse: Mapping[str, tuple[float, float, float]]


def ours(recording: Recording) -> tuple[FloatArray, FloatArray]:
    """This filter with `level` and magnetometer; levels from the log."""
    journal = prepared(recording).run()
    return journal.imu_t, journal.imu_x[:, 6:10]


def vqf(recording: Recording) -> tuple[FloatArray, FloatArray]:
    """VQF with the parameters of its paper. D. Laidig, T. Seel, Information Fusion 91 (2023) 187."""
    from vqf import VQF

    t, gyro, accel, mag = readings(recording, FLIP)
    estimator = VQF((t[-1] - t[0]) / (len(t) - 1))
    if mag is None:
        return t, in_ned(estimator.updateBatch(gyro, accel)["quat6D"], FROM_ENU)
    return t, in_ned(estimator.updateBatch(gyro, accel, mag)["quat9D"], FROM_ENU)


def complementary(name: str) -> Estimator:
    """Madgwick or Mahony of `ahrs` with its own gains."""

    def estimate(recording: Recording) -> tuple[FloatArray, FloatArray]:
        from ahrs import filters

        t, gyro, accel, mag = readings(recording, FLIP)
        given = {} if mag is None else {"mag": mag}
        run = getattr(filters, name)(gyr=gyro, acc=accel, frequency=(len(t) - 1) / (t[-1] - t[0]), **given)
        return t, in_ned(run.Q, FLIP)

    return estimate


def ekf(recording: Recording) -> tuple[FloatArray, FloatArray]:
    """EKF of `ahrs` with its own noises, in north-east-down; the dip is the log's, or it could not start."""
    from ahrs import filters

    t, gyro, accel, mag = readings(recording, np.eye(3))
    rate, given = (len(t) - 1) / (t[-1] - t[0]), {}
    if mag is not None:
        given = {"mag": mag, "magnetic_ref": float(np.rad2deg(compass_of(recording).dip))}
    run = filters.EKF(gyr=gyro, acc=-accel, frequency=rate, frame="NED", **given)
    return t, np.asarray(run.Q)


ESTIMATORS: Mapping[str, Estimator] = {
    OURS: ours, "VQF": vqf, "Madgwick": complementary("Madgwick"), "Mahony": complementary("Mahony"), "EKF": ekf,
}  # fmt: skip


def readings(recording: Recording, axes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray | None]:
    """t, rate, specific force and field (None: no magnetometer) at the IMU's instants, in other axes."""
    imu = recording.streams["imu"]
    gyro, accel = (np.ascontiguousarray(imu.array(names) @ axes.T) for names in (GYRO, ACCEL))
    if "mag" not in recording.streams:
        return imu.t, gyro, accel, None
    mag = recording.streams["mag"]
    field = np.stack([np.interp(imu.t, mag.t, mag[name]) for name in MAG], axis=-1)
    return imu.t, gyro, accel, np.ascontiguousarray(field @ axes.T)


def in_ned(q: FloatArray, world: FloatArray) -> FloatArray:
    """Forward-left-up in another world -> forward-right-down in north-east-down."""
    left, right = (np.broadcast_to(quaternion_from_matrix(C), q.shape) for C in (world, FLIP))
    return quaternion_multiply(left, quaternion_multiply(q, right))


def compare(name: str, rng: np.random.Generator, correct: bool = False) -> Comparison:
    """All estimators on one log, with the paired block bootstrap.

    Parameters
    ----------
    name : key of `LOGS`
    rng : source of randomness
    correct : all get the log with its hard iron taken off and its disturbed stretches left out
    """
    recording = resolve(LOGS[name])
    target = reference_of(recording)
    assert target is not None
    assert recording.truth is not None
    against = reference_words(recording.truth.kind)
    if correct and "mag" in recording.streams:
        recording = corrected(recording, compass_of(recording))
    errors = {}
    for label, estimate in ESTIMATORS.items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            t, q = estimate(recording)
        errors[label] = attitude_error(t, q, target)
    others = {label: error for label, error in errors.items() if label != OURS}
    return Comparison(against, errors, {label: paired(errors[OURS], error, rng) for label, error in others.items()})


def paired(mine: AttitudeError, other: AttitudeError, rng: np.random.Generator) -> tuple[float, float, float]:
    """Mean difference of squared errors over the other's mean, and its interval of 95 % from a paired block bootstrap.

    Source: H. R. Kunsch, Ann. Statist. 17 (1989) 1217; blocks side by side.
    """
    t = mine.t[(mine.t >= other.t[0]) & (mine.t <= other.t[-1])]
    block = ((t - t[0]) // BLOCK).astype(int)
    squares = [np.interp(t, error.t, error.total) ** 2 for error in (mine, other)]
    count = np.bincount(block)
    filled = count > 0
    sums = [np.bincount(block, square)[filled] for square in squares]
    draws = rng.integers(0, int(filled.sum()), (DRAWS, int(filled.sum())))
    ratio = (sums[0][draws].sum(axis=1) - sums[1][draws].sum(axis=1)) / sums[1][draws].sum(axis=1)
    low, high = np.percentile(ratio, [2.5, 97.5])
    return float(sums[0].sum() / sums[1].sum() - 1.0), float(low), float(high)


def rms_degrees(angle: FloatArray) -> float:
    """Root mean square of an angle [deg]."""
    return float(np.rad2deg(np.sqrt(np.mean(angle**2))))


def main(seed: int = 0) -> dict[str, dict[str, dict[str, float]]]:
    """Both tables: RMS of total error and of tilt [deg] by log and estimator; printed as Markdown."""
    rng = np.random.default_rng(seed)
    result: dict[str, dict[str, dict[str, float]]] = {}
    for correct in (False, True):
        title = "hard iron taken off for all" if correct else "readings as they are"
        heads = [f"{title}: total (tilt) [deg]", *ESTIMATORS, "significantly better than this filter"]
        print("\n| " + " | ".join(heads) + " |")
        print("| --- " * (len(ESTIMATORS) + 2) + "|")
        for name in LOGS:
            comparison = compare(name, rng, correct)
            cells = [f"{rms_degrees(e.total):.2f} ({rms_degrees(e.tilt):.2f})" for e in comparison.errors.values()]
            worse = [(label, low, high) for label, (_, low, high) in comparison.worse.items() if low > 0.0]
            better = [f"{label} {low:+.2f}..{high:+.2f}" for label, low, high in worse]
            print(
                f"| {name}, against {comparison.against} | " + " | ".join(cells) + f" | {', '.join(better) or '-'} |",
                flush=True,
            )
            result[f"{title}: {name}"] = {
                label: {"total": rms_degrees(error.total), "tilt": rms_degrees(error.tilt)}
                for label, error in comparison.errors.items()
            }
    return result


if __name__ == "__main__":
    main()
