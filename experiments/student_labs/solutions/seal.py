"""`python -m sinan.experiments.student_labs.solutions.seal`: the seals for practice anew, after a lab has changed."""

from __future__ import annotations

import json
from pathlib import Path

from sinan.experiments.student_labs import TITLES
from sinan.experiments.student_labs.files import practice_seals
from sinan.experiments.student_labs.lab import PRACTICE
from sinan.sensors.files import write_text


def main() -> None:
    """Write `practice.json`: for each lab the seals of each set of data."""
    rows = []
    for name in TITLES:
        each = ",\n".join(json.dumps(practice_seals(name, k)) for k in range(PRACTICE))
        rows.append(f"{json.dumps(name)}: [\n{each}\n]")
    write_text(Path(__file__).parents[1] / "practice.json", "{" + ",\n".join(rows) + "}\n")


if __name__ == "__main__":
    main()
