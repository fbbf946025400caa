"""Does one half of a log name what the other names?

    python -m sinan.experiments.benchmarks.replication [LOG ...] [--longest S] [--keep DIR] [--table FILE]

What is in an instrument is in both halves of its log; what a tracer made up is not. Each half is traced by itself. A
lasting effect that one half names is visible in the other where that one's report says so: some component of beta is
at least what it calls detectable, and then its predicted lambda is above 30.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sinan.estimator.evidence.score import DETECTABLE_LAMBDA
from sinan.experiments.benchmarks.halves import Halves, Reports, logs_of, parsed, tell, written
from sinan.experiments.blind.grade import SIGMAS, Named, deviation, effects_of
from sinan.experiments.blind.maker.catalogue import CATALOGUE
from sinan.experiments.blind.measured.draw import detectable
from sinan.experiments.blind.rates import count, shown
from sinan.experiments.report.words import number
from sinan.sensors.arrays import FloatArray

HEAD = """# Names of one half of a log in the other

Written by `python -m sinan.experiments.benchmarks.replication`. Each half of a log is traced by itself; lasting effects
alone. **visible**: the report of the other half calls a component of beta detectable (predicted lambda above 30, of
which the figure is a lower bound). **z**: difference of the two betas in sigma of both, as a normal number. What
**does not occur** is larger than a bad or badly mounted instrument has it (`experiments/blind/maker/catalogue.py`).
"""


@dataclass(frozen=True)
class Replicated:
    """A lasting effect that one half of a log names.

    Attributes
    ----------
    log, name : of the effect
    half : that names it, 0 or 1
    beta : its estimate
    information : lower bound of its predicted lambda in the other half; NaN where that half names it too
    visible : whether the other half could show it
    again : whether the other half names it
    z : difference of the betas in sigma; None where it is not named again, or has no sigma
    """

    log: str
    name: str
    half: int
    beta: FloatArray
    information: float
    visible: bool
    again: bool
    z: float | None

    @property
    def occurs(self) -> bool:
        """Whether instruments have it of that size and sign: up to the upper bound that the blind maker draws.

        Of sizes that go with the field, which a report does not say, all do.
        """
        entry = CATALOGUE.get(self.name)
        if entry is None or entry.of_field:
            return True
        return bool(np.linalg.norm(self.beta) <= entry.high and not (entry.positive and np.any(self.beta < 0.0)))


def replicated(log: str, reports: Reports) -> list[Replicated]:
    """The lasting names of each half, sought in the other."""
    found = []
    for half in (0, 1):
        own, other = lasting(reports[half]), lasting(reports[1 - half])
        for name, one in own.items():
            again, z, information = other.get(name), None, np.nan
            if again is not None:
                z = deviation(one[2], again[2], np.hypot(one[3], again[3]))
            else:
                information = least_lambda(one, reports[1 - half])
            visible = again is not None or information > DETECTABLE_LAMBDA
            found.append(Replicated(log, name, half, one[2], information, visible, again is not None, z))
    return found


def lasting(report: Mapping[str, Any]) -> dict[str, Named]:
    """The lasting effects that a report names."""
    found = [one for one in effects_of(report) if one[1] is None and not one[0].endswith(".outliers")]
    return {one[0]: one for one in found}


def least_lambda(one: Named, report: Mapping[str, Any]) -> float:
    """Lower bound of beta' Lambda beta by what a report calls detectable.

    Of a component, the others free, lambda is 30 (beta_i / d_i)^2, and a quadratic form is no less than any of its own.
    """
    least = detectable(report).get(one[0])
    return 0.0 if least is None else float(DETECTABLE_LAMBDA * np.max(np.abs(one[2]) / least, initial=0.0) ** 2)


def page(rows: Sequence[Replicated], logs: str) -> str:
    """The table, with its rates.

    Parameters
    ----------
    logs : those that were asked, in words
    """
    visible = [row for row in rows if row.visible]
    again, z = sum(row.again for row in visible), [row.z for row in rows if row.half == 0 and row.z is not None]
    alike, large = (count(sum(holds), len(holds)) for holds in ([v < SIGMAS for v in z], [not r.occurs for r in rows]))
    lines = [HEAD, f"{len(rows)} names in the halves of {logs}", ""]
    lines += ["| rate | |", "| --- | --- |"]
    lines += [f"| visible in the other half: named there | {shown(count(again, len(visible)))} |"]
    lines += [f"| named in both: betas alike within {SIGMAS:g} sigma | {shown(alike)} |"]
    lines += [f"| of a size that does not occur | {shown(large)} |"]
    lines += ["", "| log | effect | in half | beta | lambda in the other | named there | z |", "| --- " * 7 + "|"]
    return "\n".join([*lines, *(_row(row) for row in rows), ""])


def _row(row: Replicated) -> str:
    information = "-" if row.again else f"{row.information:.0f}"
    again = "yes" if row.again else "no" if row.visible else "not visible"
    z, half = "-" if row.z is None else f"{row.z:.1f}", ("first", "second")[row.half]
    beta = ", ".join(number(b) for b in row.beta) + ("" if row.occurs else " (does not occur)")
    return f"| {row.log} | {row.name} | {half} | {beta} | {information} | {again} | {z} |"


def rows_of(asked: Sequence[Halves]) -> Iterator[Replicated]:
    """Every log in turn."""
    for halves in asked:
        tell(halves.log)
        yield from replicated(halves.log, halves.reports)


def main(arguments: Sequence[str]) -> str:
    """Trace, compare, print; write the page where asked to."""
    asked, table = parsed(arguments, __doc__)
    return written(page(list(rows_of(asked)), logs_of(asked)), table)


if __name__ == "__main__":
    main(sys.argv[1:])
