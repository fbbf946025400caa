"""A journal as text, second by second, and what changed between two."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sinan.estimator.filter.events import GATED
from sinan.estimator.filter.journal import Journal
from sinan.experiments.answers.estimates import Estimate

HEAD = """# A journal of sinan, format 1: what the filter saw and believed, in steps of {every:g} s. Reviewed as a diff.
# SECOND sensor NAME used N refused N nis MEAN nu MEAN...: readings whose stamps lie in the step, the mean of
#   their NIS a degree of freedom, and of each component of their innovations in units of the sigma expected
# SECOND state NAME VALUE... sigma VALUE...: the state at the end of the step (SI; attitude: quaternion, and rad)"""


@dataclass(frozen=True)
class Bounds:
    """How far a journal may be from a kept one.

    The defaults let the last bits of another processor or library pass, and nothing that a student would see.

    Attributes
    ----------
    innovation : of a mean innovation, in sigma
    nis : of a mean NIS a degree of freedom
    state : of a state, in units of its kept sigma
    sigma : of a sigma, as a share of it
    """

    innovation: float = 1e-3
    nis: float = 1e-3
    state: float = 1e-3
    sigma: float = 1e-3


#: Row of a journal's text: second, kind, name; values by their word.
_Rows = dict[tuple[float, str, str], dict[str, list[float]]]


@dataclass(frozen=True)
class _Change:
    second: float
    kind: str
    name: str
    word: str
    before: float
    after: float
    excess: float  # difference over what is allowed; of counts, which may not differ, the difference


def journal_text(run: Estimate | Journal, every: float = 1.0) -> str:
    """A journal as text, to be kept and reviewed as a diff.

    Parameters
    ----------
    run : of `sinan.estimate`, or its journal
    every : length of a step [s]
    """
    journal = run.journal if isinstance(run, Estimate) else run
    lines = [HEAD.format(every=every)]
    steps = int(np.ceil((journal.t_end - journal.t_start) / every))
    for k in range(steps):
        begin, end = journal.t_start + k * every, journal.t_start + (k + 1) * every
        last = k == steps - 1
        lines += _sensors(journal, begin, np.inf if last else end, k * every)
        lines += _states(journal, journal.t_end if last else end, k * every)
    return "\n".join(lines) + "\n"


def _sensors(journal: Journal, begin: float, end: float, second: float) -> Iterator[str]:
    """A line a sensor that has readings in begin <= t < end."""
    for s, name in enumerate(journal.sensors):
        mine = (journal.sensor == s) & (journal.t >= begin) & (journal.t < end)
        if not np.any(mine):
            continue
        used = np.flatnonzero(mine & journal.accepted)
        refused = int(np.sum(mine & (journal.status == GATED)))
        head = f"{second:g} sensor {name} used {len(used)} refused {refused}"
        if not len(used):
            yield head
            continue
        size = int(journal.dof[used[0]])
        rows, elements = np.arange(size), np.arange(size) * (size + 1)
        ratio = journal.nu[journal.row[used][:, None] + rows]
        ratio = ratio / np.sqrt(journal.S[journal.S_row[used][:, None] + elements])
        nis = float(np.mean(journal.nis[used])) / size
        yield f"{head} nis {nis:.4f} nu {' '.join(f'{v:+.4f}' for v in np.mean(ratio, axis=0))}"


def _states(journal: Journal, end: float, second: float) -> Iterator[str]:
    """A line a block of states, at the last IMU sample before or at `end`."""
    row = max(int(np.searchsorted(journal.imu_t, end, side="right")) - 1, 0)
    x, sigma, layout = journal.imu_x[row], np.sqrt(journal.imu_var[row]), journal.model.layout
    for name in layout.names:
        values = " ".join(f"{v:+.8g}" for v in x[layout.nominal(name)])
        yield f"{second:g} state {name} {values} sigma {' '.join(f'{v:.5g}' for v in sigma[layout.slice(name)])}"


def assert_journal_equal(
    run: Estimate | Journal | str, kept: str | Path, bounds: Bounds | None = None, every: float = 1.0
) -> None:
    """Assert that a journal is the kept one, within bounds.

    Parameters
    ----------
    run : of `sinan.estimate`, its journal, or a text of `journal_text`
    kept : the text, or the file that holds it
    bounds : what may differ; default: `Bounds`
    every : length of a step [s], as the text was made with

    Raises
    ------
    AssertionError : says by sensor and state from which second on, how often and how far it differs
    """
    text = run if isinstance(run, str) else journal_text(run, every)
    where = f"{kept}: " if isinstance(kept, Path) else ""
    before = kept.read_text(encoding="utf-8") if isinstance(kept, Path) else kept
    said = changes(before, text, bounds or Bounds())
    if said:
        raise AssertionError("\n".join([f"{where}the journal has changed", *(f"  {line}" for line in said)]))


def changes(before: str, after: str, bounds: Bounds) -> list[str]:
    """What changed between two texts, a line a sensor and a state; empty: nothing beyond the bounds."""
    old, new = _parsed(before), _parsed(after)
    found = [change for key in old for change in _compared(key, old[key], new[key], bounds)] if _alike(old, new) else []
    lines = _unlike(old, new)
    groups: dict[tuple[str, str], list[_Change]] = {}
    for change in found:
        groups.setdefault((change.kind, change.name), []).append(change)
    return lines + [_in_words(name, group) for (_, name), group in groups.items()]


def _alike(old: _Rows, new: _Rows) -> bool:
    return all(key in new for key in old)


def _unlike(old: _Rows, new: _Rows) -> list[str]:
    """Sensors and states that are in one of the two alone, with the second at which that begins."""
    lines = []
    for some, others, word in ((old, new, "gone"), (new, old, "new")):
        missing: dict[tuple[str, str], float] = {}
        for second, kind, name in some:
            if (second, kind, name) not in others:
                missing.setdefault((kind, name), second)
        lines += [f"{name} ({kind}): {word} from {second:g} s on" for (kind, name), second in missing.items()]
    return lines


def _in_words(name: str, group: list[_Change]) -> str:
    """One sensor or state: since when, in how many steps, and the worst of them."""
    worst = max(group, key=lambda change: change.excess)
    seconds = sorted({change.second for change in group})
    often = f"at {seconds[0]:g} s" if len(seconds) == 1 else f"from {seconds[0]:g} s on, in {len(seconds)} steps"
    said = f"{name}: {often}; most at {worst.second:g} s: {worst.word} {worst.before:.6g} -> {worst.after:.6g}"
    counted = worst.word in ("used", "refused") or not np.isfinite(worst.excess)
    return said if counted else f"{said}, {worst.excess:.3g} times what is allowed"


def _parsed(text: str) -> _Rows:
    rows: _Rows = {}
    for number, line in enumerate(text.splitlines(), 1):
        if not line or line.startswith("#"):
            continue
        second, kind, name, *rest = line.split()
        values: dict[str, list[float]] = {}
        word = "value" if kind == "state" else ""
        try:
            for part in rest:
                if part in ("used", "refused", "nis", "nu", "sigma"):
                    word = part
                else:
                    values.setdefault(word, []).append(float(part))
            rows[float(second), kind, name] = values
        except ValueError:
            raise AssertionError(f"line {number} of the kept journal is damaged: {line}") from None
    return rows


def _compared(
    key: tuple[float, str, str], old: dict[str, list[float]], new: dict[str, list[float]], bounds: Bounds
) -> Iterator[_Change]:
    """What of one row lies beyond its bound."""
    for word, values in old.items():
        others = new.get(word, [])
        if len(others) != len(values):
            yield _Change(*key, f"{word}: numbers", float(len(values)), float(len(others)), np.inf)
            continue
        for before, after, allowed in zip(values, others, _allowed(word, old, bounds), strict=False):
            difference = abs(after - before)
            if not difference <= allowed:
                excess = difference / allowed if allowed > 0.0 else difference
                yield _Change(*key, word, before, after, excess if np.isfinite(excess) else np.inf)


def _allowed(word: str, row: dict[str, list[float]], bounds: Bounds) -> Iterable[float]:
    """What each value of a row may differ by."""
    values = row[word]
    if word == "nu":
        return [bounds.innovation] * len(values)
    if word == "nis":
        return [bounds.nis]
    if word == "sigma":
        return [bounds.sigma * value for value in values]
    if word == "value":
        sigma = row["sigma"]
        if len(values) == len(sigma) + 1:  # the quaternion: half the angle
            return [0.5 * bounds.state * max(sigma)] * len(values)
        return [bounds.state * one for one in sigma]
    return [0.0] * len(values)  # counts
