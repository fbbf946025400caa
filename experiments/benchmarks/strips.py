"""Errors of what overlapping strips show of a laser's mounting, over the sigmas that are told: one on average.

    python -m sinan.experiments.benchmarks.strips 101 137

A flight a seed, from the first to before the second; its mounting is drawn from the plausible sizes, its scene is one
of four. Prints the RMS over the flights. Twenty seconds a flight.
"""

from __future__ import annotations

import sys

import numpy as np

from sinan.experiments.mapping.cloud import Mounting
from sinan.experiments.mapping.flight import surveyed
from sinan.experiments.mapping.making import MARGIN, scans_of, trajectory
from sinan.experiments.mapping.scene import COUNTRY, Scene, hills
from sinan.experiments.mapping.strips import SOUGHT, StripFit, fit_strips, mounting_of, strips_of
from sinan.sensors.arrays import FloatArray

SCENES = (
    COUNTRY,
    Scene(hills),
    Scene(lambda north, east: 0.15 * north + 0.05 * east),
    Scene(lambda north, east: 3.0 * (np.floor(north / 15.0) % 2.0) + 0.1 * east),
)


def flown(seed: int) -> tuple[FloatArray, StripFit]:
    """(5,) the mounting that was hidden, in the order of `SOUGHT`, and what the strips say of it."""
    truth = np.random.default_rng([seed, 77]).standard_normal(5) * [size for *_, size in SOUGHT]
    recording, _ = surveyed(SCENES[seed % len(SCENES)], mounting_of(truth), seed)
    motion, _, drift = trajectory(recording)
    scans = scans_of(recording).between(motion.t[0] + MARGIN, motion.t[-1] - MARGIN)
    fit = fit_strips(scans, motion, strips_of(motion, scans.t), Mounting(), drift)
    assert fit is not None
    return truth, fit


def main(first: int, end: int) -> None:
    """Fly all seeds and print."""
    each = [(fit.beta - truth, fit.sigma) for truth, fit in map(flown, range(first, end))]
    error, sigma = np.array([e for e, _ in each]), np.array([s for _, s in each])
    for k, (name, part, _) in enumerate(SOUGHT):
        ratio, size = (float(np.sqrt(np.mean(x**2))) for x in (error[:, k] / sigma[:, k], error[:, k]))
        print(f"{name} {part}: error over sigma {ratio:.2f}, error {size:.5f}, RMS of {len(each)} flights")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
