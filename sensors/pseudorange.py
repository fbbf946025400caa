"""Pseudoranges: the plain model, the satellites that go with the measurements, and the modelled corrections.

The course writes, with corrections that are *added to the pseudorange*,

    |p_s - p_r| - d_iono = rho' + c (dt_sat + dT_rx),

so d_iono = -(delay), dT_rx = -(receiver clock error) and dt_sat = satellite clock minus system time. In physical
quantities, which is what this module and all outputs use,

    rho' = |p_s - p_r| + c (clock_rx - clock_sat) + delays.

The plain model has neither the satellite's clock nor delays; each of them is an effect of the catalogue, named
`pseudorange.*`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pymap3d

from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.constants import WGS84_A
from sinan.sensors.effects import (
    pseudorange_earth_rotation,
    pseudorange_group_delay,
    pseudorange_ionosphere,
    pseudorange_relativity,
    pseudorange_satellite_clock,
    pseudorange_troposphere,
)
from sinan.sensors.effects.declaration import Effect
from sinan.sensors.ephemeris import OK, STATUS, satellite_states
from sinan.sensors.formats.rinex_navigation import Navigation
from sinan.sensors.formats.rinex_observation import Journal, Observations, TextArray
from sinan.sensors.formats.rinex_text import WEEK, calendar
from sinan.sensors.motion import Motion
from sinan.sensors.range_noise import LOWEST_ELEVATION, RangeNoise

#: Effects whose full size is known beforehand, in the order of the catalogue.
MODELLED: Mapping[str, Effect] = {
    module.EFFECT.name: module.EFFECT
    for module in (
        pseudorange_satellite_clock,
        pseudorange_earth_rotation,
        pseudorange_relativity,
        pseudorange_group_delay,
        pseudorange_troposphere,
        pseudorange_ionosphere,
    )
}
L1 = 1575.42e6  # Hz, GPS L1, Galileo E1, QZSS L1
L2 = 1227.60e6  # Hz, GPS L2
B1I = 1561.098e6  # Hz, BeiDou B1I
B3I = 1268.52e6  # Hz, BeiDou B3I
G1, G1_STEP = 1602.0e6, 0.5625e6  # Hz, GLONASS G1 and the distance of its channels
#: Code observations by preference, with their frequency and the share of the broadcast group delay that they see.
SIGNALS: Mapping[str, tuple[tuple[str, float, float], ...]] = {
    "G": (("C1C", L1, 1.0),),
    "J": (("C1C", L1, 1.0), ("C1X", L1, 1.0)),
    "E": (("C1C", L1, 1.0), ("C1X", L1, 1.0), ("C1B", L1, 1.0)),
    "C": (("C2I", B1I, 1.0), ("C1I", B1I, 1.0), ("C6I", B3I, 0.0)),
    "R": (("C1C", G1, 0.0), ("C1P", G1, 0.0)),
}
#: The same for receivers of the P code, on one frequency, L2 where they do not give that of L1; and for both of its
#: frequencies together, in which no ionosphere is left: `ionosphere_free` makes C0W.
P_SIGNALS: Mapping[str, tuple[tuple[str, float, float], ...]] = {
    "G": (("C1W", L1, 1.0), ("C1P", L1, 1.0), ("C2W", L2, (L1 / L2) ** 2), ("C2P", L2, (L1 / L2) ** 2)),
    "R": (("C1P", G1, 0.0),),
}
P_TWO_SIGNALS: Mapping[str, tuple[tuple[str, float, float], ...]] = {"G": (("C0W", np.inf, 0.0),)}
CODES = {"ca": SIGNALS, "p": P_SIGNALS, "p_two": P_TWO_SIGNALS}
SYSTEM_NAMES = {"G": "GPS", "R": "GLONASS", "E": "Galileo", "J": "QZSS", "C": "BeiDou"}
#: Systems that share a receiver clock: QZSS sends the signals of GPS in the time of GPS (IS-QZSS-PNT, 3.2.1).
CLOCK_OF: Mapping[str, str] = {"G": "G", "J": "J", "E": "E", "C": "C", "R": "R"}
SHORTEST, LONGEST = 1.0e7, 1.0e8  # m: outside, a number is no pseudorange, whatever the receiver's clock shows


#: Error of one pseudorange, noise and multipath together, by which one epoch is weighed: RTKLIB 2.4.2 manual, E.6, for
#: a plain antenna. What of it changes with time is less: `positioning.pseudoranges.CHANGING_NOISE`.
CODE_NOISE = 0.9  # m at the zenith for each of the two parts
GLONASS_NOISE = 1.5  # times that of the others: half the chip rate
DEFAULT_ACCURACY = 2.4  # m, where the message has none
#: What Saastamoinen's model leaves of one epoch, divided by (sin E + 0.1), whatever the weather (RTKLIB 2.4.2 manual,
#: E.6). What lasts of it over a log is less, and grows as 1 / sin E: `positioning.pseudoranges.ZENITH_LEFT`.
TROPOSPHERE_LEFT = 0.3  # m
CODE_BIAS = 0.3  # m, between the codes of different signals and receivers (the same page)
#: What the broadcast ionosphere leaves is half of the delay (IS-GPS-200N, 20.3.3.5.2.5), and it is a smooth field.
IONOSPHERE_LEFT = 0.5  # 1
IONOSPHERE_RAY = 0.2  # 1, share of the delay that is particular to a ray
IONOSPHERE_LENGTH = (
    1.0e6  # m: correlation length of TEC, 9 deg of latitude (Shim et al., J. Geophys. Res. 113 (2008) A09309)
)
IONOSPHERE_UNKNOWN = 5.0  # m, 1-sigma of the vertical delay where no coefficients are known


@dataclass(frozen=True)
class Pseudoranges:
    """Pseudoranges with their satellites, one row each, sorted by epoch.

    Attributes
    ----------
    where : file, for messages
    week : GPS week
    t : (epochs,) receiver's time tags from the start of the week [s]
    epoch : (n,) index into t, not decreasing
    satellite : (n,) name
    value : (n,) pseudorange [m]
    frequency : (n,) carrier [Hz]
    position, velocity : (n, 3) of the satellite at transmission, ECEF [m], [m/s]; GLONASS has velocity zero, because
        its clocks need no `pseudorange.relativity`
    clock : (n,) satellite clock [s], from the polynomial alone
    group_delay : (n,) of the measured signal [s]
    accuracy : (n,) broadcast accuracy of orbit and clock [m]
    strength : (n,) signal-to-noise density [dB-Hz], NaN where not recorded
    message : (n,) row of the navigation table that position and clock are from
    klobuchar : (8,) coefficients, or None
    start : (3,) approximate position of the receiver [m], or None
    journal : what was left out and why, a line each
    """

    where: str
    week: int
    t: FloatArray
    epoch: IntArray
    satellite: TextArray
    value: FloatArray
    frequency: FloatArray
    position: FloatArray
    velocity: FloatArray
    clock: FloatArray
    group_delay: FloatArray
    accuracy: FloatArray
    strength: FloatArray
    message: IntArray
    klobuchar: FloatArray | None
    start: FloatArray | None
    journal: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.value)

    @property
    def system(self) -> TextArray:
        """(n,) letter of the satellite system."""
        return self.satellite.astype("<U1")

    @property
    def time(self) -> FloatArray:
        """(n,) time tag of each row [s of week]."""
        return self.t[self.epoch]

    def rows(self, keep: BoolArray | IntArray) -> Pseudoranges:
        """Some of the rows; the epochs stay."""
        columns: tuple[str, ...] = ("epoch", "satellite", "value", "frequency", "position", "velocity", "clock")
        columns += ("group_delay", "accuracy", "strength", "message")
        return replace(self, **{name: getattr(self, name)[keep] for name in columns})

    def clock_groups(self) -> tuple[IntArray, tuple[str, ...]]:
        """(n,) number of the receiver clock of each row, and the systems' letters by that number."""
        systems = self.system.tolist()
        letters = [CLOCK_OF[system] for system in systems]
        names = tuple(letter for letter in "GEJCR" if letter in set(letters))
        number = {letter: k for k, letter in enumerate(names)}
        return np.array([number[letter] for letter in letters], dtype=np.int64), names


def ionosphere_free(observations: Observations) -> Observations:
    """The same with C0W = (g C1W - C2W) / (g - 1), g = (f_1 / f_2)^2: free of what goes with 1 / f^2 (GPS P code).

    The broadcast clock is that of this combination: it has no group delay (IS-GPS-200N, 20.3.3.3.3.1). Its noise is
    sqrt(g^2 + 1) / (g - 1) = 2.98 times that of one code.
    """
    first, second = (observations.values.get(name) for name in ("C1W", "C2W"))
    if first is None or second is None:
        return observations
    g = (L1 / L2) ** 2
    gps = observations.system == "G"
    combined = np.where(gps, (g * first - second) / (g - 1.0), np.nan)
    strength = {"S0W": observations.values["S2W"]} if "S2W" in observations.values else {}
    return replace(observations, values={**observations.values, "C0W": combined, **strength})


def pseudoranges(
    observations: Observations, navigation: Navigation, systems: Iterable[str] = "GEJC", code: str = "ca"
) -> Pseudoranges:
    """Choose one code of each satellite and find the satellites' states at transmission.

    What has no usable message (none, too old, unhealthy) or is no possible range is left out, with a journal line.

    Parameters
    ----------
    observations, navigation : what was read
    systems : letters of G GPS, E Galileo, J QZSS, C BeiDou, R GLONASS
    code : `ca`, or its like in the other systems; `p`, of GPS and GLONASS; `p_two`, of both frequencies of GPS
    """
    signals = CODES[code]
    observations = ionosphere_free(observations) if code == "p_two" else observations
    system = observations.system
    value, frequency, share, strength = (np.full(len(system), np.nan) for _ in range(4))
    for letter in systems:
        for code, carrier, group in signals.get(letter, ()):
            measured = observations.values.get(code)
            if measured is None:
                continue
            rows = (system == letter) & np.isnan(value) & ~np.isnan(measured)
            value[rows], frequency[rows], share[rows] = measured[rows], carrier, group
            snr = observations.values.get("S" + code[1:], observations.values.get("S" + code[1:2]))
            if snr is not None:
                strength[rows] = snr[rows]
    journal = Journal(observations.where)
    possible = (value > SHORTEST) & (value < LONGEST)
    for r in np.flatnonzero(~np.isnan(value) & ~possible).tolist():
        found = f"{moment(observations, r)}, {observations.satellite[r]}, {value[r]:.3f} m"
        journal.add("no possible pseudorange: left out", found)
    rows = np.flatnonzero(possible)
    states = satellite_states(
        navigation,
        observations.satellite[rows],
        observations.week,
        observations.t[observations.epoch[rows]],
        value[rows],
    )
    note_unusable(observations, rows, states.status, states.age, journal)
    good = states.status == OK
    rows = rows[good]
    glonass = system[rows] == "R"
    return Pseudoranges(
        observations.where,
        observations.week,
        observations.t,
        observations.epoch[rows],
        observations.satellite[rows],
        value[rows],
        frequency[rows] + states.channel[good] * G1_STEP,
        states.position[good],
        np.where(glonass[:, None], 0.0, states.velocity[good]),
        states.clock[good],
        share[rows] * states.group_delay[good],
        states.accuracy[good],
        strength[rows],
        states.message[good],
        navigation.klobuchar,
        observations.position,
        (*observations.journal, *navigation.journal, *journal.lines()),
    )


def moment(observations: Observations, row: int) -> str:
    """The time of a row as text."""
    return calendar(observations.week * WEEK + observations.t[observations.epoch[row]])


def note_unusable(
    observations: Observations, rows: IntArray, status: IntArray, age: FloatArray, journal: Journal
) -> None:
    """A line in the journal for each satellite and reason."""
    names = observations.satellite[rows]
    for name in np.unique(names[status != OK]).tolist():
        for reason in np.unique(status[(names == name) & (status != OK)]).tolist():
            mine = np.flatnonzero((names == name) & (status == reason))
            detail = f"{name}, {len(mine)} epochs from {moment(observations, int(rows[mine[0]]))}"
            old = f" (nearest {describe(np.min(np.abs(age[mine])))} away)" if STATUS[reason].endswith("old") else ""
            journal.add(f"{STATUS[reason]}{old}: left out", detail)


def describe(seconds: float) -> str:
    """A span of time in a unit that suits it."""
    hours = seconds / 3600.0
    return f"{hours:.1f} h" if hours < 48.0 else f"{hours / 24.0:.0f} days"


def elevation_azimuth(
    satellite_e: FloatArray, receiver_e: FloatArray, latitude: FloatArray, longitude: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(n,) elevation and azimuth [rad] of satellites over receivers.

    Parameters
    ----------
    satellite_e, receiver_e : (n, 3) ECEF [m]
    latitude, longitude : (n,) of the receivers [rad]
    """
    d = satellite_e - receiver_e
    east, north, up = pymap3d.ecef2enuv(d[:, 0], d[:, 1], d[:, 2], latitude, longitude, deg=False)
    return np.arctan2(up, np.hypot(east, north)), np.arctan2(east, north)


def circumstances(ranges: Pseudoranges, receiver_e: FloatArray, faulty: BoolArray | None = None) -> Motion:
    """What the effects need to know, as the covariates of a `Motion`, one instant a row.

    Parameters
    ----------
    ranges : n rows
    receiver_e : (epochs, 3) position of the receiver at each epoch, ECEF [m]
    faulty : (n,) rows of the satellite that `pseudorange.satellite_fault` is about
    """
    latitude, longitude, height = pymap3d.ecef2geodetic(*receiver_e.T, deg=False)
    latitude, longitude, height = (np.atleast_1d(x)[ranges.epoch] for x in (latitude, longitude, height))
    receiver = receiver_e[ranges.epoch]
    elevation, azimuth = elevation_azimuth(ranges.position, receiver, latitude, longitude)
    covariates = {
        "satellite_position": ranges.position,
        "satellite_velocity": ranges.velocity,
        "receiver_position": receiver,
        "satellite_clock": ranges.clock,
        "group_delay": ranges.group_delay,
        "frequency": ranges.frequency,
        "latitude": latitude,
        "longitude": longitude,
        "height": height,
        "elevation": elevation,
        "azimuth": azimuth,
        "elapsed": ranges.time - ranges.t[0],
    }
    if ranges.klobuchar is not None:
        covariates["klobuchar"] = np.broadcast_to(ranges.klobuchar, (len(ranges), 8))
    if faulty is not None:
        covariates["faulty"] = faulty.astype(np.float64)
    return Motion(t=ranges.time, covariates=covariates)


def full_size(name: str, motion: Motion) -> FloatArray:
    """(n,) the beta that is known beforehand: 1, or the zenith delay [m] of the standard atmosphere; without broadcast
    coefficients the ionosphere has none and counts as zero."""
    if name == "pseudorange.troposphere":
        return pseudorange_troposphere.zenith_delay(motion.covariates["latitude"], motion.covariates["height"])
    known = not (name == "pseudorange.ionosphere" and not motion.has("klobuchar"))
    return np.full(len(motion), float(known))


def sum_of(motion: Motion, effects: Iterable[str]) -> FloatArray:
    """(n,) the named effects at their full size, in exact form where there is one [m]."""
    total = np.zeros(len(motion))
    for name in effects:
        effect, size = MODELLED[name], full_size(name, motion)
        if effect.exact is None:
            total += effect.regressor(motion)[:, 0, 0] * size
        else:
            total += effect.exact(np.zeros((len(motion), 1)), size[:1], motion, None)[:, 0]
    return total


def modelled(ranges: Pseudoranges, receiver_e: FloatArray, effects: Iterable[str]) -> FloatArray:
    """(n,) sum of the named effects at their full size [m], to be taken off the pseudoranges.

    Parameters
    ----------
    ranges : n rows
    receiver_e : (epochs, 3) ECEF [m]
    effects : names out of `MODELLED`
    """
    return sum_of(circumstances(ranges, receiver_e), effects)


def line_of_sight(satellite_e: FloatArray, receiver_e: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n,) distance [m] and (n, 3) its derivative by the receiver's position, minus the direction to the satellite."""
    d = satellite_e - receiver_e
    distance = np.linalg.norm(d, axis=-1)
    return distance, -d / distance[..., None]


def code_variance(
    ranges: Pseudoranges,
    elevation: FloatArray,
    ionosphere: FloatArray | float = 0.0,
    noise: RangeNoise | None = None,
) -> FloatArray:
    """(n,) variance of a pseudorange about the model [m^2].

    a^2 + b^2 / sin E : noise and multipath, larger near the horizon
    + accuracy^2      : orbit and clock, as the satellite promises
    + (0.2 I)^2       : what is particular to one ray of what the broadcast ionosphere leaves of its delay I; what is
                        common to the rays is in `ionosphere_left`
    + (T / (sin E + 0.1))^2 : what the standard troposphere leaves, T = `TROPOSPHERE_LEFT`
    + `CODE_BIAS`^2   : code biases

    Source: RTKLIB 2.4.2 manual, E.6.

    Parameters
    ----------
    ranges : n rows
    elevation : (n,) [rad]
    ionosphere : (n,) modelled delay [m]
    noise : a law of its own instead of the one above
    """
    if noise is not None:
        delay = np.broadcast_to(ionosphere, (len(ranges),))
        return noise.variance(ranges.system, elevation, ranges.strength, ranges.accuracy, delay)
    sine = np.sin(np.maximum(elevation, LOWEST_ELEVATION))
    variance = CODE_NOISE**2 * (1.0 + 1.0 / sine)
    variance = variance * np.where(ranges.system == "R", GLONASS_NOISE**2, 1.0)
    variance = variance + np.where(ranges.accuracy > 0.0, ranges.accuracy, DEFAULT_ACCURACY) ** 2
    variance = variance + (IONOSPHERE_RAY * ionosphere) ** 2 + CODE_BIAS**2
    return np.asarray(variance + (TROPOSPHERE_LEFT / (sine + 0.1)) ** 2)


def ionosphere_left(motion: Motion, ionosphere: FloatArray, share: float = IONOSPHERE_LEFT) -> FloatArray:
    """(n, 3) what the rays have in common of the delay that the broadcast ionosphere leaves [m], 1-sigma a column.

    The vertical delay that is left is a Gaussian field of standard deviation s = 0.5 I_v and correlation length L, to
    first order about the receiver: s F, s F north / L, s F east / L, with F the obliquity and north, east the distance
    of the pierce point. The errors of neighbouring rays are so equal, and most of them goes into clock and height.

    Parameters
    ----------
    motion : what `circumstances` gives
    ionosphere : (n,) modelled slant delay [m]; zero: not known, and s is 5 m
    share : of the delay, instead of 0.5
    """
    elevation, azimuth = motion.covariates["elevation"], motion.covariates["azimuth"]
    F = pseudorange_ionosphere.obliquity(elevation) * (L1 / motion.covariates["frequency"]) ** 2
    psi = np.pi * (0.0137 / (np.maximum(elevation, 0.0) / np.pi + 0.11) - 0.022)  # as in Klobuchar's model
    away = psi * WGS84_A / IONOSPHERE_LENGTH
    unknown = IONOSPHERE_UNKNOWN * share / IONOSPHERE_LEFT * F
    slant = np.where(ionosphere > 0.0, share * ionosphere, unknown)
    return np.stack([slant, slant * away * np.cos(azimuth), slant * away * np.sin(azimuth)], axis=-1)


__all__ = [
    "CLOCK_OF",
    "MODELLED",
    "SIGNALS",
    "Pseudoranges",
    "circumstances",
    "code_variance",
    "elevation_azimuth",
    "full_size",
    "ionosphere_left",
    "line_of_sight",
    "modelled",
    "pseudoranges",
    "sum_of",
]
