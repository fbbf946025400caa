"""Where the receiver really was: a fixed position or the file of a moving reference, and errors against it."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pymap3d

from sinan.estimator.positioning.integrity import east_north_up
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.rinex_text import WEEK, gps_seconds

SAME_INSTANT = 0.02  # s: a reference this near in time is taken as it is
LONGEST_GAP = 1.0  # s between two references to interpolate between
ROW = "`gps_week,tow_s,x,y,z[,q]` or `date time latitude longitude height [Q]`"


@dataclass(frozen=True)
class Reference:
    """Positions of a reference, fixed solutions only.

    Attributes
    ----------
    t : (n,) GPS time [s] since the start of week 0
    position : (n, 3) ECEF [m]
    """

    t: FloatArray
    position: FloatArray

    def at(self, week: int, t: FloatArray) -> FloatArray:
        """(epochs, 3) position at the epochs, NaN where the reference has none."""
        wanted = t + week * WEEK
        after = np.clip(np.searchsorted(self.t, wanted), 1, max(len(self.t) - 1, 1))
        before, after = after - 1, np.minimum(after, len(self.t) - 1)
        nearest = np.where(np.abs(wanted - self.t[before]) <= np.abs(self.t[after] - wanted), before, after)
        same = np.abs(wanted - self.t[nearest]) <= SAME_INSTANT
        gap = self.t[after] - self.t[before]
        share = np.where(gap > 0.0, (wanted - self.t[before]) / np.where(gap > 0.0, gap, 1.0), -1.0)
        inside = (gap > 0.0) & (gap <= LONGEST_GAP) & (share >= 0.0) & (share <= 1.0)
        between = self.position[before] + share[:, None] * (self.position[after] - self.position[before])
        known = np.where(inside[:, None], between, np.nan)
        return np.where(same[:, None], self.position[nearest], known)


def read_reference(path: Path | str) -> Reference:
    """Read a table of positions: CSV (week, second of week, ECEF, quality) or a `.pos` file (date, geodetic or ECEF).

    Rows whose quality is not 1 (fixed) are left out.

    Raises
    ------
    InputError : cannot be read, or no fixed position in it
    """
    try:
        lines = Path(path).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise InputError(path, error.strerror or "cannot be read", "a reference file") from None
    ecef = any("x-ecef" in line for line in lines if line.startswith("%"))
    rows = []
    for number, line in enumerate(lines, 1):
        if not line.strip() or line[0] in "%#" or line.startswith("gps_week"):
            continue
        try:
            row = csv_row(line) if "," in line else pos_row(line, ecef)
        except (ValueError, IndexError):
            raise InputError(path, f"`{line[:60]}`", ROW, f"line {number}") from None
        if row is not None:
            rows.append(row)
    if not rows:
        raise InputError(path, "no fixed position", f"rows {ROW} with quality 1")
    table = np.array(rows)
    table = table[np.argsort(table[:, 0], kind="stable")]
    return Reference(table[:, 0], table[:, 1:])


def csv_row(line: str) -> tuple[float, float, float, float] | None:
    """Time and ECEF position of a CSV row; None: not fixed."""
    words = [float(word) for word in next(csv.reader([line]))]
    if len(words) > 5 and words[5] != 1.0:
        return None
    return words[0] * WEEK + words[1], words[2], words[3], words[4]


def pos_row(line: str, ecef: bool) -> tuple[float, float, float, float] | None:
    """Time and ECEF position of a row of a `.pos` file; None: not fixed."""
    words = line.split()
    year, month, day = (int(word) for word in words[0].split("/"))
    hour, minute, second = words[1].split(":")
    start = gps_seconds(year, month, day, int(hour), int(minute))
    if start is None:
        raise ValueError(line)
    if len(words) > 5 and float(words[5]) != 1.0:
        return None
    x, y, z = (float(word) for word in words[2:5])
    if not ecef:
        x, y, z = (float(value) for value in pymap3d.geodetic2ecef(x, y, z))
    return start + float(second), x, y, z


def position_error(position: FloatArray, truth: FloatArray) -> dict[str, object] | None:
    """Mean, RMS and 95 % of the distance to the truth, mean error east, north, up [m]; None: nothing to compare.

    Parameters
    ----------
    position, truth : (epochs, 3) ECEF [m], NaN where there is none
    """
    both = np.isfinite(position[:, 0]) & np.isfinite(truth[:, 0])
    if not both.any():
        return None
    error = position[both] - truth[both]
    enu = np.einsum("nij,nj->ni", east_north_up(truth[both]), error)
    size = np.linalg.norm(error, axis=1)
    return {
        "mean": float(size.mean()),
        "rms": float(np.sqrt(np.mean(size**2))),
        "p95": float(np.percentile(size, 95)),
        "enu": [float(value) for value in enu.mean(axis=0)],
        "enu_std": [float(value) for value in enu.std(axis=0)],
        "epochs": int(both.sum()),
    }
