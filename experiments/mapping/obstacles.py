"""What stands on the ground: in the map, and in the plane of one scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.experiments.mapping.cloud import Cloud
from sinan.experiments.mapping.terrain import Grid
from sinan.sensors.arrays import BoolArray, FloatArray, runs_of
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import rpy_from_quaternion

#: What is lower is no obstacle [m], and what is smaller [m^2] neither.
LOWEST, SMALLEST = 1.0, 1.0


@dataclass(frozen=True)
class Obstacle:
    """Cells beside each other in which something stands.

    Attributes
    ----------
    east, north : of its middle [m]
    height : of its highest point above the ground [m]
    area : m^2
    """

    east: float
    north: float
    height: float
    area: float


def obstacles_of(objects: Grid) -> list[Obstacle]:
    """What is higher than `LOWEST` and larger than `SMALLEST`, highest first.

    Parameters
    ----------
    objects : height above the ground

    Neglects where one ends and the next begins: a tree that leans on a house is one with it.
    """
    from scipy.ndimage import label

    numbers, count = label(np.nan_to_num(objects.height) > LOWEST)
    found = []
    for number in range(1, count + 1):
        rows, columns = np.nonzero(numbers == number)
        area = len(rows) * objects.cell**2
        if area >= SMALLEST:
            east, north = (objects.cell * (float(np.mean(place)) + 0.5) for place in (columns, rows))
            height = float(np.max(objects.height[rows, columns]))
            found.append(Obstacle(objects.east + east, objects.north + north, height, area))
    return sorted(found, key=lambda one: -one.height)


@dataclass(frozen=True)
class ScanInPlane:
    """One scan.

    Attributes
    ----------
    t : s
    across, up : (k,) of every beam's point from the body, to its right and upwards [m]
    on_object : (k,) whether it is on something that stands on the ground
    """

    t: float
    across: FloatArray
    up: FloatArray
    on_object: BoolArray

    def obstacles(self) -> list[tuple[float, float, float]]:
        """From and to [m] across of beams beside each other on an object, and the shortest way there [m]."""
        away = np.hypot(self.across, self.up)
        return [
            (float(self.across[first:last].min()), float(self.across[first:last].max()), float(away[first:last].min()))
            for first, last in runs_of(self.on_object)
            if last - first > 1
        ]


def scan_in_plane(cloud: Cloud, ground: BoolArray, motion: Motion) -> ScanInPlane:
    """A scan with many points on objects and many on the ground, across the body's heading.

    Parameters
    ----------
    ground : (m,) of the cloud's points
    motion : that spans it
    """
    t, number = np.unique(cloud.t, return_inverse=True)
    standing, all_of_it = np.bincount(number.ravel(), weights=~ground), np.bincount(number.ravel())
    k = int(np.argmax(standing * (all_of_it - standing)))
    rows = np.flatnonzero(number.ravel() == k)
    rows = rows[np.argsort(cloud.angle[rows])]
    at = motion.at(t[k : k + 1])
    way = cloud.p_n[rows] - at.p_n[0]
    yaw = rpy_from_quaternion(at.q_nb)[0, 2]
    across = -np.sin(yaw) * way[:, 0] + np.cos(yaw) * way[:, 1]
    return ScanInPlane(float(t[k]), across, -way[:, 2], ~ground[rows])
