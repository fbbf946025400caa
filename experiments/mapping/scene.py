"""A made-up country to scan: hills, houses, trees; where beams meet it."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from sinan.experiments.mapping.cloud import Mounting
from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.ranging import scan_beams
from sinan.sensors.rotation import quaternion_from_rpy, rotate, rotation_exp

#: (north, east) -> height [m]
Ground = Callable[[FloatArray, FloatArray], FloatArray]
#: (north, east of the middle, half sides, height) of houses, and (north, east, radius, height) of trees [m]
HOUSES = ((12.0, 8.0, 4.0, 6.0, 5.0), (-14.0, 14.0, 5.0, 3.5, 7.0), (20.0, -16.0, 3.0, 3.0, 4.0))
TREES = ((-6.0, -12.0, 2.2, 6.0), (-20.0, -4.0, 1.8, 5.0), (4.0, 22.0, 2.5, 8.0))
FAR = 150.0  # m, the longest range


def hills(north: FloatArray, east: FloatArray) -> FloatArray:
    """The bare ground [m]."""
    return np.asarray(2.5 * np.sin(north / 11.0) * np.cos(east / 14.0) + 0.05 * east)


def on_it(north: FloatArray, east: FloatArray) -> BoolArray:
    """Whether a house or a tree stands there."""
    return np.asarray(country(north, east) > hills(north, east))


def country(north: FloatArray, east: FloatArray) -> FloatArray:
    """The ground with what stands on it [m]."""
    bare = hills(north, east)
    height = bare.copy()
    for n, e, half_n, half_e, up in HOUSES:
        inside = (np.abs(north - n) < half_n) & (np.abs(east - e) < half_e)
        height = np.where(inside, np.maximum(height, hills(np.array(n), np.array(e)) + up), height)
    for n, e, radius, up in TREES:
        away = ((north - n) ** 2 + (east - e) ** 2) / radius**2
        height = np.where(away < 1.0, np.maximum(height, bare + up * np.sqrt(np.maximum(1.0 - away, 0.0))), height)
    return height


def survey(rate: float = 20.0, speed: float = 5.0) -> Motion:
    """Seven straight strips there and back and across, at two heights, with the sway of a small multicopter."""
    lines = [
        (0.0, -10.0, 0.0, 30.0), (180.0, 0.0, 0.0, 30.0), (0.0, 10.0, 0.0, 30.0),
        (90.0, 0.0, -8.0, 30.0), (-90.0, 0.0, 8.0, 30.0), (0.0, 0.0, 0.0, 18.0), (180.0, 4.0, 0.0, 18.0),
    ]  # course [deg], east or north offset, height  # fmt: skip
    t_all, p_all, v_all, rpy_all, w_all = [], [], [], [], []
    begin = 0.0
    for course, east, north, height in lines:
        s = np.arange(0.0, 60.0 / speed, 1.0 / rate)
        along = speed * s - 30.0
        yaw = np.deg2rad(course)
        towards = np.array([np.cos(yaw), np.sin(yaw)])
        flat = along[:, None] * towards + np.array([north, east])
        p_all.append(np.column_stack([flat, np.full(len(s), -height)]))
        v_all.append(np.tile([*(speed * towards), 0.0], (len(s), 1)))
        sway = np.column_stack([0.06 * np.sin(1.7 * s + begin), 0.05 * np.sin(1.1 * s) - 0.05, np.full(len(s), yaw)])
        rpy_all.append(sway)
        roll, pitch = (
            0.06 * 1.7 * np.cos(1.7 * s + begin),
            0.05 * 1.1 * np.cos(1.1 * s),
        )
        w_all.append(np.column_stack([roll, pitch * np.cos(sway[:, 0]), -pitch * np.sin(sway[:, 0])]))
        t_all.append(begin + s)
        begin += float(s[-1]) + 20.0
    t, p, v, rpy = np.concatenate(t_all), np.concatenate(p_all), np.concatenate(v_all), np.concatenate(rpy_all)
    return Motion(t, p, v, q_nb=quaternion_from_rpy(rpy), w_ib_b=np.concatenate(w_all))


def scanned(motion: Motion, angles: FloatArray, mounting: Mounting, ground: Ground = country) -> FloatArray:
    """(n, beams) ranges that a laser so mounted reads at these instants; NaN beyond `FAR`.

    The stamps are the motion's times plus the time offset. Marching, then bisection: to a micrometre.
    """
    roll, pitch = mounting.boresight
    turn = rotation_exp(np.array([roll, 0.0, 0.0])) @ rotation_exp(np.array([0.0, pitch, 0.0]))
    d = rotate(motion.q_nb[:, None, :], scan_beams(angles) @ turn.T)
    start = (motion.p_n + rotate(motion.q_nb, np.broadcast_to(mounting.lever_arm, motion.p_n.shape)))[:, None, :]

    def above(r: FloatArray) -> FloatArray:
        p = start + r[..., None] * d
        return np.asarray(-p[..., 2] - ground(p[..., 0], p[..., 1]))

    steps = np.linspace(0.0, FAR, 301)
    low, high, hit = np.zeros(d.shape[:2]), np.full(d.shape[:2], FAR), np.zeros(d.shape[:2], dtype=bool)
    for near, far in pairwise(steps):
        now = ~hit & (above(np.full(d.shape[:2], far)) <= 0.0)
        low, high = np.where(now, near, low), np.where(now, far, high)
        hit |= now
    for _ in range(22):
        middle = 0.5 * (low + high)
        below = above(middle) <= 0.0
        low, high = np.where(below, low, middle), np.where(below, middle, high)
    return np.where(hit, 0.5 * (low + high), np.nan)
