"""`sinan gnss`: positions from RINEX files, and which effects the pseudoranges call for.

The order of the report: the plain model, then each effect that the data call for, then the model with every effect.
What the ranges alone cannot show is said, with the distance by which it moves the fix.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pymap3d

from sinan.estimator.evidence.alpha import ALPHA
from sinan.estimator.positioning import integrity
from sinan.estimator.positioning.location import Location, locate
from sinan.estimator.positioning.noise_fit import fitted
from sinan.estimator.positioning.pseudorange_trace import RangeTrace, held_out_epochs, trace_ranges
from sinan.estimator.positioning.pseudoranges import Called
from sinan.experiments.gnss.base import Differential, differential
from sinan.experiments.gnss.reference import position_error, read_reference
from sinan.sensors.arrays import FloatArray
from sinan.sensors.data_link import DataLink, parse_link
from sinan.sensors.effects.pseudorange_satellite_fault import EFFECT as FAULT
from sinan.sensors.errors import InputError
from sinan.sensors.files import new_file
from sinan.sensors.formats.rinex import Navigation, read_navigation, read_observations
from sinan.sensors.formats.rinex_text import WEEK, calendar
from sinan.sensors.pseudorange import CODES, MODELLED, SYSTEM_NAMES, Pseudoranges, pseudoranges
from sinan.sensors.range_noise import RangeNoise

Report = dict[str, object]


def solved(
    observation: Path | str,
    navigation: Sequence[Path | str],
    systems: str = "G,E,J,C",
    mask_deg: float = 10.0,
    position: Sequence[float] | None = None,
    reference: Path | str | None = None,
    base: Path | str | None = None,
    base_position: Sequence[float] | None = None,
    alpha: float = ALPHA,
    code: str = "ca",
    link: str | None = None,
) -> tuple[Report, Location]:
    """Read, fix, trace and report.

    Parameters
    ----------
    observation : RINEX observation file of the receiver
    navigation : RINEX navigation files
    systems : letters with or without commas: G GPS, E Galileo, J QZSS, C BeiDou, R GLONASS
    mask_deg : lowest elevation [deg]
    position : known ECEF position of a receiver that stands still [m]
    reference : file of known positions of a moving one
    base, base_position : observation file and ECEF position [m] of a base
    alpha : family-wise error of the trace
    code : `ca`, `p`, or `p_two` (both frequencies of the P code, without ionosphere)
    link : the data link from the base, such as `delay=5,loss=0.1`; None: every correction is there at once

    Returns
    -------
    what `--json` writes: finite numbers, strings, lists, None; and the fixes of the full model

    Raises
    ------
    InputError : a file or an argument cannot be used
    """
    letters = check_arguments(systems, mask_deg, position, reference, base, base_position)
    over = check_code(code, link, base)
    messages = read_navigation(*navigation)
    ranges = usable_ranges(observation, messages, letters, code)
    mask = math.radians(mask_deg)
    truth = known_positions(ranges, position, reference)
    require_a_fix(observation, locate(ranges, mask=mask))
    traced, final = entries(ranges, mask, trace_ranges(ranges, mask, alpha, truth), truth)
    report: Report = {
        "format": 1,
        "recording": Path(observation).name,
        "alpha": alpha,
        "systems": [SYSTEM_NAMES[letter] for letter in letters],
        "code": code,
        "mask_deg": mask_deg,
        "reference": reference_name(position, reference),
        **traced,
    }
    if base is not None and base_position is not None:
        at_base, place = usable_ranges(base, messages, letters, code), np.asarray(base_position, dtype=np.float64)
        entry = dgps_entry(differential(ranges, at_base, place, messages, mask, over), truth, place)
        report["dgps"] = {**entry, "link": None if over is None else asdict(over)}
    return finite(report), final  # type: ignore[return-value]


def entries(ranges: Pseudoranges, mask: float, found: RangeTrace, truth: FloatArray | None) -> tuple[Report, Location]:
    """What a trace found, as the report says it, and the fixes of the full model."""
    first = locate(ranges, mask=mask, excluded=found.faulty)
    noise = fitted(first)
    final = locate(ranges, mask=mask, excluded=found.faulty, noise=noise)
    report: Report = {
        "epochs": int(final.fixes.solved.sum()),
        "verdict": found.verdict,
        "effects": [effect_entry(called) for called in found.called],
        "rolled_back": list(found.rolled_back),
        "noise": noise_entry(noise, first, final, truth),
        "stages": stages(ranges, mask, found, final, truth, noise),
        "error": held_out_error(ranges, mask, found),
        "candidates": candidates(ranges, mask, found, final, noise),
        "integrity": integrity_entry(final),
        "excluded": excluded(final, found),
        "journal": journal(ranges, final),
    }
    return report, final


def require_a_fix(observation: Path | str, location: Location) -> None:
    """Raise where no epoch has a solution."""
    if not location.fixes.solved.any():
        raise InputError(
            observation, reasons(location), "an epoch with four satellites above the mask, or one more a system"
        )


def reference_name(position: Sequence[float] | None, reference: Path | str | None) -> str | None:
    """What the report calls the known place."""
    if position is not None:
        return "the position given"
    return None if reference is None else Path(reference).name


def run(observation: Path | str, navigation: Sequence[Path | str], *arguments: Any, **named: Any) -> Report:
    """The report of `solved`, with the same arguments, alone."""
    return solved(observation, navigation, *arguments, **named)[0]


def check_arguments(
    systems: str,
    mask_deg: float,
    position: Sequence[float] | None,
    reference: Path | str | None,
    base: Path | str | None,
    base_position: Sequence[float] | None,
) -> str:
    """The letters of the systems; raises where arguments do not go together."""
    letters = systems.upper().replace(",", "").replace(" ", "")
    unknown = [letter for letter in letters if letter not in SYSTEM_NAMES]
    if unknown or not letters:
        raise InputError("--systems", f"`{systems}`", "letters out of " + ",".join(SYSTEM_NAMES))
    if not 0.0 <= mask_deg < 90.0:
        raise InputError("--mask", f"{mask_deg:g} deg", "0 to 90 deg")
    if position is not None and reference is not None:
        raise InputError("--position and --reference", "both", "one of them")
    if (base is None) != (base_position is None):
        raise InputError("--base and --base-position", "one without the other", "both")
    for name, value in (("--position", position), ("--base-position", base_position)):
        if value is not None and not (len(value) == 3 and 6.2e6 < np.linalg.norm(np.asarray(value, float)) < 7.0e6):
            raise InputError(name, str(list(value)), "ECEF X Y Z in metres, near the Earth's surface")
    return letters


def check_code(code: str, link: str | None, base: Path | str | None) -> DataLink | None:
    """The link; raises where there is no such code, or a link without a base."""
    if code not in CODES:
        raise InputError("--code", f"`{code}`", ", ".join(CODES))
    if link is not None and base is None:
        raise InputError("--link", "no base", "--base and --base-position")
    return None if link is None else parse_link(link)


def usable_ranges(path: Path | str, messages: Navigation, letters: str, code: str = "ca") -> Pseudoranges:
    """Pseudoranges of a file; raises where none can be used."""
    ranges = pseudoranges(read_observations(path, "CS"), messages, letters, code)
    if not len(ranges):
        names = ", ".join(SYSTEM_NAMES[letter] for letter in letters)
        why = "; ".join(ranges.journal[-3:]) or f"no code observation of {names}"
        raise InputError(
            path, f"no usable pseudorange: {why}", f"code observations of {names} with messages of that time"
        )
    return ranges


def known_positions(
    ranges: Pseudoranges, position: Sequence[float] | None, reference: Path | str | None
) -> FloatArray | None:
    """(epochs, 3) where the receiver was, ECEF [m]; None: not known."""
    if position is not None:
        return np.tile(np.asarray(position, dtype=np.float64), (len(ranges.t), 1))
    if reference is None:
        return None
    truth = read_reference(reference).at(ranges.week, ranges.t)
    if not np.isfinite(truth).any():
        start = calendar(ranges.week * WEEK + float(ranges.t[0]))
        raise InputError(
            reference, f"no position at an epoch of {ranges.where} (from {start})", "a reference of that time"
        )
    return truth


def effect_entry(called: Called) -> Report:
    """One effect of the report."""
    declaration = FAULT if called.satellite else MODELLED[called.name]
    s = called.statistic
    return {
        "name": called.name,
        "satellite": called.satellite,
        "beta": s.beta.tolist(),
        "std": s.std.tolist(),
        "modelled": None if called.satellite else called.full.tolist(),
        "unit": list(declaration.units),
        "statistic": s.statistic / max(1.0, s.scatter),
        "lambda": s.statistic,
        "p_value": s.p_value,
        "confused_with": list(called.confused_with),
        "interval": None if called.interval is None else list(called.interval),
        "evidence": "known position" if called.known_position else "ranges",
        "summary": declaration.summary,
    }


def stages(
    ranges: Pseudoranges,
    mask: float,
    found: RangeTrace,
    final: Location,
    truth: FloatArray | None,
    noise: RangeNoise | None = None,
) -> list[Report]:
    """The plain model, each further effect, and the model with every effect, if that is another one."""
    entries = [stage((), [], locate(ranges, (), mask=mask, exclude=False, noise=noise), truth, "plain model")]
    names: list[str] = []
    labels: list[str] = []
    without = np.zeros(len(ranges), dtype=bool)
    for called in found.called:
        labels.append(called.name)
        if called.satellite is None:
            names.append(called.name)
        elif called.interval is not None:
            late = ranges.time - ranges.t[0] >= called.interval[0]
            without = without | ((ranges.satellite == called.satellite) & late)
        location = locate(ranges, names, mask=mask, exclude=False, excluded=without, noise=noise)
        source = "known position" if called.known_position else "ranges"
        entries.append(stage(tuple(labels), names, location, truth, source))
    everything = tuple(labels) + tuple(name for name in MODELLED if name not in names)
    label = "every effect, satellites tested epoch by epoch"
    return [*entries, stage(everything, list(MODELLED), final, truth, label)]


def stage(
    labels: Sequence[str], names: Sequence[str], location: Location, truth: FloatArray | None, evidence: str
) -> Report:
    """One stage of the report: residuals, mean position and, where it is known, the error."""
    fixes = location.fixes
    left = (fixes.residual + np.nan_to_num(fixes.common))[fixes.used]
    entry: Report = {
        "effects": list(labels),
        "evidence": evidence,
        "residual_rms": rms(left),
        "nis_per_dof": nis_per_dof(location),
        "position": np.nanmean(fixes.position, axis=0).tolist() if fixes.solved.any() else None,
        "dop": dop_entry(location),
    }
    if truth is not None:
        entry["position_error"] = position_error(fixes.position, truth)
    return entry


def nis_per_dof(location: Location) -> float:
    """Normalised squared residuals a degree of freedom: one where the weights are right."""
    fixes = location.fixes
    return float(np.nansum(fixes.sse) / max(int(fixes.redundancy[fixes.solved].sum()), 1))


def noise_entry(noise: RangeNoise, before: Location, after: Location, truth: FloatArray | None) -> Report:
    """The law of the ranges' errors that this log calls for, and what it does compared with the fixed one."""
    entry: Report = {
        "system": {SYSTEM_NAMES[letter]: noise.system[letter] for letter in after.clock_names},
        "elevation": noise.elevation,
        "strength": noise.strength,
        "ionosphere_ray": noise.ray,
        "ionosphere_field": noise.field,
        "nis_per_dof": {"fixed": nis_per_dof(before), "fitted": nis_per_dof(after)},
    }
    if truth is not None:
        errors = {"fixed": before, "fitted": after}
        entry["position_error"] = {name: position_error(one.fixes.position, truth) for name, one in errors.items()}
    return entry


def dop_entry(location: Location) -> Report:
    """Mean dilution of precision."""
    d = integrity.dilution(location.fixes, location.ranges.position, location.ranges.epoch, location.clock_group)
    names = {"gdop": d.geometric, "pdop": d.position, "hdop": d.horizontal, "vdop": d.vertical, "tdop": d.time}
    return {name: mean(value) for name, value in names.items()}


def held_out_error(ranges: Pseudoranges, mask: float, found: RangeTrace) -> Report:
    """Residuals of the last third of the time, by the plain model and by the effects that the ranges call for."""
    names = [c.name for c in found.called if c.satellite is None and not c.known_position]
    before = locate(ranges, (), mask=mask, exclude=False)
    after = locate(ranges, names, mask=mask, exclude=False, excluded=found.faulty)
    late = held_out_epochs(ranges)[ranges.epoch]

    def entry(location: Location) -> Report:
        rows = location.fixes.used & late
        left = location.fixes.residual + np.nan_to_num(location.fixes.common)
        return {"rms": rms(left[rows]), "unit": "m"}

    return {
        "held_out": True,
        "stream": "pseudorange",
        "same_names_on_fitting_part": found.same_on_fitting_part,
        "before": entry(before),
        "after": entry(after),
    }


def candidates(
    ranges: Pseudoranges, mask: float, found: RangeTrace, final: Location, noise: RangeNoise | None = None
) -> list[Report]:
    """What the ranges did not call for: statistic, the smallest size that would show, and where it moves the fix."""
    entries: list[Report] = []
    R = integrity.east_north_up(final.fixes.position)
    for s in found.left:
        rest = [name for name in MODELLED if name != s.name]
        without = locate(ranges, rest, mask=mask, exclude=False, excluded=~final.fixes.used, noise=noise)
        moved = np.einsum("nij,nj->ni", R, without.fixes.position - final.fixes.position)
        both = np.isfinite(moved).all(axis=1)
        shift = moved[both].mean(axis=0).tolist() if both.any() else None
        entries.append(
            {
                "name": s.name,
                "statistic": s.statistic / max(1.0, s.scatter),
                "dof": s.dof,
                "p_value": s.p_value,
                "beta": s.beta.tolist(),
                "std": s.std.tolist(),
                "detectable_from": s.detectable_from.tolist(),
                "moves_fix_enu": shift,
                "evidence": "ranges",
            }
        )
    return entries


def integrity_entry(location: Location) -> Report:
    """What could be checked, in how many epochs, and how well."""
    checks = location.integrity
    statements = [checks.statement(k) for k in range(len(checks.redundancy))]
    used = location.fixes.used
    return {
        "epochs": {text: statements.count(text) for text in dict.fromkeys(statements)},
        "alpha": integrity.ALPHA,
        "minimal_detectable_bias": mean(checks.mdb[used & np.isfinite(checks.mdb)]),
        "horizontal_protection_level": mean(checks.horizontal[np.isfinite(checks.horizontal)]),
        "vertical_protection_level": mean(checks.vertical[np.isfinite(checks.vertical)]),
    }


def excluded(location: Location, found: RangeTrace) -> list[Report]:
    """Satellites that were left out, and in how many epochs."""
    entries = []
    for reason, rows in (("fault", found.faulty), ("test", location.excluded & ~found.faulty)):
        names, counts = np.unique(location.ranges.satellite[rows], return_counts=True)
        entries += [
            {"satellite": name, "epochs": int(count), "reason": reason}
            for name, count in zip(names.tolist(), counts.tolist(), strict=True)
        ]
    return entries


def journal(ranges: Pseudoranges, location: Location) -> list[str]:
    """What was left out on the way, a line each."""
    unsolved = np.flatnonzero(~location.fixes.solved)
    lines = list(ranges.journal)
    if len(unsolved):
        at = calendar(ranges.week * WEEK + float(ranges.t[unsolved[0]]))
        lines.append(
            f"{ranges.where}: {len(unsolved)} epochs without a solution, the first at {at}: {reasons(location)}"
        )
    if (location.integrity.redundancy == 0).any():
        count = int((location.integrity.redundancy == 0).sum())
        lines.append(f"{ranges.where}: {count} epochs: {integrity.UNCHECKED}")
    return lines


def reasons(location: Location) -> str:
    """How many satellites the epochs without a solution have above the mask."""
    usable = np.bincount(location.ranges.epoch[location.fixes.used], minlength=len(location.ranges.t))
    there = np.bincount(location.ranges.epoch, minlength=len(location.ranges.t))
    unsolved = ~location.fixes.solved
    most = int(there[unsolved].max(initial=0)) if not usable[unsolved].any() else int(usable[unsolved].max())
    clocks = len(location.clock_names)
    return f"at most {most} usable satellites for position and clock ({clocks} receiver clocks in the recording)"


def dgps_entry(result: Differential, truth: FloatArray | None, base_position: FloatArray) -> Report:
    """The differential part of the report; the distance to the base is the known one where the rover's place is."""
    away = None if truth is None else mean(np.linalg.norm(truth - base_position, axis=1))
    age = np.abs(result.age[result.location.fixes.used])
    entry: Report = {
        "baseline": result.baseline if away is None else away,
        "age": {"mean": mean(age), "max": float(age.max()) if len(age) else None},
        "epochs": int(result.location.fixes.solved.sum()),
        "modelled": list(result.effects),
        "residual_rms": rms(result.location.fixes.residual[result.location.fixes.used]),
        "position": np.nanmean(result.location.fixes.position, axis=0).tolist(),
    }
    if truth is not None:
        entry["position_error"] = position_error(result.location.fixes.position, truth)
        entry["position_domain"] = {"position_error": position_error(result.by_position, truth)}
    return entry


def solution_table(location: Location) -> tuple[list[str], list[list[object]]]:
    """Names and rows of the fixes, one row an epoch that has one; NaN: not known."""
    fixes, checks = location.fixes, location.integrity
    lat, lon, height = pymap3d.ecef2geodetic(*fixes.position.T)
    count = np.bincount(location.ranges.epoch[fixes.used], minlength=len(location.ranges.t))
    d = integrity.dilution(fixes, location.ranges.position, location.ranges.epoch, location.clock_group)
    head = ["gps_week", "tow_s", "x_ecef_m", "y_ecef_m", "z_ecef_m", "latitude_deg", "longitude_deg", "height_m"]
    head += [f"clock_{name}_m" for name in location.clock_names]
    head += ["satellites", "hdop", "vdop", "horizontal_protection_m", "vertical_protection_m", "integrity"]
    rows: list[list[object]] = []
    for k in np.flatnonzero(fixes.solved).tolist():
        week, t = location.ranges.week, float(location.ranges.t[k])
        rows.append(
            [week + int(t // WEEK), t % WEEK, *fixes.position[k].tolist(), float(lat[k]), float(lon[k]),
             float(height[k]), *fixes.clock[k].tolist(), int(count[k]), float(d.horizontal[k]), float(d.vertical[k]),
             float(checks.horizontal[k]), float(checks.vertical[k]), checks.statement(k)]
        )  # fmt: skip
    return head, rows


#: Decimals of the columns of the fixes; of all others, 4.
_DECIMALS = {"tow_s": 7, "latitude_deg": 9, "longitude_deg": 9, "hdop": 3, "vdop": 3, "horizontal_protection_m": 2,
             "vertical_protection_m": 2}  # fmt: skip


def write_solution(path: Path | str, location: Location) -> None:
    """The fixes as CSV, one row an epoch that has one."""
    head, rows = solution_table(location)
    with new_file(Path(path)) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(head)
        for row in rows:
            writer.writerow([_written(name, value) for name, value in zip(head, row, strict=True)])


def _written(name: str, value: object) -> str:
    if not isinstance(value, float):
        return str(value)
    kept = not name.startswith(("clock", "horizontal", "vertical")) or np.isfinite(value)
    return f"{value:.{_DECIMALS.get(name, 4)}f}" if kept else ""


def rms(value: FloatArray) -> float | None:
    """Root mean square; None of nothing."""
    value = value[np.isfinite(value)]
    return float(np.sqrt(np.mean(value**2))) if len(value) else None


def mean(value: FloatArray) -> float | None:
    """Mean of the finite values; None of nothing."""
    value = value[np.isfinite(value)]
    return float(value.mean()) if len(value) else None


def finite(value: object) -> object:
    """The same with None for numbers that JSON does not have."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
