"""What a capture shows while it goes on: a table on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from sinan.sensors.errors import printable

if TYPE_CHECKING:
    from rich.console import Group

    from sinan.experiments.capture.session import Session

#: How often the table is drawn, and a line is written where there is no terminal [s].
_DRAWN, _LINE = 0.25, 5.0
#: Rates of streams are those of the last seconds [s].
_SPAN = 3.0


class Rates:
    """Rows a second of each stream."""

    def __init__(self) -> None:
        self._seen: list[tuple[float, dict[str, int]]] = []

    def now(self, rows: dict[str, int]) -> dict[str, float]:
        """Rates over the last seconds [1/s], of how many rows there are by now."""
        t = time.monotonic()
        self._seen = [one for one in self._seen if one[0] > t - _SPAN - _DRAWN] + [(t, dict(rows))]
        begin, before = self._seen[0]
        return {name: (n - before.get(name, 0)) / max(t - begin, _DRAWN) for name, n in rows.items()}


def status_line(session: Session, rates: dict[str, float]) -> str:
    """How it stands, in a line."""
    parts = [", ".join(f"{name} {rate:.1f}/s" for name, rate in rates.items()) or "nothing yet"]
    watch = session.poses or session.faces
    parts += [watch.line] if watch is not None else []
    parts += [f"lost {share_lost(session)}"] if session.vehicle.lost else []
    missing = session.missing(time.monotonic())
    parts += [f"missing: {'; '.join(missing)}"] if missing else []
    return f"{session.elapsed:6.1f} s  " + "; ".join(parts)


def share_lost(session: Session) -> str:
    """Messages that did not come, by their numbers."""
    lost, received = session.vehicle.lost, session.vehicle.received
    return f"{lost} messages ({100.0 * lost / max(lost + received, 1):.1f} %)"


@contextmanager
def shown() -> Iterator[tuple[Callable[[str], None], Callable[[Session], None]]]:
    """What is told of events, and what is called several times a second."""
    if not sys.stdout.isatty():
        yield _say, _Lines()
        return
    from rich.console import Console
    from rich.live import Live

    console = Console(highlight=False)
    with Live(console=console, auto_refresh=False, transient=True) as live:
        yield lambda text: console.print(printable(text), markup=False), _Drawn(live.update)


def _say(text: str) -> None:
    sys.stdout.write(f"{printable(text)}\n")
    sys.stdout.flush()


class _Lines:
    """A line now and then."""

    def __init__(self) -> None:
        self._rates, self._next = Rates(), time.monotonic() + _LINE

    def __call__(self, session: Session) -> None:
        rates = self._rates.now(session.recording.rows)
        if time.monotonic() >= self._next:
            self._next = time.monotonic() + _LINE
            _say(status_line(session, rates))


class _Drawn:
    """A table on the terminal."""

    def __init__(self, update: Callable[..., None]) -> None:
        self._rates, self._update, self._next = Rates(), update, 0.0

    def __call__(self, session: Session) -> None:
        if time.monotonic() >= self._next:
            self._next = time.monotonic() + _DRAWN
            self._update(_table(session, self._rates.now(session.recording.rows)), refresh=True)


def _table(session: Session, rates: dict[str, float]) -> Group:
    """Streams, rates, rows, how old the newest is; beneath, what is missing and what is wanted."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    title = f"{session.vehicle.title}, {session.elapsed:.0f} s; Ctrl-C ends it well"
    table = Table()
    table.add_column("stream")
    for name in ("rate [1/s]", "rows", "newest [s ago]"):
        table.add_column(name, justify="right")
    recording = session.recording
    for name, rate in rates.items():
        age = max(session.elapsed - recording.last[name], 0.0)
        table.add_row(name, f"{rate:.1f}", str(recording.rows[name]), f"{age:.1f}")
    lines = []
    watch = session.poses or session.faces
    lines += [watch.line] if watch is not None else []
    lines += session.faces.drawing if session.faces is not None else []
    lines += [f"lost: {share_lost(session)}"] if session.vehicle.lost else []
    lines += [f"missing: {text}" for text in session.missing(time.monotonic())]
    return Group(Text(title, style="bold"), table, Text(printable("\n".join(lines), keep="\n")))
