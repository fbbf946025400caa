"""The table of the measured minutes, made from their JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sinan.estimator.evidence.score import DETECTABLE_LAMBDA
from sinan.experiments.blind.grade import REFUSED, SIGMAS
from sinan.experiments.blind.measured.draw import BEYOND, NOT_VISIBLE, OF_WANDER, PUT, SIZES, UNDONE, detectable
from sinan.experiments.blind.rates import count, shown
from sinan.experiments.report.words import number
from sinan.sensors.arrays import FloatArray

#: By "seed log" and effect, what is detectable of each component; None: nothing.
Sizes = Mapping[str, Mapping[str, Sequence[float | None]]]
#: What is detectable by the reports of the controls that later ones are held against: `detectable` of a `rates.json`.
REFERENCE = Path(__file__).with_name("detectable.json")
(
    RIGHT,
    RIGHT_ANY,
    RIGHT_TOLD,
    IN_CLASS,
    LOCAL,
    LOCAL_SEEN,
    LOCAL_TOLD,
    LOCAL_ANY,
    OUTLIERS,
    FURTHER,
    FURTHER_LEFT_OUT,
    LOST,
    BETA,
) = (
    "lasting, detectable by the control's own word: right name",
    "lasting, of any size: right name",
    f"lasting, told by the minute itself (more than {DETECTABLE_LAMBDA:g}): right name",
    "lasting, detectable: right name, or said to be confused with what is named",
    f"step or transient of {OF_WANDER:g} sigma or more of its stream's wander: right name",
    f"the same, seen by one who knows (2 log L grows by {DETECTABLE_LAMBDA:g}): right name",
    f"step or transient, told by the minute itself (more than {DETECTABLE_LAMBDA:g}): right name",
    "step or transient of any size: right name",
    "outliers: right name",
    "further names, that the control has not",
    "the same, rivals of what the control names left out",
    "names of the control that are gone",
    f"beta less the control's, within {SIGMAS:g} sigma",
)
OF_CONTROL, SIGMAS_OF_WANDER = (", ".join(f"{unit * size:g}" for size in SIZES) for unit in (1.0, OF_WANDER))
HEAD = f"""# Effects put into measured minutes

Written by `sinan blind OUT --measured --table docs/blind_measured.md`. A lively minute of a measured log; one thing
done to its readings by the formulas of [effects.md](effects.md), written out once more (`experiments/blind/measured`);
nothing declared. The untouched minute is the control, and what a log has that is beyond its label is in both.

- Log, effect, direction, interval and size are drawn whatever the tracer says. A lasting effect comes in sizes of
  {OF_CONTROL} times what the control's report says would be found, of the component that is seen best; in none
  that the report calls invisible, nor larger than a bad or badly mounted instrument has it
  (`experiments/blind/maker/catalogue.py`), nor where it undoes what the control names of the same effect: what is left
  of both would not be found.
- A step or transient comes in {SIGMAS_OF_WANDER} times the wander of its stream: the RMS distance of an error's
  mean over the length of the interval (at most a third of the minute) from that over as long before and after, of the
  readings about the motion that the log itself shows. None is larger than three plausible sizes
  (`sensors/effects/streams.py`).
- **gain**: growth of 2 log L of that minute when the very effect is put into the model, about its lambda if the noise
  is what the levels of the untouched minute say.
- **told**: the same of twice the log-posterior, the sizes of the noise sought without the effect in the model and with
  it: what there is to see where nobody knows the untouched minute. Less than nothing: the search has ended elsewhere.
- **reference**: what the reports of the same controls called detectable while white noise was all that the model had
  (`detectable.json`, made with the commit 2687d4c).
- Where the control names the effect too, its beta has to be nearer to that with what was put in than to the control's.
- Supply current and temperature are as logged, or drawn where a log has none, in control and minute alike.
- Intervals of 95 % (Clopper-Pearson).
"""


def rates(runs: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """By what is asked: k of n with its interval."""
    put = [r for r in runs if r["status"] == PUT]
    lasting = [r for r in put if r["lasting"]]
    visible = [r for r in lasting if r["size"] >= 1.0]
    outliers = [r for r in put if r["name"].endswith(".outliers")]
    offsets = [r for r in put if not r["lasting"] and r not in outliers]
    far = [r for r in offsets if r["size"] >= 1.0]
    z = [r["grade"]["z"] for r in put if r["grade"]["z"] is not None]
    return {
        RIGHT: _share(visible, "right"),
        RIGHT_ANY: _share(lasting, "right"),
        RIGHT_TOLD: _share(_told(lasting), "right"),
        IN_CLASS: _share(visible, "in_class"),
        LOCAL: _share(far, "right"),
        LOCAL_SEEN: _share([r for r in far if r["gain"] > DETECTABLE_LAMBDA], "right"),
        LOCAL_TOLD: _share(_told(far), "right"),
        LOCAL_ANY: _share(offsets, "right"),
        OUTLIERS: _share(outliers, "right"),
        FURTHER: _share(put, "further"),
        FURTHER_LEFT_OUT: _share(put, "further_left_out"),
        LOST: _share([r for r in put if r["grade"]["control"]], "lost"),
        BETA: count(sum(value < SIGMAS for value in z), len(z)),
    }


def _share(runs: Sequence[Mapping[str, Any]], key: str) -> dict[str, Any]:
    return count(sum(bool(r["grade"][key]) for r in runs), len(runs))


def _told(runs: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Those of which the minute itself tells enough."""
    return [r for r in runs if r["told"] > DETECTABLE_LAMBDA]


def key_of(control: Mapping[str, Any]) -> str:
    """A control among those of the reference: the minute goes with seed and log."""
    return f"{control['seed']} {control['log']}"


def sizes_of(controls: Sequence[Mapping[str, Any]]) -> Sizes:
    """What is detectable by the reports of controls; None: not at any size."""
    return {
        key_of(c): {n: [float(v) if np.isfinite(v) else None for v in d] for n, d in detectable(c["report"]).items()}
        for c in controls
    }


def against(controls: Sequence[Mapping[str, Any]], reference: Sizes) -> FloatArray:
    """(k,) detectable sizes over those of the reference, one for each effect of each log that both have: the median of
    its components; infinite where it was visible and is not, zero where it is only now.
    """
    ratios = []
    for control in controls:
        before = reference.get(key_of(control), {})
        for name, now in detectable(control["report"]).items():
            then = np.array(before.get(name, []), dtype=np.float64)
            then = np.where(np.isfinite(then), then, np.inf)
            if len(then) == len(now) and np.any(seen := np.isfinite(then) | np.isfinite(now)):
                with np.errstate(invalid="ignore"):
                    ratios.append(float(np.median(np.where(np.isfinite(then), now / then, 0.0)[seen])))
    return np.array(ratios)


def page(controls: Sequence[Mapping[str, Any]], runs: Sequence[Mapping[str, Any]]) -> str:
    """The whole page."""
    reference: Sizes = json.loads(REFERENCE.read_text(encoding="utf-8")) if REFERENCE.is_file() else {}
    states = {word: sum(r["status"] == word for r in runs) for word in (PUT, NOT_VISIBLE, BEYOND, UNDONE, REFUSED)}
    drawn = ", ".join(f"{n} {word}" for word, n in states.items() if n)
    seeds = ", ".join(sorted({str(r["seed"]) for r in runs}))
    lines = [HEAD, f"{len(runs)} draws of seed {seeds} from {len({r['log'] for r in runs})} logs: {drawn}.", ""]
    lines += ["| rate | |", "| --- | --- |"]
    lines += [f"| {what} | {shown(entry)} |" for what, entry in rates(runs).items()]
    lines += [f"| {what} | {value} |" for what, value in _values(controls, runs, reference).items()]
    lines += ["", "## Controls: nothing put in", "", "| log | from [s] | drawn | names | verdict | CPU s |"]
    lines += ["| --- " * 6 + "|", *(_control_row(c) for c in controls)]
    lines += [
        "",
        "## What is detectable by the controls' reports: component seen best, median over logs that show it",
        "",
    ]
    lines += ["| effect | detectable | logs that show it, of | in the reference |", "| --- " * 4 + "|"]
    lines += _detectable_rows(sizes_of(controls), reference)
    lines += ["", "## Minutes with an effect", "", "| log | put in | size | gain | told | named | further | lost | z |"]
    lines += ["| --- " * 9 + "|", *(_run_row(r) for r in runs if r["status"] == PUT)]
    failed = [r for r in runs if r["status"] == REFUSED] + [c for c in controls if c["report"]["verdict"] == REFUSED]
    lines += ["", "Not traced:", ""] if failed else []
    lines += [f"- {one['log']}: {one.get('why') or one['report']['why']}" for one in failed]
    return "\n".join([*lines, ""])


def _values(
    controls: Sequence[Mapping[str, Any]], runs: Sequence[Mapping[str, Any]], reference: Sizes
) -> dict[str, str]:
    """What is no rate."""
    ratio = against(controls, reference)
    pace = [r["grade"]["seconds"] for r in runs if r["status"] == PUT]
    named = sum(bool(c["report"]["effects"]) for c in controls)
    median = f"{np.median(ratio):.3g}  (of {len(ratio)})" if len(ratio) else "-"
    return {
        "controls with names": f"{named} of {len(controls)}",
        "detectable size over that of the reference, median over logs and effects": median,
        "CPU seconds a minute: median, largest": f"{np.median(pace):.3g}, {max(pace):.3g}" if pace else "-",
    }


def _control_row(control: Mapping[str, Any]) -> str:
    report = control["report"]
    names = ", ".join(effect["name"] for effect in report["effects"]) or "-"
    drawn = ", ".join(name.replace("_", " of ") for name in control["drawn"]) or "-"
    begin, seconds = f"{control['begin']:.0f}", f"{report['cpu_seconds']:.0f}"
    return f"| {control['log']} | {begin} | {drawn} | {names} | {report['verdict']} | {seconds} |"


def _detectable_rows(sizes: Sizes, reference: Sizes) -> list[str]:
    """Of each effect that a control asks for."""
    rows = []
    for name in sorted({name for of_log in sizes.values() for name in of_log}):
        now, before = _best(name, sizes), _best(name, {key: reference[key] for key in sizes if key in reference})
        shows = f"{int(np.sum(np.isfinite(now)))}, {len(now)}"
        rows.append(f"| {name} | {_median(now)} | {shows} | {_median(before)} |")
    return rows


def _best(name: str, sizes: Sizes) -> FloatArray:
    """(k,) smallest detectable component in each log that asks for an effect; infinite where none is."""
    asked = [of_log[name] for of_log in sizes.values() if name in of_log]
    return np.array([min((v for v in values if v is not None), default=np.inf) for values in asked])


def _median(values: FloatArray) -> str:
    seen = values[np.isfinite(values)]
    return number(float(np.median(seen))) if len(seen) else "-"


def _run_row(run: Mapping[str, Any]) -> str:
    grade = run["grade"]
    z = "-" if grade["z"] is None else f"{grade['z']:.1f}"
    named = "yes" + (", as in the control" if grade["known"] else "") if grade["right"] else "no"
    further, lost = (", ".join(grade[key]) or "-" for key in ("further", "lost"))
    beta = ", ".join(number(b) for b in run["beta"])
    put = f"{run['name']} {beta}"
    gain, told = ("-" if run[key] is None else number(run[key]) for key in ("gain", "told"))
    return f"| {run['log']} | {put} | {run['size']:g} | {gain} | {told} | {named} | {further} | {lost} | {z} |"
