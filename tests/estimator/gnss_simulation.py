"""A simulated constellation with broadcast messages, exact pseudoranges, and RINEX files of both."""

from __future__ import annotations

import datetime
from dataclasses import replace
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import EARTH_RATE, SPEED_OF_LIGHT
from sinan.sensors.ephemeris import kepler_orbit
from sinan.sensors.formats.rinex import GLONASS, KEPLER, Navigation
from sinan.sensors.formats.rinex_navigation import LAYOUT, LAYOUT_END
from sinan.sensors.formats.rinex_observation import Observations
from sinan.sensors.formats.rinex_text import GPS_EPOCH, WEEK
from sinan.sensors.pseudorange import Pseudoranges, pseudoranges

WEEK_NUMBER = 2200
START = 345600.0  # s of week
RECEIVER = np.array([3582104.895, 532590.207, 5232755.260])  # ECEF [m]
KLOBUCHAR = np.array([1.1e-8, 1.5e-8, -6e-8, -1.2e-7, 9e4, 1.3e5, -6.5e4, -2.6e5])


def messages(systems: str = "G", planes: int = 6, each: int = 4, seed: int = 1) -> Navigation:
    """Broadcast messages of a full constellation of each system, reference time at `START`."""
    rng = np.random.default_rng(seed)
    rows = []
    for k, system in enumerate(systems):
        for i in range(planes * each):
            row = np.zeros(1, dtype=KEPLER)
            row["satellite"] = f"{system}{i + 1:02d}"
            row["toc"] = row["toe"] = row["sent"] = WEEK_NUMBER * WEEK + START
            row["af0"], row["af1"] = rng.normal(0.0, 1e-4), rng.normal(0.0, 1e-11)
            row["e"], row["sqrt_a"] = rng.uniform(0.0, 0.02), 5153.6 + 100.0 * k
            row["m0"] = 2.0 * np.pi * (i % each) / each + 0.4 * (i // each) + 0.3 * k
            row["omega0"], row["i0"] = 2.0 * np.pi * (i // each) / planes, 0.96
            row["omega"], row["omega_dot"], row["delta_n"] = rng.uniform(-1, 1), -8e-9, 4e-9
            row["crs"], row["crc"] = rng.normal(0.0, 30.0), rng.normal(200.0, 30.0)
            row["cus"], row["cuc"], row["cis"], row["cic"] = rng.normal(0.0, 3e-6, 4)
            row["accuracy"], row["group_delay"] = 2.0, rng.normal(0.0, 5e-9)
            row["source"] = 517.0 if system == "E" else 1.0
            row["group_delay_2"] = row["group_delay"]
            rows.append(row)
    return Navigation("simulated", np.concatenate(rows), np.zeros(0, dtype=GLONASS), KLOBUCHAR)


def travel(row: np.ndarray, receiver_e: FloatArray, received: float) -> tuple[FloatArray, FloatArray, float]:
    """Satellite position and velocity at transmission, in the frame of reception, and the time of transmission."""
    sent = received - 0.075
    reference = float(row["toe"][0]) - WEEK_NUMBER * WEEK
    for _ in range(6):
        p, v = kepler_orbit(row, np.array([sent - reference]))
        angle = EARTH_RATE * (received - sent)
        turn = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        at = turn @ p[0]
        sent = received - float(np.linalg.norm(at - receiver_e)) / SPEED_OF_LIGHT
    return at, v[0], sent


def observe(
    navigation: Navigation,
    t: FloatArray,
    receiver_e: FloatArray = RECEIVER,
    clock: float = 3e-4,
    lowest: float = 5.0,
    noise: FloatArray | None = None,
) -> Observations:
    """Exact pseudoranges without atmosphere: geometry, Earth rotation, clocks with relativity and group delay.

    Parameters
    ----------
    t : (epochs,) time tags of the receiver [s of week]
    receiver_e : (3,) or (epochs, 3)
    clock : receiver clock error [s]
    lowest : elevation [deg]
    noise : (epochs, satellites) added [m]
    """
    where = np.broadcast_to(receiver_e, (len(t), 3))
    epoch, names, values = [], [], []
    for k, tag in enumerate(t.tolist()):
        up = where[k] / np.linalg.norm(where[k])
        for i in range(len(navigation.kepler)):
            row = navigation.kepler[i : i + 1]
            p, _, sent = travel(row, where[k], tag - clock)
            d = p - where[k]
            if np.degrees(np.arcsin(d @ up / np.linalg.norm(d))) < lowest:
                continue
            since = sent - (float(row["toc"][0]) - WEEK_NUMBER * WEEK)
            original = kepler_orbit(row, np.array([sent - (float(row["toe"][0]) - WEEK_NUMBER * WEEK)]))
            relativity = -2.0 * float(original[0][0] @ original[1][0]) / SPEED_OF_LIGHT**2
            offset = float(row["af0"][0] + row["af1"][0] * since) + relativity - float(row["group_delay"][0])
            extra = 0.0 if noise is None else float(noise[k, i])
            epoch.append(k)
            names.append(str(row["satellite"][0]))
            values.append(float(np.linalg.norm(d)) + SPEED_OF_LIGHT * (clock - offset) + extra)
    return Observations(
        "simulated.obs",
        3.04,
        None,
        WEEK_NUMBER,
        t,
        np.array(epoch, dtype=np.int64),
        np.array(names, dtype="<U3"),
        {"C1C": np.array(values), "C2I": np.full(len(values), np.nan)},
        (),
    )


def simulated(
    systems: str = "G", epochs: int = 5, interval: float = 30.0, noise: float = 0.0, **options: object
) -> Pseudoranges:
    """Pseudoranges of a simulated receiver."""
    navigation = messages(systems)
    t = START + interval * np.arange(epochs)
    rng = np.random.default_rng(7)
    added = rng.normal(0.0, noise, (epochs, len(navigation.kepler))) if noise else None
    return pseudoranges(observe(navigation, t, noise=added, **options), navigation, systems)  # type: ignore[arg-type]


def with_bias(ranges: Pseudoranges, satellite: str, bias: FloatArray) -> Pseudoranges:
    """The same with metres added to one satellite; `bias` is (epochs,)."""
    value = ranges.value + np.where(ranges.satellite == satellite, bias[ranges.epoch], 0.0)
    return replace(ranges, value=value)


def date(t: float) -> datetime.datetime:
    """Calendar time of a second of the simulated week."""
    return datetime.datetime.fromordinal(GPS_EPOCH + 7 * WEEK_NUMBER) + datetime.timedelta(seconds=t)


def header_line(text: str, label: str) -> str:
    """A line of a RINEX header."""
    return f"{text:<60}{label}\n"


def observation_3(observed: Observations) -> str:
    """The C1C of an `Observations` as RINEX 3.04."""
    lines = [
        header_line("     3.04           OBSERVATION DATA    M", "RINEX VERSION / TYPE"),
        header_line("  3582104.0000   532590.0000  5232755.0000", "APPROX POSITION XYZ"),
    ]
    lines += [header_line(f"{system}    2 C1C S1C", "SYS / # / OBS TYPES") for system in "GEJC"]
    lines.append(header_line("", "END OF HEADER"))
    for k, tag in enumerate(observed.t.tolist()):
        when, rows = date(tag), np.flatnonzero(observed.epoch == k)
        second = when.second + when.microsecond / 1e6
        lines.append(f"> {when:%Y %m %d %H %M} {second:10.7f}  0{len(rows):3d}\n")
        for r in rows.tolist():
            lines.append(f"{observed.satellite[r]}{observed.values['C1C'][r]:14.3f} 7{45.0:14.3f}\n")
    return "".join(lines)


def observation_2(observed: Observations) -> str:
    """The same as RINEX 2.11 with seven types, so that a record has two lines."""
    lines = [
        header_line("     2.11           OBSERVATION DATA    M", "RINEX VERSION / TYPE"),
        header_line("     7    L1    L2    C1    P2    S1    S2    D1", "# / TYPES OF OBSERV"),
        header_line("", "END OF HEADER"),
    ]
    for k, tag in enumerate(observed.t.tolist()):
        when, rows = date(tag), np.flatnonzero(observed.epoch == k).tolist()
        names = [str(observed.satellite[r]) for r in rows]
        second = when.second + when.microsecond / 1e6
        stamp = f" {when:%y} {when.month:2d} {when.day:2d} {when.hour:2d} {when.minute:2d}{second:11.7f}"
        lines.append(f"{stamp}  0{len(rows):3d}{''.join(names[:12])}\n")
        lines += [" " * 32 + "".join(names[i : i + 12]) + "\n" for i in range(12, len(names), 12)]
        for r in rows:
            lines.append(f"{'':32}{observed.values['C1C'][r]:14.3f}  {'':16}{45.0:14.3f}\n")
            lines.append(f"{40.0:14.3f}\n")
    return "".join(lines)


def navigation_3(navigation: Navigation) -> str:
    """The messages as RINEX 3.04."""
    alpha = "".join(f"{x:12.4e}" for x in KLOBUCHAR[:4])
    beta = "".join(f"{x:12.4e}" for x in KLOBUCHAR[4:])
    lines = [
        header_line("     3.04           N: GNSS NAV DATA    M", "RINEX VERSION / TYPE"),
        header_line(f"GPSA {alpha}", "IONOSPHERIC CORR"),
        header_line(f"GPSB {beta}", "IONOSPHERIC CORR"),
        header_line("", "END OF HEADER"),
    ]
    for row in navigation.kepler:
        lines += record(row, f"{row['satellite']} {date(row['toc'] - WEEK_NUMBER * WEEK):%Y %m %d %H %M %S}", 4)
    return "".join(lines)


def navigation_2(navigation: Navigation) -> str:
    """The GPS messages as RINEX 2.11."""
    lines = [
        header_line("     2.11           N: GPS NAV DATA", "RINEX VERSION / TYPE"),
        header_line("  " + "".join(f"{x:12.4e}" for x in KLOBUCHAR[:4]).replace("e", "D"), "ION ALPHA"),
        header_line("  " + "".join(f"{x:12.4e}" for x in KLOBUCHAR[4:]).replace("e", "D"), "ION BETA"),
        header_line("", "END OF HEADER"),
    ]
    for row in navigation.kepler:
        when = date(row["toc"] - WEEK_NUMBER * WEEK)
        number = int(str(row["satellite"])[1:])
        stamp = f"{number:2d} {when:%y} {when.month:2d} {when.day:2d} {when.hour:2d} {when.minute:2d}"
        lines += [line.replace("e", "D") for line in record(row, f"{stamp}{when.second:5.1f}", 3)]
    return "".join(lines)


def record(row: np.void, stamp: str, indent: int) -> list[str]:
    """One Kepler message."""
    names = (*LAYOUT, *LAYOUT_END[str(row["satellite"])[0]])
    value = {name: float(row[name]) for name in row.dtype.names if name != "satellite"}
    value["toe"] = value["toe"] % WEEK
    value["sent"] = value["sent"] % WEEK
    numbers = [f"{value.get(name, 0.0):19.12e}" for name in names] + [""] * 2
    lines = [stamp + "".join(numbers[:3])]
    lines += [" " * indent + "".join(numbers[3 + 4 * i : 7 + 4 * i]) for i in range(7)]
    return [line + "\n" for line in lines]


def files(folder: Path, systems: str = "G", epochs: int = 5, interval: float = 30.0) -> tuple[Path, Path]:
    """A pair of RINEX 3 files of a simulated receiver."""
    navigation = messages(systems)
    observed = observe(navigation, START + interval * np.arange(epochs))
    observation, broadcast = folder / "rover.obs", folder / "rover.nav"
    observation.write_text(observation_3(observed))
    broadcast.write_text(navigation_3(navigation))
    return observation, broadcast
