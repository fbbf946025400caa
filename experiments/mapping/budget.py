"""Error budget of a point of the map, cause by cause."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.experiments.mapping.cloud import Mounting, Scans
from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.ranging import scan_beams
from sinan.sensors.rotation import cross, matrix_from_quaternion

CAUSES = ("range", "angle", "attitude", "position", "boresight", "lever arm", "time")


@dataclass(frozen=True)
class Sigmas:
    """1-sigma of each cause, of each axis.

    Attributes
    ----------
    range : m, of one reading
    angle : rad, of a beam in the scan's plane
    attitude : (3,) rad, of the body's axes
    position : (3,) m, NED
    boresight : (2,) rad, roll and pitch
    lever_arm : (3,) m, body
    time : s, of the stamps against the IMU's
    """

    range: float
    angle: float
    attitude: FloatArray
    position: FloatArray
    boresight: FloatArray
    lever_arm: FloatArray
    time: float


def budget(scans: Scans, motion: Motion, sigmas: Sigmas, mounting: Mounting) -> dict[str, tuple[float, float]]:
    """By cause, and for all together: RMS over the points of the horizontal (both axes) and vertical 1-sigma [m].

    With s = l + r beam in the body, d p = d p_n + C (d theta x s) + C d l + C beam d r + C r beam' d a
    + C (d b x r beam) - (v + C (w x s)) d t, each with the variance of its cause; causes are independent.

    Parameters
    ----------
    motion : that spans the scans; a rate that it does not know counts as zero

    Source: P. Schaer, J. Skaloud, S. Landtwing, K. Legat, 5th Int. Symp. Mobile Mapping Technology (2007). Neglects
    what a slanting beam makes of a rough ground, and that the errors of one strip are not independent of each other.
    """
    at = motion.at(scans.t - mounting.time_offset)
    keep = np.isfinite(scans.ranges)
    row, beam = np.nonzero(keep)
    r, C = scans.ranges[keep][:, None], matrix_from_quaternion(at.q_nb)[row]
    direction = scan_beams(scans.angles)[beam]
    sideways = np.column_stack([np.zeros(len(beam)), np.cos(scans.angles[beam]), -np.sin(scans.angles[beam])])
    s = mounting.lever_arm + r * direction
    rate = at.w_ib_b[row] if at.has("w_ib_b") else np.zeros_like(s)
    swept = at.v_n[row] + np.einsum("nij,nj->ni", C, cross(rate, s))

    def through(columns: list[FloatArray]) -> tuple[float, float]:
        """Of displacements in the body, one a unit of noise."""
        moved = [np.einsum("nij,nj->ni", C, column) for column in columns]
        return _rms(moved)

    axes = np.eye(3)
    parts = {
        "range": through([sigmas.range * direction]),
        "angle": through([sigmas.angle * r * sideways]),
        "attitude": through([sigmas.attitude[k] * cross(axes[k], s) for k in range(3)]),
        "position": _rms([np.tile(sigmas.position[k] * axes[k], (len(r), 1)) for k in range(3)]),
        "boresight": through([sigmas.boresight[k] * cross(axes[k], r * direction) for k in range(2)]),
        "lever arm": through([np.tile(sigmas.lever_arm[k] * axes[k], (len(r), 1)) for k in range(3)]),
        "time": _rms([sigmas.time * swept]),
    }
    total = np.sqrt(np.sum(np.square(list(parts.values())), axis=0))
    return parts | {"together": (float(total[0]), float(total[1]))}


def _rms(moved: list[FloatArray]) -> tuple[float, float]:
    squares = np.sum([np.square(one) for one in moved], axis=0)
    mean = np.mean(squares, axis=0)
    return float(np.sqrt(mean[0] + mean[1])), float(np.sqrt(mean[2]))
