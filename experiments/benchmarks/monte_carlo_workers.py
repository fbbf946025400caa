"""CPU seconds of one and of two workers for the same Monte Carlo runs, in turns.

    python -m experiments.benchmarks.monte_carlo_workers [--runs 150] [--rounds 2]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from time import perf_counter

SCENARIO = "square"
RUNS = 150
ROUNDS = 2


def cpu_seconds(workers: int, runs: int) -> tuple[float, float]:
    """CPU seconds of `sinan montecarlo` and of all its processes, and seconds by the clock."""
    command = [sys.executable, "-m", "experiments", "montecarlo", SCENARIO, "--runs", str(runs)]
    before, start = os.times(), perf_counter()
    subprocess.run([*command, "--workers", str(workers)], check=True, stdout=subprocess.DEVNULL)
    after = os.times()
    used = after.children_user + after.children_system - before.children_user - before.children_system
    return used, perf_counter() - start


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
