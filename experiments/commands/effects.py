"""`sinan effects`: the catalogue, or one effect of it, as text."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby
from textwrap import fill

from sinan.experiments.effects_page import declared_in, facts
from sinan.sensors.effects import CATALOGUE, Effect
from sinan.sensors.errors import InputError

WIDTH = 100  # characters a line


def run(name: str | None) -> str:
    """The list of all effects, or what is known of one, or of one stream's.

    Raises
    ------
    InputError : neither an effect nor a stream; names the nearest
    """
    if name is None:
        return listing(CATALOGUE.values())
    if name in CATALOGUE:
        return described(CATALOGUE[name])
    ours = [effect for effect in CATALOGUE.values() if effect.name.split(".")[0] == name]
    if ours:
        return listing(ours)
    from difflib import get_close_matches

    near = get_close_matches(name, list(CATALOGUE), n=3, cutoff=0.4)
    raise InputError("effects", f"no effect `{name}`", ", ".join(near) or "a name of `sinan effects`")


def listing(effects: Iterable[Effect]) -> str:
    """One line an effect, by sensor."""
    blocks = []
    by_sensor = sorted(effects, key=lambda effect: effect.name.split(".")[0])
    for _, group in groupby(by_sensor, key=lambda effect: effect.name.split(".")[0]):
        blocks.append("\n".join(f"{effect.name:28} {effect.summary}" for effect in group))
    return "\n\n".join(blocks)


def described(effect: Effect) -> str:
    """Everything that the declaration says."""
    lines = [effect.name, fill(f"{effect.summary} {effect.physics}", WIDTH), ""]
    for label, text in [*facts(effect), ("file", declared_in(effect))]:
        plain = text.replace("`", "")
        lines.append(fill(plain, WIDTH, initial_indent=f"{label:14}", subsequent_indent=" " * 14))
    return "\n".join(lines)
