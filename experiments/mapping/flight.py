"""A made-up survey: a multicopter with DGPS and a scanning laser that is not straight flies over a scene."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from sinan.experiments.mapping.cloud import Mounting
from sinan.experiments.mapping.scene import Scene, scanned
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.motion import Motion
from sinan.sensors.recording import Recording, Stream
from sinan.sensors.simulate import simulate

#: Beams of the scan [rad]
ANGLES = np.deg2rad(np.linspace(-35.0, 35.0, 41))
#: Returned brightness of ground and of what stands on it.
GROUND_BRIGHT, OBJECT_BRIGHT = 400.0, 900.0
SCENARIO = Path(__file__).parent / "survey.toml"


def surveyed(scene: Scene, mounting: Mounting, seed: int) -> tuple[Recording, Motion]:
    """The recording, which says nothing of the mounting; the true motion at its scans, whose stamps are late by the
    time offset.

    Parameters
    ----------
    scene : lies under the survey of `survey.toml`, 80 m by 70 m about the origin
    seed : of all noise
    """
    scenario = load_scenario(SCENARIO)
    made, _ = simulate(scenario, np.random.default_rng(seed))
    rng = np.random.default_rng([seed, 1])
    motion = scenario.trajectory().motion(made.streams["laser"].t)
    ranges = scanned(scene, motion, ANGLES, mounting, rng)
    spec = replace(made.sensors["laser"], angles=ANGLES)
    noisy = np.nan_to_num(ranges + (spec.noise_std or 0.0) * rng.standard_normal(ranges.shape), nan=0.0)
    columns = {f"range_{k}": column for k, column in enumerate(noisy.T)}
    stream = Stream(motion.t + mounting.time_offset, columns)
    recording = made.replace(streams={**made.streams, "laser": stream}, sensors={**made.sensors, "laser": spec})
    return recording, motion
