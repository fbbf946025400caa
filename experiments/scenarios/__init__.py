"""What can be simulated: scenarios as TOML files, and the function behind `sinan simulate`."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from sinan.experiments.scenarios.loader import load_scenario, scenario_names
from sinan.sensors.arrays import FloatArray, finite_or_none
from sinan.sensors.effects import CATALOGUE, Effect, effect
from sinan.sensors.effects.declaration import IMPLAUSIBLE
from sinan.sensors.errors import InputError
from sinan.sensors.files import resolved, together, write_text
from sinan.sensors.recording import Recording
from sinan.sensors.scenario import Scenario
from sinan.sensors.simulate import Present, simulate

__all__ = [
    "Effects", "interval_note", "load_scenario", "parse_effect", "present_of", "scenario_names", "simulate_to_folder",
    "simulated", "size_note", "with_sensors",
]  # fmt: skip

#: Effects by name with their parameters, or in the command line's form: `mag.current=0.003,0,0@20:30`.
Effects = Mapping[str, Sequence[float] | FloatArray | float] | Sequence[str]
#: The scenario that has every sensor that a flight may be given.
MORE_SENSORS = "_camera"
#: Effects that cannot be said without the interval in which they act
_NEEDS_INTERVAL = {"step": "@T0", "transient": "@T0:T1"}


def parse_effect(text: str) -> Present:
    """`NAME=B0[,B1...][@T0[:T1]]` as an effect that is in the simulated world.

    `mag.current=0.01,0,0` acts all the time, `mag.step=0.05,0,0@20` from 20 s on, `gps.transient=3,0,0@20:30` between.

    Raises
    ------
    InputError : says which part does not fit
    """
    where = f"--effect {text}"
    name, equals, rest = text.partition("=")
    if not equals:
        typed = re.split(r"[:\s,@]", text.strip(), maxsplit=1)
        mark = text.strip()[len(typed[0]) :][:1]
        found = ("no `=`" if not mark else "a blank" if mark.isspace() else f"`{mark}`") + " after the name"
        example = _example(_known(where, typed[0]))
        raise InputError(where, found, f"`=`, as in {example} (NAME=B0[,B1...][@T0[:T1]])")
    declaration = _known(where, name.strip())
    values, at, interval = rest.partition("@")
    beta = np.array(_numbers(where, values, ","))
    if at and not interval:
        raise InputError(where, "nothing after `@`", "@T0 or @T0:T1 [s], or no `@`")
    limits = _numbers(where, interval, ":") if at else []
    if len(limits) > 2 or (len(limits) == 2 and limits[0] >= limits[1]):
        raise InputError(where, f"@{interval}", "@T0 or @T0:T1 with T0 < T1 [s]")
    family = name.split(".")[-1]
    if family in _NEEDS_INTERVAL and len(limits) < (2 if family == "transient" else 1):
        raise InputError(where, "no interval", f"{_NEEDS_INTERVAL[family]} [s] after the values")
    t0, t1 = (*limits, *(-np.inf, np.inf)[len(limits) :])
    if len(beta) != declaration.size:
        names = ", ".join(f"{p.name} [{p.unit}]" for p in declaration.parameters)
        found = f"{len(beta)} value{'s' if len(beta) > 1 else ''}"
        raise InputError(where, found, f"{declaration.size}: {names}, such as {_example(declaration)}")
    return Present(declaration, beta, t0, t1)


def _known(where: str, name: str) -> Effect:
    """The effect of that name; else an error that names the nearest ones."""
    try:
        return effect(name)
    except KeyError:
        near = get_close_matches(name, CATALOGUE, n=3, cutoff=0.6)
        near += [] if near else [known for known in CATALOGUE if known.startswith(name.split(".")[0] + ".")]
        expected = ", or ".join(near[:3]) if near else "a name such as mag.current or gps.latency"
        raise InputError(where, f"no effect `{name}`", f"{expected} (`sinan effects` lists all)") from None


def _example(declaration: Effect) -> str:
    """How an effect is written: its first parameter at a plausible size."""
    family = declaration.name.split(".")[-1]
    interval = {"step": "@20", "transient": "@20:30"}.get(family, "")
    values = [f"{declaration.plausible[0]:g}", *["0"] * (declaration.size - 1)]
    return f"{declaration.name}={','.join(values)}{interval}"


def interval_note(present: Present) -> str:
    """What to know of an effect that acts for a while though its model in the catalogue acts all the time; or ""."""
    if present.effect.localised is not None or not np.isfinite([present.t0, present.t1]).any():
        return ""
    stream = present.effect.stream
    near = [name for name in (f"{stream}.step", f"{stream}.transient") if name in CATALOGUE]
    return (
        f"{present.effect.name} is no time-localised effect: with an interval it is in the data only then, and every "
        f"model of it expects it all the time; localised are {' and '.join(near) or 'steps and transients'}"
    )


def size_note(present: Present, field: float = 1.0) -> str:
    """What to know of an effect that is far larger than those of instruments that are sold; or "".

    Parameters
    ----------
    field : norm of the magnetic field, with which some parameters go
    """
    plausible = present.effect.plausible * (field if present.effect.in_field_units else 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.nan_to_num(np.abs(present.beta) / plausible, nan=0.0)
    k = int(np.argmax(ratio))
    if ratio[k] <= IMPLAUSIBLE:
        return ""
    parameter = present.effect.parameters[k]
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    return (
        f"{present.effect.name}: {parameter.name} = {present.beta[k]:g}{unit} is {ratio[k]:.3g} times the plausible "
        f"{plausible[k]:g}{unit} of instruments that are sold; beyond {IMPLAUSIBLE:.0f} times the tracer does not give "
        "an error that name"
    )


def _numbers(where: str, text: str, separator: str) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(separator)]
    except ValueError:
        raise InputError(where, repr(text), f"numbers with `{separator}` between") from None
    if not np.all(np.isfinite(numbers)):
        raise InputError(where, repr(text), "finite numbers")
    return numbers


def present_of(effects: Effects) -> list[Present]:
    """Effects as they are in a simulated world.

    Raises
    ------
    InputError : an unknown name, twice the same, a number of parameters that does not fit
    """
    if isinstance(effects, Mapping):
        listed = {name: np.atleast_1d(np.asarray(beta, dtype=np.float64)) for name, beta in effects.items()}
        texts: Sequence[str] = [f"{name}={','.join(map(repr, beta.tolist()))}" for name, beta in listed.items()]
    else:
        texts = [effects] if isinstance(effects, str) else effects
    present = [parse_effect(text) for text in texts]
    names = [entry.effect.name for entry in present]
    if len(set(names)) < len(names):
        raise InputError("--effect", f"{max(names, key=names.count)} twice", "each effect once")
    return present


def simulated(
    scenario: str | Path | Scenario, effects: Effects = (), seed: int = 0, declare: bool = False
) -> tuple[Recording, list[Present]]:
    """A scenario simulated with effects, as `simulate_to_folder` and `sinan.simulate` do; and the effects."""
    flown = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
    present = present_of(effects)
    return simulate(flown, np.random.default_rng(seed), present, declare)[0], present


def with_sensors(scenario: Scenario, names: Sequence[str]) -> Scenario:
    """The scenario with these sensors alone; one that it has not is that of `MORE_SENSORS`.

    Raises
    ------
    InputError : an unknown sensor, a scenario of poses that is to have one more, or a gyroscope without accelerometer
    """
    more = load_scenario(MORE_SENSORS).sensors
    known = {**more, **scenario.sensors}
    for name in names:
        if name not in known:
            raise InputError("--sensors", f"no sensor `{name}`", "some of " + ", ".join(known))
        if scenario.kind != "flight" and name not in scenario.sensors:
            raise InputError("--sensors", f"`{name}` in poses", "some of " + ", ".join(scenario.sensors))
    if "gyro" in names and "accel" not in names:
        raise InputError("--sensors", "gyro without accel", "both: they share the clock of the accelerometer")
    return scenario.replace(sensors={name: known[name] for name in known if name in names})


def simulate_to_folder(
    scenario: str | Path,
    out: Path,
    effects: Sequence[str] = (),
    declare: bool = False,
    seed: int = 0,
    force: bool = False,
    sensors: Sequence[str] = (),
    tell: Callable[[str], None] = lambda note: None,
) -> Path:
    """What `sinan simulate` does: a plain recording with truth, and the answer beside the folder, never in it.

    Parameters
    ----------
    scenario : name or TOML file
    out : folder of the recording
    effects : as `parse_effect` reads them
    declare : write the effects into the recording
    seed : of the random numbers
    force : replace a recording that was written before
    sensors : as of `with_sensors`; none: those of the scenario
    tell : called with what the user should know

    Returns
    -------
    the answer file, `OUT.answer.json`

    Raises
    ------
    InputError : no such scenario or effect, or one that does not fit; the folder or the answer is in use
    """
    from sinan.sensors.formats.plain import require_free, write_recording

    out = Path(out)
    answer = answer_file(out)
    require_free(out, force)
    _require_free_answer(answer, force)
    flown = load_scenario(scenario)
    flown = with_sensors(flown, sensors) if sensors else flown
    recording, present = simulated(flown, effects, seed, declare)
    for note in filter(None, map(interval_note, present)):
        tell(note)
    for name in () if flown.static else flown.sensors:
        if name not in ("accel", "gyro") and name not in recording.streams:
            tell(f"{name}: no reading arrives, all are out of range, lost or in a drop-out: the recording has none")
    m_n = recording.environment.magnetic_field
    field = 1.0 if m_n is None else float(np.linalg.norm(m_n))
    for note in filter(None, (size_note(entry, field) for entry in present)):
        tell(note)
    entries = [
        {
            "name": entry.effect.name,
            "beta": entry.beta.tolist(),
            "unit": list(entry.effect.units),
            "interval": [finite_or_none(entry.t0), finite_or_none(entry.t1)],
        }
        for entry in present
    ]
    content = {"format": 1, "scenario": str(scenario), "seed": seed, "declared": declare, "effects": entries}
    with together():
        write_recording(recording, out)
        write_text(answer, json.dumps(content, indent=1) + "\n")
    return answer


def answer_file(out: Path) -> Path:
    """Where the answer of a recording is: beside its folder."""
    out = out if out.name.strip(".") else resolved(out)
    return out.with_name(out.name + ".answer.json")


def _require_free_answer(answer: Path, force: bool) -> None:
    """Raise unless an answer may be written: there is none, or it is to be replaced, and is one.

    Raises
    ------
    InputError : a link; something else; an answer that may not be replaced
    """
    if answer.is_symlink():
        raise InputError(answer, "a link", "another folder: the answer is written beside it")
    if not answer.exists():
        return
    try:
        found = json.loads(answer.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        found = None
    if not (isinstance(found, dict) and {"format", "effects"} <= set(found)):
        raise InputError(answer, "no answer of a simulation", "another folder: the answer is written beside it")
    if not force:
        raise InputError(answer, "an answer that was written before", "another folder, or --force to replace it")
