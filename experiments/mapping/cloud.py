"""Scans along a trajectory as points in NED, and their file."""

from __future__ import annotations

from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.constants import WGS84_A
from sinan.sensors.errors import InputError, with_extra
from sinan.sensors.files import write_bytes
from sinan.sensors.motion import Motion
from sinan.sensors.ranging import scan_beams
from sinan.sensors.rotation import rotate, rotation_exp

#: Coordinates of a file are whole multiples of this [m].
MILLIMETRE = 1e-3
#: Classes of the standard: not classified, ground, an object.
UNCLASSIFIED, GROUND, OBJECT = 1, 2, 5


@dataclass(frozen=True)
class Mounting:
    """How a laser sits on the body, and how late its stamps are: the parameters of `laser.boresight`,
    `laser.lever_arm` and `laser.time_offset`.

    Attributes
    ----------
    boresight : (2,) roll, pitch [rad]
    lever_arm : (3,) body [m]
    time_offset : a scan belongs to its stamp less this [s]
    """

    boresight: FloatArray = field(default_factory=lambda: np.zeros(2))
    lever_arm: FloatArray = field(default_factory=lambda: np.zeros(3))
    time_offset: float = 0.0

    @property
    def turn(self) -> FloatArray:
        """(3, 3) B = Rx(roll) Ry(pitch), which turns a beam."""
        roll, pitch = self.boresight
        return rotation_exp(np.array([roll, 0.0, 0.0])) @ rotation_exp(np.array([0.0, pitch, 0.0]))


@dataclass(frozen=True)
class Scans:
    """Scans of one flight.

    Attributes
    ----------
    t : (n,) s
    ranges : (n, beams) m; not finite where nothing came back
    angles : (beams,) rad, beam i along (0, sin a_i, cos a_i) in the body
    intensity : (n, beams), or empty
    """

    t: FloatArray
    ranges: FloatArray
    angles: FloatArray
    intensity: FloatArray

    def between(self, first: float, last: float) -> Scans:
        """Those whose stamps lie between two instants [s]."""
        inside = (self.t > first) & (self.t < last)
        return Scans(self.t[inside], self.ranges[inside], self.angles, self.intensity[inside[: len(self.intensity)]])


def placed(scans: Scans, motion: Motion, mounting: Mounting) -> FloatArray:
    """(n, beams, 3) NED [m]: p + C_nb (l + range B beam) at t - time offset, B = Rx(b0) Ry(b1).

    Parameters
    ----------
    motion : that spans the scans

    Source: J. Skaloud, D. Lichti, ISPRS J. Photogrammetry and Remote Sensing 61(1), 2006, equation 1. Neglects that the
    body moves while one scan is swept.
    """
    at = motion.at(scans.t - mounting.time_offset)
    beams = scan_beams(scans.angles) @ mounting.turn.T
    arm = mounting.lever_arm + scans.ranges[..., None] * beams
    return np.asarray(at.p_n[:, None, :] + rotate(at.q_nb[:, None, :], arm))


@dataclass(frozen=True)
class Cloud:
    """Points of a map.

    Attributes
    ----------
    p_n : (m, 3) NED [m]
    t : (m,) s
    angle : (m,) of the beam [rad]
    intensity : (m,), or empty
    strip : (m,) number of the strip, -1: of none
    """

    p_n: FloatArray
    t: FloatArray
    angle: FloatArray
    intensity: FloatArray
    strip: IntArray

    def __len__(self) -> int:
        return len(self.t)


def cloud_of(scans: Scans, motion: Motion, mounting: Mounting, strip: IntArray) -> Cloud:
    """The points of all beams that came back.

    Parameters
    ----------
    strip : (n,) of each scan
    """
    keep = np.isfinite(scans.ranges)
    shape = scans.ranges.shape
    intensity = scans.intensity[keep] if scans.intensity.size else np.empty(0)
    return Cloud(
        placed(scans, motion, mounting)[keep],
        np.broadcast_to(scans.t[:, None], shape)[keep],
        np.broadcast_to(scans.angles, shape)[keep],
        intensity,
        np.broadcast_to(strip[:, None], shape)[keep],
    )


def east_north_up(p_n: FloatArray, origin: tuple[float, float, float] | None) -> FloatArray:
    """(m, 3) map coordinates [m]: east and north of the origin, and the ellipsoidal height where there is an origin.

    East and north are those of a transverse Mercator projection about the origin, which the tangent plane is to the
    scale of the height: 4 mm a kilometre and less at the fifth kilometre. Without an origin, -down.
    """
    east_north = p_n[:, [1, 0]]
    if origin is None:
        return np.column_stack([east_north, -p_n[:, 2]])
    from sinan.sensors.formats.geodetic import geodetic_columns

    height = geodetic_columns(p_n, origin)[:, 2]
    return np.column_stack([east_north * WGS84_A / (WGS84_A + origin[2]), height])


def write_las(path: Path, cloud: Cloud, ground: BoolArray, origin: tuple[float, float, float] | None) -> None:
    """A `.las` or `.laz` file (LAS 1.4, point format 6): class, intensity, scan angle, time, strip as point source.

    Parameters
    ----------
    ground : (m,) whether a point is ground; empty: not classified

    Raises
    ------
    InputError : laspy is not installed
    """
    try:
        import laspy
        from laspy.vlrs.known import WktCoordinateSystemVlr
    except ImportError:
        raise InputError("laspy", "not installed", with_extra("map")) from None
    points = east_north_up(cloud.p_n, origin)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.offsets, header.scales = np.floor(points.min(axis=0)), np.full(3, MILLIMETRE)
    if origin is not None:
        header.vlrs.append(WktCoordinateSystemVlr(projection(origin)))
        header.global_encoding.wkt = True
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.gps_time = cloud.t
    las.scan_angle = np.round(np.rad2deg(cloud.angle) / 0.006).astype(np.int16)  # the standard's unit
    las.point_source_id = np.maximum(cloud.strip + 1, 0).astype(np.uint16)
    las.return_number[:] = las.number_of_returns[:] = 1
    if cloud.intensity.size:
        las.intensity = np.clip(np.round(cloud.intensity), 0, 65535).astype(np.uint16)
    classes = np.where(ground, GROUND, OBJECT) if len(ground) else np.full(len(cloud), UNCLASSIFIED)
    las.classification = classes.astype(np.uint8)
    content = BytesIO()
    las.write(content, do_compress=path.suffix == ".laz")
    write_bytes(path, content.getvalue())


def projection(origin: tuple[float, float, float]) -> str:
    """The coordinate system of a map about an origin, as WKT."""
    latitude, longitude, _ = origin
    return (
        'PROJCS["local transverse Mercator",GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],'
        'PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],'
        f'PARAMETER["latitude_of_origin",{latitude:.10f}],PARAMETER["central_meridian",{longitude:.10f}],'
        'PARAMETER["scale_factor",1],PARAMETER["false_easting",0],PARAMETER["false_northing",0],UNIT["metre",1]]'
    )
