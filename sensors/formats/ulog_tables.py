"""The topics of a PX4 log as tables, a CSV file each, for the reader of ULogs: what pyulog's `ulog2csv` makes of one.

A file is called `LOG_TOPIC_K.csv`, K counts the instances of its topic from 0. Its columns are those of the log, with
`timestamp` first, in us. What a log says of itself (parameters, texts) is in none of them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.columns import content_of, table_of
from sinan.sensors.formats.text_table import NOT_A_NUMBER, TextTable
from sinan.sensors.formats.ulog_messages import Fields, Said, Topics, read_topics

_INERTIAL = ("sensor_combined", "vehicle_imu", "sensor_gyro", "vehicle_angular_velocity")
#: Topics by which files are known to be of PX4, and where the log's own name ends.
_KNOWN = (
    *_INERTIAL, "vehicle_acceleration", "sensor_accel", "vehicle_magnetometer", "sensor_mag", "vehicle_air_data",
    "sensor_baro", "vehicle_gps_position", "sensor_gps", "distance_sensor", "battery_status", "esc_status",
    "actuator_motors", "actuator_outputs", "airspeed", "airspeed_validated", "vehicle_attitude",
    "vehicle_visual_odometry", "vehicle_local_position", "vehicle_status",
)  # fmt: skip
_FILE = re.compile(rf"(?:(?P<log>.+)_)?(?P<topic>{'|'.join(_KNOWN)})_(?P<instance>\d{{1,2}})\.csv", re.ASCII)
_OTHER = re.compile(r"(\w+)_(\d{1,2})\.csv", re.ASCII)
_CLOCK = "timestamp"
#: Bytes in which a line of names has ended.
_LONGEST_HEADER = 2**16


class TopicTables(Fields):
    """Those of tables; a file is read when one of its fields is asked for.

    Parameters
    ----------
    files : by topic, a further instance k as `topic#k`

    Attributes
    ----------
    said, notes : what the log says of itself, and what could not be read: nothing

    Raises
    ------
    InputError : a file without names of columns or without times
    """

    def __init__(self, files: Mapping[str, Path]) -> None:
        self.said, self.notes = Said(), ()
        self._tables: dict[str, TextTable] = {}
        for topic, file in sorted(files.items()):
            if content_of(file) == "empty":
                raise InputError(file, "an empty file", "a table; make it anew with ulog2csv, or take it away")
            table = table_of(file, NOT_A_NUMBER)
            if _CLOCK in table.names:
                self._tables |= {topic: table} if table.first(_CLOCK) else {}
            elif topic.split("#")[0] in _KNOWN:
                found = f"no column {_CLOCK} among {', '.join(table.names[:6])}"
                raise InputError(file, found, "a table as ulog2csv makes it, or --map FILE.toml", "line 1")
        self._names = {f"{topic}.{name}": (topic, name) for topic, one in self._tables.items() for name in one.names}
        self._read: dict[str, tuple[dict[str, FloatArray], dict[str, InputError]]] = {}

    def __getitem__(self, name: str) -> FloatArray:
        topic, column = self._names[name]
        if topic not in self._read:
            self._read[topic] = self._tables[topic].read_numbers()
        columns, others = self._read[topic]
        if column in others:
            raise others[column]
        return columns[column]

    def rows(self, topic: str) -> int:
        """How many readings of a topic there are."""
        return len(self[f"{topic}.{_CLOCK}"])

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics that have a reading."""
        return tuple(self._tables)


def topics_of(path: Path) -> Topics | TopicTables:
    """The topics of a ULog, of a folder of its tables, or of the log that one such table is of.

    Raises
    ------
    InputError : tables of several logs in a folder; what `read_topics`, `TopicTables` find wrong
    """
    if path.is_file() and content_of(path) == "ulog":
        return read_topics(path)
    return TopicTables(_tables_of(path, _log_of(path)))


def log_name(path: Path) -> str:
    """What a log is called: its file, without its suffix; of tables, what their names begin with, else their folder."""
    return path.stem if path.is_file() and content_of(path) == "ulog" else _log_of(path) or _folder_of(path).name


def holds_topics(path: Path) -> bool:
    """Whether a path is a folder of tables of topics, or one of them whose log has an IMU."""
    if path.is_dir():
        return any(_has_clock(file) for _, file in _known_in(path))
    own = [log for log in _logs_in(_folder_of(path)) if log and path.name.startswith(f"{log}_")]
    if not (own or _FILE.fullmatch(path.name)) or not _has_clock(path):
        return False
    tables = _tables_of(path, _log_of(path))
    return path in tables.values() and any(topic in _INERTIAL for topic in tables)


def _has_clock(file: Path) -> bool:
    with file.open("rb") as text:
        return re.search(rb"(?<![\w.])timestamp(?![\w.])", text.readline(_LONGEST_HEADER)) is not None


def _known_in(folder: Path) -> list[tuple[re.Match[str], Path]]:
    files = sorted(file for file in folder.glob("*.csv") if file.is_file())
    return [(found, file) for file in files if (found := _FILE.fullmatch(file.name)) is not None]


def _folder_of(path: Path) -> Path:
    return path.resolve() if path.is_dir() else path.resolve().parent


def _logs_in(folder: Path) -> list[str]:
    """What the logs of a folder are called.

    A name that continues another is another log's only if it has an IMU: `a_estimator_aid_src` of the topic
    `estimator_aid_src_airspeed` is no log beside `a`.
    """
    found = _known_in(folder)
    names = {one["log"] or "" for one, _ in found}
    inertial = {one["log"] or "" for one, _ in found if one["topic"] in _INERTIAL}

    def continues(name: str) -> bool:
        return any(name != other and name.startswith(f"{other}_" if other else "") for other in names)

    return sorted(name for name in names if name in inertial or not continues(name))


def _log_of(path: Path) -> str:
    """Which log of its folder a path is, or has."""
    logs = _logs_in(_folder_of(path))
    if path.is_dir():
        if len(logs) != 1:
            raise InputError(
                path,
                f"tables of {len(logs)} logs ({', '.join(repr(log) for log in logs[:4])})",
                "one file of the log meant",
            )
        return logs[0]
    own = [log for log in logs if path.name.startswith(f"{log}_" if log else "")]
    return max(own, key=len)


def _tables_of(path: Path, log: str) -> dict[str, Path]:
    """The file of each topic of a log."""
    begin = f"{log}_" if log else ""
    others = [name for name in _logs_in(_folder_of(path)) if name != log and name.startswith(begin)]
    files: dict[str, Path] = {}
    for file in sorted((path if path.is_dir() else path.parent).glob("*.csv")):
        if not file.name.startswith(begin) or any(file.name.startswith(f"{other}_") for other in others):
            continue
        if found := _OTHER.fullmatch(file.name[len(begin) :]):
            files[f"{found[1]}#{int(found[2])}" if int(found[2]) else found[1]] = file
    return files
