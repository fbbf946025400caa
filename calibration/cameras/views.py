"""What a camera saw of a target: corners found in pictures by OpenCV (extra `camera`), or read from a table.

OpenCV finds corners only; every fit is `calibration.cameras.camera`'s own, and a table of corners needs no OpenCV.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError, with_extra
from sinan.sensors.files import write_text

PICTURES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".pgm")
COLUMNS = ("image", "x", "y", "z", "u", "v")
#: Corners that a view needs. Four are the least of a plane's picture, since a homography has 8 = 2 * 4 unknowns; of six
#: 2 * 6 - 8 = 4 coordinates are left to judge by.
LEAST_CORNERS = 6
#: Half of the window in which a corner is refined, at most [pixels]: that of OpenCV's tutorial on camera calibration.
_WINDOW = 11
_MARKERS_DEFAULT = "DICT_5X5_100"


@dataclass(frozen=True)
class View:
    """One picture of the target.

    Attributes
    ----------
    name : of the picture
    points : (n, 3) corners on the target [m, or the target's own unit]
    pixels : (n, 2) where they were seen
    """

    name: str
    points: FloatArray
    pixels: FloatArray

    def __post_init__(self) -> None:
        if self.points.shape != (len(self.pixels), 3) or self.pixels.shape != (len(self.points), 2):
            raise ValueError(
                f"`{self.name}`: points {self.points.shape}, pixels {self.pixels.shape}; expected (n, 3), (n, 2)"
            )

    def __len__(self) -> int:
        return len(self.points)

    def rows(self, keep: FloatArray | slice) -> View:
        """The view with some of its corners."""
        return View(self.name, self.points[keep], self.pixels[keep])


@dataclass(frozen=True)
class Views:
    """All pictures of one camera.

    Attributes
    ----------
    where : file or folder, for messages
    views : those with enough corners
    without : name -> why nothing came of a picture
    size : width, height [pixels]; (0, 0) where a table does not say it
    """

    where: str
    views: tuple[View, ...]
    without: dict[str, str]
    size: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class Board:
    """A flat target.

    Attributes
    ----------
    columns, rows : inner corners of a chessboard; squares of a ChArUco board
    square : side of a square [m]
    marker : side of a marker [m]; None: a chessboard
    dictionary : OpenCV's name of the markers' dictionary
    legacy : a ChArUco board printed with OpenCV before 4.6 and an even number of rows
    """

    columns: int
    rows: int
    square: float = 1.0
    marker: float | None = None
    dictionary: str = _MARKERS_DEFAULT
    legacy: bool = False

    @property
    def points(self) -> FloatArray:
        """(columns rows, 3) the inner corners of a chessboard, row by row."""
        across, along = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        flat = np.column_stack([across.ravel(), along.ravel(), np.zeros(self.columns * self.rows)])
        return np.asarray(self.square * flat)


def opencv() -> ModuleType:
    """OpenCV.

    Raises
    ------
    InputError : it is not installed
    """
    try:
        import cv2
    except ImportError:
        raise InputError("pictures", "no OpenCV", f"a table of corners, or {with_extra('camera')}") from None
    return cv2


def views_of(place: Path, board: Board | None, progress: Callable[[str, int, int], None] | None = None) -> Views:
    """The views in a folder of pictures, or in a table of corners.

    Parameters
    ----------
    place : folder or CSV file
    board : what the pictures show; a table needs none
    progress : told the picture, how many are done, and how many there are

    Raises
    ------
    InputError : nothing there, no board for pictures, a damaged table, no view with enough corners
    """
    if not place.exists():
        raise InputError(str(place), "no such file or folder", "a folder of pictures, or a table of corners")
    if not place.is_dir():
        return read_corners(place)
    if board is None:
        raise InputError(str(place), "pictures and no board", "its inner corners, such as --board 9x6")
    pictures = sorted(path for path in place.iterdir() if path.suffix.lower() in PICTURES)
    if not pictures:
        raise InputError(str(place), "no picture", ", ".join(PICTURES))
    cv2 = opencv()
    found, without, sizes = [], {}, set()
    for number, path in enumerate(pictures):
        if progress:
            progress(path.name, number, len(pictures))
        grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if grey is None:
            without[path.name] = "cannot be read"
            continue
        sizes.add((grey.shape[1], grey.shape[0]))
        view = charuco(path.name, grey, board) if board.marker else chessboard(path.name, grey, board)
        if len(view) < LEAST_CORNERS:
            without[path.name] = f"{len(view)} corners found, {LEAST_CORNERS} needed"
        else:
            found.append(view)
    if len(sizes) > 1:
        raise InputError(str(place), f"pictures of {len(sizes)} sizes", "pictures of one camera, all of one size")
    if not found:
        raise InputError(
            str(place), f"the board in none of {len(pictures)} pictures", "the right number of inner corners"
        )
    return Views(str(place), tuple(found), without, sizes.pop())


def chessboard(name: str, grey: FloatArray, board: Board) -> View:
    """The inner corners of a chessboard that is in the picture as a whole, to a fraction of a pixel."""
    cv2 = opencv()
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    there, corners = cv2.findChessboardCorners(grey, (board.columns, board.rows), flags=flags)
    if not there:
        return View(name, np.zeros((0, 3)), np.zeros((0, 2)))
    grid = np.asarray(corners, dtype=np.float64).reshape(board.rows, board.columns, 2)
    apart = min(
        float(np.min(np.linalg.norm(np.diff(grid, axis=axis), axis=-1))) for axis in (0, 1) if grid.shape[axis] > 1
    )
    half = int(np.clip(apart / 2.0, 1, _WINDOW))  # no neighbour within it
    until = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    fine = cv2.cornerSubPix(grey, np.asarray(corners, dtype=np.float32), (half, half), (-1, -1), until)
    return View(name, board.points, np.asarray(fine, dtype=np.float64).reshape(-1, 2))


def charuco(name: str, grey: FloatArray, board: Board) -> View:
    """The corners of a ChArUco board that can be told from its markers: the board may be hidden in part."""
    cv2 = opencv()
    number = getattr(cv2.aruco, board.dictionary, None)
    if number is None:
        raise InputError("--dictionary", board.dictionary, "a dictionary of OpenCV, such as DICT_5X5_100")
    dictionary = cv2.aruco.getPredefinedDictionary(number)
    target = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square, board.marker, dictionary)
    target.setLegacyPattern(board.legacy)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(target).detectBoard(grey)
    if ids is None or corners is None:
        return View(name, np.zeros((0, 3)), np.zeros((0, 2)))
    points = np.asarray(target.getChessboardCorners(), dtype=np.float64)[np.ravel(ids)]
    return View(name, points, np.asarray(corners, dtype=np.float64).reshape(-1, 2))


def read_corners(path: Path) -> Views:
    """A table with the columns image, x, y, u, v and perhaps z: one corner a row, target in metres, pixels.

    A line `# size = 640x480` says how large the pictures are.

    Raises
    ------
    InputError : no table, a column that is not there, what is no number
    """
    size = (0, 0)
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(str(path), type(error).__name__, "a table of corners as text") from None
    for line in lines:
        if line.startswith("#") and "size" in line and "x" in line.split("=")[-1]:
            size = _size(path, line.split("=")[-1])
    rows = csv.reader(line for line in lines if line.strip() and not line.startswith("#"))
    head = [cell.strip() for cell in next(rows, [])]
    lacking = [name for name in COLUMNS if name != "z" and name not in head]
    if lacking:
        raise InputError(str(path), f"columns {', '.join(head[:8]) or 'none'}", f"also {', '.join(lacking)}")
    where = {name: head.index(name) for name in COLUMNS if name in head}
    table: dict[str, list[list[float]]] = {}
    for number, row in enumerate(rows, start=2):
        try:
            numbers = [float(row[where[name]]) if name in where else 0.0 for name in COLUMNS[1:]]
        except (ValueError, IndexError):
            raise InputError(str(path), ",".join(row)[:60], "an image and numbers", f"corner {number - 1}") from None
        if not np.all(np.isfinite(numbers)):
            raise InputError(str(path), ",".join(row)[:60], "finite numbers", f"corner {number - 1}")
        table.setdefault(row[where["image"]].strip(), []).append(numbers)
    views, without = [], {}
    for name, entries in table.items():
        values = np.array(entries)
        if len(values) < LEAST_CORNERS:
            without[name] = f"{len(values)} corners, {LEAST_CORNERS} needed"
        else:
            views.append(View(name, values[:, :3], values[:, 3:]))
    if not views:
        raise InputError(str(path), f"{len(table)} images", f"an image with {LEAST_CORNERS} corners or more")
    return Views(str(path), tuple(views), without, size)


def _size(path: Path, text: str) -> tuple[int, int]:
    parts = text.strip().split("x")
    if len(parts) != 2 or not all(part.strip().isdigit() for part in parts):
        raise InputError(str(path), text.strip()[:40], "width x height, such as 640x480", "size")
    return int(parts[0]), int(parts[1])


def write_corners(path: Path, views: Sequence[View], size: tuple[int, int] = (0, 0)) -> None:
    """The table that `read_corners` reads."""
    lines = [f"# size = {size[0]}x{size[1]}"] if all(size) else []
    lines.append(",".join(COLUMNS))
    for view in views:
        for (x, y, z), (u, v) in zip(view.points, view.pixels, strict=True):
            lines.append(f"{view.name},{x:.9g},{y:.9g},{z:.9g},{u:.4f},{v:.4f}")
    write_text(path, "\n".join(lines) + "\n")
