"""Flights of several kinds: each draws a path, a heading and a wind; tilt stays below `TILT_LIMIT`."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from sinan.experiments.blind.maker.body import Hand, Multirotor
from sinan.experiments.blind.maker.catalogue import log_uniform
from sinan.experiments.blind.maker.curves import STEP_ACCELERATION, STEP_SPEED, Curve, Rise, Sine
from sinan.experiments.blind.maker.turning import random_direction, random_rotation

#: No multirotor of the usual kind tilts further outside acrobatics, and a beam along body down loses the ground [rad].
TILT_LIMIT = 0.9
#: Least thrust over weight: rotors always push.
VERTICAL_LIMIT = 0.5

Path = tuple[Curve, Curve, Curve]


def draw_multirotor(
    rng: np.random.Generator, style: str, length: float, gravity: float, low: bool, at_rest: bool
) -> Multirotor:
    """A flight of a style of `STYLES` over `length` seconds; `low`: within the rotors' own wash; `at_rest`: it hovers
    for the first seconds."""
    while True:
        fade = (float(rng.uniform(3.0, 5.0)), float(rng.uniform(2.0, 4.0))) if at_rest else None
        path, heading = STYLES[style](rng, length, low, fade)
        gusty = style == "gusts"
        wind = draw_wind(rng, gusty)
        drag = float(rng.uniform(0.15, 0.4) if gusty else rng.uniform(0.02, 0.3))
        flight = Multirotor(path, heading, wind, drag, gravity)
        body = flight(np.arange(0.0, length, 0.02))
        if np.max(np.arccos(body.C[:, 2, 2])) < TILT_LIMIT and np.min(body.thrust) > VERTICAL_LIMIT * gravity:
            return flight


def wander(
    rng: np.random.Generator, length: float, low: bool, fade: tuple[float, float] | None, strength: float = 1.5
) -> tuple[Path, Curve]:
    """Sums of sines on every axis and in heading."""
    push = strength * log_uniform(rng, 0.5, 1.6)
    north = Curve(float(rng.normal(0.0, 5.0)), sines(rng, 5, push, (0.05, 0.5)), fade=fade)
    east = Curve(float(rng.normal(0.0, 5.0)), sines(rng, 5, push, (0.05, 0.5)), fade=fade)
    down = vertical(rng, low, fade)
    turning = sines(rng, 3, float(rng.uniform(0.1, 0.5)), (0.03, 0.2), reach=1.5)
    return (north, east, down), Curve(float(rng.uniform(-np.pi, np.pi)), turning, fade=fade)


def aggressive(
    rng: np.random.Generator, length: float, low: bool, fade: tuple[float, float] | None
) -> tuple[Path, Curve]:
    """The same, harder and faster."""
    (north, east, down), _ = wander(rng, length, low, fade, strength=3.0)
    turning = sines(rng, 4, float(rng.uniform(0.6, 1.5)), (0.1, 0.5), reach=2.0)
    return (north, east, down), Curve(float(rng.uniform(-np.pi, np.pi)), turning, fade=fade)


def gusts(rng: np.random.Generator, length: float, low: bool, fade: tuple[float, float] | None) -> tuple[Path, Curve]:
    """A hover that the wind shakes."""
    (north, east, down), heading = wander(rng, length, low, fade, strength=0.3)
    return (north, east, down), heading


def figure_eight(
    rng: np.random.Generator, length: float, low: bool, fade: tuple[float, float] | None
) -> tuple[Path, Curve]:
    """A lying eight, with the heading swinging as the path does."""
    period = float(rng.uniform(9.0, 25.0))
    omega = 2.0 * np.pi / period
    size = min(float(rng.uniform(0.8, 2.5)) / omega**2, 30.0)
    turned, phase = float(rng.uniform(0.0, 2.0 * np.pi)), float(rng.uniform(0.0, 2.0 * np.pi))
    along, across = (size, omega, phase), (0.5 * size, 2.0 * omega, 2.0 * phase)
    c, s = np.cos(turned), np.sin(turned)
    north = [Sine(c * along[0], *along[1:]), Sine(-s * across[0], *across[1:])]
    east = [Sine(s * along[0], *along[1:]), Sine(c * across[0], *across[1:])]
    heading = [Sine(float(rng.uniform(0.3, 1.2)), omega, float(rng.uniform(0.0, 2.0 * np.pi)))]
    path = (Curve(0.0, north, fade=fade), Curve(0.0, east, fade=fade), vertical(rng, low, fade))
    return path, Curve(float(rng.uniform(-np.pi, np.pi)), heading, fade=fade)


def square(rng: np.random.Generator, length: float, low: bool, fade: tuple[float, float] | None) -> tuple[Path, Curve]:
    """Legs, stops and turns on the spot, one after the other, with the height changed now and then."""
    t, at = float(rng.uniform(3.0, 5.0)), 0
    sides = rng.uniform(5.0, 25.0, size=2)
    push = float(rng.uniform(0.8, 3.0))
    rises: list[list[Rise]] = [[], [], [], []]
    floor, ceiling = (0.6, 3.0) if low else (2.0, 12.0)
    height = start = float(rng.uniform(floor, ceiling))
    while t < length:
        axis, sign = at % 2, 1.0 if at % 4 < 2 else -1.0
        leg = leg_time(sides[axis], push)
        rises[axis].append(Rise(sign * float(sides[axis]), t, leg))
        if rng.uniform() < 0.5:
            new = float(rng.uniform(floor, ceiling))
            rises[2].append(Rise(height - new, t, max(leg, leg_time(abs(new - height), 1.5))))
            height = new
        t += leg + float(rng.uniform(0.5, 2.0))
        turn = float(rng.choice([-0.5, 0.5, 1.0])) * np.pi
        lasting = abs(turn) * STEP_SPEED / float(rng.uniform(0.5, 1.5))
        rises[3].append(Rise(turn, t, lasting))
        t += lasting + float(rng.uniform(0.5, 2.0))
        at += 1
    small = [Curve(0.0, sines(rng, 3, 0.15, (0.1, 0.5)), rises[axis], fade) for axis in (0, 1)]
    down = Curve(-start, sines(rng, 2, 0.05, (0.2, 0.5), reach=0.2), rises[2], fade)
    return (small[0], small[1], down), Curve(float(rng.uniform(-np.pi, np.pi)), rises=rises[3])


def climb(rng: np.random.Generator, length: float, low: bool, fade: tuple[float, float] | None) -> tuple[Path, Curve]:
    """Climbs and descents between levels, over a slow wander."""
    (north, east, _), heading = wander(rng, length, low, fade, strength=0.7)
    t, height = float(rng.uniform(3.0, 6.0)), float(rng.uniform(1.5, 4.0))
    start, rises = height, []
    while t < length:
        new = float(rng.uniform(0.8, 4.0) if low else rng.uniform(1.5, 30.0))
        lasting = max(leg_time(abs(new - height), 2.0), abs(new - height) * STEP_SPEED / 4.0)
        rises.append(Rise(height - new, t, lasting))
        t, height = t + lasting + float(rng.uniform(1.0, 6.0)), new
    return (north, east, Curve(-start, sines(rng, 2, 0.1, (0.1, 0.4), reach=0.2), rises, fade)), heading


STYLES: Mapping[
    str, Callable[[np.random.Generator, float, bool, tuple[float, float] | None], tuple[Path, Curve]]
] = {
    "wander": wander,
    "aggressive": aggressive,
    "gusts": gusts,
    "figure_eight": figure_eight,
    "square": square,
    "climb": climb,
}  # fmt: skip
#: Styles that tilt enough for what only shows when tilted.
TILTING = ("aggressive", "gusts", "wander", "square")


def sines(
    rng: np.random.Generator, count: int, push: float, band: tuple[float, float], reach: float = 20.0
) -> list[Sine]:
    """Sines of which each takes a random share of the acceleration `push`, in a band of frequency [Hz].

    No amplitude exceeds `reach`.
    """
    shares = push * rng.dirichlet(np.ones(count))
    omegas = 2.0 * np.pi * np.array([log_uniform(rng, *band) for _ in range(count)])
    phases = rng.uniform(0.0, 2.0 * np.pi, size=count)
    return [
        Sine(float(min(share / omega**2, reach / count)), float(omega), float(phase))
        for share, omega, phase in zip(shares, omegas, phases, strict=True)
    ]


def vertical(rng: np.random.Generator, low: bool, fade: tuple[float, float] | None) -> Curve:
    """A height that wanders and stays above the ground."""
    middle = float(rng.uniform(1.0, 2.5)) if low else log_uniform(rng, 2.5, 20.0)
    moving = sines(rng, 4, float(rng.uniform(0.2, 1.2)), (0.04, 0.4), reach=0.8 * (middle - 0.3))
    return Curve(-middle, moving, fade=fade)


def draw_wind(rng: np.random.Generator, gusty: bool) -> Path:
    """A mean wind with gusts of a second and more; hardly any of it vertical."""
    strength = float(rng.uniform(2.0, 5.0) if gusty else rng.uniform(0.0, 1.0))
    curves = []
    for share in (1.0, 1.0, 0.15):
        shaking = [
            Sine(float(share * strength * a), 2.0 * np.pi * log_uniform(rng, 0.05, 0.7), float(rng.uniform(0.0, 6.28)))
            for a in rng.dirichlet(np.ones(4))
        ]
        curves.append(Curve(float(rng.normal(0.0, 2.0)) * (share == 1.0), shaking))
    return (curves[0], curves[1], curves[2])


def leg_time(distance: float, push: float) -> float:
    """Time of a smooth step whose largest acceleration is `push` [s]."""
    return max(1.5, float(np.sqrt(distance * STEP_ACCELERATION / push)))


def draw_hand(
    rng: np.random.Generator, count: int, rest: tuple[float, float], turn: tuple[float, float],
    first_rest: float, fastest: float, gravity: float,
) -> tuple[Hand, float]:  # fmt: skip
    """Turns in the hand and when the last rest ends; angles of 0.6 to 2.6 rad about any axis, at `fastest`
    rad/s at most."""
    angles = rng.uniform(0.6, 2.6, size=count)
    turns = np.stack([angle * random_direction(rng) for angle in angles])
    duration = np.maximum(rng.uniform(*turn, size=count), angles * STEP_SPEED / fastest)
    rests = rng.uniform(*rest, size=count)
    begin = first_rest + np.concatenate([[0.0], np.cumsum(duration + rests)[:-1]])
    arm = float(rng.uniform(0.03, 0.15)) * random_direction(rng)
    return Hand(random_rotation(rng), turns, begin, duration, arm, gravity), float(begin[-1] + duration[-1] + rests[-1])
