"""Progress on the terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sensors.recording import Recording


def note(text: str) -> None:
    """What the user should know, on stderr."""
    sys.stderr.write(f"note: {text}\n")


def tell_notes(recording: Recording) -> None:
    """What the reader chose or left out, on stderr."""
    for text in recording.notes:
        note(text)


@contextmanager
def progress(what: str) -> Iterator[Callable[[str, int, int], None]]:
    """A progress line on stderr; the callable says what is being done, how much is done, and how much there is."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

    columns = [
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    ]
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=None)

        def step(description: str, done: int, total: int) -> None:
            bar.update(task, completed=done, total=total, description=f"{what} {description}".strip())

        yield step
