"""Sensor models with one mistake each, and whether a test notices.

    python -m tests.mutants                         every mutant of every model and effect; docs/notes/mutants.md
    python -m tests.mutants laser sonar             of some models
    python -m tests.mutants --sample 40 --seed 1    a part, as the suite runs it
    python -m tests.mutants laser --list            what would be tried

A mutant is a model's file in which one term is dropped, one sign turned, one condition taken out or one function left
out. The tests of `TARGETS` run on it, and the first that fails has killed it. A mutant that lives is a sentence of the
model that no test reads, or it is the same model written otherwise: then `tests/mutants_equivalent.toml` says why.

Each mutant runs in a process of its own, forked from one that has read NumPy, SciPy and pytest but nothing of ours.
"""

from __future__ import annotations

import argparse
import ast
import copy
import os
import random
import signal
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
EQUIVALENT = Path(__file__).with_name("mutants_equivalent.toml")
#: A mutant whose tests have not ended by then is dead: one that loops is noticed by whoever runs it [s].
PATIENCE = 60.0

_CONTRACTS = ("tests/contracts/test_sensors.py", "tests/contracts/test_effects_by_another_hand.py")
_GNSS = ("tests/sensors/test_pseudorange.py", "tests/sensors/test_dgps.py", "tests/estimator/test_point_positioning.py")
#: File of a model -> the tests that are to notice, the likeliest first
TARGETS: dict[str, tuple[str, ...]] = {
    "accelerometer": _CONTRACTS,
    "gyroscope": _CONTRACTS,
    "magnetometer": ("tests/sensors/test_magnetometer.py", *_CONTRACTS),
    "sonar": ("tests/sensors/test_sonar.py", *_CONTRACTS),
    "barometer": _CONTRACTS,
    "laser": ("tests/sensors/test_laser.py", *_CONTRACTS),
    "ranging": ("tests/sensors/test_laser.py", "tests/sensors/test_sonar.py", *_CONTRACTS),
    "gps": _CONTRACTS,
    "level": _CONTRACTS,
    "lenses": ("tests/sensors/test_camera.py",),
    "camera": ("tests/sensors/test_camera.py", "tests/sensors/test_camera_effects.py", *_CONTRACTS),
    "bounds": ("tests/sensors/test_bounds.py",),
    "zero_rate": ("tests/estimator/test_zero_rate.py",),
    "noise": ("tests/sensors/test_noise.py", *_CONTRACTS),
    "atmosphere": ("tests/sensors/test_atmosphere.py", "tests/sensors/test_sonar.py"),
    "pseudorange": ("tests/sensors/test_pseudorange_model.py", *_GNSS),
    "dgps": ("tests/sensors/test_dgps_model.py", *_GNSS),
}

_EFFECTS = ("tests/contracts/test_effects_by_another_hand.py", "tests/contracts/test_effects.py")
#: By the first part of a file's name, where it is not the effects' own tests that are to notice
_ELSEWHERE = {
    "pseudorange": tuple(f"tests/sensors/test_pseudorange{part}.py" for part in ("_effects", "", "_model")),
    "camera": ("tests/sensors/test_camera_effects.py",),
}
TARGETS |= {
    f"effects.{path.stem}": _ELSEWHERE.get(path.stem.split("_")[0], _EFFECTS)
    for path in sorted((ROOT / "sensors" / "effects").glob("*.py"))
    if path.stem not in ("__init__", "declaration", "streams", "outliers")
}

#: Functions whose call is left out, its first argument staying
_LEFT_OUT = {"abs", "clip", "exp", "log", "maximum", "minimum", "nan_to_num", "sqrt", "max", "min"}
#: Functions that stand for each other
_SWAPPED = {"sin": "cos", "cos": "sin", "rotate": "rotate_back", "rotate_back": "rotate", "maximum": "minimum",
            "minimum": "maximum", "left": "right", "right": "left"}  # fmt: skip
_TURNED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One mistake in one file.

    Attributes
    ----------
    model : a key of `TARGETS`
    place : function that it is in, with its class
    line : of the file
    what : before -> after
    node, put : number of the node in the file's walk, and what comes in its place
    """

    model: str
    place: str
    line: int
    what: str
    node: int
    put: ast.AST

    @property
    def name(self) -> str:
        """By which `mutants_equivalent.toml` calls it: without the line, which moves."""
        return f"{self.model}.{self.place}: {self.what}"

    def tree(self) -> ast.Module:
        """The file with the mistake in it."""
        tree = parsed(self.model)
        target = list(ast.walk(tree))[self.node]
        for parent in ast.walk(tree):
            for field, value in ast.iter_fields(parent):
                if value is target:
                    setattr(parent, field, copy.deepcopy(self.put))
                elif isinstance(value, list) and any(entry is target for entry in value):
                    value[:] = [copy.deepcopy(self.put) if entry is target else entry for entry in value]
        return ast.fix_missing_locations(tree)


def file_of(model: str) -> Path:
    """Where a model is written."""
    return ROOT / "sensors" / f"{model.replace('.', '/')}.py"


def parsed(model: str) -> ast.Module:
    """The file of a model."""
    return ast.parse(file_of(model).read_text(encoding="utf-8"))


def mutants(model: str) -> list[Mutant]:
    """Every mutant of a model, in the order of its file."""
    tree = parsed(model)
    places = {node: where for node, *where in _places(tree)}
    around = {child: node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)}
    found = []
    for number, node in enumerate(ast.walk(tree)):
        if node in places:
            place, gives_numbers = places[node]
            for put in _replacements(node, gives_numbers):
                before, after = (_shown(entry) for entry in (node, put))
                if before != after:
                    context = f" in {_shown(around[node])}" if isinstance(node, ast.Constant) else ""
                    line = getattr(node, "lineno", 0)
                    found.append(Mutant(model, place, line, f"{before} -> {after}{context}", number, put))
    return sorted(found, key=lambda mutant: mutant.line)


def _places(tree: ast.Module) -> Iterator[tuple[ast.AST, str, bool]]:
    """The nodes that say something of the model, no annotation, text or error; the function that they are in, and
    whether that returns numbers, whose sign can be turned.
    """

    def inside(node: ast.AST, place: str, gives_numbers: bool) -> Iterator[tuple[ast.AST, str, bool]]:
        yield node, place, gives_numbers
        for field, value in ast.iter_fields(node):
            if field in ("annotation", "returns", "decorator_list") or isinstance(node, ast.Raise | ast.JoinedStr):
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from inside(child, place, gives_numbers)

    def walk(node: ast.AST, path: str) -> Iterator[tuple[ast.AST, str, bool]]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef):
                returns = "" if child.returns is None else ast.unparse(child.returns)
                yield from inside(child, f"{path}{child.name}", "FloatArray" in returns or returns == "float")
            elif isinstance(child, ast.ClassDef):
                yield from walk(child, f"{path}{child.name}.")
            elif path and isinstance(child, ast.AnnAssign) and child.value is not None:
                yield from inside(child.value, path.rstrip("."), False)  # the default of an attribute

    yield from walk(tree, "")


def _shown(node: ast.AST) -> str:
    """The node on one line; of an `if` its condition."""
    if isinstance(node, ast.If):
        return f"if {_shown(node.test)}"
    text = " ".join(ast.unparse(ast.fix_missing_locations(copy.deepcopy(node))).split())
    return text if len(text) <= 140 else f"{text[:90]} ... {text[-45:]}"


def _replacements(node: ast.AST, gives_numbers: bool) -> Iterator[ast.AST]:
    """What may come in the place of a node.

    Parameters
    ----------
    gives_numbers : the function returns numbers
    """
    match node:
        case ast.BinOp():
            yield from _of_two_terms(node)
        case ast.expr():
            yield from _of_expressions(node)
        case ast.stmt():
            yield from _of_statements(node, gives_numbers)


def _of_two_terms(node: ast.BinOp) -> Iterator[ast.AST]:
    """One term alone, or the other sign or power."""
    match node:
        case ast.BinOp(left, ast.Add(), right):
            yield from (left, right, ast.BinOp(left, ast.Sub(), right))
        case ast.BinOp(left, ast.Sub(), right):
            yield from (left, _minus(right), ast.BinOp(left, ast.Add(), right))
        case ast.BinOp(left, ast.Mult(), right) | ast.BinOp(left, ast.BitAnd() | ast.BitOr(), right):
            yield from (left, right)
        case ast.BinOp(left, ast.Div() | ast.FloorDiv(), right):
            yield from (left, ast.BinOp(ast.Constant(1.0), ast.Div(), right), ast.BinOp(left, ast.Mult(), right))
        case ast.BinOp(left, ast.Pow(), _):
            yield left


def _of_expressions(node: ast.expr) -> Iterator[ast.AST]:
    """What is not negated, one condition fewer, the other case, the other sign, an entry fewer."""
    match node:
        case ast.UnaryOp(ast.USub() | ast.Not() | ast.Invert(), operand):
            if not (isinstance(operand, ast.Constant) and isinstance(operand.value, int)):  # an axis, an index
                yield operand
        case ast.BoolOp(op, values):
            for k in range(len(values)):
                rest = values[:k] + values[k + 1 :]
                yield ast.BoolOp(op, rest) if len(rest) > 1 else rest[0]
        case ast.Compare(left, [op], [right]) if type(op) in _TURNED:
            yield ast.Compare(left, [_TURNED[type(op)]()], [right])
        case ast.IfExp(_, body, orelse):
            yield from (body, orelse)
        case ast.Constant(value) if isinstance(value, float):
            yield ast.Constant(-value if value else 1.0)
        case ast.Call(function, arguments, keywords):
            yield from _calls(function, arguments, keywords)
        case ast.Dict(keys, values):
            for k in range(len(values)):
                yield ast.Dict(keys[:k] + keys[k + 1 :], values[:k] + values[k + 1 :])
                yield ast.Dict(keys, [*values[:k], _minus(values[k]), *values[k + 1 :]])


def _of_statements(node: ast.stmt, gives_numbers: bool) -> Iterator[ast.AST]:
    """A branch always or never taken, a value that is not assigned or returned with the other sign."""
    match node:
        case ast.If(_, body, orelse):
            yield from (ast.If(ast.Constant(value), body, orelse) for value in (True, False))
        case ast.Assign([ast.Subscript() as target], value):
            yield ast.Pass()
            yield ast.Assign([target], _minus(value))
        case ast.AugAssign(target, op, value):
            yield ast.Pass()
            if isinstance(op, ast.Add | ast.Sub):
                yield ast.AugAssign(target, ast.Sub() if isinstance(op, ast.Add) else ast.Add(), value)
        case ast.Return(ast.Tuple(parts)) if gives_numbers:
            for k in range(len(parts)):
                yield ast.Return(ast.Tuple([*parts[:k], _minus(parts[k]), *parts[k + 1 :]], ast.Load()))
        case ast.Return(value) if gives_numbers and not isinstance(value, ast.Dict | ast.Name | None):
            yield ast.Return(_minus(value))


def _minus(node: ast.expr) -> ast.expr:
    return node.operand if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) else ast.UnaryOp(
        ast.USub(), node
    )  # fmt: skip


def _calls(function: ast.expr, arguments: list[ast.expr], keywords: list[ast.keyword]) -> Iterator[ast.AST]:
    name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
    if name == "where" and len(arguments) == 3:
        yield from arguments[1:]
    if name in _LEFT_OUT and arguments:
        yield from arguments[:1] if name != "maximum" and name != "minimum" else arguments[:2]
    if name in _SWAPPED:
        other = copy.deepcopy(function)
        setattr(other, "attr" if isinstance(other, ast.Attribute) else "id", _SWAPPED[name])
        yield ast.Call(other, arguments, keywords)


@dataclass(frozen=True)
class Fate:
    """What became of a mutant: the test that killed it, or nothing; and how long it took [s]."""

    mutant: Mutant
    killed_by: str
    seconds: float


class _Instead(MetaPathFinder):
    """Reads the mutant where its model is imported."""

    def __init__(self, mutant: Mutant) -> None:
        self._module, self._path, self._tree = f"sinan.sensors.{mutant.model}", file_of(mutant.model), mutant.tree()

    def find_spec(self, fullname: str, path: object = None, target: object = None) -> ModuleSpec | None:
        if fullname != self._module:
            return None
        loader = SourceFileLoader(fullname, str(self._path))
        loader.get_code = lambda name: compile(self._tree, str(self._path), "exec")  # type: ignore[method-assign,assignment]
        return spec_from_file_location(fullname, self._path, loader=loader)


class _FirstFailure:
    """Of a pytest run: the test that failed first."""

    def __init__(self) -> None:
        self.name = ""

    def pytest_runtest_logreport(self, report: object) -> None:
        if getattr(report, "failed", False) and not self.name:
            self.name = str(getattr(report, "nodeid", ""))

    def pytest_collectreport(self, report: object) -> None:
        self.pytest_runtest_logreport(report)


def fate(mutant: Mutant | None, tests: Sequence[str]) -> tuple[str, float]:
    """The test that kills a mutant, "" if it lives, and the time it took [s]; None: the file as it is."""
    began = time.monotonic()
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        try:
            os.write(writing, _run(mutant, tests).encode())
        finally:
            os._exit(0)
    os.close(writing)
    signal.signal(signal.SIGALRM, lambda *_: os.kill(child, signal.SIGKILL))
    signal.setitimer(signal.ITIMER_REAL, PATIENCE)
    with os.fdopen(reading, encoding="utf-8") as pipe:
        said = pipe.read()
    os.waitpid(child, 0)
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    killed_by = said.strip() if said else f"no end within {PATIENCE:.0f} s, or the end of the process"
    return killed_by, time.monotonic() - began


def _run(mutant: Mutant | None, tests: Sequence[str]) -> str:
    """The tests in a forked process: what failed first, or a blank line."""
    import pytest

    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.dup2(silence, 2)
    if mutant is not None:
        sys.meta_path.insert(0, _Instead(mutant))
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    failure = _FirstFailure()
    status = pytest.main(["-x", "-q", "-p", "no:cacheprovider", *tests], plugins=[failure])
    return failure.name or ("\n" if status == 0 else f"pytest's status {int(status)}")


def _warm() -> None:
    """Read what every child needs and no model is part of."""
    import allantools  # noqa: F401
    import numba  # noqa: F401
    import numpy  # noqa: F401
    import pandas  # noqa: F401
    import pygeomag  # noqa: F401
    import pymap3d  # noqa: F401
    import pytest  # noqa: F401
    import scipy.interpolate
    import scipy.optimize
    import scipy.signal
    import scipy.spatial.transform
    import scipy.stats  # noqa: F401

    assert not any(name.startswith("sinan.sensors.") for name in sys.modules)


def equivalents() -> dict[str, str]:
    """Mutants that are the same model written otherwise, and why."""
    return {entry["mutant"]: entry["why"] for entry in tomllib.loads(EQUIVALENT.read_text("utf-8"))["equivalent"]}


def judged(chosen: Sequence[Mutant], tell: Callable[[Fate], None]) -> list[Fate]:
    """The fate of each mutant.

    Raises
    ------
    RuntimeError : the tests fail on the models as they are
    """
    _warm()
    tests = dict.fromkeys(test for mutant in chosen for test in TARGETS[mutant.model])
    name, _ = fate(None, list(tests))
    if name:
        raise RuntimeError(f"{name} fails without a mutant")
    fates = []
    for mutant in chosen:
        fates.append(Fate(mutant, *fate(mutant, TARGETS[mutant.model])))
        tell(fates[-1])
    return fates


def table(fates: Sequence[Fate], same: Sequence[str]) -> str:
    """Mutants, killed, equivalent and alive of each model, as a table in Markdown."""
    rows = ["| model | mutants | killed | the same model | alive |", "| --- | --- | --- | --- | --- |"]
    total: Counter[str] = Counter()
    for model in dict.fromkeys(entry.mutant.model for entry in fates):
        mine = [entry for entry in fates if entry.mutant.model == model]
        count = Counter(
            "killed" if entry.killed_by else "same" if entry.mutant.name in same else "alive" for entry in mine
        )
        total += Counter(mutants=len(mine), **count)
        rows.append(f"| `{model}` | {len(mine)} | {count['killed']} | {count['same']} | {count['alive']} |")
    rows.append(f"| all | {total['mutants']} | {total['killed']} | {total['same']} | {total['alive']} |")
    return "\n".join(rows)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run; status 1 where a mutant lives that is not named equivalent, or one that is named so is killed."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants")
    parser.add_argument("models", nargs="*", choices=[*TARGETS, []], help="default: all")
    parser.add_argument("--sample", type=int, help="only so many, drawn at random")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--list", action="store_true", help="say what would be tried")
    options = parser.parse_args(arguments)
    os.chdir(ROOT)
    chosen = [mutant for model in options.models or TARGETS for mutant in mutants(model)]
    if options.sample is not None:
        chosen = random.Random(options.seed).sample(chosen, min(options.sample, len(chosen)))
    if options.list:
        print("\n".join(f"{mutant.line:4} {mutant.name}" for mutant in chosen))
        return 0
    same = equivalents()

    def tell(entry: Fate) -> None:
        if not entry.killed_by and entry.mutant.name not in same:
            print(f"alive: sensors/{entry.mutant.model}.py:{entry.mutant.line} {entry.mutant.name}", flush=True)
        elif entry.killed_by and entry.mutant.name in same:
            print(f"named equivalent, but {entry.killed_by} kills it: {entry.mutant.name}", flush=True)

    began = time.monotonic()
    fates = judged(chosen, tell)
    print(f"\n{table(fates, list(same))}\n\n{time.monotonic() - began:.0f} s")
    return int(any(bool(entry.killed_by) == (entry.mutant.name in same) for entry in fates))


if __name__ == "__main__":
    raise SystemExit(main())
