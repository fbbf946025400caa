"""The catalogue of effects: one file an effect, one line in `shipped.py`.

`effect("mag.current")` gives a declaration, `effects_for("flight", ("accel", "mag"))` the candidates. A file is read
when its effect is first asked for. Effects of one's own, which no file here declares, are those of `own.py`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.effects.own import own_effects
from sinan.sensors.effects.shipped import read, shipped_files
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion

__all__ = ["CATALOGUE", "Effect", "Parameter", "apply_effects", "effect", "effects_for"]

_STREAM_OF = {"motion": "level"}  # where the first part of a name is not the stream


class _Catalogue(Mapping[str, Effect]):
    """All effects by name; a file is read when its effect is first asked for."""

    def __getitem__(self, name: str) -> Effect:
        return effect(name)

    def __iter__(self) -> Iterator[str]:
        return iter(_names())

    def __len__(self) -> int:
        return len(_names())


CATALOGUE: Mapping[str, Effect] = _Catalogue()


def _names() -> tuple[str, ...]:
    return (*shipped_files(), *own_effects())


def effect(name: str) -> Effect:
    """The effect of that name.

    Raises
    ------
    KeyError : no such effect; names the nearest ones
    """
    shipped = shipped_files()
    if name in shipped:
        return read(*shipped[name])
    mine = own_effects()
    if name not in mine:
        from difflib import get_close_matches

        near = get_close_matches(name, _names(), n=3, cutoff=0.4) or _names()
        raise KeyError(f"no effect `{name}`; there are {', '.join(near)}")
    return mine[name]


def effects_for(kind: str, streams: Collection[str], localised: bool = False) -> tuple[Effect, ...]:
    """The effects that are candidates in a recording of a kind with certain streams.

    Parameters
    ----------
    kind : flight or poses (pseudoranges are effects of stream `pseudorange`)
    streams : sensors that the recording has, as `Effect.stream` names them (`level` where that pseudo-sensor is on)
    localised : also the time-localised families (step, transient, outliers), whose interval has to be searched
    """
    ours = [name for name in CATALOGUE if _STREAM_OF.get(name.split(".")[0], name.split(".")[0]) in streams]
    return tuple(e for e in map(effect, ours) if kind in e.kinds and (localised or not e.is_local))


def apply_effects(
    plain: FloatArray,
    effects: Mapping[str, FloatArray] | list[tuple[Effect, FloatArray]],
    motion: Motion,
    model: SensorModel,
) -> FloatArray:
    """The reading with several effects of one stream in it, each taken of the plain reading.

    reading = plain + sum (effect_i(plain) - plain); with `gps.latency` a lever arm is that of t - b too.

    Parameters
    ----------
    plain : (n, size) what the perfect sensor reads
    effects : beta by name, or pairs of an effect and its beta
    motion : at the instants of the readings
    model : of the sensor
    """
    pairs = [(effect(n), b) for n, b in effects.items()] if isinstance(effects, Mapping) else list(effects)
    late = next((float(np.asarray(b)[0]) for e, b in pairs if e.name == "gps.latency"), 0.0)
    reading = plain.copy()
    for entry, beta in pairs:
        if entry.name == "gps.lever_arm" and late != 0.0:
            reading += entry.change(plain, beta, motion.at(motion.t - late), model)
        else:
            reading += entry.change(plain, beta, motion, model)
    return reading
