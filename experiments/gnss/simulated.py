"""Scenarios of pseudoranges: a rover at rest or on its way, a base, and the data link between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pymap3d

from sinan.sensors.arrays import FloatArray
from sinan.sensors.code_receiver import CLASSES, CodeReceiver
from sinan.sensors.data_link import DataLink
from sinan.sensors.errors import InputError
from sinan.sensors.files import new_file
from sinan.sensors.formats import rinex_writing
from sinan.sensors.formats.rinex_navigation import Navigation
from sinan.sensors.formats.rinex_observation import Observations
from sinan.sensors.formats.toml_table import Table, read_toml
from sinan.sensors.pseudorange import Pseudoranges, pseudoranges
from sinan.sensors.pseudorange_simulation import (
    START,
    WEEK_NUMBER,
    Air,
    Fault,
    constellation,
    satellite_errors,
    simulate_ranges,
)
from sinan.sensors.range_error import RangeError

FOLDER = Path(__file__).parent / "scenarios"
LONGEST = 7000.0  # s: the messages hold for two hours about the start
MOST_EPOCHS = 20_000


@dataclass(frozen=True)
class RangeScenario:
    """What is simulated.

    Attributes
    ----------
    name, summary : in words
    seconds : length
    origin : latitude, longitude [rad], height [m] of the rover's start
    rover, base : classes of the receivers
    radius, speed : of the circle that the rover drives [m], [m/s]; speed zero: at rest
    away : north, east, up of the base from the origin [m]
    errors : what the broadcast messages are wrong by
    air : delays
    faults : satellites that are off
    link : from base to rover
    """

    name: str
    summary: str
    seconds: float
    origin: tuple[float, float, float]
    rover: CodeReceiver
    base: CodeReceiver
    radius: float
    speed: float
    away: tuple[float, float, float]
    errors: tuple[RangeError, ...]
    air: Air
    faults: tuple[Fault, ...]
    link: DataLink


@dataclass(frozen=True)
class SimulatedRanges:
    """What two receivers have measured, and where they were.

    Attributes
    ----------
    scenario : what was simulated
    navigation : broadcast messages
    rover, base : observations
    position : (epochs, 3) of the rover, ECEF [m]
    base_position : (3,)
    """

    scenario: RangeScenario
    navigation: Navigation
    rover: Observations
    base: Observations
    position: FloatArray
    base_position: FloatArray

    def ranges(self) -> tuple[Pseudoranges, Pseudoranges]:
        """Of rover and base, with the satellites' states."""
        rover = pseudoranges(self.rover, self.navigation, "G", code_of(self.scenario.rover))
        return rover, pseudoranges(self.base, self.navigation, "G", code_of(self.scenario.base))


def code_of(receiver: CodeReceiver) -> str:
    """How `pseudoranges` calls what the class measures."""
    return "ca" if receiver.codes == ("C1C",) else "p" if len(receiver.codes) == 1 else "p_two"


def scenario_names() -> tuple[str, ...]:
    """The scenarios of pseudoranges that are shipped."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def load(name: str) -> RangeScenario:
    """A scenario by its name or its file.

    Raises
    ------
    InputError : no such scenario, or a key that is wrong; names it
    """
    path = Path(name) if name.endswith(".toml") else FOLDER / f"{name}.toml"
    if not path.is_file():
        raise InputError(name, "no such scenario", "a TOML file or one of " + ", ".join(scenario_names()))
    return scenario_of(Table(path, _merged(path, 4)), path.stem)


def scenario_of(table: Table, name: str) -> RangeScenario:
    """The scenario that a table says, laid over those that it is like; see `load`."""
    rover, base, link, air = (table.table(key) for key in ("rover", "base", "link", "air"))
    origin, away = table.vector("origin", 3), base.vector("away", 3)
    if origin is None:
        raise table.error("origin", "no such key", "latitude and longitude in deg, height in m")
    found = RangeScenario(
        name=name,
        summary=table.text("summary") or "",
        seconds=table.number("seconds", at_least=1.0, at_most=LONGEST) or 600.0,
        origin=(float(np.deg2rad(origin[0])), float(np.deg2rad(origin[1])), float(origin[2])),
        rover=_receiver(rover),
        base=_receiver(base),
        radius=rover.number("radius", at_least=1.0, at_most=1e4) or 100.0,
        speed=rover.number("speed", at_least=0.0, at_most=1e3) or 0.0,
        away=(0.0, 10000.0, 0.0) if away is None else (float(away[0]), float(away[1]), float(away[2])),
        errors=tuple(map(_error, table.tables("error"))),
        air=_air(air),
        faults=tuple(map(_fault, table.tables("fault"))),
        link=_link(link),
    )
    table.text("like")
    for one in (table, rover, base, link, air):
        one.done()
    if found.seconds * max(found.rover.rate, found.base.rate) > MOST_EPOCHS:
        raise table.error("seconds", f"{found.seconds:g} s", f"at most {MOST_EPOCHS} epochs of a receiver")
    return found


def _merged(path: Path, deepest: int) -> dict[str, object]:
    """The keys of a file over those of the scenario that it is `like`: tables are laid over, lists replace lists."""
    data = read_toml(path)
    like = data.pop("like", None)
    if like is None:
        return data
    below_path = next((f for f in (path.parent / f"{like}.toml", FOLDER / f"{like}.toml") if f.is_file()), None)
    if below_path is None or deepest == 0:
        raise InputError(path, repr(like), "the name of another scenario", "key like")
    below = _merged(below_path, deepest - 1)
    for key, value in data.items():
        under = below.get(key)
        below[key] = {**under, **value} if isinstance(value, dict) and isinstance(under, dict) else value
    return below


def _receiver(table: Table) -> CodeReceiver:
    receiver = CLASSES[table.text("receiver", tuple(CLASSES)) or "ca"]
    keys = ("noise", "drift", "drift_time", "clock_drift", "clock_noise", "rate")
    given: dict[str, Any] = {key: table.number(key, at_least=1e-6, at_most=1e6) for key in keys}
    return replace(receiver, **{key: value for key, value in given.items() if value is not None})


def _error(table: Table) -> RangeError:
    sigma = table.number("sigma", at_least=0.0, at_most=1e4)
    time = table.number("time", at_least=1e-3, at_most=1e6)
    order = table.whole("order", at_least=1, at_most=2)
    table.done()
    return RangeError(sigma or 0.0, time or 1800.0, order or 1)


def _air(table: Table) -> Air:
    troposphere = table.number("troposphere", at_least=0.0, at_most=10.0)
    ionosphere = table.number("ionosphere", at_least=0.0, at_most=10.0)
    return Air(2.4 if troposphere is None else troposphere, 1.0 if ionosphere is None else ionosphere)


def _fault(table: Table) -> Fault:
    satellite = table.text("satellite") or ""
    sizes = [table.number(key, at_least=-1e5, at_most=1e5) or 0.0 for key in ("offset", "drift", "onset")]
    table.done()
    return Fault(satellite, *sizes)


def _link(table: Table) -> DataLink:
    content, rate = table.text("content", ("corrections", "raw")), table.flag("rate")
    keys = ("interval", "delay", "loss", "run", "window")
    given: dict[str, Any] = {key: table.number(key, at_least=0.0, at_most=1e6) for key in keys}
    link = DataLink(content=content or "corrections", rate=True if rate is None else rate)
    return replace(link, **{key: value for key, value in given.items() if value is not None})


def places(scenario: RangeScenario, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(epochs, 3) of the rover and (3,) of the base, ECEF [m], at seconds of the scenario."""
    angle = scenario.speed / scenario.radius * t
    north, east = scenario.radius * np.sin(angle), scenario.radius * (1.0 - np.cos(angle))
    rover = np.stack(pymap3d.enu2ecef(east, north, np.zeros(len(t)), *scenario.origin, deg=False), axis=1)
    n, e, u = scenario.away
    base = np.array([float(x) for x in pymap3d.enu2ecef(e, n, u, *scenario.origin, deg=False)])
    return rover, base


def simulate(scenario: RangeScenario, seed: int = 0) -> SimulatedRanges:
    """What rover and base measure; the broadcast messages are as wrong for one as for the other."""
    navigation = constellation(seed)
    observed: list[Observations] = []
    where: list[FloatArray] = []
    grids = [np.round(np.arange(int(scenario.seconds * one.rate + 1e-6) + 1) / one.rate, 7)
             for one in (scenario.rover, scenario.base)]  # fmt: skip
    every = np.unique(np.concatenate(grids))
    errors = satellite_errors(every, scenario.errors, len(navigation.kepler), seed)
    for k, receiver in enumerate((scenario.rover, scenario.base)):
        t = grids[k]
        keep = np.searchsorted(every, t)
        rover, base = places(scenario, t)
        where.append(rover if k == 0 else np.tile(base, (len(t), 1)))
        observed.append(
            simulate_ranges(
                receiver, navigation, START + t, where[-1], errors[keep], scenario.air, scenario.faults,
                seed=2 * seed + k,
            )
        )  # fmt: skip
    return SimulatedRanges(scenario, navigation, observed[0], observed[1], where[0], where[1][0])


def write(simulated: SimulatedRanges, folder: Path) -> Sequence[Path]:
    """RINEX files of both receivers and of the messages, and the rover's true positions."""
    folder.mkdir(parents=True, exist_ok=True)
    t = simulated.rover.t
    texts = {
        "rover.obs": rinex_writing.observation_text(simulated.rover),
        "base.obs": rinex_writing.observation_text(simulated.base),
        "broadcast.nav": rinex_writing.navigation_text(simulated.navigation),
        "reference.csv": rinex_writing.reference_text(WEEK_NUMBER, t, simulated.position),
        "base_position.txt": " ".join(f"{x:.4f}" for x in simulated.base_position) + "\n",
    }
    for name, text in texts.items():
        with new_file(folder / name) as file:
            file.write(text)
    return [folder / name for name in texts]


def as_json(scenario: RangeScenario) -> dict[str, object]:
    """The scenario as plain numbers and words."""
    table: dict[str, object] = asdict(scenario)
    table["origin"] = [float(np.rad2deg(scenario.origin[0])), float(np.rad2deg(scenario.origin[1])), scenario.origin[2]]
    return table
