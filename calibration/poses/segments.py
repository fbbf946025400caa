"""Static segments of a full-rate log: where the sensor lay still, and the mean reading of each pose.

The course finds them by hand: the mean of 100 readings a pose, poses at least a threshold apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray, IntArray, runs_of
from sinan.sensors.errors import InputError

#: A window counts as still when its scatter is below the valley between the two heaps of log scatter, still and moving,
#: but within these multiples of the log's own floor, since the scatter of 50 readings varies by 10 % and a quiet log
#: has one heap only; a sensor held in the hand shows ten times the floor, and a slow turn a hundred. A choice, half and
#: twice of which change no pose of a gyroscope that is turned (`bounds_of_work turns`).
STILL_FACTORS = (3.0, 30.0)
#: Window over which scatter is found [s]: of 50 readings at 100 Hz a sigma is known to 1 / sqrt(2 * 50) = 10 %.
WINDOW = 0.5
#: Least length of a pose [s]; the course averages 100 readings at 100 Hz.
SHORTEST = 1.0
#: What is cut from each end of a pose, since the hand still touches it [s]: a choice, half and twice of
#: which move a g-sensitivity by 0.5 of its sigma (`bounds_of_work turns`).
MARGIN = 0.2
#: Poses closer than this to the one before are the same pose [rad]: a touch makes no second pose of one rest. Measured:
#: without it the five rests of one log (`mpu6050_hmc5883l/set-2/full-sphere`) were enough for an accelerometer.
APART = np.deg2rad(5.0)


@dataclass(frozen=True)
class Poses:
    """Mean readings over static segments.

    Attributes
    ----------
    t : (poses,) middle of each segment [s]
    start, stop : (poses,) first row, and one past the last row, of what was averaged
    mean : (poses, channels) mean reading
    noise : (poses, channels) standard deviation of one reading inside the segment
    """

    t: FloatArray
    start: IntArray
    stop: IntArray
    mean: FloatArray
    noise: FloatArray

    def __len__(self) -> int:
        return len(self.t)

    @property
    def count(self) -> IntArray:
        """(poses,) readings averaged."""
        return self.stop - self.start


def rolling_scatter(values: FloatArray, window: int) -> FloatArray:
    """(n,) root of the variances, summed over the channels, in a centred window; the ends repeat."""
    sums = np.cumsum(np.vstack([np.zeros(values.shape[1]), values - values.mean(axis=0)]), axis=0)
    squares = np.cumsum(np.vstack([np.zeros(values.shape[1]), (values - values.mean(axis=0)) ** 2]), axis=0)
    mean = (sums[window:] - sums[:-window]) / window
    variance = np.maximum((squares[window:] - squares[:-window]) / window - mean**2, 0.0).sum(axis=1)
    scatter = np.sqrt(variance)
    before = (len(values) - len(scatter)) // 2
    return np.pad(scatter, (before, len(values) - len(scatter) - before), mode="edge")


def still_threshold(scatter: FloatArray) -> float:
    """Scatter that separates still from moving: Otsu's threshold of its logarithm, within `STILL_FACTORS` of the floor.

    The floor is the tenth percentile. Source: N. Otsu, IEEE Trans. SMC 9 (1979) 62.
    """
    floor = max(float(np.percentile(scatter, 10)), np.finfo(float).tiny)
    logs = np.log(np.clip(scatter, floor, 1e4 * floor))
    counts, edges = np.histogram(logs, bins=128)
    centres = 0.5 * (edges[1:] + edges[:-1])
    below = np.cumsum(counts)[:-1]
    above = len(logs) - below
    sums = np.cumsum(counts * centres)[:-1]
    gap = sums / np.maximum(below, 1) - (np.sum(counts * centres) - sums) / np.maximum(above, 1)
    valley = float(np.exp(edges[1 + int(np.argmax(below * above * gap**2))]))
    return float(np.clip(valley, STILL_FACTORS[0] * floor, STILL_FACTORS[1] * floor))


def still_rows(t: FloatArray, accel: FloatArray, gyro: FloatArray | None = None) -> BoolArray:
    """(n,) whether the sensor lies still around each row.

    Scatter of the accelerometer, and of the gyroscope where there is one, below `still_threshold`. A slow steady turn
    keeps the gyroscope's scatter low but not its mean: rows whose smoothed rate leaves the median of the still ones by
    more than the noise allows are dropped.

    Parameters
    ----------
    t : (n,) s
    accel : (n, 3) m/s^2
    gyro : (n, 3) rad/s
    """
    window = max(round(float(WINDOW / np.median(np.diff(t)))), 5) if len(t) > 1 else 1
    if len(t) < 2 * window:
        return np.zeros(len(t), dtype=bool)
    still = np.ones(len(t), dtype=bool)
    for values in [accel] if gyro is None else [accel, gyro]:
        scatter = rolling_scatter(values, window)
        still &= scatter < still_threshold(scatter)
    if gyro is not None and np.any(still):
        mean = np.stack([np.convolve(column, np.full(window, 1.0 / window), mode="same") for column in gyro.T], axis=1)
        centre = np.median(mean[still], axis=0)
        away = np.max(np.abs(mean - centre), axis=1)
        typical = np.median(away[still])
        still &= away < max(5.0 * typical, 0.01)  # rad/s; half a degree a second is a hand, not a bias
    return still


def find_poses(
    t: FloatArray,
    accel: FloatArray,
    gyro: FloatArray | None = None,
    where: str = "imu",
    apart: float = APART,
    at_least: int = 1,
) -> Poses:
    """Find the static poses of a full-rate log.

    Parameters
    ----------
    t : (n,) s
    accel : (n, 3) m/s^2
    gyro : (n, 3) rad/s; makes the search surer
    where : how messages call the log
    apart : poses closer than this to the one before belong to it and are dropped [rad]
    at_least : poses needed

    Returns
    -------
    Poses with the channels accel x y z, and gyro x y z where given

    Raises
    ------
    InputError : fewer than `at_least` poses
    """
    still = still_rows(t, accel, gyro)
    values = accel if gyro is None else np.hstack([accel, gyro])
    rate = 1.0 / np.median(np.diff(t)) if len(t) > 1 else 1.0
    margin, shortest = round(float(MARGIN * rate)), round(float(SHORTEST * rate))
    kept: list[tuple[int, int]] = []
    directions: list[FloatArray] = []
    for first, last in runs_of(still):
        start, stop = first + margin, last - margin
        if stop - start < shortest:
            continue
        mean = accel[start:stop].mean(axis=0)
        direction = mean / max(float(np.linalg.norm(mean)), np.finfo(float).tiny)
        if directions and float(np.linalg.norm(direction - directions[-1])) < apart:
            continue
        kept.append((start, stop))
        directions.append(direction)
    if len(kept) < at_least:
        found = f"{len(kept)} static pose{'' if len(kept) == 1 else 's'}"
        raise InputError(where, found, f"at least {at_least}, each {SHORTEST + 2 * MARGIN:.1f} s or longer")
    return Poses(
        t=np.array([0.5 * (t[a] + t[b - 1]) for a, b in kept]),
        start=np.array([a for a, _ in kept], dtype=np.int64),
        stop=np.array([b for _, b in kept], dtype=np.int64),
        mean=np.array([values[a:b].mean(axis=0) for a, b in kept]).reshape(len(kept), values.shape[1]),
        noise=np.array([values[a:b].std(axis=0, ddof=1) for a, b in kept]).reshape(len(kept), values.shape[1]),
    )
