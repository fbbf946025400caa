"""Made-up country to scan: bare ground, houses, trees; where beams meet it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sinan.experiments.mapping.cloud import Mounting
from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.ranging import scan_beams
from sinan.sensors.rotation import rotate

#: (north, east) -> height [m]
Ground = Callable[[FloatArray, FloatArray], FloatArray]
FAR = 150.0  # m, the longest range
#: Steps of the march along a beam; what is thinner than `FAR` / `MARCH` may be passed through.
MARCH = 300
#: A point that is higher above the bare ground is on an object [m].
STANDS = 0.05


@dataclass(frozen=True)
class Scene:
    """Ground and what stands on it.

    Attributes
    ----------
    bare : height of the ground, (north, east) [m] -> [m]
    houses : (north, east of the middle, half sides, height above the ground in the middle) [m]
    trees : (north, east, radius, height) of half ellipsoids [m]
    gaps : share of beams that pass between the leaves
    """

    bare: Ground
    houses: tuple[tuple[float, float, float, float, float], ...] = ()
    trees: tuple[tuple[float, float, float, float], ...] = ()
    gaps: float = 0.0

    def solid(self, north: FloatArray, east: FloatArray) -> FloatArray:
        """Height of the ground and of roofs [m]."""
        height = np.array(self.bare(north, east))
        for n, e, half_n, half_e, up in self.houses:
            inside = (np.abs(north - n) < half_n) & (np.abs(east - e) < half_e)
            roof = float(self.bare(np.array(n), np.array(e))) + up
            height = np.where(inside, np.maximum(height, roof), height)
        return height

    def top(self, north: FloatArray, east: FloatArray) -> FloatArray:
        """Height of ground, roofs and crowns [m]."""
        height, bare = self.solid(north, east), self.bare(north, east)
        for n, e, radius, up in self.trees:
            away = ((north - n) ** 2 + (east - e) ** 2) / radius**2
            crown = bare + up * np.sqrt(np.maximum(1.0 - away, 0.0))
            height = np.where(away < 1.0, np.maximum(height, crown), height)
        return height

    def on_object(self, p_n: FloatArray) -> BoolArray:
        """(m,) whether true points (m, 3) NED are on something that stands on the ground."""
        return np.asarray(-p_n[:, 2] - self.bare(p_n[:, 0], p_n[:, 1]) > STANDS)


def hills(north: FloatArray, east: FloatArray) -> FloatArray:
    """Ground that slopes to 0.23 [m]."""
    return np.asarray(2.5 * np.sin(north / 11.0) * np.cos(east / 14.0) + 0.05 * east)


#: Hills with three houses and three trees, as the tests and `sinan lab laser_map` scan them.
COUNTRY = Scene(
    hills,
    ((12.0, 8.0, 4.0, 6.0, 5.0), (-14.0, 14.0, 5.0, 3.5, 7.0), (20.0, -16.0, 3.0, 3.0, 4.0)),
    ((-6.0, -12.0, 2.2, 6.0), (-20.0, -4.0, 1.8, 5.0), (4.0, 22.0, 2.5, 8.0)),
)


def scanned(
    scene: Scene, motion: Motion, angles: FloatArray, mounting: Mounting, rng: np.random.Generator | None = None
) -> FloatArray:
    """(n, beams) ranges that a laser so mounted reads at these instants, without noise [m]; NaN beyond `FAR`.

    Parameters
    ----------
    motion : at the instants of the scans; their stamps are these plus the time offset
    angles : (beams,) rad
    rng : which beams pass between leaves; None: none does
    """
    low = marched(scene.top, motion, angles, mounting)
    if rng is None or not scene.trees:
        return low
    through = rng.random(low.shape) < scene.gaps
    return np.where(through, marched(scene.solid, motion, angles, mounting), low)


def marched(height: Ground, motion: Motion, angles: FloatArray, mounting: Mounting) -> FloatArray:
    """(n, beams) ranges to a surface: marching, then bisection, to a micrometre."""
    d = rotate(motion.q_nb[:, None, :], scan_beams(angles) @ mounting.turn.T)
    start = (motion.p_n + rotate(motion.q_nb, np.broadcast_to(mounting.lever_arm, motion.p_n.shape)))[:, None, :]

    def above(r: FloatArray) -> FloatArray:
        p = start + r[..., None] * d
        return np.asarray(-p[..., 2] - height(p[..., 0], p[..., 1]))

    low, high, hit = np.zeros(d.shape[:2]), np.full(d.shape[:2], FAR), np.zeros(d.shape[:2], dtype=bool)
    for near, far in pairwise(np.linspace(0.0, FAR, MARCH + 1)):
        now = ~hit & (above(np.full(d.shape[:2], far)) <= 0.0)
        low, high = np.where(now, near, low), np.where(now, far, high)
        hit |= now
        if hit.all():
            break
    for _ in range(22):
        middle = 0.5 * (low + high)
        below = above(middle) <= 0.0
        low, high = np.where(below, low, middle), np.where(below, middle, high)
    return np.where(hit, 0.5 * (low + high), np.nan)
