"""Work in processes of this machine, which end with it: when it is done, fails, is stopped or killed."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing.context import ForkServerContext, SpawnContext
from threading import Thread
from typing import TypeVar

from sinan.experiments.workers.stopping import AT_ONCE, in_whole
from sinan.sensors.errors import InputError

Task = TypeVar("Task")
Result = TypeVar("Result")

Context = ForkServerContext | SpawnContext

MOST_RESTARTS = 3  # of a pool whose worker was killed
#: A process that was killed is waited for so long [s]: it takes milliseconds.
PATIENCE = 0.3
#: `sinan.sensors.effects.own.VARIABLE`, without loading what that module needs.
_OWN_FILES = "SINAN_EFFECTS"
_LEADER = f"{__package__}.leader"


def in_processes(
    work: Callable[[Task], Result],
    tasks: Sequence[Task],
    workers: int,
    done: Callable[[Task, Result], None],
    loaded: str = "",
) -> None:
    """Do tasks in worker processes; a pool that loses one is started again with what is not done.

    Parameters
    ----------
    work : done in a worker, of one task
    workers : processes
    done : called here with each task and its result, in the order in which they get done
    loaded : module that is loaded once, for all processes; default that of `work`

    Raises
    ------
    InputError : workers die again and again
    """
    left = dict(enumerate(tasks))
    for _ in range(1 + MOST_RESTARTS):
        with suppress(BrokenProcessPool), _pool(workers, loaded or module_of(work)) as pool:
            with in_whole():  # the first of them start the processes
                jobs = {pool.submit(work, task): number for number, task in left.items()}
            for job in as_completed(jobs):
                result = job.result()
                done(left.pop(jobs[job]), result)
        if not left:
            return
    raise InputError("--workers", f"workers died {1 + MOST_RESTARTS} times", "memory for them, or fewer")


@contextmanager
def _pool(workers: int, loaded: str) -> Iterator[ProcessPoolExecutor]:
    """A pool whose processes are killed unless all goes well: they may be in the middle of a long task."""
    others, pool = multiprocessing.active_children(), None
    try:
        pool = ProcessPoolExecutor(workers, mp_context=context(loaded), initializer=begin, initargs=(own_files(),))
        yield pool
    except BaseException as error:
        ours = [process for process in multiprocessing.active_children() if process not in others]
        for process in ours:
            process.kill()
        if pool is not None:
            pool.shutdown(wait=False, cancel_futures=True)
        for process in ours:
            process.join(PATIENCE)
        if not isinstance(error, BrokenProcessPool):
            end_fork_server()
        raise
    pool.shutdown()


def module_of(work: Callable[..., object]) -> str:
    """Where a function is from; of a partial one, the function in it."""
    while isinstance(work, partial):
        work = work.func
    return work.__module__


def context(loaded: str) -> Context:
    """How processes are started: by a fork server that has loaded what they need, where the system has one.

    Parameters
    ----------
    loaded : module that the server imports; the first that asks in a process decides
    """
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    from multiprocessing import forkserver, resource_tracker

    server = multiprocessing.get_context("forkserver")
    server.set_forkserver_preload([_LEADER, loaded])
    if end_fork_server not in AT_ONCE:
        AT_ONCE.append(end_fork_server)
    # Ctrl-C goes to every process of a terminal. The server and all that it forks inherit that it is blocked, from
    # their first instruction. The tracker is started before, because its start would let Ctrl-C through again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return server


def end_fork_server() -> None:
    """Kill the server, which else would go on loading for seconds, and with it a worker that it forked just now, of
    which nobody knows yet. It is started again where it is needed.
    """
    from multiprocessing import forkserver

    number = getattr(getattr(forkserver, "_forkserver", None), "_forkserver_pid", None)  # it has no public name
    if number is None:
        return
    for kill in (os.killpg, os.kill):  # it leads a group once it has loaded the first of what it needs
        with suppress(ProcessLookupError):
            kill(number, signal.SIGKILL)


def own_files() -> str:
    """Files of effects of the user's own, which a fork server that was started before they were read does not know."""
    return os.environ.get(_OWN_FILES, "")


def begin(own: str) -> None:
    """What a worker begins with: it leaves Ctrl-C to the process that started it, and ends when that one is gone.

    Parameters
    ----------
    own : `own_files` of the process that started it
    """
    os.environ[_OWN_FILES] = own
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
