"""What can be simulated: scenarios as TOML files, and the function behind `sinan simulate`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from experiments.scenarios.loader import load_scenario, scenario_names
from sensors.effects import effect
from sensors.errors import InputError
from sensors.simulate import Present, simulate

__all__ = ["load_scenario", "parse_effect", "scenario_names", "simulate_to_folder"]

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
        raise InputError(where, "no `=`", "NAME=B0[,B1...][@T0[:T1]]")
    try:
        declaration = effect(name.strip())
    except KeyError as error:
        raise InputError(where, f"no effect `{name}`", str(error.args[0]).partition("; ")[2]) from None
    values, _, interval = rest.partition("@")
    beta = np.array(_numbers(where, values, ","))
    limits = _numbers(where, interval, ":") if interval else []
    if len(limits) > 2 or (len(limits) == 2 and limits[0] >= limits[1]):
        raise InputError(where, f"@{interval}", "@T0 or @T0:T1 with T0 < T1 [s]")
    family = name.split(".")[-1]
    if family in _NEEDS_INTERVAL and len(limits) < (2 if family == "transient" else 1):
        raise InputError(where, "no interval", f"{_NEEDS_INTERVAL[family]} [s] after the values")
    t0, t1 = (*limits, *(-np.inf, np.inf)[len(limits) :])
    if len(beta) != declaration.size:
        names = ", ".join(f"{p.name} [{p.unit}]" for p in declaration.parameters)
        raise InputError(where, f"{len(beta)} values", f"{declaration.size}: {names}")
    return Present(declaration, beta, t0, t1)


def _numbers(where: str, text: str, separator: str) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(separator)]
    except ValueError:
        raise InputError(where, repr(text), f"numbers with `{separator}` between") from None
    if not np.all(np.isfinite(numbers)):
        raise InputError(where, repr(text), "finite numbers")
    return numbers


def simulate_to_folder(
    scenario: str | Path, out: Path, effects: Sequence[str] = (), declare: bool = False, seed: int = 0
) -> Path:
    """What `sinan simulate` does: a plain recording with truth, and the answer beside the folder, never in it.

    Parameters
    ----------
    scenario : name or TOML file
    out : folder of the recording
    effects : as `parse_effect` reads them
    declare : write the effects into the recording
    seed : of the random numbers

    Returns
    -------
    the answer file, `OUT.answer.json`

    Raises
    ------
    InputError : no such scenario or effect, or one that does not fit
    """
    from sensors.formats.plain import write_recording

    present = [parse_effect(text) for text in effects]
    names = [entry.effect.name for entry in present]
    if len(set(names)) < len(names):
        raise InputError("--effect", f"{max(names, key=names.count)} twice", "each effect once")
    recording, truth = simulate(load_scenario(scenario), np.random.default_rng(seed), present, declare)
    out = Path(out)
    write_recording(recording, out, truth)
    answer = out.with_name(out.name + ".answer.json")
    entries = [
        {
            "name": entry.effect.name,
            "beta": entry.beta.tolist(),
            "unit": list(entry.effect.units),
            "interval": [_or_none(entry.t0), _or_none(entry.t1)],
        }
        for entry in present
    ]
    content = {"format": 1, "scenario": str(scenario), "seed": seed, "declared": declare, "effects": entries}
    answer.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return answer


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
