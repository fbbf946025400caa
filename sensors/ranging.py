"""Geometry shared by sonar and laser: a beam fixed in the body meets the flat ground."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import cross, rotate, rotate_back, tilted

BODY_DOWN = np.array([0.0, 0.0, 1.0])


def scan_beams(angles: FloatArray) -> FloatArray:
    """(beams, 3) unit vectors (0, sin a, cos a) in the body of a scan in its right-down plane; `angles` [rad]."""
    return np.stack([np.zeros_like(angles), np.sin(angles), np.cos(angles)], axis=-1)


def descent(q_nb: FloatArray, beam_b: FloatArray = BODY_DOWN) -> FloatArray:
    """(C_nb beam)_down, by how much a beam goes down over one unit of its length; (..., 4), (..., 3) -> (...).

    For the beam (0, sin a, cos a) of a body with roll and pitch: cos(pitch) cos(roll - a).
    """
    return rotate(q_nb, beam_b)[..., 2]


def slant_range(motion: Motion, beam_b: FloatArray = BODY_DOWN) -> FloatArray:
    """Distance to the flat ground along the unit vector `beam_b` (3,) or (n, 3).

    range = (ground_down - down) / (C_nb beam_b)_down;  for body down the divisor is cos(pitch) cos(roll)

    Returns
    -------
    (n,) m; infinite where the beam does not point below the horizon
    """
    down = descent(motion.q_nb, beam_b)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(down > 0.0, motion.height / down, np.inf)


def slant_range_jacobian(motion: Motion, beam_b: FloatArray = BODY_DOWN) -> dict[str, FloatArray]:
    """Blocks position (n, 1, 3) and attitude (n, 1, 3) of `slant_range`.

    With c = e3' C_nb beam: d range / d down = -1 / c, and since d(C_nb beam) = -C_nb [beam]x dtheta_b,
    d range / d dtheta_b = range / c (e3' C_nb [beam]x) = range / c (d_b x beam)' with d_b = C_bn e3. No finite number
    where the beam does not point below the horizon.
    """
    n = len(motion)
    c = descent(motion.q_nb, beam_b)
    d_b = rotate_back(motion.q_nb, np.broadcast_to(BODY_DOWN, (n, 3)))
    position = np.zeros((n, 1, 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        position[:, 0, 2] = -1.0 / c
        attitude = (slant_range(motion, beam_b) / c)[:, None] * cross(d_b, beam_b)
    return {"position": position, "attitude": attitude[:, None, :]}


def height_from_beams(ranges: FloatArray, beams_b: FloatArray, roll: FloatArray, pitch: FloatArray) -> FloatArray:
    """Height above flat ground [m] from ranges along several beams, exactly: least squares over the beams.

    Beam i goes down by c_i = (C_nb beam_i)_down over one metre, the `descent` that the model of the filter has too, so
    it meets the ground at range_i = h / c_i. With equal noise on the ranges the best h minimises
    sum (range_i - h / c_i)^2:  h = sum(range_i / c_i) / sum(1 / c_i^2).

    Parameters
    ----------
    ranges : (n, beams) m
    beams_b : (beams, 3) unit vectors in the body
    roll, pitch : (n,) rad
    """
    c = descent(tilted(roll, pitch)[:, None, :], beams_b)
    return np.asarray(np.sum(ranges / c, axis=1) / np.sum(1.0 / c**2, axis=1))


def tilt_compensated_height(slant: FloatArray, roll: FloatArray, pitch: FloatArray) -> FloatArray:
    """Height above flat ground [m] from a slant range along body down: h = range cos(pitch) cos(roll).

    Parameters
    ----------
    slant : (n,) m
    roll, pitch : (n,) rad

    Neglects sonar.beam_cone, sonar.mount_offset, sonar.terrain_slope and the laser's like. Source: the course, section
    4.
    """
    return np.asarray(slant * descent(tilted(roll, pitch)))
