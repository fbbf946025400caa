"""Pseudoranges of simulated receivers: a constellation with its broadcast messages, and what receivers measure of it.

    rho' = |R p_s(t_tx) - p_r(t)| + c (clock_rx - clock_sat) + troposphere + ionosphere + e_s(t) + m + n

The signal's travel is solved in the frame that turns with the Earth, R the turn during the travel, so nothing is linear
here. The satellite's clock has its polynomial, the periodic relativistic term and the group delay of the code that is
measured; e_s is what the broadcast message is wrong by, the same for every receiver; m and n are the receiver's own.

Neglected: a difference between C/A and P code in the satellite; phase; the tides of station and antenna.

Sources: IS-GPS-200N, 20.3.3; Global Positioning System Standard Positioning Service Performance Standard, 4th ed.
(2008), table A.2-1, for the slots.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.code_receiver import CodeReceiver, strength
from sinan.sensors.constants import EARTH_RATE, SPEED_OF_LIGHT
from sinan.sensors.ephemeris import kepler_orbit
from sinan.sensors.formats.rinex_navigation import GLONASS, KEPLER, Navigation, Table
from sinan.sensors.formats.rinex_observation import Observations
from sinan.sensors.formats.rinex_text import WEEK
from sinan.sensors.pseudorange import L1, L2, MODELLED, Pseudoranges, circumstances
from sinan.sensors.range_error import RangeError

WEEK_NUMBER, START = 2200, 345600.0  # GPS week of every simulation and its second of week
#: Longitude of the node at the reference epoch and argument of latitude of the baseline 24 slots [deg].
SLOTS: Mapping[float, tuple[float, ...]] = {
    272.847: (268.126, 161.786, 11.676, 41.806),
    332.847: (80.956, 173.336, 309.976, 204.376),
    32.847: (111.876, 11.796, 339.666, 241.556),
    92.847: (135.226, 265.446, 35.156, 167.356),
    152.847: (197.046, 302.596, 66.066, 333.686),
    212.847: (238.886, 345.226, 105.206, 135.346),
}
KLOBUCHAR = np.array([1.1e-8, 1.5e-8, -6e-8, -1.2e-7, 9e4, 1.3e5, -6.5e4, -2.6e5])
TRAVEL_PASSES = 5  # of the signal's travel time: each gains a factor v / c
CARRIER = {"C1C": L1, "C1W": L1, "C2W": L2}


def constellation(seed: int = 0) -> Navigation:
    """Broadcast messages of 24 GPS satellites for the two hours about `START`; eccentricities and clocks are drawn."""
    rng = np.random.default_rng(seed)
    rows = np.zeros(24, dtype=KEPLER)
    nodes = [(node, u) for node, slots in SLOTS.items() for u in slots]
    for k, (node, u) in enumerate(nodes):
        row = rows[k : k + 1]
        omega = rng.uniform(0.0, 360.0)
        row["satellite"] = f"G{k + 1:02d}"
        row["toc"] = row["toe"] = row["sent"] = WEEK_NUMBER * WEEK + START
        row["af0"], row["af1"] = rng.normal(0.0, 1e-4), rng.normal(0.0, 3e-12)
        row["e"], row["sqrt_a"] = rng.uniform(0.001, 0.015), np.sqrt(26559710.0)
        row["m0"], row["omega"] = np.deg2rad((u - omega) % 360.0), np.deg2rad(omega)
        row["omega0"], row["i0"], row["omega_dot"] = np.deg2rad(node), np.deg2rad(55.0), -8e-9
        row["accuracy"], row["group_delay"], row["source"] = 2.0, rng.normal(0.0, 5e-9), 1.0
    return Navigation("simulated", rows, np.zeros(0, dtype=GLONASS), KLOBUCHAR)


@dataclass(frozen=True)
class Air:
    """What delays the ranges, by the declarations of the catalogue.

    Attributes
    ----------
    troposphere : zenith delay [m]
    ionosphere : share of Klobuchar's delay
    """

    troposphere: float = 2.4
    ionosphere: float = 1.0


@dataclass(frozen=True)
class Fault:
    """A satellite whose range is off by `offset` + `drift` (t - `onset`) from the onset on: m, m/s, s of the run."""

    satellite: str
    offset: float
    drift: float = 0.0
    onset: float = 0.0


@dataclass(frozen=True)
class Rows:
    """Pairs of an instant and a satellite in view, as `simulate_ranges` computes them; all (n,) or (n, 3)."""

    epoch: np.ndarray
    satellite: np.ndarray
    position: FloatArray
    velocity: FloatArray
    distance: FloatArray
    clock: FloatArray
    elevation: FloatArray


def satellite_errors(t: FloatArray, errors: Sequence[RangeError], count: int, seed: int) -> FloatArray:
    """(instants, satellites) what the broadcast messages are wrong by [m], the same for every receiver."""
    rng = np.random.default_rng([seed, 1])
    total = np.zeros((len(t), count))
    for error in errors:
        total += error.draw(t, count, rng)
    return total


def receiver_clock(t: FloatArray, receiver: CodeReceiver, rng: np.random.Generator) -> FloatArray:
    """(instants,) clock error [s]: an offset, a drift, and white frequency noise summed up."""
    step = np.diff(t, prepend=t[0])
    walk = np.cumsum(receiver.clock_noise * np.sqrt(step) * rng.standard_normal(len(t)))
    return np.asarray((1e5 * rng.uniform(-1.0, 1.0) + receiver.clock_drift * (t - t[0]) + walk) / SPEED_OF_LIGHT)


def in_view(
    table: Table, tag: FloatArray, clock: FloatArray, receiver_e: FloatArray, lowest: float
) -> tuple[Rows, FloatArray]:
    """The satellites above an elevation at every instant; also (n,) the travel times [s].

    Parameters
    ----------
    table : broadcast messages, one a satellite
    tag : (epochs,) of the receiver's clock [s of week]
    clock : (epochs,) what it is ahead [s]
    receiver_e : (epochs, 3) ECEF at those instants [m]
    lowest : elevation [rad]
    """
    epoch, number = (x.ravel() for x in np.meshgrid(np.arange(len(tag)), np.arange(len(table)), indexing="ij"))
    message, r = table[number], receiver_e[epoch]
    received = (tag - clock)[epoch]
    reference = message["toe"] - WEEK_NUMBER * WEEK
    travel = np.full(len(epoch), 0.075)
    for _ in range(TRAVEL_PASSES):
        p, v = kepler_orbit(message, received - travel - reference)
        s, c = np.sin(EARTH_RATE * travel), np.cos(EARTH_RATE * travel)
        turned = np.stack([c * p[:, 0] + s * p[:, 1], -s * p[:, 0] + c * p[:, 1], p[:, 2]], axis=1)
        distance = np.linalg.norm(turned - r, axis=1)
        travel = distance / SPEED_OF_LIGHT
    up = r / np.linalg.norm(r, axis=1)[:, None]  # of a round Earth: 0.2 deg at the most
    elevation = np.arcsin(np.sum((turned - r) * up, axis=1) / distance)
    since = received - travel - (message["toc"] - WEEK_NUMBER * WEEK)
    relativity = -2.0 * np.sum(p * v, axis=1) / SPEED_OF_LIGHT**2
    satellite_clock = message["af0"] + message["af1"] * since + message["af2"] * since**2 + relativity
    seen = elevation > lowest
    rows = Rows(epoch, number, p, v, distance, satellite_clock, elevation)
    return Rows(*(value[seen] for value in vars(rows).values())), travel[seen]


def delays(rows: Rows, navigation: Navigation, t: FloatArray, receiver_e: FloatArray, air: Air) -> FloatArray:
    """(n, 2) troposphere, and ionosphere on L1 [m], by the effects' own declarations."""
    n, names = len(rows.epoch), navigation.kepler["satellite"][rows.satellite]
    zero = np.zeros(n)
    ranges = Pseudoranges(
        "simulated", WEEK_NUMBER, t, rows.epoch, names, zero, np.full(n, L1), rows.position, rows.velocity, zero, zero,
        zero, zero, np.zeros(n, dtype=np.int64), navigation.klobuchar, None, (),
    )  # fmt: skip
    motion = circumstances(ranges, receiver_e)
    sizes = {"pseudorange.troposphere": air.troposphere, "pseudorange.ionosphere": air.ionosphere}
    return np.stack([MODELLED[name].regressor(motion)[:, 0, 0] * size for name, size in sizes.items()], axis=1)


def simulate_ranges(
    receiver: CodeReceiver,
    navigation: Navigation,
    t: FloatArray,
    receiver_e: FloatArray,
    errors: FloatArray | None = None,
    air: Air | None = None,
    faults: Sequence[Fault] = (),
    lowest: float = np.deg2rad(5.0),
    seed: int = 0,
) -> Observations:
    """What a receiver measures.

    Parameters
    ----------
    receiver : class of the receiver
    navigation : of the constellation
    t : (epochs,) tags of the receiver's clock [s of week]
    receiver_e : (epochs, 3) where it is, ECEF [m]
    errors : (epochs, satellites) what the messages are wrong by [m]; zero if not given
    air : delays; none if not given
    faults : satellites that are off
    lowest : elevation that is tracked [rad]
    seed : of noise, slow errors and clock
    """
    rng = np.random.default_rng([seed, 2])
    clock = receiver_clock(t, receiver, rng)
    rows, _ = in_view(navigation.kepler, t, clock, receiver_e, lowest)
    message = navigation.kepler[rows.satellite]
    delay = np.zeros((len(rows.epoch), 2)) if air is None else delays(rows, navigation, t, receiver_e, air)
    common = rows.distance + SPEED_OF_LIGHT * (clock[rows.epoch] - rows.clock) + delay[:, 0]
    common += 0.0 if errors is None else errors[rows.epoch, rows.satellite]
    for fault in faults:
        elapsed = (t - t[0])[rows.epoch] - fault.onset
        off = (message["satellite"] == fault.satellite) & (elapsed >= 0.0)
        common += np.where(off, fault.offset + fault.drift * elapsed, 0.0)
    power = strength(rows.elevation)
    slow = RangeError(1.0, receiver.drift_time)
    values: dict[str, FloatArray] = {}
    for code in receiver.codes:
        gamma = (L1 / CARRIER[code]) ** 2
        own = receiver.slow(rows.elevation) * slow.draw(t, len(navigation.kepler), rng)[rows.epoch, rows.satellite]
        own += receiver.sigma(power) * rng.standard_normal(len(power))
        values[code] = common + gamma * (delay[:, 1] + SPEED_OF_LIGHT * message["group_delay"]) + own
        values["S" + code[1:]] = power - receiver.losses
    return Observations("simulated", 3.04, receiver_e[0], WEEK_NUMBER, t, rows.epoch, message["satellite"], values, ())


__all__ = [
    "START",
    "WEEK_NUMBER",
    "Air",
    "Fault",
    "constellation",
    "satellite_errors",
    "simulate_ranges",
]
