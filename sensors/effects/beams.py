"""Range beams fixed in the body: their directions, and where they meet an inclined ground."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.laser import Laser, ground_points
from sinan.sensors.motion import Motion
from sinan.sensors.ranging import BODY_DOWN, descent, scan_beams, slant_range
from sinan.sensors.rotation import cross, rotate, rotate_back, rotation_exp

BORESIGHT_AXES = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # a beam is turned about body forward, then right


def angles_of(motion: Motion) -> FloatArray:
    """(beams,) of the scan of the covariate `angles` (n, beams), else one zero: along body down [rad]."""
    return motion.covariates["angles"][0] if motion.has("angles") else np.zeros(1)


def beams_b(motion: Motion) -> FloatArray:
    """(beams, 3) directions in the body."""
    return scan_beams(angles_of(motion))


def inclined_ground(motion: Motion, slope: FloatArray) -> FloatArray:
    """(n, beams) range to the plane whose height above `ground_down` is slope_0 north + slope_1 east.

    The beam's point p + r d lies in the plane where
    p_down + r d_down = ground_down - slope_0 (p_north + r d_north) - slope_1 (p_east + r d_east), so
    r = (height - slope . p_horizontal) / (d_down + slope . d_horizontal);  infinite where the beam does not meet it.
    """
    ranges = []
    for beam in beams_b(motion):
        d = rotate(motion.q_nb, np.broadcast_to(beam, (len(motion), 3)))
        towards = d[:, 2] + d[:, :2] @ slope
        with np.errstate(divide="ignore", invalid="ignore"):
            ranges.append(np.where(towards > 0.0, (motion.height - motion.p_n[:, :2] @ slope) / towards, np.inf))
    return np.stack(ranges, axis=1)


def inclined_ground_slope(motion: Motion) -> FloatArray:
    """(n, beams, 2) derivative of `inclined_ground` at slope 0: -(p + r d)_horizontal / d_down."""
    angles = angles_of(motion)
    meets = ground_points(motion, Laser(1.0, angles=angles).predict(motion), angles)[..., :2]
    return -meets / descent(motion.q_nb[:, None, :], scan_beams(angles))[..., None]


def boresight_slope(motion: Motion) -> FloatArray:
    """(n, beams, 2): d range / d b_j = -range / c (d_b . (e_j x beam)), c = d_b . beam, d_b = C_bn e_down."""
    d_b = rotate_back(motion.q_nb, np.broadcast_to(BODY_DOWN, (len(motion), 3)))
    rows = []
    for beam in beams_b(motion):
        turned = cross(BORESIGHT_AXES, beam)
        rows.append(-(slant_range(motion, beam) / (d_b @ beam))[:, None] * (d_b @ turned.T))
    return np.stack(rows, axis=1)


def boresight_range(motion: Motion, beta: FloatArray) -> FloatArray:
    """(n, beams) ranges along Rx(b0) Ry(b1) beam, the whole rotation."""
    turn = rotation_exp(np.array([beta[0], 0.0, 0.0])) @ rotation_exp(np.array([0.0, beta[1], 0.0]))
    return np.stack([slant_range(motion, turn @ beam) for beam in beams_b(motion)], axis=1)


def lever_arm_slope(motion: Motion) -> FloatArray:
    """(n, beams, 3): the beam starts at p + R r, so range = (height - (R r)_down) / c: d range / d r = -d_b / c."""
    d_b = rotate_back(motion.q_nb, np.broadcast_to(BODY_DOWN, (len(motion), 3)))
    c = descent(motion.q_nb[:, None, :], beams_b(motion))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(-d_b[:, None, :] / c[..., None])
