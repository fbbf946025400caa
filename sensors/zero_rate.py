"""Zero rate: a body that lies or stands still does not turn, and its gyroscope reads its bias."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.noise import BiasProcess, colour

#: What gravity makes of a gyroscope's bias in one attitude [rad/s]: a choice, a third of 0.1 deg/s/g, which data sheets
#: call the linear acceleration sensitivity (MPU-6050, ITG-3200, BMI088). Half and twice keep the bias within its
#: sigmas where three times as much is put in (`test_zero_rate`).
OF_GRAVITY = 5e-4
#: How long a body that rests now and then keeps its attitude [s]: a choice; half and twice likewise.
ATTITUDE_TIME = 30.0


@dataclass(frozen=True, eq=False)
class ZeroRate:
    """Over some windows the body does not turn: a pseudo-reading mean(w) = b_gyro + c + n at the end of each.

    c is what gravity does to the gyroscope in the attitude of that rest, a state with a time constant.

    It is a sensor like any other, named, journalled, in the report; on only where the noise of the gyroscope is not
    declared, and the log has such windows.

    Neglects the rotation of the Earth (7e-5 rad/s, which is then part of the bias) and that the same samples drive
    the filter: over a window the estimate of the attitude is better than its covariance says, and c is in its rate too.

    Attributes
    ----------
    begin, end : (k,) of the windows [s]
    sigma : (3,) standard deviation of the mean rate of a window about the bias [rad/s]
    """

    begin: FloatArray
    end: FloatArray
    sigma: FloatArray
    name: str = "zero_rate"
    size: int = 3

    @property
    def R(self) -> FloatArray:
        """(3, 3) (rad/s)^2."""
        return np.diag(self.sigma**2)

    @property
    def bias(self) -> BiasProcess | None:
        """None: its bias is that of the gyroscope, which is a state of its own."""
        return None

    @property
    def of_gravity(self) -> BiasProcess:
        """What gravity adds to the rate in this attitude and in no other: windows of one rest have it in common."""
        return colour("c_zero_rate", self.size, OF_GRAVITY, ATTITUDE_TIME)

    def predict(self, motion: Motion) -> FloatArray:
        """(n, 3) zero [rad/s]: the body does not turn."""
        return np.zeros((len(motion), 3))

    def jacobian(self, motion: Motion) -> Mapping[str, FloatArray]:
        """The gyroscope's bias."""
        return {"b_gyro": np.broadcast_to(np.eye(3), (len(motion), 3, 3))}

    def means(self, t: FloatArray, values: FloatArray) -> FloatArray:
        """(k, ...) means over the windows of what goes with the instants t (n,), (n, ...); zero where there is none."""
        first, after = np.searchsorted(t, self.begin), np.searchsorted(t, self.end, side="right")
        means = np.zeros((len(first), *values.shape[1:]))
        for k, (i, j) in enumerate(zip(first.tolist(), after.tolist(), strict=True)):
            if j > i:
                means[k] = values[i:j].mean(axis=0)
        return means
