"""A scenario from its TOML file. docs/scenarios.md has the keys."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from datetime import date
from pathlib import Path
from typing import Any, cast

import numpy as np

from sinan.sensors.earth import normal_gravity
from sinan.sensors.errors import InputError
from sinan.sensors.formats.header import HIGHEST, LISTS, LOWEST, SENSOR_KEYS, scan_angles
from sinan.sensors.formats.toml_table import Table, read_toml
from sinan.sensors.geomagnetism import earth_field
from sinan.sensors.lenses import LENSES
from sinan.sensors.manoeuvres import DEFAULTS, KINDS, Manoeuvre
from sinan.sensors.recording import SensorSpec
from sinan.sensors.registry import where
from sinan.sensors.scenario import Air, Instrument, Marks, Scenario, Supply, Turns, Vibration, Warming

FOLDER = Path(__file__).parent


def simulated() -> tuple[str, ...]:
    """The sensors that a scenario may have."""
    return where(lambda entry: entry.make is not None or entry.name == "camera")


#: what a tesla is in the unit in which the field is declared; "norm": divided by its own norm
UNITS = {"norm": None, "T": 1.0, "uT": 1e6, "nT": 1e9}
MAX_LIKE = 8  # scenarios deep; more is a circle
#: The longest scenario [s], a day, and the most rows of a stream: three hours at 400 Hz. A simulation holds them all.
LONGEST, MOST_ROWS = 86400.0, 5_000_000
#: The most marks of a camera: each is looked for in every picture.
MOST_MARKS = 10_000
#: The largest length [m], angle [deg], time [s] or other size in a scenario; the shortest time by which is divided.
LARGEST, SHORTEST = 1e6, 1e-3
#: The fastest clock [Hz]: no instrument that is sold has more than 32 kHz.
FASTEST = 1e5
#: Keys of manoeuvres with narrower bounds: a square has sides, what is spun up or shaken takes its time.
_BOUNDS = {
    "laps": (0.25, 1e4),
    "rest": (0.0, LONGEST),
    **dict.fromkeys(("period", "spin_up", "spin_down"), (SHORTEST, LONGEST)),
}
#: Keys of records that divide.
_DIVISORS = ("time_constant", "period", "capacity", "hover_throttle")
_RECORDS = {"warming": Warming, "baro_warming": Warming, "supply": Supply}


def scenario_names() -> tuple[str, ...]:
    """The scenarios that are shipped; files that begin with an underscore are parts that others are `like`."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml") if not path.stem.startswith("_")))


def load_scenario(name: str | Path) -> Scenario:
    """A scenario by its name or its file.

    Raises
    ------
    InputError : no such scenario, or a key that is wrong; names it
    """
    path = Path(name) if str(name).endswith(".toml") else FOLDER / f"{name}.toml"
    if not _is_file(path):
        found = "no such file" if str(name).endswith(".toml") else "no such scenario"
        raise InputError(str(name), found, "a TOML file or one of " + ", ".join(scenario_names()))
    return scenario_of(Table(path, merged(path)), path.stem)


def _is_file(path: Path) -> bool:
    """Whether there is such a file; a name that no file can have has none."""
    try:
        return path.is_file()
    except OSError:
        return False


def merged(path: Path, depth: int = 0) -> dict[str, Any]:
    """The tables of a file laid over those of the scenario that it is `like`; sensors that it is `without` left out."""
    data: dict[str, Any] = read_toml(path)
    like = data.pop("like", None)
    if like is None:
        return data
    base = path.parent / f"{like}.toml"
    base = base if _is_file(base) else FOLDER / f"{like}.toml"
    if not isinstance(like, str) or not _is_file(base) or depth > MAX_LIKE:
        raise InputError(path, repr(like), "the name of another scenario", "key like")
    below = merged(base, depth + 1)
    without = data.pop("without", [])
    if not isinstance(without, list) or not all(name in simulated() for name in without):
        raise InputError(path, repr(without), "a list of " + ", ".join(simulated()), "key without")
    sensors = Table(base, below).table("sensors").data
    below["sensors"] = {name: spec for name, spec in sensors.items() if name not in without}
    if "turns" in data:
        below.pop("manoeuvre", None)
    if "manoeuvre" in data:
        below.pop("turns", None)
    return _laid_over(below, data)


def _laid_over(below: dict[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """`above` where it says something, table by table; the word "none" takes a key away."""
    for key, value in above.items():
        if isinstance(value, dict) and isinstance(below.get(key), dict):
            _laid_over(below[key], value)
        elif value == "none":
            below.pop(key, None)
        else:
            below[key] = value
    return below


def scenario_of(table: Table, name: str) -> Scenario:
    """The scenario that a table says, laid over those that it is like; see `load_scenario`."""
    origin, gravity, field = _place(table)
    turns = _turns(table)
    start = table.vector("start", 4, at_most=LARGEST)
    start = np.zeros(4) if start is None else start
    scenario = Scenario(
        name=table.text("name") or name,
        summary=table.text("summary") or "",
        kind="poses" if table.text("kind", ("flight", "poses")) == "poses" else "flight",
        sensors=_sensors(table),
        manoeuvres=_manoeuvres(table, turns is not None),
        turns=turns,
        static=table.flag("static") or False,
        start=(start[0], start[1], start[2], float(np.deg2rad(start[3])), 0.0 if table.flag("on_ground") else 1.0),
        smoothing=_or(table.number("smoothing", at_least=0.05, at_most=2.0), 0.25),
        origin=origin,
        gravity=gravity,
        magnetic_field=field,
        ground_down=_size(table.table("environment"), "ground_down") or 0.0,
        air=_air(table.table("air")),
        vibration=_vibration(table.table("vibration")),
        covariate_rate=_or(table.number("covariate_rate", at_least=0.0, at_most=FASTEST), 50.0),
        truth_rate=_or(table.number("truth_rate", at_least=0.0, at_most=FASTEST), 50.0),
        initial=_initial(table.table("initial")),
        **{key: _record(table.table(key), kind) for key, kind in _RECORDS.items()},
    )
    table.text("like")
    table.get("without", "array", items={"enum": [*simulated()]})
    table.done()
    _require_bounded(table, scenario)
    return scenario


def _require_bounded(table: Table, scenario: Scenario) -> None:
    """Raise an `InputError` for more rows than a simulation can hold."""
    duration = scenario.duration
    if duration > LONGEST:
        raise table.error("duration", f"{duration:g} s in all", f"at most {LONGEST:g} s")
    fastest = max(scenario.sensors.values(), key=lambda instrument: instrument.rate).rate
    if fastest * duration < 2.0:
        raise table.error("rate", f"{fastest:g} Hz for {duration:g} s", "two readings or more of one sensor")
    rates = {f"sensors.{name}.rate": instrument.rate for name, instrument in scenario.sensors.items()}
    for key, rate in {**rates, "covariate_rate": scenario.covariate_rate, "truth_rate": scenario.truth_rate}.items():
        if rate * duration > MOST_ROWS:
            found = f"{rate:g} Hz for {duration:g} s, {rate * duration:.3g} rows"
            raise table.error(key, found, f"at most {MOST_ROWS} rows, {MOST_ROWS / duration:.4g} Hz")


def _size(table: Table, key: str) -> float | None:
    return table.number(key, at_least=-LARGEST, at_most=LARGEST)


def _time(table: Table, key: str) -> float | None:
    return table.number(key, at_least=SHORTEST, at_most=LONGEST)


def _or(value: float | None, default: float) -> float:
    return default if value is None else value


def _place(table: Table) -> tuple[tuple[float, float, float] | None, float, tuple[float, float, float]]:
    """Origin, gravity there, and the magnetic field there on the date; `[environment]` may say both instead."""
    environment, place = table.table("environment"), table.table("origin")
    gravity = environment.number("gravity", at_least=SHORTEST, at_most=LARGEST)
    field = environment.vector("magnetic_field", 3, at_most=LARGEST)
    if field is not None and not np.any(field):
        raise environment.wrong("magnetic_field", "a field that is not zero")
    unit = environment.text("magnetic_unit", tuple(UNITS)) or "norm"
    environment.get("ground_down")
    environment.done()
    origin = None
    if "origin" in table:
        values = [
            place.number("latitude", at_least=-90.0, at_most=90.0),
            place.number("longitude", at_least=-180.0, at_most=360.0),
            place.number("height", at_least=LOWEST, at_most=HIGHEST),
        ]
        if None in values:
            raise place.error("latitude", "a part is missing", "latitude, longitude [deg] and height [m]")
        latitude, longitude, height = (float(value) for value in values if value is not None)
        origin = (latitude, longitude, height)
        gravity = normal_gravity(float(np.deg2rad(latitude)), height) if gravity is None else gravity
        day = place.get("date", "string", format="date")
        if field is None and not isinstance(day, date):
            raise place.error("date", repr(day), "a date such as 2026-06-01, for the Earth's magnetic field")
        if field is None:
            try:
                tesla = earth_field(latitude, longitude, height, cast(date, day))
            except ValueError as error:
                raise place.error("date", str(day), str(error)) from None
            scale = UNITS[unit]
            field = tesla / np.linalg.norm(tesla) if scale is None else tesla * scale
        place.done()
    default = Scenario("", {})
    gravity = default.gravity if gravity is None else gravity
    return origin, gravity, default.magnetic_field if field is None else (field[0], field[1], field[2])


def _air(table: Table) -> Air:
    wind = table.vector("wind", 2, at_most=LARGEST)
    air = Air(
        drag=table.number("drag", at_least=0.0, at_most=LARGEST) or 0.0,
        wind=(0.0, 0.0) if wind is None else (wind[0], wind[1]),
        wind_known=table.flag("wind_known") or False,
    )
    table.done()
    return air


def _vibration(table: Table) -> Vibration:
    amplitude = table.vector("amplitude", 3, at_most=LARGEST)
    frequency = _or(table.number("frequency", at_least=SHORTEST, at_most=FASTEST), Vibration().frequency)
    table.done()
    return Vibration() if amplitude is None else Vibration((amplitude[0], amplitude[1], amplitude[2]), frequency)


def _record(table: Table, kind: type[Any]) -> Any:
    """A record of plain numbers; what is not given keeps the record's default."""
    given = {
        entry.name: table.number(
            entry.name, at_least=SHORTEST if entry.name in _DIVISORS else -LARGEST, at_most=LARGEST
        )
        for entry in fields(kind)
    }
    table.done()
    return kind(**{key: value for key, value in given.items() if value is not None})


def _initial(table: Table) -> tuple[float, float, float] | None:
    stds = [
        table.number(key, at_least=0.0, at_most=LARGEST) for key in ("position_std", "velocity_std", "attitude_std")
    ]
    declared = table.flag("declared")
    table.done()
    if declared is False:
        return None
    position, velocity, attitude = (_or(value, default) for value, default in zip(stds, (1.0, 0.2, 0.02), strict=True))
    return position, velocity, attitude


def _turns(table: Table) -> Turns | None:
    if "turns" not in table:
        return None
    turns = table.table("turns")
    default = Turns()
    result = Turns(
        kind=turns.text("kind", ("poses", "sweep", "hand")) or default.kind,
        duration=_or(_time(turns, "duration"), default.duration),
        poses=turns.whole("poses", at_least=2, at_most=MOST_ROWS) or default.poses,
        hold=_or(_time(turns, "hold"), default.hold),
        turn=_or(_time(turns, "turn"), default.turn),
        sway=_or(turns.number("sway", at_least=0.0, at_most=LARGEST), default.sway),
        attitudes=_attitudes(turns),
        around=np.deg2rad(_or(turns.number("around", at_least=-LARGEST, at_most=LARGEST), 0.0)),
    )
    turns.done()
    return result


def _attitudes(turns: Table) -> tuple[tuple[float, float, float], ...]:
    """Roll, pitch, yaw [rad] of each pose, from a list of lists in degrees."""
    angles = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
    entries = turns.get("attitudes", "array", items=angles, minItems=2, maxItems=MOST_ROWS)
    if entries is None:
        return ()
    if not isinstance(entries, list) or not 2 <= len(entries) <= MOST_ROWS:
        raise turns.wrong("attitudes", "two or more of [roll, pitch, yaw], deg")
    tables = [Table(turns.path, {"attitudes": row}, turns.name) for row in entries]
    rows = [table.vector("attitudes", 3, at_most=LARGEST) for table in tables]
    return tuple((float(r), float(p), float(y)) for r, p, y in (np.deg2rad(row) for row in rows if row is not None))


def _manoeuvres(table: Table, turned: bool) -> tuple[Manoeuvre, ...]:
    if turned:
        table.get("manoeuvre")
        return ()
    entries = table.tables("manoeuvre")
    if not entries:
        raise table.error("manoeuvre", "none", "at least one [[manoeuvre]], or [turns]")
    return tuple(map(_manoeuvre, entries))


def _manoeuvre(table: Table) -> Manoeuvre:
    kind = table.text("kind", tuple(KINDS))
    duration = _time(table, "duration")
    if kind is None or duration is None:
        raise table.error("kind", "kind or duration is missing", "both")
    bounds = {key: _BOUNDS.get(key, (-LARGEST, LARGEST)) for key in DEFAULTS[kind]}
    keys = {key: table.number(key, at_least=low, at_most=high) for key, (low, high) in bounds.items()}
    table.done()
    for key in {"spin_up", "spin_down"} & set(keys):
        if (spinning := _or(keys[key], DEFAULTS[kind][key])) >= duration:
            raise table.error(key, f"{spinning:g} s in a manoeuvre of {duration:g} s", "less than its duration")
    return Manoeuvre(kind, duration, {key: value for key, value in keys.items() if value is not None})


def _sensors(table: Table) -> dict[str, Instrument]:
    sensors = table.table("sensors")
    found = {name: _instrument(sensors.table(name), name) for name in simulated() if name in sensors}
    sensors.done()
    if not found:
        raise table.error("sensors", "no sensor", "at least one of " + ", ".join(simulated()))
    if "gyro" in found and "accel" not in found:
        raise table.error("sensors", "gyro without accel", "both: they share the clock of the accelerometer")
    if "camera" in found and table.get("kind") == "poses":
        raise table.error("sensors", "a camera", 'kind = "flight": poses have none')
    return found


def _instrument(table: Table, name: str) -> Instrument:
    spec: dict[str, object] = {}
    for key in SENSOR_KEYS[name]:
        if key == "angles":
            spec[key] = scan_angles(table)
        elif key == "lens":
            spec[key] = table.text(key, tuple(LENSES)) or ""
        elif key in LISTS:
            spec[key] = table.vector(key, LISTS[key], at_most=LARGEST)
        elif key != "imu_samples":
            spec[key] = table.number(key, at_least=0.0, at_most=LARGEST)
    place = table.vector("place", 3, at_most=LARGEST)
    interval = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
    intervals = table.get("dropouts", "array", items=interval) or []
    rate = table.number("rate", above=0.0, at_most=FASTEST)
    if rate is None and name != "gyro":
        raise table.error("rate", "no such key", "readings a second [Hz]")
    instrument = Instrument(
        spec=SensorSpec(**{key: value for key, value in spec.items() if value is not None}),  # type: ignore[arg-type]
        rate=_or(rate, 200.0),
        offset=_or(table.number("offset", at_least=0.0, at_most=LONGEST), 0.0),
        jitter=_or(table.number("jitter", at_least=0.0, at_most=LONGEST), 0.0),
        loss=_or(table.number("loss", at_least=0.0, at_most=1.0), 0.0),
        dropouts=_intervals(table, intervals),
        minimum=_or(table.number("minimum", at_least=0.0), 0.0),
        maximum=_or(table.number("maximum", above=0.0), np.inf),
        beam_angle=float(np.deg2rad(_or(table.number("beam_angle", above=0.0, at_most=90.0), 90.0))),
        softness=_or(table.number("softness", at_least=0.0, at_most=1.0), 0.0),
        scale_std=_or(table.number("scale_std", at_least=0.0, at_most=LARGEST), 0.0),
        velocity=name != "gps" or "velocity_noise_std" in table,
        place=(100.0, 50.0, 0.0) if place is None else (place[0], place[1], place[2]),
        marks=_marks(table) if name == "camera" else Marks(),
    )
    table.done()
    return instrument


def _marks(table: Table) -> Marks:
    """What a camera sees, and how large its pictures are."""
    default = Marks()
    size = table.vector("size", 2, at_most=LARGEST)
    return Marks(
        count=table.whole("marks", at_least=1, at_most=MOST_MARKS) or default.count,
        reach=_or(table.number("reach", above=0.0, at_most=LARGEST), default.reach),
        height=_or(table.number("height", at_least=0.0, at_most=LARGEST), default.height),
        most=table.whole("most", at_least=1, at_most=MOST_MARKS) or default.most,
        size=default.size if size is None else (float(size[0]), float(size[1])),
    )


def _intervals(table: Table, intervals: object) -> tuple[tuple[float, float], ...]:
    right = isinstance(intervals, list) and all(
        isinstance(pair, list)
        and len(pair) == 2
        and all(isinstance(value, int | float) for value in pair)
        and pair[0] < pair[1]
        for pair in intervals
    )
    if not right:
        raise table.wrong("dropouts", "a list of [start, end] in s")
    return tuple((float(pair[0]), float(pair[1])) for pair in cast(list[list[float]], intervals))
