"""The manoeuvre that would decide between effects that one recording cannot tell apart.

The table `separation.json` has, for every pair of effects that look alike in some scenario of the catalogue, their
squared canonical correlation r^2 in each scenario; `python -m sinan.experiments.separation.study` makes it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from sinan.sensors.effects import effect

TABLE = Path(__file__).with_name("separation.json")
#: r^2 above which two effects are one class. The right name leads the wrong one by lambda (1 - r^2) in 2 log L, and
#: models within 10 count as confused (`score.CONFUSED`): at 0.8 that lead is reached at lambda = 50, an effect 1.3
#: times as large as one that is just detectable (lambda = 30); above 0.8 also effects that are plainly there stay
#: confused, at 0.98 up to lambda = 500.
CLASS_BOUND = 0.8
#: A scenario can decide where it would detect each effect, the other one allowed for, at its plausible size: 1, since
#: the unit of a size is that.
SEEN_FROM = 1.0
#: Among scenarios whose r^2 is this close to the lowest the one that sees both effects best is the better advice: what
#: tells the two apart is lambda (1 - r^2), of which a tenth is lost at the most where r^2 is next to zero.
AS_GOOD = 0.1


@dataclass(frozen=True)
class Scene:
    """One scenario as the table was made with it.

    Attributes
    ----------
    key : its row in the table: the scenario's name, and how it was changed
    scenario, kind, summary, sensors : of the scenario that was flown or turned
    advised : whether it can be asked for: no shaken vehicle, no instrument beyond the usual ones
    sees : smallest detectable size of each effect that shows in it, in plausible sizes, median over the components
    """

    key: str
    scenario: str
    kind: str
    summary: str
    sensors: tuple[str, ...]
    advised: bool
    sees: Mapping[str, float]

    @property
    def advice(self) -> str:
        """What to do, in words: fly or record it."""
        verb = "fly" if self.kind == "flight" and "gps" in self.sensors else "record"
        changed = self.key.removeprefix(self.scenario)
        acronym = self.summary[1:2].isupper()
        summary = self.summary if acronym else self.summary[:1].lower() + self.summary[1:]
        return f"{verb} {self.scenario}{changed} ({summary})"


@dataclass(frozen=True)
class Look:
    """How alike two effects look in one scenario.

    Attributes
    ----------
    scene : the scenario
    r2 : squared canonical correlation
    first_from, second_from : smallest detectable size of each, given the other, in plausible sizes; None: not seen
    """

    scene: Scene
    r2: float
    first_from: float | None
    second_from: float | None

    @property
    def decides(self) -> bool:
        """Whether the scenario can be asked for and tells the two apart where both have their plausible size."""
        return self.scene.advised and self.r2 <= CLASS_BOUND and self.sees_both_from <= SEEN_FROM

    @property
    def sees_both_from(self) -> float:
        """The larger of the two detectable sizes."""
        return max(float("inf") if size is None else size for size in (self.first_from, self.second_from))

    @property
    def swapped(self) -> Look:
        """The same of the pair in the other order."""
        return Look(self.scene, self.r2, self.second_from, self.first_from)


@cache
def scenes() -> dict[str, Scene]:
    """The scenarios of the table."""
    table = json.loads(TABLE.read_text(encoding="utf-8"))
    return {
        key: Scene(key, s["scenario"], s["kind"], s["summary"], tuple(s["sensors"]), s["advised"], s["sees"])
        for key, s in table["scenarios"].items()
    }


@cache
def alike() -> dict[tuple[str, str], tuple[Look, ...]]:
    """The pairs above `CLASS_BOUND` in some scenario, names in order of the alphabet, and how they look in each."""
    table = json.loads(TABLE.read_text(encoding="utf-8"))
    return {
        (pair["effects"][0], pair["effects"][1]): tuple(Look(scenes()[key], *v) for key, v in pair["in"].items())
        for pair in table["pairs"]
    }


def looks(first: str, other: str) -> tuple[Look, ...]:
    """How alike two effects look in every scenario that sees both; empty where they are nowhere above the bound."""
    found = alike().get((min(first, other), max(first, other)), ())
    return found if first < other else tuple(look.swapped for look in found)


def deciding(first: str, *rivals: str) -> tuple[Look, ...]:
    """How `first` looks compared with each rival in the scenario that tells it best from all of them; empty: none does.

    The best has the lowest r^2 or one `AS_GOOD`, and of these sees all effects from the smallest sizes on.
    """
    by_rival = [{look.scene.key: look for look in looks(first, rival) if look.decides} for rival in rivals]
    common = [tuple(found[key] for found in by_rival) for key in by_rival[0] if all(key in f for f in by_rival)]
    if not common:
        return ()
    lowest = min(max(look.r2 for look in found) for found in common)
    good = [found for found in common if max(look.r2 for look in found) <= lowest + AS_GOOD]
    return min(good, key=lambda found: max(look.sees_both_from for look in found))


def apart(first: str, other: str) -> tuple[Scene, str] | None:
    """The scenario that shows one of the two best and the other not at all, and the name of the one it shows."""
    shown = [
        (scene.sees[name], scene, name)
        for scene in scenes().values()
        for name, hidden in ((first, other), (other, first))
        if scene.advised and scene.sees.get(name, SEEN_FROM) < SEEN_FROM and hidden not in scene.sees
    ]
    _, scene, name = min(shown, key=lambda found: found[0], default=(0.0, None, ""))
    return None if scene is None else (scene, name)


def separating_manoeuvre(first: str, others: Sequence[str]) -> str:
    """The sentence of an ambiguous verdict: what to fly or record next, and why it would decide.

    A scenario that tells `first` from all `others` goes before one for each. Where no scenario does, the
    declaration of `first` says what would help (`Effect.separates`).

    Parameters
    ----------
    first : the effect that was named
    others : those that it is confused with
    """
    rivals = [name for name in dict.fromkeys(others) if name != first]
    if not rivals:
        return ""
    return _for_all(first, rivals) or "; ".join(dict.fromkeys(_for_one(first, rival) for rival in rivals))


def _for_all(first: str, rivals: Sequence[str]) -> str:
    """The scenario that tells `first` from all rivals; empty where there is none."""
    found = deciding(first, *rivals)
    if not found:
        return ""
    listed = ", ".join(
        f"{in_digits(look.r2)} with {rival} instead of up to {in_digits(most_alike(first, rival).r2)}"
        for rival, look in zip(rivals, found, strict=True)
    )
    return f"{found[0].scene.advice}, where {first} has a squared correlation of {listed}"


def _for_one(first: str, rival: str) -> str:
    if deciding(first, rival):
        return _for_all(first, [rival])
    if not looks(first, rival):
        return _not_alike(first, rival)
    found = apart(first, rival)
    if found is None:
        return effect(first).separates
    scene, shown = found
    hidden = rival if shown == first else first
    return f"{scene.advice}, where {shown} shows from {scene.sees[shown]:.2g} of its plausible size on and {hidden} not"


def _not_alike(first: str, rival: str) -> str:
    """Two that every scenario tells apart: more of what shows them."""
    unseen = float("inf")
    together = [
        s
        for s in scenes().values()
        if s.advised and max(s.sees.get(first, unseen), s.sees.get(rival, unseen)) <= SEEN_FROM
    ]
    if not together:
        return effect(first).separates
    scene = min(together, key=lambda s: max(s.sees[first], s.sees[rival]))
    return f"{scene.advice}: {first} and {rival} have a squared correlation below {CLASS_BOUND:g} in every scenario"


def most_alike(first: str, other: str) -> Look:
    """The scenario in which two effects of the table look most alike."""
    return max(looks(first, other), key=lambda look: look.r2)


def in_digits(r2: float) -> str:
    """Two digits that round neither to zero nor to one: 0.9997 -> 0.9997."""
    if r2 < 0.005:
        return "less than 0.01"
    return f"{r2:.2f}" if r2 < 0.995 else f"{min(r2, 0.9999):.4f}"
