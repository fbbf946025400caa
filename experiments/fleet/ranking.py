"""Logs compared: which vehicle has how much of each effect, and what changed since its last log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sinan.experiments.report.trace_words import size_words
from sinan.experiments.report.verdict_words import reported

#: An effect has changed where its parameters moved by so many sigma of their difference, each by itself.
_CHANGED = 3.0


def fleet(documents: Sequence[Mapping[str, Any]], pages: Sequence[str]) -> dict[str, Any]:
    """Vehicles and effects, each ranked, as JSON.

    Parameters
    ----------
    documents : of `batch.run`, in the order of the logs
    pages : of each log
    """
    vehicles: dict[str, list[dict[str, Any]]] = {}
    for document, page in zip(documents, pages, strict=True):
        if document["why_not"] is None:
            logs = vehicles.setdefault(document["vehicle"], [])
            logs.append(_log(document, page, logs[-1] if logs else None))
    ranked = sorted(vehicles.items(), key=lambda one: (-one[1][-1]["explained"], one[0]))
    return {
        "format": 1,
        "logs": len(documents),
        "vehicles": [{"vehicle": vehicle, "logs": logs} for vehicle, logs in ranked],
        "effects": _by_effect(vehicles),
        "failed": [{"log": one["log"], "why": one["why_not"]} for one in documents if one["why_not"] is not None],
    }


def _log(document: Mapping[str, Any], page: str, before: Mapping[str, Any] | None) -> dict[str, Any]:
    """What is said of a log among the others."""
    error = document["error"]
    effects = [
        {
            "name": effect["name"], "beta": effect["beta"], "std": effect["std"], "unit": effect["unit"],
            "size": size_words(effect), "log10_p_value": effect["log10_p_value"],
            "change": _change(effect, before),
        }
        for effect in reported(document)
    ]  # fmt: skip
    names = {effect["name"] for effect in effects}
    return {
        "log": document["log"],
        "page": page,
        "verdict": document["verdict"],
        "headline": document["headline"],
        "explained": max(0.0, 1.0 - error["after"]["rms"] / error["before"]["rms"]) if effects else 0.0,
        "effects": effects,
        "gone": [] if before is None else [e["name"] for e in before["effects"] if e["name"] not in names],
    }


def _change(effect: Mapping[str, Any], before: Mapping[str, Any] | None) -> str:
    """What became of an effect since the last log of its vehicle: "", "new", "same", "more", "less" or "other"."""
    if before is None:
        return ""
    last = next((one for one in before["effects"] if one["name"] == effect["name"]), None)
    if last is None:
        return "new"
    if len(last["beta"]) != len(effect["beta"]) or last["unit"] != effect["unit"]:
        return "other"
    now, then = np.array(effect["beta"]), np.array(last["beta"])
    variance = sum(np.array([np.nan if s is None else s for s in one["std"]]) ** 2 for one in (effect, last))
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = np.abs(now - then) / np.sqrt(variance)
    if not np.any(moved > _CHANGED):
        return "same"
    sizes = np.linalg.norm(now), np.linalg.norm(then)
    along = float(now @ then) / max(float(sizes[0] * sizes[1]), 1e-300)
    return "other" if along < np.sqrt(0.5) else "more" if sizes[0] > sizes[1] else "less"


def _by_effect(vehicles: Mapping[str, Sequence[Mapping[str, Any]]]) -> list[dict[str, Any]]:
    """Each effect's vehicles by its size in the last log of each, the largest first; those without it are left out."""
    found: dict[str, list[dict[str, Any]]] = {}
    for vehicle, logs in vehicles.items():
        for effect in logs[-1]["effects"]:
            entry = {"vehicle": vehicle, "log": logs[-1]["log"], "page": logs[-1]["page"],
                     **{key: effect[key] for key in ("size", "unit", "change", "log10_p_value")},
                     "norm": float(np.linalg.norm(effect["beta"]))}  # fmt: skip
            found.setdefault(effect["name"], []).append(entry)
    for entries in found.values():
        entries.sort(key=lambda one: (one["unit"], -one["norm"], one["vehicle"]))
    order = sorted(found.items(), key=lambda one: (-len(one[1]), one[0]))
    return [{"name": name, "ranking": entries} for name, entries in order]
