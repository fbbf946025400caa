"""The law of the ranges' errors from measured logs, each judged by a law that it took no part in.

    SINAN_DATA=FOLDER python -m sinan.experiments.benchmarks.range_noise

For every log: normalised squared residual a degree of freedom (it should be one) and the RMS position error, by the
fixed law of `code_variance`; by the mean of what the other sites' logs say; by its own fit with that as the prior; and
the last third of it by a fit to its first two thirds. Then, of logs of half an hour and more at a known place, how
likely their residuals are by how long a satellite's error lasts.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pymap3d

from sinan.estimator.evidence.score import BLOCKS
from sinan.estimator.positioning.location import Location, locate
from sinan.estimator.positioning.noise_fit import Problem, fit, problem_of
from sinan.estimator.positioning.pseudoranges import Columns, linearise, state_variance
from sinan.experiments.gnss.reference import position_error, read_reference
from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.formats.rinex import read_navigation, read_observations
from sinan.sensors.pseudorange import Pseudoranges, pseudoranges
from sinan.sensors.range_noise import RangeNoise

MASK = np.deg2rad(10.0)
BEGIN = RangeNoise(
    {"G": 0.6, "E": 0.4, "J": 0.6, "C": 1.1, "R": 1.9}, elevation=0.4, strength=0.3, ray=0.1, field=0.3
)  # what the prior of the sites' own fits is centred at; a log tells what it can
BEGIN_SPREAD = 1.0
#: Times that a satellite's error may last, and how long a log is at least that can tell them [s].
TRIED, LONG_ENOUGH = (900.0, 1800.0, 3600.0, 7200.0, 14400.0), 1500.0
NAGOYA_BASE = tuple(float(x) for x in pymap3d.geodetic2ecef(35.134707705, 136.977577539, 104.8530))
FUJISAWA = (-3959400.631, 3385704.533, 3667523.111)
_ESBJERG = ("esbjerg_static_2020/ESBC00DNK_R_20201770000_01D_MN.rnx", (3582104.895, 532590.207, 5232755.260))
_DRIVEN = "rover_rtk_reference.csv"
_KAMAKURA, _NAGOYA, _OHIO = "kamakura_car_2021/", "nagoya_short_baseline_2024/", "ohio_long_baseline_2024/"
#: site -> logs: name, observations, messages, where it was (nothing: not known)
SITES: Mapping[str, Sequence[tuple[str, str, str, tuple[float, ...] | str]]] = {
    "esbjerg": (
        ("Esbjerg, 1 h", "esbjerg_static_2020/ESBC00DNK_R_20201771200_01H_30S_MO.rnx", *_ESBJERG),
        ("Esbjerg, 24 h", "esbjerg_static_2020/ESBC00DNK_R_20201770000_01D_10M_MO.rnx", *_ESBJERG),
    ),
    "kamakura": (
        ("Kamakura, car", _KAMAKURA + "rover_SEPT265G.21O", _KAMAKURA + "SEPT2650.21P", _KAMAKURA + _DRIVEN),
        ("Fujisawa, base", _KAMAKURA + "base_3034265G.21O", _KAMAKURA + "SEPT2650.21P", FUJISAWA),
    ),
    "nagoya": (
        ("Nagoya, rover", _NAGOYA + "rover.obs", _NAGOYA + "base.nav", _NAGOYA + "rover_rtk.pos"),
        ("Nagoya, base", _NAGOYA + "base.obs", _NAGOYA + "base.nav", NAGOYA_BASE),
    ),
    "ohio": (
        ("Ohio, OHAB", _OHIO + "ohab0010.24o", _OHIO + "brdc0010.24n", (780292.975, -4688194.062, 4239545.212)),
        ("Ohio, OHCL", _OHIO + "ohcl0010.24o", _OHIO + "brdc0010.24n", (525642.837, -4868609.832, 4073374.484)),
    ),
    "boulder": (
        ("Boulder, walk", "boulder_walk_imu_2025/gnss_1730_1hz.obs", "boulder_walk_imu_2025/gnss_1730.nav", ""),
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Log:
    """A measured log: its site, ranges, fixes by the fixed law, what the likelihood needs, and where it was."""

    name: str
    site: str
    ranges: Pseudoranges
    location: Location
    problem: Problem
    truth: FloatArray | None


@dataclass(frozen=True)
class Judged:
    """NIS a degree of freedom and RMS position error [m] of one log by: fixed, others, own; and the last third."""

    name: str
    nis: tuple[float, ...]
    rms: tuple[float | None, ...]
    law: RangeNoise


def read(folder: Path) -> list[Log]:
    """The logs that are in the folder."""
    logs = []
    for site, listed in SITES.items():
        for name, observation, navigation, where in listed:
            if not (folder / observation).is_file():
                continue
            ranges = pseudoranges(
                read_observations(folder / observation), read_navigation(folder / navigation), "GEJCR"
            )
            location = locate(ranges, mask=MASK)
            truth = None
            if isinstance(where, tuple):
                truth = np.tile(np.array(where), (len(ranges.t), 1))
            elif where:
                truth = read_reference(folder / where).at(ranges.week, ranges.t)
            logs.append(Log(name, site, ranges, location, problem_of(location, location.fixes.used), truth))
    return logs


def typical(logs: Sequence[Log]) -> RangeNoise:
    """The geometric mean over the sites of what each site's logs say together."""
    sites = sorted({log.site for log in logs})
    laws = [fit([log.problem for log in logs if log.site == site], BEGIN, BEGIN_SPREAD)[0] for site in sites]
    return RangeNoise.of(np.exp(np.mean([np.log(law.sizes) for law in laws], axis=0)))


def judge(logs: Sequence[Log]) -> list[Judged]:
    """Every log by the law of the other sites, and by its own fit about that."""
    found = []
    for log in logs:
        prior = typical([other for other in logs if other.site != log.site])
        own = fit([log.problem], prior)[0]
        t = log.ranges.t
        early = t < t[0] + 2.0 / 3.0 * (t[-1] - t[0])
        first = fit([problem_of(log.location, log.location.fixes.used, early)], prior)[0]
        solved = [log.location, *(locate(log.ranges, mask=MASK, noise=law) for law in (prior, own))]
        late = nis(locate(log.ranges, mask=MASK, noise=first), ~early)
        errors = [None if log.truth is None else position_error(one.fixes.position, log.truth) for one in solved]
        rms = tuple(None if error is None else float(str(error["rms"])) for error in errors)
        everywhere = np.ones(len(t), dtype=bool)
        values = tuple(nis(one, everywhere) for one in solved)
        found.append(Judged(log.name, (*values, late), rms, own))
    return found


def nis(location: Location, during: BoolArray) -> float:
    """Normalised squared residuals a degree of freedom."""
    epochs = location.fixes.solved & during
    return float(np.sum(location.fixes.sse[epochs]) / max(int(location.fixes.redundancy[epochs].sum()), 1))


def likelihoods(log: Log) -> list[float]:
    """2 log L of the residuals at the known place, for each of the times `TRIED`, less that for the first of them.

    A Kalman filter over blocks of time with the satellites' errors as its state, as the trace has it; the clocks of
    each epoch are projected out.
    """
    location = locate(log.ranges, mask=MASK)
    keep = (location.elevation > MASK) & location.fixes.solved[log.ranges.epoch]
    assert log.truth is not None
    rows = np.flatnonzero(keep & np.isfinite(log.truth[log.ranges.epoch, 0]))
    columns = linearise(location, log.truth, [], rows, True)
    variance, block = state_variance(location, log.truth, rows), float(np.ptp(log.ranges.t)) / BLOCKS
    found = [_log_likelihood(columns, variance, float(np.exp(-block / seconds))) for seconds in TRIED]
    return [2.0 * (one - found[0]) for one in found]


def _log_likelihood(columns: Columns, variance: FloatArray, persistence: float) -> float:
    """Up to a constant, without an inverse of S = H P H' + 1.

    With nu = z - H x and M = (P^-1 + H'H)^-1: nu' S^-1 nu = nu'nu - (H'nu)' M H'nu, |S| = |1 + P H'H|.
    """
    m = len(variance)
    x, P, total = np.zeros(m), np.diag(variance), 0.0
    for k in range(BLOCKS):
        H, z = columns.state[columns.block == k], columns.residual[columns.block == k]
        A, nu = np.eye(m) + P @ (H.T @ H), z - H @ x
        M = np.linalg.solve(A, P)
        total -= 0.5 * float(nu @ nu - (H.T @ nu) @ M @ (H.T @ nu) + np.linalg.slogdet(A)[1])
        x, P = persistence * (x + M @ (H.T @ nu)), persistence**2 * 0.5 * (M + M.T)
        P = P + (1.0 - persistence**2) * np.diag(variance)
    return total


def main() -> None:
    """Print the tables."""
    logs = read(Path(os.environ["SINAN_DATA"]) / "gnss")
    names = (*(f"s_{letter}" for letter in "GEJCR"), "elevation", "strength", "ray", "field")
    print("typical:", ", ".join(f"{n} {x:.3f}" for n, x in zip(names, typical(logs).sizes, strict=True)))
    print("| log | NIS fixed | others | own | last third | RMS fixed | others | own |\n|" + " --- |" * 8)
    for one in judge(logs):
        cells = [f"{x:.2f}" for x in one.nis] + ["-" if x is None else f"{x:.2f}" for x in one.rms]
        print(f"| {one.name} | {' | '.join(cells)} |")
    print(
        f"| log, 2 log L if an error lasts | {' | '.join(f'{t:g} s' for t in TRIED)} |\n|" + " --- |" * (len(TRIED) + 1)
    )
    for log in logs:
        if log.truth is not None and np.ptp(log.ranges.t) > LONG_ENOUGH:
            print(f"| {log.name} | {' | '.join(f'{x:.0f}' for x in likelihoods(log))} |")


if __name__ == "__main__":
    main()
