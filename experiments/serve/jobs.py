"""Logs that wait, the one that is traced, and what came of the others: each in a process that can be ended."""

from __future__ import annotations

import json
import os
import re
import secrets
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Condition, Event, Thread, Timer
from typing import Any

from sinan.experiments.workers import alone as workers

#: Letters of a log's name that are kept on the disk: the last ones, with its ending.
_NAME_KEPT = 60
#: Bytes of a line that a process says; more of it is no line of ours.
_LONGEST_LINE = 100_000
#: A process that is killed is waited for so long [s].
_PATIENCE = 0.3

WAITING, RUNNING, DONE, FAILED = "waiting", "running", "done", "failed"


@dataclass(frozen=True)
class Limits:
    """What one user may ask for.

    Attributes
    ----------
    size : of a log [bytes]
    seconds, memory : of work on it; bytes that it may ask for
    waiting : logs in the queue
    kept : results that are kept, the latest
    """

    size: int = 500 * 2**20
    seconds: float = workers.Limits.seconds
    memory: int = workers.Limits.memory
    waiting: int = 20
    kept: int = 50


class Refused(Exception):
    """A log that the queue does not take, with the reason."""


@dataclass
class Job:
    """One log.

    Attributes
    ----------
    number : that nobody guesses
    name : of the log as its owner calls it: a text, whatever it is
    folder : with the log until it is done, then with the page and its numbers
    size : of the log [bytes]
    state, stage : how far it is, in a word and in words
    said : verdict and head line, or why there are none
    """

    number: str
    name: str
    folder: Path
    size: int
    state: str = WAITING
    stage: str = ""
    said: dict[str, Any] = field(default_factory=dict)
    began: float = 0.0
    ended: float = 0.0
    process: subprocess.Popen[bytes] | None = None

    @property
    def log(self) -> Path:
        """Where the log is while it is needed."""
        own = re.sub(r"[^A-Za-z0-9_.-]+", "_", self.name).lstrip("._-")
        return self.folder / (own[-_NAME_KEPT:].lstrip("._-") or "log")

    @property
    def page(self) -> Path:
        """The page of its verdict."""
        return self.folder / "result" / "page.html"

    @property
    def report(self) -> Path:
        """The numbers."""
        return self.folder / "result" / "report.json"

    def as_table(self) -> dict[str, Any]:
        """For the list in the browser."""
        end = self.ended or time.monotonic()
        seconds = end - self.began if self.began else 0.0
        return {"id": self.number, "name": self.name, "size": self.size, "state": self.state,
                "stage": self.stage, "seconds": round(seconds, 1), **self.said}  # fmt: skip


class Queue:
    """Jobs in the order in which they came; one thread does them.

    Parameters
    ----------
    folder : for logs and results; whoever made it removes it
    limits : of size, time and number
    """

    def __init__(self, folder: Path, limits: Limits) -> None:
        self.limits = limits
        self._folder, self._jobs, self._closed = folder, dict[str, Job](), False
        self._changed = Condition()
        self._thread = Thread(target=self._work, daemon=True)
        self._thread.start()

    def new(self, name: str, size: int) -> Job:
        """A place for a log that is about to come; `add` puts it into the queue.

        Raises
        ------
        Refused : it is empty or too large, or too many wait
        """
        if size <= 0:
            raise Refused("an empty file")
        if size > self.limits.size:
            raise Refused(f"{size / 2**20:.0f} MB; at most {self.limits.size / 2**20:.0f} MB are taken (--size)")
        with self._changed:
            if sum(job.state == WAITING for job in self._jobs.values()) >= self.limits.waiting:
                raise Refused(f"{self.limits.waiting} logs wait already")
        number = secrets.token_hex(8)
        job = Job(number, name, self._folder / number, size)
        job.page.parent.mkdir(parents=True)
        return job

    def add(self, job: Job) -> None:
        """Let a log that is there be traced when its turn comes."""
        with self._changed:
            self._jobs[job.number] = job
            ended = [one for one in self._jobs.values() if one.state in (DONE, FAILED)]
            old = ended[: max(0, len(ended) - self.limits.kept)]
            for one in old:
                del self._jobs[one.number]
            self._changed.notify_all()
        for one in [*old]:
            self.discard(one)

    @staticmethod
    def discard(job: Job) -> None:
        """Remove all that there is of a job."""
        shutil.rmtree(job.folder, ignore_errors=True)

    def get(self, number: str) -> Job | None:
        """A job by its number."""
        with self._changed:
            return self._jobs.get(number)

    def __iter__(self) -> Iterator[Job]:
        with self._changed:
            return iter(list(self._jobs.values()))

    def remove(self, number: str) -> bool:
        """End a job, and forget it; False: there is none of that number."""
        with self._changed:
            job = self._jobs.pop(number, None)
        if job is None:
            return False
        _kill(job.process)
        self.discard(job)
        return True

    def close(self) -> None:
        """End all that is at work; nothing is begun any more."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        for job in self:
            _kill(job.process)
        self._thread.join(_PATIENCE)

    # ---- the thread

    def _work(self) -> None:
        while (job := self._next()) is not None:
            try:
                state, said = self._done(job)
            except Exception as error:  # whatever it was, the next log is not to suffer from it
                state, said = FAILED, {"why": f"{type(error).__name__}: {error}"}
            with suppress(OSError):
                job.log.unlink()
            with self._changed:  # last of all: whoever sees the end finds the log gone
                job.said, job.state, job.stage, job.ended = said, state, "", time.monotonic()

    def _next(self) -> Job | None:
        with self._changed:
            while not self._closed:
                job = next((one for one in self._jobs.values() if one.state == WAITING), None)
                if job is not None:
                    job.state, job.stage, job.began = RUNNING, "begins", time.monotonic()
                    return job
                self._changed.wait()
        return None

    def _done(self, job: Job) -> tuple[str, dict[str, Any]]:
        """State and words of one log, in a process that leads a session of its own and ends when this one does."""
        words = [sys.executable, "-m", "sinan.experiments.serve.one_job", str(job.log), job.name, str(job.page.parent),
                 str(self.limits.memory)]  # fmt: skip
        late, answer = Event(), dict[str, Any]()
        with subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True,
            cwd=job.folder, env=_environment(),
        ) as process:  # fmt: skip
            job.process = process
            watch = Timer(self.limits.seconds, _end_late, (process, late))
            watch.daemon = True
            watch.start()
            try:
                if self._closed or self.get(job.number) is None:  # removed before it had begun
                    _kill(process)
                answer = _heard(process, job)
            finally:
                watch.cancel()
                _kill(process)
        if late.is_set():
            why = f"stopped after {self.limits.seconds:.0f} s, the longest that a log may take (--time)"
            return FAILED, {"why": why}
        if answer.get("answer") == DONE and job.page.is_file():
            return DONE, {key: str(answer[key]) for key in ("verdict", "headline") if key in answer}
        died = f"the process that read it ended without an answer ({process.returncode})"
        return FAILED, {"why": str(answer.get("why", died))}


def _environment() -> dict[str, str]:
    """That of a process which is to import this very package, wherever it runs."""
    import sinan

    own = str(Path(str(sinan.__file__)).resolve().parents[1])
    return {**os.environ, "PYTHONPATH": os.pathsep.join([own, *filter(None, [os.environ.get("PYTHONPATH")])])}


def _heard(process: subprocess.Popen[bytes], job: Job) -> dict[str, Any]:
    """What a process answers in the end; until then, how far it is."""
    assert process.stdout is not None
    answer: dict[str, Any] = {}
    while line := process.stdout.readline(_LONGEST_LINE):
        said = _said(line)
        job.stage = str(said.get("stage", job.stage))
        answer = said if "answer" in said else answer
    process.wait()
    return answer


def _said(line: bytes) -> dict[str, Any]:
    """What a process says in a line of JSON; empty: something else."""
    try:
        said = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return said if isinstance(said, dict) else {}


def _end_late(process: subprocess.Popen[bytes], late: Event) -> None:
    late.set()
    _kill(process)


def _kill(process: subprocess.Popen[bytes] | None) -> None:
    """End a process and all that it has started, at once; nothing where it has ended by itself."""
    if process is None or process.poll() is not None:
        return
    with suppress(OSError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
    with suppress(subprocess.TimeoutExpired):
        process.wait(_PATIENCE)
