"""Each task in a process of its own with limits: one that never ends, takes all memory or dies harms no other."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess, current_process
from pathlib import Path
from threading import Lock
from typing import TypeVar, cast

from sinan.experiments.workers.processes import PATIENCE, begin, context, end_fork_server, own_files
from sinan.experiments.workers.stopping import in_whole

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Limits:
    """What one task may take.

    Attributes
    ----------
    seconds : of time, whoever else is at work on the machine
    memory : bytes that it may ask for beyond what it begins with; on Linux alone
    """

    seconds: float = 900.0
    memory: int = 4 * 2**30


class Ended(Enum):
    """Why there is no result."""

    LATE = "it took longer than it may"
    DIED = "its process was killed"


#: What a process says when it begins. Until then it may load, for so long [s].
_BEGINS = "begins"
_LOADING = 60.0


@dataclass
class _Running:
    task: int
    process: BaseProcess
    until: float


#: Of the tables of `multiprocessing`, where several threads (of a Dask worker) start processes.
_tables = Lock()


def each_alone(
    work: Callable[[Task], Result],
    tasks: Sequence[Task],
    workers: int,
    limits: Limits,
    done: Callable[[Task, Result | Ended], None],
    loaded: str,
) -> None:
    """Do each task in a process that is killed when its time is over.

    Parameters
    ----------
    work : done in a process, of one task; what it raises is raised here
    workers : processes at a time
    done : called here with each task and its result, in the order in which they get done
    loaded : module that is loaded once, for all processes
    """
    left = list(range(len(tasks)))[::-1]
    with _running() as running:
        while left or running:
            while left and len(running) < workers:
                number = left.pop()
                _start(running, number, limits, loaded, work, tasks[number])
            for end in _asking(running):
                answer = _received(end) if end.poll() else Ended.LATE
                if answer == _BEGINS:
                    running[end].until = time.monotonic() + limits.seconds
                    continue
                number = _end(running, end)
                if isinstance(answer, BaseException):
                    raise answer
                done(tasks[number], cast("Result | Ended", answer))


def _asking(running: Mapping[Connection, _Running]) -> list[Connection]:
    """Those that say something, have died, or are late; one of them is waited for."""
    soon = min(one.until for one in running.values())
    ready = wait(list(running), max(0.0, soon - time.monotonic()))
    return [end for end, one in running.items() if end in ready or one.until <= time.monotonic()]


@contextmanager
def _running() -> Iterator[dict[Connection, _Running]]:
    """What is at work, by the pipe through which it answers; killed unless all goes well."""
    running: dict[Connection, _Running] = {}
    try:
        yield running
    except BaseException:
        for one in running.values():
            one.process.kill()
        if running:
            end_fork_server()
        raise


def _start(
    running: dict[Connection, _Running],
    number: int,
    limits: Limits,
    loaded: str,
    work: Callable[[Task], Result],
    task: Task,
) -> None:
    here, there = multiprocessing.Pipe(duplex=False)
    with _tables, _no_demon(), in_whole():
        process = context(loaded).Process(target=_one, args=(there, work, task, limits.memory, own_files()))
        process.start()
        running[here] = _Running(number, process, time.monotonic() + _LOADING + limits.seconds)
    there.close()


@contextmanager
def _no_demon() -> Iterator[None]:
    """The worker of a Dask cluster under a nanny is a demon, and `multiprocessing` starts nothing from one, lest it be
    left over; what is started here ends with who started it (`processes.begin`).
    """
    own = current_process()
    demon, own._config["daemon"] = own.daemon, False  # type: ignore[attr-defined]  # of a process at work it is read alone
    try:
        yield
    finally:
        own._config["daemon"] = demon  # type: ignore[attr-defined]


def _one(end: Connection, work: Callable[[Task], Result], task: Task, memory: int, own: str) -> None:
    """What the process does."""
    begin(own)
    end.send(_BEGINS)
    limit_memory(memory)
    try:
        result: Result | BaseException = work(task)
    except BaseException as error:
        result = error
    end.send(result)


def _received(end: Connection) -> object:
    try:
        return end.recv()
    except (EOFError, OSError):
        return Ended.DIED


def _end(running: dict[Connection, _Running], end: Connection) -> int:
    """Kill what may be left of a process, and forget it; which task it was at."""
    one = running.pop(end)
    with _tables:
        one.process.kill()
        one.process.join(PATIENCE)
    end.close()
    return one.task


def limit_memory(more: int) -> None:
    """From here on this process may ask for so much more memory [bytes]; beyond it there is a `MemoryError`.

    Until `end_memory_limit`, which whoever tells of that error needs: what it holds is still taken.
    """
    try:
        import resource

        pages = int(Path("/proc/self/statm").read_text().split()[5])
    except (ImportError, OSError):  # elsewhere than on Linux the limit does not count what is mapped
        return
    most = pages * resource.getpagesize() + more
    hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
    if hard != resource.RLIM_INFINITY:
        most = min(most, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (most, hard))


def end_memory_limit() -> None:
    """From here on this process may ask for as much memory as before `limit_memory`."""
    try:
        import resource
    except ImportError:
        return
    hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
    resource.setrlimit(resource.RLIMIT_DATA, (hard, hard))
