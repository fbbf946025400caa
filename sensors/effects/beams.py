"""Range beams fixed in the body: their directions, and where they meet an inclined ground."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.laser import Laser, ground_points
from sinan.sensors.motion import Motion
from sinan.sensors.ranging import descent, scan_beams
from sinan.sensors.rotation import rotate

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
