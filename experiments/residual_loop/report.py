"""What the loop found in a recording, as the JSON of its report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np

from sinan.estimator.evidence.budget import Budget
from sinan.estimator.evidence.score import Statistic
from sinan.estimator.evidence.source import LocalFinding
from sinan.estimator.evidence.term import Term
from sinan.experiments.residual_loop.judged import Judged
from sinan.experiments.residual_loop.prove import Change, Errors
from sinan.experiments.residual_loop.traced import Part, Traced
from sinan.experiments.residual_loop.trials import Finding
from sinan.experiments.residual_loop.verdict import Named, Twin, Verdict
from sinan.sensors.arrays import finite_or_none


def report(traced: Traced) -> dict[str, object]:
    """The trace as the JSON of the report."""
    verdict = traced.verdict
    shown = next(part for part in traced.parts if part.trace.verdict.proof.stream == verdict.proof.stream)
    others = traced.judged
    colour = any(item.kind == "colour" for item in verdict.remaining)
    proof = verdict.proof
    return {
        "format": 1,
        "recording": traced.name,
        "alpha": traced.alpha,
        "p_value_needed": traced.alpha / max(traced.families, 1),
        "verdict": verdict.word,
        "effects": [_named(traced.part_of(one), one) for one in verdict.effects],
        "error": _error(shown, verdict),
        "consistency": {"nis_before": proof.nis_before, "nis_after": proof.nis_after, "white_after": not colour},
        "candidates": [entry for part in traced.parts for entry in _candidates_of(part, others)],
        "remaining": [
            {
                "stream": r.stream,
                "kind": r.kind,
                "excess": finite_or_none(r.excess),
                "follows": r.follows,
                "p_value": r.p_value,
                "what": r.what,
            }
            for r in verdict.remaining
        ],
        "budget": [asdict(one) for part in traced.parts for one in _budget(part)],
        "rolled_back": list(verdict.rolled_back),
        "separates": verdict.separates,
        "twins": [_twin(shown, twin, verdict.reference) for twin in verdict.twins],
        "sensors": [
            {"sensor": part.sensor, "error": _error(part, part.trace.verdict)}
            for part in traced.parts
            if len(traced.parts) > 1
        ],
        "left_out": [{"sensor": sensor, "why": why} for sensor, why in traced.left_out],
    }


def _budget(part: Part) -> Sequence[Budget]:
    """Of the model that is reported."""
    return part.source.budget(part.trace.selection.plain, part.trace.final)


def _error(part: Part, verdict: Verdict) -> dict[str, object]:
    """Errors before and after of the model that is reported of a part."""
    proof = verdict.proof
    return {
        "held_out": True,
        "stream": proof.stream,
        "same_names_on_fitting_part": verdict.same_names,
        "before": _errors(proof.before),
        "after": _errors(proof.after),
        "in_sample": {
            "before": {"sse": proof.in_sample_before.sse, "rms": proof.in_sample_before.rms},
            "after": {"sse": proof.in_sample_after.sse, "rms": proof.in_sample_after.rms},
        },
        "untested": [term.name for term in proof.untested],
        "truth": _before_after(verdict.truth, verdict.reference),
        "truth_held_out": _before_after(verdict.truth_held_out, verdict.reference),
        "held_out_part": held_out_part(part),
    }


def _candidates_of(part: Part, others: Sequence[Judged]) -> list[dict[str, object]]:
    longest = _duration(part)
    lasting = [_candidate(part, s, others, longest) for s in _candidates(part)]
    return lasting + [_local_candidate(found, others) for found in part.trace.selection.plain_local]


def _candidates(part: Part) -> list[Statistic]:
    """Statistics about the plain model; the detectable size of what was not found, about the final one."""
    selection = part.trace.selection
    final = {s.name: s for s in part.source.detectable(selection.final, selection.final_statistics)}
    return [replace(s, detectable_from=final.get(s.name, s).detectable_from) for s in selection.plain_statistics]


def _before_after(
    pair: tuple[Mapping[str, float], Mapping[str, float]] | None, reference: Mapping[str, object] | None
) -> dict[str, object] | None:
    return None if pair is None else {**(reference or {}), "before": dict(pair[0]), "after": dict(pair[1])}


#: What is held out where readings are withheld.
PREDICTED = "withheld seconds"


def held_out_part(part: Part) -> str:
    """Which part of the data took no part in the fit, in words."""
    if part.source.is_predicting:
        return PREDICTED
    held = part.source.residuals(part.trace.selection.plain)[0].held_out
    stretches = int(np.sum(np.diff(held.astype(int)) == 1)) + int(held[0])
    share = "third" if np.mean(held) > 0.25 else "fifth"
    return f"last {share}" if stretches == 1 and held[-1] else f"held-out {share}"


def _clock(part: Part) -> tuple[bool, float]:
    """Whether the "time" of the readings is their number, in a log without time stamps; what it shows where words count
    from.
    """
    residuals = part.source.residuals(part.trace.selection.plain)
    return all(r.counted for r in residuals), residuals[0].zero


def _duration(part: Part) -> float:
    """How long the readings last, which no time that they show exceeds [s]; without time stamps infinite."""
    residuals = part.source.residuals(part.trace.selection.plain)
    t = np.concatenate([r.t for r in residuals])
    return float("inf") if all(r.counted for r in residuals) else float(np.ptp(t))


def _named(part: Part, named: Named) -> dict[str, object]:
    """An effect, and what it does to the held-out error."""
    held = named.contribution
    error = None if held is None else _change(held.error)
    return {**_effect(part, named.finding), "predicts": named.predicts, "held_out": error}


def _twin(part: Part, twin: Twin, reference: Mapping[str, object] | None) -> dict[str, object]:
    return {
        **_named(part, twin.named),
        "errors": [_change(one) for one in twin.errors],
        "truth": _before_after(twin.truth, reference),
        "truth_held_out": _before_after(twin.truth_held_out, reference),
    }


def _change(error: Change) -> dict[str, object]:
    return {"stream": error.stream, "unit": error.unit, "before": error.before, "after": error.after}


def _effect(part: Part, finding: Finding) -> dict[str, object]:
    entry = finding.term.effect
    size, units = part.source.field.of(entry)
    interval = finding.term.interval
    is_count, zero = _clock(part)
    return {
        "name": finding.term.name,
        "beta": [float(size * b) for b in finding.beta],
        "std": [finite_or_none(size * s) for s in finding.std],
        "unit": list(units),
        "parameters": [p.name for p in entry.parameters],
        "p_value": float(np.exp(finding.log_p)),
        "log10_p_value": finding.log_p / float(np.log(10.0)),
        "lambda": max(finding.information, 0.0),
        "confused_with": list(finding.confused_with),
        "at_least": finding.at_least,
        "interval": None if interval is None else [float(interval[0]), float(interval[1])],
        "interval_after_first": None if interval is None else [float(t) - zero for t in interval],
        "interval_unit": "reading" if is_count else "s",
        "satellite": finding.term.satellite,
        "summary": entry.opposite if entry.is_opposite(finding.beta) else entry.summary,
    }


def _errors(errors: Errors) -> dict[str, object]:
    return {
        "rms": errors.rms,
        "unit": errors.unit,
        "nis_per_dof": errors.nis_per_dof,
        "interval": list(errors.interval),
    }


def _candidate(part: Part, s: Statistic, others: Sequence[Judged], longest: float) -> dict[str, object]:
    entry = Term(s.name).effect
    size, units = part.source.field.of(entry)
    sizes = zip(size * s.detectable_from, units, strict=True)
    return {
        "name": s.name,
        "parameters": [p.name for p in entry.parameters],
        "unit": list(units),
        "statistic": s.statistic,
        "dof": s.dof,
        "p_value": s.p_value,
        "scatter": s.scatter,
        "detectable_from": [None if unit == "s" and d > longest else finite_or_none(d) for d, unit in sizes],
        **_judgement(s.name, [one for one in others if one.term.interval is None]),
    }


def _local_candidate(found: LocalFinding, others: Sequence[Judged]) -> dict[str, object]:
    interval = found.term.interval
    return {
        "name": found.term.name,
        "statistic": found.statistic,
        "dof": found.dof,
        "p_value": float(np.exp(found.log_p)),
        "interval": None if interval is None else [float(interval[0]), float(interval[1])],
        "detectable_from": [],
        **_judgement(found.term.name, [one for one in others if (one.term.interval is None) == (interval is None)]),
    }


def _judgement(name: str, others: Sequence[Judged]) -> dict[str, object]:
    """How a candidate that was not found was judged in the end: null where it was found, or could not be seen."""
    own = next((one for one in others if one.term.name == name), None)
    return {
        "judged_log10_p_value": None if own is None else own.log_p / float(np.log(10.0)),
        "refused": "" if own is None else own.why,
    }
