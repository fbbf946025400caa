"""CPU seconds of one and of two workers for the same Monte Carlo runs, in turns.

python -m sinan.experiments.benchmarks.monte_carlo_workers [--runs 150] [--rounds 2]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path
from time import perf_counter, sleep

SCENARIO = "square"
RUNS = 150
ROUNDS = 2
LOOK = 0.1  # s between two looks at the processes


def cpu_seconds(workers: int, runs: int) -> tuple[float, float]:
    """CPU seconds of `sinan montecarlo` and of all processes of its session, and seconds by the clock.

    The workers are children of a server of their own, whose times reach no parent: they are read while they live.
    """
    command = [sys.executable, "-m", "experiments", "montecarlo", SCENARIO, "--runs", str(runs)]
    start, used = perf_counter(), dict[int, float]()
    process = subprocess.Popen(
        [*command, "--workers", str(workers)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    while process.poll() is None:
        used |= _times(process.pid)
        sleep(LOOK)
    return sum(used.values()), perf_counter() - start


def _times(session: int) -> dict[int, float]:
    """CPU seconds of every living process of a session, by its number (Linux)."""
    tick, found = os.sysconf("SC_CLK_TCK"), {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == session:
            found[int(stat.parent.name)] = (int(fields[11]) + int(fields[12])) / tick
    return found


def main(runs: int = RUNS, rounds: int = ROUNDS) -> float:
    """Measure and print; returns the smallest CPU seconds of two workers over those of one."""
    best = {1: float("inf"), 2: float("inf")}
    for _ in range(rounds):
        for workers in best:
            used, clock = cpu_seconds(workers, runs)
            best[workers] = min(best[workers], used)
            print(f"{workers} workers: {used:6.1f} CPU s, {clock:6.1f} s by the clock")
    print(f"two workers over one: {best[2] / best[1]:.3f}")
    return best[2] / best[1]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    chosen = parser.parse_args()
    main(chosen.runs, chosen.rounds)
