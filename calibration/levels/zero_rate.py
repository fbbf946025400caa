"""Windows in which a body is at rest, by what its IMU reads there: a hypothesis against motion, each with a prior.

At rest an IMU reads constants and its own noise: short means scatter about their mean as those of white noise do, by as
much as instruments of the class do. In motion they follow each other, and scatter by anything. With q von Neumann's
ratio of a window's means on one axis (half the mean square of their differences, over their variance; 1 for white
noise, (n - 2) / (n^2 - 1) its variance; J. von Neumann, Ann. Math. Stat. 12(4), 1941), z the sum of (1 - q) over six
axes in its sigmas, and s the scatter of the rates, or of the forces, of all three axes,

    log odds = log N(z) / U(z) + sum over rates and forces of log N(log s; log s_class, SPREAD) / U(log s),

U being uniform over what motions have. Either is as probable before the log.

Neglects that noise below the rate of the means is not white, and a turn at a constant rate as smooth as rest: to such
a reading the filter gives the weight that it has beside the gyroscope's bias (`TURNS`).
"""

from __future__ import annotations

import numpy as np

from sinan.estimator.filter.flight_model import Stray
from sinan.sensors.arrays import FloatArray
from sinan.sensors.last_digit import rounding_variance
from sinan.sensors.recording import ACCEL, GYRO, Recording
from sinan.sensors.zero_rate import ZeroRate

#: Length of a window, and of the means in it [s]: a choice. A hand moves below 5 Hz, so that one mean is like the one
#: before, and an instrument's low-pass of 10 Hz or more forgets between them. Half and twice of either find the same
#: seconds of a log to one at its ends (`test_zero_rate`).
WINDOW, MEAN = 1.0, 0.1
#: White noise of consumer gyroscopes [rad/s/sqrt(Hz)] and accelerometers [m/s^2/sqrt(Hz)], and the spread of its
#: logarithm: a choice within their data sheets, 0.005 (MPU-6050), 0.01 (MPU-9250), 0.014 (BMI088) and 0.03
#: deg/s/sqrt(Hz) (L3GD20), 400, 300 and 175 ug/sqrt(Hz) (the first three). Neglects that these are one-sided, and the
#: scatter of means is that of the two-sided N, 0.71 of them: a third of `SPREAD`. Half and twice of the first two find
#: the same rest (`test_zero_rate`), twice of the spread takes two of twenty shaken seconds for it.
GYRO_NOISE, ACCEL_NOISE, SPREAD = 1.7e-4, 2e-3, 1.0
#: Over how much of its natural logarithm the scatter of what moves is uniform, as a density: log(1e5), from 1e-4 to
#: 10 rad/s/sqrt(Hz), 1e-3 to 100 m/s^2/sqrt(Hz).
DECADES = float(np.log(1e5))
#: Median of chi-square with one degree of freedom: chi2.ppf(0.5, 1).
OF_MEDIAN = 0.455
#: A body that turns as smoothly as if it were at rest does so at any rate between -1 and 1 rad/s: a choice. Half and
#: twice weigh a turn of 0.1 rad/s with less than 1e-6 (`test_zero_rate`).
TURNS = 2.0


def zero_rate_of(recording: Recording) -> tuple[ZeroRate, Stray] | None:
    """Windows of a log in which the body is at rest, and the share of them in which it is not; None: there are none.

    The noise of a mean rate is the Allan deviation over a window, which has the gyroscope's flicker besides its white
    noise; where no two windows follow each other it is that of white noise; and at least what the last digit hides.
    """
    imu = recording.streams["imu"]
    step = imu.step
    each = max(1, round(MEAN / step))
    n = round(WINDOW / (each * step))
    count = len(imu) // (n * each)
    if n < 4 or count < 1:
        return None
    t = imu.t[: count * n * each].reshape(count, n * each)
    u = imu.array((*GYRO, *ACCEL))[: count * n * each]
    means = u.reshape(count, n, each, 6).mean(axis=2)
    odds = np.where(t[:, -1] - t[:, 0] < 1.5 * WINDOW, log_odds(means, each * step), -np.inf)
    rest = np.flatnonzero(odds > 0.0)
    if not len(rest):
        return None
    rates = means[rest, :, :3]
    white = np.mean(np.var(rates, axis=1, ddof=1), axis=0) / n
    follows = np.diff(rest) == 1
    steps = np.diff(rates.mean(axis=1), axis=0)[follows] ** 2
    allan = 0.5 * np.median(steps, axis=0) / OF_MEDIAN if len(steps) else 0.0  # one step of a slow turn is no noise
    noise = np.maximum(white, allan)
    digit = rounding_variance(imu.array(GYRO))
    samples = u.reshape(count, -1, 6)[rest, :, :3]
    scatter = np.mean(np.var(samples, axis=1), axis=0)
    noise = np.maximum(noise, np.where(scatter < 3.0 * digit, digit, 0.0))  # below half a step all windows err alike
    noise = np.where(np.any(np.ptp(samples, axis=1), axis=0), noise, np.max(noise))  # a silent axis tells none
    share = float(np.mean(1.0 / (1.0 + np.exp(odds[rest]))))
    return ZeroRate(t[rest, 0], t[rest, -1], np.sqrt(noise)), Stray(share, TURNS)


def log_odds(means: FloatArray, step: float) -> FloatArray:
    """(k,) logarithm of the odds of rest against motion of windows (k, n, 6) of means of rate and force over `step`."""
    n = means.shape[1]
    variance = np.var(means, axis=1, ddof=1)
    ratio = 0.5 * np.mean(np.diff(means, axis=1) ** 2, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(variance > 0.0, ratio / variance, 1.0)
    sigma = np.sqrt((n - 2.0) / (n * n - 1.0))
    z, most = np.sum(1.0 - ratio, axis=1) / (np.sqrt(6.0) * sigma), np.sqrt(6.0) / sigma
    odds = -0.5 * z**2 + np.log(2.0 * most / np.sqrt(2.0 * np.pi))
    for axes, noise in ((slice(0, 3), GYRO_NOISE), (slice(3, 6), ACCEL_NOISE)):
        scatter = np.sqrt(np.mean(variance[:, axes], axis=1) * step)
        off = np.log(np.maximum(scatter, np.finfo(float).tiny) / noise) / SPREAD
        odds += -0.5 * off**2 + np.log(DECADES / (SPREAD * np.sqrt(2.0 * np.pi)))
    return odds
