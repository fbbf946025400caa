"""Every number that decides something, and where it is from: read off the code and the comments beside it.

A comment belongs to a constant when it stands above it (`#:`) or behind it, or above the lines that it begins. What it
says of the origin is told by its words: *cited* (an author and a year, a standard, a data sheet), *measured* (a note, a
command, a simulation, a log), *derived* (a formula, or a reason with the number that it follows from), *stated risk* (a
level of a test), *bound of work* (checked by halving and doubling), *choice* (halved and doubled, with what it
changes); a comment that says only what the number is gives no origin. Each assignment has its own, not that of the line
above.
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDERS = ("estimator", "calibration", "experiments/residual_loop")
#: Modules whose numbers are bits and sizes of the machine, not of the question.
_MACHINE = ("engine_numba.py", "smoother_numba.py", "kernel_cache.py")
_RISK = re.compile(r"\bstated\s+risk\b")
#: "A choice" alone is none: the case, or the test, that puts it to the test is named.
_CHOICE = re.compile(r"\b[Aa] choice\b.*`(?:bounds_of_work \w+|test_\w+)`")
_WORK = re.compile(r"\bbounds? of work\b|bounds_of_work")
_CITED = re.compile(
    r"\b(19|20)\d\d\b|data ?sheet|standard(?! deviation| normal)|IS-GPS|WGS|RTCA|ISO"
    r"|Welsch|Cauchy|Huber|Baarda|the course|\bAP_\w+|EKF2_\w+|RTKLIB \d|OpenCV's"
)
_MEASURED = re.compile(
    r"docs/notes|docs/blind|python -m|\bsimulat|\bmeasured:|of \d[\d,]* (?:logs|cases|minutes|messages)|in logs"
    r"|of the logs|cases at",
    re.IGNORECASE,
)
#: Words alone derive nothing. A formula does, and a reason in which a number is said, in digits or as a word.
_FORMULA = re.compile(r"[<=>]|\bsqrt\(|\b\w+\.(?:ppf|isf|sf|cdf)\(|\blog\(|\d (?:[-+*/]|to the) \d")
_REASON = re.compile(r"\bbecause\b|\bso that\b|\bsince\b|\bof which\b")
_NUMBER = re.compile(
    r"\d|\b(?:one|two|three|four|five|six|seven|eight|nine|ten|half|third|quarter|fifth|tenth|twice|hundred)\b"
)

HEAD = """# Constants

Every number at the top of a module of {folders} that decides something: {total} of them. What is written beside it in
the code is its reason; the last column says of what sort that is, by the words of the comment:

- **cited**: an author and a year, a standard, a data sheet ({cited});
- **measured**: a note, a named command, a simulation, a log ({measured});
- **derived**: a formula, or a reason in which the number, or one that gives it, is said ({derived});
- **stated risk**: the level of a test, the share of false alarms that is accepted: a choice by its nature ({stated});
- **bound of work**: rounds, lengths of lists, steps of differences; `python -m
  sinan.experiments.benchmarks.bounds_of_work` halves and doubles each and shows what an answer does, where its
  case reaches it ({bound}; figures:
  [bounds of work](../notes/bounds_of_work.md));
- **choice**: nothing gives it; the same command, or a test that is named, shows what half and twice change, and the
  comment says it ({choice});
- **no origin**: the comment says what the number is and not why it is that one, or there is none ({none}).

The table is made whenever the site is built (`docs/make/constants_page.py`). The sort is told by a few patterns, so
that a comment's own words are what counts.
"""


@dataclass(frozen=True)
class Constant:
    """A number with a name, its text in the code, and the comment beside it."""

    module: str
    name: str
    value: str
    comment: str

    @property
    def origin(self) -> str:
        """Of what sort its reason is."""
        if _RISK.search(self.comment):
            return "stated risk"
        if _CHOICE.search(self.comment):
            return "choice"
        if _WORK.search(self.comment):
            return "bound of work"
        if _CITED.search(self.comment):
            return "cited"
        if _MEASURED.search(self.comment):
            return "measured"
        said = re.sub(r"\[[^]]*\]|`[^`]*`", "", self.comment)  # neither units nor names of code
        is_reason = _REASON.search(said) and _NUMBER.search(said)
        return "derived" if _FORMULA.search(said) or is_reason else "no origin"


def constants() -> list[Constant]:
    """All of them, module after module."""
    files = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py") if path.name not in _MACHINE)
    return [constant for path in files for constant in _of(path)]


def _of(path: Path) -> list[Constant]:
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    module = path.relative_to(ROOT).with_suffix("").as_posix()
    found: list[Constant] = []
    for node in ast.parse(text).body:
        target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
        value = getattr(node, "value", None)
        if target is None or value is None or not isinstance(node, (ast.Assign, ast.AnnAssign)):
            continue
        names = [target] if isinstance(target, ast.Name) else list(getattr(target, "elts", []))
        names = [one.id for one in names if isinstance(one, ast.Name)]
        if not names or not all(re.fullmatch(r"_?[A-Z][A-Z0-9_]+", name) for name in names) or not _is_number(value):
            continue
        comment = _comment(lines, node.lineno - 1, node.end_lineno or node.lineno)
        found.append(Constant(module, ", ".join(names), " ".join(ast.unparse(value).split()), comment))
    return found


def _is_number(value: ast.expr) -> bool:
    """Whether an expression holds a number and neither text nor a call of the project."""
    inside = list(ast.walk(value))
    constants = [node.value for node in inside if isinstance(node, ast.Constant)]
    numbers = [v for v in constants if isinstance(v, (int, float)) and not isinstance(v, bool)]
    texts = [v for v in constants if isinstance(v, str)]
    plain = not any(isinstance(node, (ast.Lambda, ast.comprehension, ast.Set)) for node in inside)
    plain = plain and not any(isinstance(node, ast.Name) and node.id == "slice" for node in inside)
    plain = plain and numbers != list(range(len(numbers)))  # names of cases, not sizes
    return bool(numbers) and plain and (not texts or isinstance(value, ast.Dict))


def _comment(lines: list[str], first: int, end: int) -> str:
    """What stands behind the assignment, or above it."""
    behind = [lines[i].split("  # ", 1)[1] for i in range(first, end) if "  # " in lines[i]]
    above: list[str] = []
    while first > 0 and lines[first - 1].startswith("#:"):
        first -= 1
        above.insert(0, lines[first][2:].strip())
    return " ".join([*above, *behind]).replace("fmt: skip", "").strip()


def page() -> str:
    """The head with its counts, then a table a folder."""
    found = constants()
    kinds = ("cited", "measured", "derived", "stated risk", "bound of work", "choice", "no origin")
    count = {kind.split()[0]: sum(c.origin == kind for c in found) for kind in kinds}
    folders = ", ".join(f"`{folder}`" for folder in FOLDERS)
    lines = [HEAD.format(total=len(found), none=count["no"], folders=folders, **count)]
    for module in dict.fromkeys(c.module for c in found):
        lines += [
            f"\n## `{module}.py`\n",
            "| constant | value | what the code says of it | origin |",
            "| --- | --- | --- | --- |",
        ]
        for c in (c for c in found if c.module == module):
            value = c.value if len(c.value) < 60 else c.value[:57] + "..."
            cells = (f"`{c.name}`", f"`{value}`", _plain(c.comment) or "-", c.origin)
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def _plain(text: str) -> str:
    """Without what Markdown would take for its own."""
    return re.sub(r"([*_<>\[\]$])", r"\\\1", text)
