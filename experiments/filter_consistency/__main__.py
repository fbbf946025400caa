"""python -m sinan.experiments.filter_consistency errors|flights|heading|hover [--runs N] [--seed S] [--json FILE]"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from sinan.experiments.filter_consistency import errors, flights, heading
from sinan.experiments.report.console import progress
from sinan.experiments.report.files import write_json

Progress = Callable[[int, int], None]


def _errors(runs: int, seed: int, step: Progress) -> tuple[dict[str, Any], str]:
    document = errors.study(runs, seed, step)
    return document, errors.table(document)


def _flights(runs: int, seed: int, step: Progress) -> tuple[dict[str, Any], str]:
    document = flights.report(flights.fly(runs, seed, progress=step))
    return document, flights.table(document)


def _heading(runs: int, seed: int, step: Progress) -> tuple[dict[str, Any], str]:
    document = heading.study(runs, seed, step)
    return document, heading.table(document)


def _hover(runs: int, seed: int, step: Progress) -> tuple[dict[str, Any], str]:
    document = heading.hover_study(runs, seed, step)
    return document, heading.table(document)


STUDIES = {"errors": (_errors, 100), "flights": (_flights, 200), "heading": (_heading, 40), "hover": (_hover, 40)}


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    """Run one study and print its table."""
    parser = argparse.ArgumentParser(prog="python -m sinan.experiments.filter_consistency", description=__doc__)
    parser.add_argument("study", choices=list(STUDIES))
    parser.add_argument("--runs", type=int, help="flights: in all; others: of each row")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args(arguments)
    study, usual = STUDIES[chosen.study]
    with progress(chosen.study) as step:
        document, text = study(chosen.runs or usual, chosen.seed, lambda done, total: step("", done, total))
    print(text)
    if chosen.json is not None:
        write_json(chosen.json, document)
    return document


if __name__ == "__main__":
    main()
