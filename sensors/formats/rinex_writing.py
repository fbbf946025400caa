"""RINEX 3.04 of simulated receivers and constellations: what other programs, and `sinan gnss`, read."""

from __future__ import annotations

import datetime

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.formats.rinex_navigation import LAYOUT, LAYOUT_END, Navigation
from sinan.sensors.formats.rinex_observation import Observations
from sinan.sensors.formats.rinex_text import GPS_EPOCH, WEEK

TICK = 1e-7  # s, of the time tags that the format has


def observation_text(observed: Observations) -> str:
    """A file of GPS code observations; metres to the millimetre.

    Parameters
    ----------
    observed : of one receiver, GPS alone
    """
    codes = list(observed.values)
    position = np.zeros(3) if observed.position is None else observed.position
    lines = [
        _head(f"{3.04:9.2f}           OBSERVATION DATA    G", "RINEX VERSION / TYPE"),
        _head("".join(f"{x:14.4f}" for x in position), "APPROX POSITION XYZ"),
        _head(f"G{len(codes):5d} " + " ".join(codes), "SYS / # / OBS TYPES"),
        _head(f"{_first(observed)}     GPS", "TIME OF FIRST OBS"),
        _head("", "END OF HEADER"),
    ]
    columns = np.stack([observed.values[code] for code in codes], axis=1)
    for k, tag in enumerate(observed.t.tolist()):
        rows = np.flatnonzero(observed.epoch == k).tolist()
        lines.append(f"> {_calendar(observed.week, tag)}  0{len(rows):3d}\n")
        for r in rows:
            fields = "".join(" " * 16 if np.isnan(x) else f"{x:14.3f}  " for x in columns[r])
            lines.append(f"{observed.satellite[r]}{fields}".rstrip() + "\n")
    return "".join(lines)


def navigation_text(navigation: Navigation) -> str:
    """A file of GPS messages with the ionosphere's coefficients."""
    lines = [_head(f"{3.04:9.2f}           N: GNSS NAV DATA    G", "RINEX VERSION / TYPE")]
    if navigation.klobuchar is not None:
        for name, four in (("GPSA", navigation.klobuchar[:4]), ("GPSB", navigation.klobuchar[4:])):
            lines.append(_head(f"{name} " + "".join(f"{x:12.4e}" for x in four), "IONOSPHERIC CORR"))
    lines.append(_head("", "END OF HEADER"))
    for row in navigation.kepler:
        lines += _record(row)
    return "".join(lines)


def reference_text(week: int, t: FloatArray, position: FloatArray) -> str:
    """A table of known positions, as `sinan gnss --reference` reads it: (epochs,) s of week, (epochs, 3) ECEF [m]."""
    rows = [f"{week},{s:.7f},{x:.4f},{y:.4f},{z:.4f},1" for s, (x, y, z) in zip(t, position, strict=True)]
    return "\n".join(["gps_week,tow_s,x,y,z,q", *rows, ""])


def _head(text: str, label: str) -> str:
    return f"{text:<60}{label}\n"


def _moment(week: int, t: float) -> datetime.datetime:
    return datetime.datetime.fromordinal(GPS_EPOCH + 7 * week) + datetime.timedelta(seconds=t)


def _calendar(week: int, t: float) -> str:
    t = round(t / TICK) * TICK
    when = _moment(week, float(np.floor(t)))
    return f"{when:%Y %m %d %H %M} {when.second + t - np.floor(t):10.7f}"


def _first(observed: Observations) -> str:
    when = _moment(observed.week, float(np.floor(observed.t[0])))
    fields = "".join(f"{x:6d}" for x in (when.year, when.month, when.day, when.hour, when.minute))
    return f"{fields}{when.second + observed.t[0] % 1.0:13.7f}"


def _record(row: np.void) -> list[str]:
    """One message: the clock's line, then seven of four numbers."""
    value = {name: float(row[name]) for name in (row.dtype.names or ()) if name != "satellite"}
    value["week"] = value["toe"] // WEEK
    when = _moment(0, value["toc"])
    value["toe"], value["sent"] = value["toe"] % WEEK, value["sent"] % WEEK
    numbers = [f"{value.get(name, 0.0):19.12e}" for name in (*LAYOUT, *LAYOUT_END["G"])]
    lines = [f"{row['satellite']} {when:%Y %m %d %H %M %S}" + "".join(numbers[:3])]
    lines += ["    " + "".join(numbers[3 + 4 * i : 7 + 4 * i]) for i in range(7)]
    return [line + "\n" for line in lines]
