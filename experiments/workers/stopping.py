"""Ctrl-C, and the signal by which a system asks a command to end: what is finished is kept, and one line says so."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from threading import Timer
from types import FrameType
from typing import Any, NoReturn

_HEARD = (signal.SIGINT, signal.SIGTERM)
#: An exception that a library has swallowed is raised again after so long [s].
_AGAIN = 0.25
#: What is still at work after so long does not keep a stopped command from ending [s].
_PATIENCE = 0.7
#: What is done even by a command that ends at once.
AT_ONCE: list[Callable[[], None]] = []
#: The signal that asked.
_asked: int | None = None
#: Whether it waits, since something is done that is done in whole.
_waits = False


class Stopped(BaseException):
    """Somebody asked the command to stop.

    Parameters
    ----------
    number : of the signal
    how : how far it came, and how to go on
    """

    def __init__(self, number: int, how: str = "") -> None:
        self.number = number
        super().__init__(f"stopped{how}")


@contextmanager
def listening() -> Iterator[None]:
    """Work that ends with one line and `Stopped` where a signal asks for it, and at once where one asks again.

    A signal that whoever started the command has it ignore stays ignored.
    """
    default = (signal.SIG_DFL, signal.default_int_handler)
    before = {number: signal.signal(number, _stop) for number in _HEARD if signal.getsignal(number) in default}
    hook, sys.unraisablehook = sys.unraisablehook, _unraisable
    try:
        yield
    except BaseException as error:  # a library may have made another error of it
        if _asked is None:
            raise
        _leave(error if isinstance(error, Stopped) else Stopped(_asked))
    finally:
        sys.unraisablehook = hook
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def going_on(how: Callable[[], str]) -> Iterator[None]:
    """Work of which something is left when it is stopped.

    Parameters
    ----------
    how : called then; how far it came and how to go on, such as " after 3 of 20 flights: the same command goes on"
    """
    try:
        yield
    except BaseException as error:
        number = error.number if isinstance(error, Stopped) else _asked
        if number is None:
            raise
        raise Stopped(number, how()) from None


@contextmanager
def in_whole() -> Iterator[None]:
    """A moment that is not interrupted: a process of which half is started leaves words of Python's own behind."""
    global _waits
    _waits = True
    try:
        yield
    finally:
        _waits = False
        if _asked is not None:
            raise Stopped(_asked)


def _stop(number: int, frame: FrameType | None) -> None:
    global _asked
    if _asked is not None:
        os.write(2, b"sinan: stopped at once\n")
        for act in AT_ONCE:
            act()
        os._exit(128 + number)
    _asked = number
    if hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, _stop_again)
        signal.setitimer(signal.ITIMER_REAL, _AGAIN, _AGAIN)
    if not _waits:
        raise Stopped(number)


def _stop_again(number: int, frame: FrameType | None) -> None:
    """Raise it once more, unless it is on its way."""
    error = sys.exc_info()[1]
    while error is not None:
        if isinstance(error, Stopped):
            return
        error = error.__context__
    if _asked is not None and not _waits:
        raise Stopped(_asked)


def _unraisable(lost: Any) -> None:
    """Say nothing of a `Stopped` that was raised where it cannot be: it is raised again."""
    if not isinstance(lost.exc_value, Stopped):
        sys.__unraisablehook__(lost)


def _leave(stopped: Stopped) -> NoReturn:
    """End the command with its line, and the status by which a shell knows the signal.

    The interpreter and its libraries are not taken apart, which would take another half a second, and which those that
    were interrupted may not survive; what `multiprocessing` has in the system is given back.
    """
    for number in (*_HEARD, *([signal.SIGALRM] if hasattr(signal, "SIGALRM") else [])):
        signal.signal(number, signal.SIG_IGN)
    status = 128 + stopped.number
    end = Timer(_PATIENCE, os._exit, (status,))
    end.daemon = True
    end.start()
    sys.stderr.write(f"sinan: {stopped}\n")
    with suppress(OSError, ValueError):
        sys.stdout.flush()
    give_back = getattr(sys.modules.get("multiprocessing.util"), "_exit_function", None)
    if give_back is not None:
        give_back()
    os._exit(status)
