"""Point positioning: microseconds an epoch against gnss-lib-py's `wls` on equal input, and a whole day at once.

`gnss-lib-py` is measured where it is installed. All of it in one run, interleaved, medians.
"""

from __future__ import annotations

import importlib
import time
import warnings
from collections.abc import Callable

import numpy as np

from sinan.estimator.positioning.integrity import east_north_up
from sinan.estimator.positioning.location import locate
from sinan.estimator.positioning.point_positioning import solve
from sinan.sensors.arrays import FloatArray, IntArray
from sinan.sensors.pseudorange import L1, Pseudoranges

RECEIVER = np.array([3582104.895, 532590.207, 5232755.260])  # ECEF [m]
SATELLITES = 10
EPOCHS = 2880  # a day of 30 s


def sky(epochs: int, seed: int = 1) -> tuple[FloatArray, FloatArray, IntArray]:
    """Satellites (n, 3), noisy ranges (n,) and epochs (n,) of a receiver that stands still."""
    rng = np.random.default_rng(seed)
    elevation = np.arcsin(rng.uniform(np.sin(0.2), 1.0, (epochs, SATELLITES)))
    azimuth = rng.uniform(0.0, 2.0 * np.pi, (epochs, SATELLITES))
    enu = np.stack([np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)], -1)
    satellites = RECEIVER + rng.uniform(2.0e7, 2.5e7, (epochs, SATELLITES, 1)) * (
        enu @ east_north_up(RECEIVER[None])[0]
    )
    ranges = np.linalg.norm(satellites - RECEIVER, axis=2) + 3.0e4 + rng.standard_normal((epochs, SATELLITES))
    return satellites.reshape(-1, 3), ranges.ravel(), np.repeat(np.arange(epochs), SATELLITES)


def pseudoranges_of(satellites: FloatArray, ranges: FloatArray, epoch: IntArray) -> Pseudoranges:
    """The same as the input of the whole chain: mask, effects, weights, tests."""
    n = len(ranges)
    names = np.array([f"G{k % SATELLITES + 1:02d}" for k in range(n)])
    zero, one = np.zeros(n), np.ones(n)
    return Pseudoranges(
        "benchmark",
        2200,
        np.arange(int(epoch[-1]) + 1, dtype=np.float64) * 30.0,
        epoch,
        names,
        ranges,
        L1 * one,
        satellites,
        np.zeros((n, 3)),
        zero,
        zero,
        2.0 * one,
        45.0 * one,
        np.zeros(n, dtype=np.int64),
        np.array([1.1e-8, 1.5e-8, -6e-8, -1.2e-7, 9e4, 1.3e5, -6.5e4, -2.6e5]),
        None,
        (),
    )


def seconds(action: Callable[[], object]) -> float:
    """Duration of one call."""
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def main(epochs: int = EPOCHS, repeats: int = 5) -> dict[str, float]:
    """Seconds a day and microseconds an epoch; with gnss-lib-py its share and the largest difference [m]."""
    satellites, ranges, epoch = sky(epochs)
    whole = pseudoranges_of(satellites, ranges, epoch)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            wls = importlib.import_module("gnss_lib_py.algorithms.snapshot").wls
    except ImportError:
        wls = None
    few = min(epochs, 200) * SATELLITES
    times: dict[str, list[float]] = {"solve": [], "locate": [], "gnss_lib_py": []}
    theirs = np.zeros((few // SATELLITES, 3))

    def one_by_one() -> None:
        for k in range(few // SATELLITES):
            rows = slice(k * SATELLITES, (k + 1) * SATELLITES)
            state = wls(np.zeros((4, 1)), satellites[rows], ranges[rows, None], sv_rx_time=True)
            theirs[k] = state[:3, 0]

    for _ in range(repeats):
        times["solve"].append(seconds(lambda: solve(satellites, ranges, epoch, epochs)))
        times["locate"].append(seconds(lambda: locate(whole)))
        if wls is not None:
            times["gnss_lib_py"].append(seconds(one_by_one) * SATELLITES * epochs / few)
    result = {f"{name}_s_a_day": float(np.median(value)) for name, value in times.items() if value}
    result["solve_us_an_epoch"] = 1e6 * result["solve_s_a_day"] / epochs
    if wls is not None:
        ours = solve(satellites, ranges, epoch, epochs).position[: len(theirs)]
        result["times_faster"] = result["gnss_lib_py_s_a_day"] / result["solve_s_a_day"]
        result["largest_difference_m"] = float(np.abs(ours - theirs).max())
    return result


if __name__ == "__main__":
    for key, number in main().items():
        print(f"{key:24} {number:.6g}")
