"""What a Monte-Carlo study says, as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sinan.experiments.report.words import state_size


def summary(document: Mapping[str, Any]) -> str:
    """Averages against their intervals, errors against the filter's sigma, one a line."""

    def line(name: str, entry: Mapping[str, Any]) -> str:
        if entry["mean_per_dof"] is None:
            return f"  {name:12} no reading"
        low, high = entry["interval"]
        return f"  {name:12} {entry['mean_per_dof']:.3f}  {low:.3f} to {high:.3f}{remark(entry)}".rstrip()

    lines = [f"{document['scenario']}: {document['runs']} flights; 1 is a filter that knows how wrong it is"]
    lines.append(
        "squared error over its predicted variance, a state, at the end (NEES), and its 95 % interval about 1:"
    )
    lines.append(line("all states", document["nees"]["overall"]))
    lines += [line(name, entry) for name, entry in document["nees"]["blocks"].items()]
    lines.append("squared innovation over its predicted variance, a degree of freedom, whole flights (NIS):")
    lines += [line(name, entry) for name, entry in document["nis"].items()]
    lines.append("error at the end, RMS over the flights, and the sigma that the filter predicts:")
    lines += [
        f"  {name:12} {state_size(name, error)}, predicted {state_size(name, document['rms_sigma'][name])}"
        for name, error in document["rms_error"].items()
    ]
    normal = {"1": 68.3, "2": 95.4, "3": 99.7}
    shares = ", ".join(f"{k} sigma {100 * v:.1f} % ({normal[k]} %)" for k, v in document["coverage"].items())
    return "\n".join([*lines, f"errors within (expected): {shares}"])


def remark(entry: Mapping[str, Any]) -> str:
    """Whether an average lies outside its interval, and whether chance would do that to one of so many."""
    low, high = entry["interval"]
    if low <= entry["mean_per_dof"] <= high:
        return ""
    low, high = entry["family_interval"]
    return "  outside, as one in twenty is" if low <= entry["mean_per_dof"] <= high else "  outside: not by chance"
