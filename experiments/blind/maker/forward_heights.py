"""What each effect adds to the height of the barometer and to ranges: docs/effects.md once more."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from sinan.experiments.blind.maker.body import Body
from sinan.experiments.blind.maker.forward import Forward, Seen, diagonal, warm
from sinan.experiments.blind.maker.scene import Surroundings
from sinan.experiments.blind.maker.turning import rot_x, rot_y
from sinan.sensors.arrays import FloatArray

#: Height over which the rotors' wash dies out near the ground [m] (EFFECTS: baro.propwash).
WASH_HEIGHT = 2.0
#: Step of the lag's own integration [s], and how many time constants of its past are followed.
LAG_STEP, LAG_PAST = 2e-3, 15.0


def baro_airspeed(b: FloatArray, seen: Seen) -> FloatArray:
    """height += b V^2."""
    return np.outer(seen.body.airspeed**2, b)


def baro_propwash(b: FloatArray, seen: Seen) -> FloatArray:
    """height += b x mean throttle x exp(-h / 2 m)."""
    h = seen.scene.ground_down - seen.body.p[:, 2]
    return np.outer(seen.scene.throttle(seen.body).mean(axis=1) * np.exp(-h / WASH_HEIGHT), b)


def baro_lag(b: FloatArray, seen: Seen) -> FloatArray:
    """The reading is z with b dz/dt = height - z, exact for a height that is linear within each fine step."""
    lag = float(b[0])
    t = seen.body.t
    past = np.arange(t[0] - LAG_PAST * lag - LAG_STEP, t[-1] + 2.0 * LAG_STEP, LAG_STEP)
    height = -seen.scene.motion(past).p[:, 2]
    decay = np.exp(-LAG_STEP / lag)
    within = lag / LAG_STEP * (1.0 - decay)
    weights = [1.0 - within, within - decay]
    z, _ = lfilter(weights, [1.0, -decay], height, zi=[height[0] - weights[0] * height[0]])
    return (np.interp(t, past, z) - seen.plain[:, 0])[:, None]


def stretched(b: FloatArray, seen: Seen) -> FloatArray:
    """range x (1 + b)."""
    return diagonal(b, seen)


def shifted(b: FloatArray, seen: Seen) -> FloatArray:
    """range + b."""
    return np.broadcast_to(b, seen.plain.shape)


def sonar_beam_cone(b: FloatArray, seen: Seen) -> FloatArray:
    """range = h / cos(max(0, tilt - b))."""
    h = seen.scene.ground_down - seen.body.p[:, 2]
    tilt = np.arccos(np.clip(seen.body.C[:, 2, 2], -1.0, 1.0))
    return (h / np.cos(np.maximum(0.0, tilt - b[0])) - seen.plain[:, 0])[:, None]


def terrain_slope(b: FloatArray, seen: Seen) -> FloatArray:
    """The ground's height above `ground_down` is b0 north + b1 east: where the beam meets that plane."""
    return (beam_range(seen.body, seen.scene, (0.0, 0.0, 1.0), b) - seen.plain[:, 0])[:, None]


def boresight(b: FloatArray, seen: Seen) -> FloatArray:
    """Beam along Rx(b0) Ry(b1) (0, 0, 1) in the body."""
    beam = rot_x(float(b[0])) @ rot_y(float(b[1])) @ np.array([0.0, 0.0, 1.0])
    return (beam_range(seen.body, seen.scene, beam) - seen.plain[:, 0])[:, None]


def lever_arm(b: FloatArray, seen: Seen) -> FloatArray:
    """The transducer sits at p + R b: its own height above the ground, along its own beam."""
    moved = replace(seen.body, p=seen.body.p + seen.body.to_ned(np.broadcast_to(b, seen.body.p.shape)))
    return (beam_range(moved, seen.scene) - seen.plain[:, 0])[:, None]


def beam_range(
    body: Body, scene: Surroundings, beam_b: object = (0.0, 0.0, 1.0), slope: FloatArray | None = None
) -> FloatArray:
    """(n,) slant range to a plane: p_d + r d_d = ground - b0 (p_n + r d_n) - b1 (p_e + r d_e)."""
    d = body.to_ned(np.asarray(beam_b, dtype=np.float64))
    b = np.zeros(2) if slope is None else slope
    clear = scene.ground_down - body.p[:, 2] - body.p[:, :2] @ b
    return np.asarray(clear / (d[:, 2] + d[:, :2] @ b))


HEIGHT_EFFECTS: Mapping[str, Forward] = {
    "baro.airspeed": baro_airspeed,
    "baro.temperature": warm,
    "baro.propwash": baro_propwash,
    "baro.lag": baro_lag,
    "baro.scale": diagonal,
    "sonar.sound_speed": stretched,
    "sonar.mount_offset": shifted,
    "sonar.beam_cone": sonar_beam_cone,
    "sonar.terrain_slope": terrain_slope,
    "sonar.boresight": boresight,
    "sonar.lever_arm": lever_arm,
    "laser.boresight": boresight,
    "laser.lever_arm": lever_arm,
    "laser.mount_offset": shifted,
    "laser.scale": stretched,
    "laser.terrain_slope": terrain_slope,
}
