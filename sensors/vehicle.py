"""What goes on aboard while a simulated multicopter flies: throttle, current, airspeed, temperatures, vibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.scenario import Scenario, Warming
from sinan.sensors.trajectory import Multicopter, Turntable
from sinan.sensors.vibration import WINDOW

#: Share of throttle by which opposite motors differ for an angular acceleration of 1 rad/s^2 (a 1 kg frame of 0.45 m)
MIXING = np.array([0.002, 0.002, 0.004])
#: Signs of roll, pitch, yaw in the four motors of an X frame
ARMS = np.array([[-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0], [-1.0, -1.0, -1.0]])
#: The frequencies of the three axes' vibration over the motors': no two in step
TONES = np.array([1.0, 0.93, 1.07])


@dataclass(frozen=True)
class Vehicle:
    """The vehicle of a scenario: its trajectory, and everything that goes with thrust, airspeed and time.

    Attributes
    ----------
    scenario : of the experiment
    trajectory : its motion
    """

    scenario: Scenario
    trajectory: Multicopter | Turntable

    def motion(self, t: FloatArray, sensor: str) -> Motion:
        """The motion at the instants t, with the covariates as the sensor's own effects see them."""
        motion = self.trajectory.motion(t)
        spec = self.scenario.sensors.get(sensor)
        covariates = {"temperature": self.temperature(t, sensor), **self.aboard(motion)}
        if sensor == "accel":
            covariates["vibration"] = self.vibration_power(t)
        if spec is not None and spec.spec.angles is not None:
            covariates["angles"] = np.tile(spec.spec.angles, (len(t), 1))
        return motion.with_covariates(**covariates)

    def aboard(self, motion: Motion) -> dict[str, FloatArray]:
        """Throttle, current, airspeed, wind along the motion."""
        thrust = self.thrust(motion)
        wind = np.tile(np.array(self.scenario.air.wind), (len(motion), 1))
        return {
            "throttle": self.throttle(thrust),
            "current": self.current(motion.t, thrust),
            "airspeed": self.airspeed(motion),
            "wind": wind,
        }

    def thrust(self, motion: Motion) -> FloatArray:
        """(n,) thrust over weight: 1 in hover, 0 on the ground and on a turntable."""
        if not isinstance(self.trajectory, Multicopter):
            return np.zeros(len(motion))
        return np.maximum(-motion.f_b[:, 2] / self.scenario.gravity, 0.0) * self.trajectory.lift(motion.t)

    def throttle(self, thrust: FloatArray) -> FloatArray:
        """(n,) mean throttle, 0 to 1: thrust goes with the square of the rotor speed, rotor speed with throttle."""
        return np.clip(self.scenario.supply.hover_throttle * np.sqrt(thrust), 0.0, 1.0)

    def motors(self, motion: Motion) -> FloatArray:
        """(n, 4) throttle of each motor, whose mean is the mean throttle."""
        mean = self.throttle(self.thrust(motion))[:, None]
        turning = (motion.dw_b * MIXING) @ ARMS.T * (mean > 0.0)
        return np.clip(mean + np.clip(turning, -mean, 1.0 - mean), 0.0, 1.0)

    def voltage(self, t: FloatArray) -> FloatArray:
        """(n,) battery voltage, falling evenly as at hover [V]."""
        supply = self.scenario.supply
        used = np.maximum(t, 0.0) * supply.hover_current / supply.capacity
        return supply.full_voltage - (supply.full_voltage - supply.empty_voltage) * used

    def current(self, t: FloatArray, thrust: FloatArray) -> FloatArray:
        """(n,) supply current [A]: idle + hover x thrust^1.5 (momentum theory), more as the voltage falls.

        On a bench without rotors a load is switched softly on and off, so that its field can be seen.
        """
        supply = self.scenario.supply
        if not isinstance(self.trajectory, Multicopter):
            return supply.idle_current + 0.5 * supply.hover_current * (
                1.0 + np.tanh(4.0 * np.sin(2.0 * np.pi * t / 19.0))
            )
        return supply.idle_current + supply.hover_current * thrust**1.5 * supply.full_voltage / self.voltage(t)

    def airspeed(self, motion: Motion) -> FloatArray:
        """(n,) speed against the air [m/s]."""
        return np.asarray(np.linalg.norm(motion.v_n - np.array([*self.scenario.air.wind, 0.0]), axis=1))

    def temperature(self, t: FloatArray, sensor: str) -> FloatArray:
        """(n,) temperature of the sensor's board [degC]: the barometer's own, or the one that all others share."""
        return warmed(t, self.scenario.baro_warming if sensor == "baro" else self.scenario.warming)

    def vibration_amplitude(self, thrust: FloatArray) -> FloatArray:
        """(n, 3) amplitude of the shaking [m/s^2]: an imbalance pulls with the square of the rotor speed."""
        return thrust[:, None] * np.array(self.scenario.vibration.amplitude)

    def vibration_power(self, t: FloatArray) -> FloatArray:
        """(n, 3) variance of the shaking, half its squared amplitude, averaged over `WINDOW` about t [(m/s^2)^2]."""
        if not any(self.scenario.vibration.amplitude):
            return np.zeros((len(t), 3))
        grid = np.arange(t[0] - WINDOW, t[-1] + WINDOW, WINDOW / 100.0)
        power = 0.5 * self.vibration_amplitude(self.thrust(self.trajectory.motion(grid))) ** 2
        summed = np.cumsum(power, axis=0) * (WINDOW / 100.0)
        ahead, behind = t + 0.5 * WINDOW, t - 0.5 * WINDOW
        return np.stack([np.interp(ahead, grid, s) - np.interp(behind, grid, s) for s in summed.T], axis=-1) / WINDOW

    def shaking(self, motion: Motion, rng: np.random.Generator) -> FloatArray:
        """(n, 3) vibration at the IMU's instants [m/s^2]: one tone an axis that follows the rotor speed."""
        thrust = self.thrust(motion)
        frequency = self.scenario.vibration.frequency * np.sqrt(thrust)
        steps = np.diff(motion.t, prepend=motion.t[0])
        phase = 2.0 * np.pi * np.cumsum(frequency * steps)[:, None] * TONES + rng.uniform(0.0, 2.0 * np.pi, 3)
        return self.vibration_amplitude(thrust) * np.sin(phase)


def warmed(t: FloatArray, warming: Warming) -> FloatArray:
    """(n,) ambient + rise (1 - exp(-t / time_constant)) + swing sin(2 pi t / period) [degC]."""
    rising = warming.rise * (1.0 - np.exp(-np.maximum(t, 0.0) / warming.time_constant))
    return np.asarray(warming.ambient + rising + warming.swing * np.sin(2.0 * np.pi * t / warming.period))
