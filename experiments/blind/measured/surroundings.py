"""What surrounds the instruments of a measured log, as the effects ask for it: `maker.scene.Surroundings`."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import savgol_filter

from sinan.calibration.levels.preparation import Prepared
from sinan.estimator.filter.smoother import estimated_motion
from sinan.experiments.blind.maker.body import Body
from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.recording import ACCEL, Recording, Stream
from sinan.sensors.rotation import matrix_from_quaternion

#: Rates are smoothed by parabolas over so long before their slope is taken [s]; three samples are the least, which
#: leave them as they are.
RATE_SMOOTHING = 0.05
#: Vibration is what is quicker than this [s]; its variance is over so long [s], less that of its quietest tenth, which
#: is taken for white noise (EFFECTS: accel.vibration).
SLOW, OVER, QUIET = 0.06, 0.5, 0.1


@dataclass(frozen=True)
class Shaken:
    """The vibration of a log's own accelerometer.

    Attributes
    ----------
    t, power : (n,), (n, 3) variance at the IMU's instants [s], [(m/s^2)^2]
    """

    t: FloatArray
    power: FloatArray

    def variance(self, t: FloatArray) -> FloatArray:
        """(k, 3) at other instants."""
        return np.stack([np.interp(t, self.t, column) for column in self.power.T], axis=-1)

    @staticmethod
    def of(imu: Stream) -> Shaken:
        """Variance of what the running mean leaves."""
        step = imu.step
        f_b = imu.array(ACCEL)
        quick = f_b - running_mean(f_b, SLOW / step)
        power = running_mean(quick**2, OVER / step)
        return Shaken(imu.t, power - np.quantile(power, QUIET, axis=0))


@dataclass(frozen=True)
class Along:
    """A log's surroundings along the motion that its own readings show.

    Attributes
    ----------
    recording : covariates are taken from its streams
    estimate : motion of the body at the IMU's instants, rates smoothed
    """

    recording: Recording
    estimate: Motion

    @property
    def field_n(self) -> FloatArray:
        """(3,) NED, in the magnetometer's unit."""
        return np.asarray(self.estimate.m_n[0])

    @property
    def ground_down(self) -> float:
        """Down coordinate of the ground [m]."""
        return self.estimate.ground_down

    @property
    def vibration(self) -> Shaken:
        """Of the airframe."""
        return Shaken.of(self.recording.streams["imu"])

    def motion(self, t: FloatArray) -> Body:
        """The motion at other instants; of the air as much as its speed says, which is all that an effect asks for."""
        at = self.estimate.at(t)
        wind, thrust = np.zeros((len(t), 3)), np.linalg.norm(at.f_b, axis=1)
        if "air" in self.recording.streams:
            wind = at.v_n - np.outer(self._logged(t, "air", "airspeed"), [1.0, 0.0, 0.0])
        C = matrix_from_quaternion(at.q_nb)
        return Body(t, at.p_n, at.v_n, at.acceleration_n(), C, at.f_b, at.w_ib_b, at.dw_b, wind, thrust)

    def current(self, body: Body) -> FloatArray:
        """(n,) supply current [A]."""
        return self._logged(body.t, "power", "current")

    def throttle(self, body: Body) -> FloatArray:
        """(n, motors) 0 to 1."""
        names = [name for name in self.recording.streams["motors"].columns if name.startswith("motor_")]
        return np.stack([self._logged(body.t, "motors", name) for name in names], axis=-1)

    def temperature(self, sensor: str, t: FloatArray) -> FloatArray:
        """(n,) of a sensor's own thermometer, else the IMU's [degC]."""
        own = sensor if sensor in self.recording.streams else "imu"
        has = self.recording.streams[own].has(("temperature",))
        return self._logged(t, own if has else "imu", "temperature")

    def _logged(self, t: FloatArray, stream: str, column: str) -> FloatArray:
        found = self.recording.streams[stream]
        return np.interp(t, found.t, found[column])


def along(recording: Recording, ready: Prepared) -> Along:
    """Surroundings of a recording along the smoothed motion of the filter.

    Parameters
    ----------
    recording : as it is, with its covariates
    ready : the same made ready for the filter
    """
    estimate = estimated_motion(ready.run())
    w_b = smoothed(estimate.t, estimate.w_ib_b)
    return Along(recording, replace(estimate, w_ib_b=w_b, dw_b=np.gradient(w_b, estimate.t, axis=0)))


def smoothed(t: FloatArray, values: FloatArray) -> FloatArray:
    """(n, 3) parabolas fitted over `RATE_SMOOTHING`."""
    window = 2 * round(0.5 * RATE_SMOOTHING / float(np.median(np.diff(t)))) + 1
    return values if window < 5 else np.asarray(savgol_filter(values, window, 2, axis=0))


def running_mean(values: FloatArray, width: float) -> FloatArray:
    """(n, 3) centred mean over `width` rows, at least three; over fewer at the ends."""
    half = max(1, round(0.5 * width))
    total = np.vstack([np.zeros(values.shape[1]), np.cumsum(values, axis=0)])
    rows = np.arange(len(values))
    first, last = np.maximum(rows - half, 0), np.minimum(rows + half + 1, len(values))
    return np.asarray((total[last] - total[first]) / (last - first)[:, None])
