"""From latitude, longitude and height to north, east, down at an origin."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.recording import GEODETIC, NO_HEIGHT, POSITION, VELOCITY, Stream
from sinan.sensors.settling import unsettled

Origin = tuple[float, float, float]


def to_ned(
    where: Path | str, streams: Mapping[str, Stream], origin: Origin | None
) -> tuple[dict[str, Stream], Origin | None, tuple[str, ...]]:
    """Turn geodetic positions of `gps` and `base` into NED.

    Parameters
    ----------
    where : of the recording, for messages
    streams : by name; latitude, longitude in deg, height in m above the ellipsoid; a GPS without heights is taken to be
        at that of the origin, its fixes marked by `epv` as such that tell none
    origin : of the NED frame; None: the first fix of `gps` after it has settled, else of `base`

    Returns
    -------
    streams : with `north, east, down` [m] in place of the geodetic columns
    origin : the one that was used, or the one given
    notes : what was chosen

    Raises
    ------
    InputError : latitude beyond 90 deg, longitude beyond 360 deg
    """
    changed, notes = dict(streams), []
    for name in ("gps", "base"):
        stream = streams.get(name)
        if stream is None or stream.has(POSITION) or len(stream) == 0:
            continue
        if name == "gps" and stream.has(GEODETIC[:2]) and "height" not in stream:
            level = np.full(len(stream), 0.0 if origin is None else origin[2])
            epv = np.full(len(stream), NO_HEIGHT)
            stream = Stream(stream.t, {**stream.columns, "height": level, "epv": epv})
            notes.append("gps: the log has no height of the receiver's: its fixes are those of latitude and longitude")
        if not stream.has(GEODETIC):
            continue
        lla = stream.array(GEODETIC)
        _check_degrees(where, name, lla)
        if origin is None:
            first = _settled(stream, lla)
            origin = (float(lla[first, 0]), float(lla[first, 1]), float(lla[first, 2]))
            which = f"fix {first + 1} of {name}, where it has settled," if first else f"the first fix of {name}"
            notes.append(f"no [origin]: {which} is taken ({origin[0]:.7f}, {origin[1]:.7f} deg, {origin[2]:.2f} m)")
        kept = {column: values for column, values in stream.columns.items() if column not in GEODETIC}
        changed[name] = Stream(stream.t, {**ned_columns(lla, origin), **kept})
    return changed, origin, tuple(notes)


def _settled(stream: Stream, lla: FloatArray) -> int:
    """Row of the first fix after the receiver has settled."""
    somewhere = lla[len(lla) // 2]
    places = np.column_stack(list(ned_columns(lla, (somewhere[0], somewhere[1], somewhere[2])).values()))
    return unsettled(stream.t, places, stream.array(VELOCITY) if stream.has(VELOCITY) else None)


def ned_columns(lla: FloatArray, origin: Origin) -> dict[str, FloatArray]:
    """`north, east, down` [m], each (n,), of (n, 3) latitude, longitude [deg] and height [m] (WGS-84)."""
    import pymap3d

    ned = pymap3d.geodetic2ned(lla[:, 0], lla[:, 1], lla[:, 2], *origin, deg=True)
    return {name: np.asarray(values, dtype=np.float64) for name, values in zip(POSITION, ned, strict=True)}


def geodetic_columns(ned: FloatArray, origin: Origin) -> FloatArray:
    """(n, 3) latitude, longitude [deg] and height [m] (WGS-84) of places (n, 3) in NED [m]."""
    import pymap3d

    return np.column_stack(pymap3d.ned2geodetic(*ned.T, *origin, deg=True))


def _check_degrees(where: Path | str, name: str, lla: FloatArray) -> None:
    for column, limit, values in (("latitude", 90.0, lla[:, 0]), ("longitude", 360.0, lla[:, 1])):
        bad = np.flatnonzero(np.abs(values) > limit)
        if len(bad):
            value = values[bad[0]]
            looks = " (looks like 1e-7 deg)" if abs(value) > 1e5 else ""
            raise InputError(
                where, f"{column} {value:.9g}{looks}", f"degrees, at most {limit:g}", f"stream {name}, row {bad[0] + 1}"
            )
