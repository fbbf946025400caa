"""What a map says, once read: files, streams, clocks and quantities. `docs/formats.md` is the manual of maps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.formats.columns import FileOptions
from sinan.sensors.formats.header import Header
from sinan.sensors.recording import ACCEL, FIX_QUALITY, GYRO, MAG, POSITION, QUATERNION, VELOCITY, Kind
from sinan.sensors.registry import BySensor
from sinan.sensors.sensor_type import Quantities

_PLACE: Mapping[str, tuple[tuple[str, ...], str]] = {
    "latitude": (("latitude",), "degrees"),
    "longitude": (("longitude",), "degrees"),
    "height": (("height",), "length"),
    "position": (POSITION, "length"),
    "velocity": (VELOCITY, "speed"),
}
_FIX_QUALITY_IS = {"eph": "length", "epv": "length", "s_variance": "speed"}
_OF_GPS: Quantities = {
    **_PLACE,
    **{name: ((name,), _FIX_QUALITY_IS.get(name, "number")) for name in FIX_QUALITY},
}
_OF_IMU: Quantities = {
    "accel": (ACCEL, "acceleration"),
    "gyro": (GYRO, "rate"),
    "temperature": (("temperature",), "temperature"),
}
_OTHERS: Mapping[str, Quantities] = {
    "power": {"current": (("current",), "current"), "voltage": (("voltage",), "voltage")},
    "motors": {"motor": ((), "ratio")},
    "air": {
        "airspeed": (("airspeed",), "speed"),
        "wind": (("wind_north", "wind_east"), "speed"),
        "temperature": (("temperature",), "temperature"),
    },
    "poses": {
        "accel": (ACCEL, "acceleration"),
        "mag": (MAG, "field"),
        "temperature": (("temperature",), "temperature"),
    },
}
#: What a stream may hold: the columns that a quantity becomes, and what it is (a key of `UNITS`).
QUANTITIES: Mapping[str, Quantities] = BySensor(
    lambda entry: _OF_GPS if entry.name == "gps" else entry.quantities, before={"imu": _OF_IMU}, after=_OTHERS
)
REFERENCE_QUANTITIES: Mapping[str, tuple[tuple[str, ...], str]] = {
    **_PLACE,
    "quaternion": (QUATERNION, "number"),
    "roll_pitch_yaw": (("roll", "pitch", "yaw"), "angle"),
    "roll_pitch": (("roll", "pitch"), "angle"),
}
DROPS = ("repeated time", "held value", "interpolated", "not finite", "zeros", "not unit")


@dataclass(frozen=True)
class Clock:
    """Where the time of a stream comes from.

    Attributes
    ----------
    column : of the time; empty: the rows are counted
    minus : a column that is taken off it, in the same unit; empty: none
    rate : of the rows that are counted, or that the column counts [Hz]; None: the column is a time
    unit : of the column, a key of `UNITS["time"]`
    zero : what the log's clock shows at t = 0, in its own unit
    wrap : the value at which the log's clock starts again from 0, in its own unit; None: never
    even : the stamps are those of a link that delivers in bursts: the rows lie evenly on the line fitted to them
    """

    column: str = ""
    minus: str = ""
    rate: float | None = None
    unit: str = "s"
    zero: float = 0.0
    wrap: float | None = None
    even: bool = False


@dataclass(frozen=True)
class Quantity:
    """Some columns of a log that are one measured quantity, and the way to its SI value in the body's axes.

    value = axes @ (unit * ((column - minus + offset) / scale - zero) / per_unit), with undo = {offset, scale}, counts =
    {zero, per_unit}.

    Attributes
    ----------
    outputs : the columns of the stream that it becomes
    columns : of the log, as many as outputs
    minus : columns of the log that are taken off them, as many again; empty: none
    file : of the map that holds them; empty: the stream's
    factor, shift : to SI
    unit : as the map names it; empty: none
    undo_offset, undo_scale, zero, per_unit : see above, each one number or one a column
    axes : (3, 3) or None
    polar : columns are speed, course [deg] and down: velocity in NED
    enu : a vector in east, north, up; a quaternion into east-north-up
    inverse : a quaternion from the world into the sensor, to be turned round
    """

    outputs: tuple[str, ...]
    columns: tuple[str, ...]
    minus: tuple[str, ...] = ()
    file: str = ""
    factor: float = 1.0
    shift: float = 0.0
    unit: str = ""
    undo_offset: FloatArray = field(default_factory=lambda: np.zeros(1))
    undo_scale: FloatArray = field(default_factory=lambda: np.ones(1))
    zero: FloatArray = field(default_factory=lambda: np.zeros(1))
    per_unit: FloatArray = field(default_factory=lambda: np.ones(1))
    axes: FloatArray | None = None
    polar: bool = False
    enu: bool = False
    inverse: bool = False


@dataclass(frozen=True)
class Keep:
    """Which rows count: those where a column lies strictly between two bounds, or equals a value."""

    column: str
    above: float = -np.inf
    below: float = np.inf
    equals: float | None = None


@dataclass(frozen=True)
class StreamMap:
    """One stream of the recording.

    Attributes
    ----------
    name : of the stream, or "reference"
    file : that holds it
    clock : its time
    quantities : what it measures, by name
    keep : rows that count; all conditions have to hold
    drop : what is left out, of `DROPS`
    skip_rows : at the beginning
    align : "rows" where quantities of several files share their rows, "interpolate" where they are brought to the rows
        of `file`
    """

    name: str
    file: str
    clock: Clock
    quantities: Mapping[str, Quantity]
    keep: tuple[Keep, ...] = ()
    drop: tuple[str, ...] = ()
    skip_rows: int = 0
    align: str = "rows"


@dataclass(frozen=True)
class Map:
    """How a log is read.

    Attributes
    ----------
    path : of the map, for messages
    kind, name : of the recording; an empty name is the log's
    header : what the map declares of origin, environment and noise
    files : by name; the log itself is `""`
    streams : of the recording
    reference : what the recording may be scored against
    kind_of_reference : what that is, of `TRUTH_KINDS`; empty where there is none
    aligned : whether it has the instrument's axes and clock
    notes : for the recording's
    """

    path: Path
    kind: Kind
    name: str
    header: Header
    files: Mapping[str, FileOptions]
    streams: tuple[StreamMap, ...]
    reference: StreamMap | None = None
    kind_of_reference: str = ""
    aligned: bool = False
    notes: tuple[str, ...] = ()

    def axes_of(self, quantity: str) -> FloatArray | None:
        """(3, 3) axes that the first stream with this quantity gives it; None: those of the log."""
        return next((one.quantities[quantity].axes for one in self.streams if quantity in one.quantities), None)
