"""A simulated flight for the course's formulas: readings, and the motion that they are compared with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sinan.experiments.scenarios import load_scenario
from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.recording import Stream
from sinan.sensors.rotation import rpy_from_quaternion
from sinan.sensors.simulate import simulate

SEED = 1


def flown(name: str, sensor: str, angles: FloatArray | None = None) -> tuple[Stream, Motion, FloatArray]:
    """One sensor's stream of a scenario, the true motion at its stamps, and the true roll, pitch, yaw (n, 3) [rad].

    Parameters
    ----------
    name : of the scenario
    sensor : mag, sonar or laser
    angles : (beams,) of a laser scan [rad]; None: one beam
    """
    scenario = load_scenario(name)
    instrument = scenario.sensors[sensor]
    sensors = {**scenario.sensors, sensor: replace(instrument, spec=replace(instrument.spec, angles=angles))}
    recording, _ = simulate(scenario.replace(sensors=sensors), np.random.default_rng(SEED))
    stream = recording.streams[sensor]
    motion = scenario.trajectory().motion(stream.t)
    return stream, motion, rpy_from_quaternion(motion.q_nb)


def rms(error: FloatArray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(error**2)))
