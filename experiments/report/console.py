"""Progress on the terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from threading import Timer
from typing import TYPE_CHECKING

from sinan.sensors.errors import printable

if TYPE_CHECKING:
    from sinan.sensors.recording import Recording


def note(text: str) -> None:
    """What the user should know, on stderr."""
    sys.stderr.write(f"note: {printable(text)}\n")


def tell_notes(recording: Recording) -> None:
    """What the reader chose or left out, on stderr."""
    for text in recording.notes:
        note(text)


#: Work that is done by then needs no word [s].
_PATIENCE = 1.5


def first_run_note() -> str:
    """What a first run waits for: a remark where the filter's kernels are not compiled yet, else nothing."""
    from sinan.estimator.filter.compiled import is_compiled

    return "" if is_compiled() else " (first run: compiling, once, up to a minute)"


@cache
def tell_kernel_cache() -> None:
    """Where compiled kernels are kept, once, where that is not as usual and they are not there yet."""
    from sinan.estimator.filter.kernel_cache import kernel_cache

    kept, text = kernel_cache()
    if text and not kept:
        note(text)
    elif text:
        from sinan.estimator.filter.compiled import is_compiled

        if not is_compiled():
            note(text)


@contextmanager
def working(what: str, flies: bool = False) -> Iterator[None]:
    """On a terminal, a line on stderr with the time that passes, once the work takes longer than a moment.

    Parameters
    ----------
    flies : whether the work runs the compiled filter
    """
    if flies:
        tell_kernel_cache()
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    text = what + (first_run_note() if flies else "")
    line = Progress(
        SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=Console(stderr=True),
        transient=True,
    )  # fmt: skip
    line.add_task(text, total=None)
    begin = Timer(_PATIENCE, line.start)
    begin.daemon = True
    begin.start()
    try:
        yield
    finally:
        begin.cancel()
        begin.join()
        line.stop()


@contextmanager
def progress(what: str, flies: bool = False) -> Iterator[Callable[[str, int, int], None]]:
    """On a terminal, a progress line on stderr; the callable says what is being done, how much of how much is done.

    Parameters
    ----------
    flies : whether the work runs the compiled filter
    """
    if flies:
        tell_kernel_cache()
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

    columns = [
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    ]
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        waits = first_run_note() if flies and sys.stderr.isatty() else ""
        task = bar.add_task(what + waits, total=None)

        def step(description: str, done: int, total: int) -> None:
            bar.update(
                task, completed=done, total=total, description=f"{what} {description}".strip() + ("" if done else waits)
            )

        yield step
