"""C/A and P code compared: classes of receivers simulated, and what measured RINEX says of both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sinan.estimator.positioning import integrity
from sinan.estimator.positioning.location import Location, locate
from sinan.experiments.gnss.link_study import MASK, elevations, slow_variance, white_variance
from sinan.experiments.gnss.reference import read_reference
from sinan.experiments.gnss.simulated import load, simulate
from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.code_receiver import CLASSES
from sinan.sensors.formats.rinex import read_navigation, read_observations
from sinan.sensors.formats.rinex_observation import Observations
from sinan.sensors.pseudorange import CODES, MODELLED, Pseudoranges, line_of_sight, modelled, pseudoranges
from sinan.sensors.pseudorange_simulation import Air

#: Measured logs with P code: observations, messages, and where the receiver was.
LOGS: Mapping[str, tuple[str, str, Sequence[float] | str]] = {
    "esbjerg_static_2020": (
        "ESBC00DNK_R_20201771200_01H_30S_MO.rnx",
        "ESBC00DNK_R_20201770000_01D_MN.rnx",
        (3582104.895, 532590.207, 5232755.260),
    ),
    "kamakura_car_2021": ("rover_SEPT265G.21O", "SEPT2650.21P", "rover_rtk_reference.csv"),
    "nagoya_short_baseline_2024": ("rover.obs", "base.nav", "rover_rtk.pos"),
    "ohio_long_baseline_2024": ("ohab0010.24o", "brdc0010.24n", (780292.9750, -4688194.0620, 4239545.2120)),
}


@dataclass(frozen=True)
class CodeRow:
    """One line of a table: a receiver or a log, with one code.

    Attributes
    ----------
    what, code : who measured, and what
    range_error : RMS of range minus truth about the mean of each epoch [m]
    expected : the same as the class declares it [m]; None: measured
    noise : what changes from epoch to epoch of a satellite, over sqrt(2) [m]
    position_rms, bias, scatter : of the fix: RMS, length of its mean error, RMS about the mean [m]
    pdop : mean dilution of precision
    """

    what: str
    code: str
    range_error: float
    expected: float | None
    noise: float
    position_rms: float
    bias: float
    scatter: float
    pdop: float


def classes(seed: int = 0, seconds: float = 900.0) -> list[CodeRow]:
    """Every class of receivers, at rest for a while under an air that the models know, and true messages."""
    scenario = replace(load("static_ca"), seconds=seconds, errors=(), air=Air(2.4, 1.0))
    rows = []
    for name, receiver in CLASSES.items():
        found = simulate(replace(scenario, rover=receiver, base=receiver), seed)
        ranges = found.ranges()[0]
        location = locate(ranges, mask=MASK, exclude=False)
        used = location.fixes.used
        variance = white_variance(receiver, ranges) + slow_variance(receiver, elevations(found, ranges))
        expected = float(np.sqrt(np.mean(variance[used])))
        rows.append(_row(name, "+".join(receiver.codes), location, found.position, expected))
    return rows


def measured(folder: Path) -> list[CodeRow]:
    """The logs that are in the folder, GPS alone, with C/A code, P code, and both frequencies of the P code."""
    rows = []
    for name, (observation, navigation, where) in LOGS.items():
        if not (folder / name / observation).is_file():
            continue
        observed = read_observations(folder / name / observation, "CS")
        messages = read_navigation(folder / name / navigation)
        for code in CODES:
            ranges = pseudoranges(observed, messages, "G", code)
            if not len(ranges):
                continue
            location = locate(ranges, mask=MASK)
            if isinstance(where, str):
                truth = read_reference(folder / name / where).at(ranges.week, ranges.t)
            else:
                truth = np.tile(np.asarray(where, dtype=np.float64), (len(ranges.t), 1))
            rows.append(_row(name, _measured_code(observed, code), location, truth, None))
    return rows


def _measured_code(observed: Observations, code: str) -> str:
    """The RINEX names of what was solved."""
    if code == "p_two":
        return "C1W+C2W"
    gps = observed.system == "G"
    there = {name for name, value in observed.values.items() if np.isfinite(value[gps]).any()}
    return next(name for name, *_ in CODES[code]["G"] if name in there)


def _row(what: str, code: str, location: Location, truth: FloatArray, expected: float | None) -> CodeRow:
    """Numbers of one receiver and code."""
    ranges = location.ranges
    keep = location.fixes.used & np.isfinite(truth[ranges.epoch, 0])
    known = np.where(np.isfinite(truth), truth, 1e7)
    distance, _ = line_of_sight(ranges.position, known[ranges.epoch])
    left = ranges.value - distance - modelled(ranges, known, MODELLED)
    left = _about_the_mean(ranges, left, keep)
    error = (location.fixes.position - truth)[location.fixes.solved & np.isfinite(truth[:, 0])]
    rms, bias = float(np.sqrt(np.mean(np.sum(error**2, axis=1)))), float(np.linalg.norm(error.mean(axis=0)))
    d = integrity.dilution(location.fixes, ranges.position, ranges.epoch, location.clock_group)
    return CodeRow(
        what, code, float(np.sqrt(np.mean(left[keep] ** 2))), expected, _changing(ranges, left, keep), rms, bias,
        float(np.sqrt(max(rms**2 - bias**2, 0.0))), float(np.nanmean(d.position)),
    )  # fmt: skip


def _about_the_mean(ranges: Pseudoranges, left: FloatArray, keep: BoolArray) -> FloatArray:
    """(n,) less the mean of its epoch, which is the receiver's clock, scaled up by the degree of freedom it takes."""
    count = np.bincount(ranges.epoch[keep], minlength=len(ranges.t))
    mean = np.bincount(ranges.epoch[keep], left[keep], minlength=len(ranges.t)) / np.maximum(count, 1)
    scale = np.sqrt(count / np.maximum(count - 1, 1))
    return np.asarray((left - mean[ranges.epoch]) * scale[ranges.epoch])


def _changing(ranges: Pseudoranges, left: FloatArray, keep: BoolArray) -> float:
    """RMS of the steps from one epoch of a satellite to the next, over sqrt(2) [m]."""
    steps = []
    for name in np.unique(ranges.satellite[keep]):
        rows = np.flatnonzero(keep & (ranges.satellite == name))
        steps.append(np.diff(left[rows])[np.diff(ranges.epoch[rows]) == 1])
    return float(np.sqrt(np.mean(np.concatenate(steps) ** 2) / 2.0))
