"""Range beams fixed in the body: their directions, and where they meet an inclined ground."""

from __future__ import annotations

import numpy as np

from sensors.arrays import FloatArray
from sensors.motion import Motion
from sensors.ranging import slant_range
from sensors.rotation import rotate

BORESIGHT_AXES = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # a beam is turned about body forward, then right


def beams_b(motion: Motion) -> FloatArray:
    """(beams, 3) directions in the body: along body down, or the scan of the covariate `angles` (n, beams) [rad]."""
    angles = motion.covariates["angles"][0] if motion.has("angles") else np.zeros(1)
    return np.stack([np.zeros_like(angles), np.sin(angles), np.cos(angles)], axis=-1)


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
        meets = towards > 0.0
        ranges.append(
            np.where(meets, (motion.height - motion.p_n[:, :2] @ slope) / np.where(meets, towards, 1.0), np.inf)
        )
    return np.stack(ranges, axis=1)


def inclined_ground_slope(motion: Motion) -> FloatArray:
    """(n, beams, 2) derivative of `inclined_ground` at slope 0: -(p + r d)_horizontal / d_down."""
    rows = []
    for beam in beams_b(motion):
        d = rotate(motion.q_nb, np.broadcast_to(beam, (len(motion), 3)))
        meets = motion.p_n[:, :2] + slant_range(motion, beam)[:, None] * d[:, :2]
        rows.append(-meets / d[:, 2:3])
    return np.stack(rows, axis=1)
