"""Reading RINEX: milliseconds a megabyte of each installed reader, on files named on the command line.

python -m sinan.experiments.benchmarks.gnss_parsing FILE...
"""

from __future__ import annotations

import contextlib
import importlib
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

from sinan.sensors.formats.rinex import read_observations

EVERYTHING = "CLDS"


def readers() -> dict[str, Callable[[str], object]]:
    """The readers that are installed, each reading every observation of every system."""
    found: dict[str, Callable[[str], object]] = {"sinan": lambda path: read_observations(path, EVERYTHING)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, module, function in (("georinex", "georinex", "load"), ("pygnss-tec", "gnss_tec", "read_rinex_obs")):
            with contextlib.suppress(ImportError):
                found[name] = getattr(importlib.import_module(module), function)
    return found


def main(paths: list[str], repeats: int = 3) -> dict[str, dict[str, float]]:
    """Best milliseconds a megabyte by file and reader; a reader that fails has no entry."""
    result: dict[str, dict[str, float]] = {}
    available = readers()
    for path in paths:
        size = Path(path).stat().st_size / 1e6
        result[path] = {}
        for name, read in available.items():
            durations = []
            for _ in range(1 if name == "georinex" else repeats):
                start = time.perf_counter()
                try:
                    with warnings.catch_warnings():
                        warnings.simplefilter("ignore")
                        read(path)
                except Exception as error:  # other people's readers raise what they like
                    print(f"{name} on {path}: {type(error).__name__}", file=sys.stderr)
                    break
                durations.append(time.perf_counter() - start)
            if durations:
                result[path][name] = 1e3 * min(durations) / size
    return result


if __name__ == "__main__":
    for file, speeds in main(sys.argv[1:]).items():
        print(file, ", ".join(f"{name} {value:.1f} ms/MB" for name, value in speeds.items()))
