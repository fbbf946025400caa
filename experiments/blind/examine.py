"""The tracer before a recording with a sealed answer: it sees what a person with the recording in hand sees."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from pathlib import Path

from sinan.estimator.evidence.alpha import ALPHA
from sinan.experiments.blind.maker.make import INDEX_FILE
from sinan.experiments.datasets import resolve
from sinan.experiments.residual_loop.report import report
from sinan.experiments.residual_loop.run import trace_recording
from sinan.sensors.errors import InputError
from sinan.sensors.recording import Recording


def index_of(runs: Path) -> dict[str, dict[str, str | None]]:
    """Kind and sensor of each recording of a folder.

    Raises
    ------
    InputError : no such folder, or not one of these
    """
    path = runs / INDEX_FILE
    if not path.is_file():
        raise InputError(str(runs), "no index.json", "a folder of recordings with sealed answers")
    found: dict[str, dict[str, str | None]] = json.loads(path.read_text(encoding="utf-8"))
    return found


def examine(folder: Path, asked: Mapping[str, str | None], alpha: float = ALPHA) -> dict[str, object]:
    """The report of the trace of one recording, and the CPU seconds that it took.

    Parameters
    ----------
    asked : sensor, where the recording has several
    alpha : family-wise error
    """
    begin = time.process_time()
    document = examined(resolve(str(folder), None), asked["sensor"], alpha)
    document["cpu_seconds"] = time.process_time() - begin
    return document


def examined(recording: Recording, sensor: str | None = None, alpha: float = ALPHA) -> dict[str, object]:
    """The same of a recording that is read already; the CPU seconds are those of the trace."""
    begin = time.process_time()
    return {**report(trace_recording(recording, sensor, alpha)), "cpu_seconds": time.process_time() - begin}
