"""The sensors, one line each: a module of this folder, and what in it declares the sensor, `SENSOR` unless named.

All tables by sensor are made from these declarations, and see what is registered later.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from typing import Generic, TypeVar

from sinan.sensors.sensor_type import SensorType

_LINES = (
    "accelerometer",
    "gyroscope",
    "magnetometer",
    "barometer",
    "sonar",
    "laser",
    "gps",
    "gps:BASE",
    "camera",
)

T = TypeVar("T")
_SENSORS: dict[str, SensorType] = {}


def register(sensor: SensorType) -> None:
    """Add a sensor; one of the same name is replaced. Before recordings of it are read, simulated or filtered."""
    _SENSORS[sensor.name] = sensor


def remove(name: str) -> None:
    """Take a registered sensor away again."""
    del _SENSORS[name]


def _read() -> None:
    for line in _LINES:
        module, _, attribute = line.partition(":")
        register(getattr(import_module(f"sinan.sensors.{module}"), attribute or "SENSOR"))


_read()


def sensors() -> tuple[SensorType, ...]:
    """All declarations, in the order of the list."""
    return tuple(_SENSORS.values())


def sensor(name: str) -> SensorType:
    """The declaration of one sensor.

    Raises
    ------
    KeyError : no such sensor
    """
    if name not in _SENSORS:
        raise KeyError(f"no sensor `{name}`; there are {', '.join(_SENSORS)}")
    return _SENSORS[name]


def is_sensor(name: str) -> bool:
    """Whether there is a sensor of that name: `level` and the bounds of a motion are none."""
    return name in _SENSORS


def where(holds: Callable[[SensorType], object]) -> tuple[str, ...]:
    """Names of the sensors of which something holds."""
    return tuple(name for name, entry in _SENSORS.items() if holds(entry))


def height_sensors() -> tuple[str, ...]:
    """The sensors whose readings show a height, and no place."""
    return where(lambda entry: entry.height is not None)


class BySensor(Mapping[str, T], Generic[T]):
    """A table by sensor that follows the list: what `of` takes from each declaration.

    Parameters
    ----------
    of : the entry of a sensor; None or empty: it has none
    before, after : entries that are of no sensor
    """

    def __init__(
        self,
        of: Callable[[SensorType], T | None],
        before: Mapping[str, T] | None = None,
        after: Mapping[str, T] | None = None,
    ) -> None:
        self._of, self._before, self._after = of, dict(before or {}), dict(after or {})

    def _all(self) -> dict[str, T]:
        own = {name: found for name, entry in _SENSORS.items() if (found := self._of(entry))}
        return {**self._before, **own, **self._after}

    def __getitem__(self, name: str) -> T:
        if name in self._before or name in self._after:
            return self._after[name] if name in self._after else self._before[name]
        found = self._of(_SENSORS[name]) if name in _SENSORS else None
        if not found:
            raise KeyError(name)
        return found

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())
