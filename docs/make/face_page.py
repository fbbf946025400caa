"""The names of `import sinan`: signatures, parameters, returns and errors, from the docstrings that `help()` shows."""

from __future__ import annotations

import dataclasses
import inspect
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import sinan
from sinan.experiments.answers.asked import Answer
from sinan.experiments.report.made import sinan_version

HEAD = """# Python: every name

Made of the docstrings, which `help(sinan.trace)` shows too. Examples, by what one wants to do: [Python
interface](../face.md). Arguments after `*` are given by name.

Units are SI, n is the number of instants or rows. Body axes: x forward, y right, z down; navigation frame: NED;
quaternions: scalar first, body to NED. `FloatArray` is a NumPy array of floats, whose shape is said;
[other types](#other-types-in-signatures) are at the end.

"""
#: Sections of a docstring that are tables of names and texts.
TABLES = ("Parameters", "Attributes", "Raises")
SECTIONS = (*TABLES, "Returns", "Yields", "Examples")
#: A default that is longer than this says nothing.
LONGEST_DEFAULT = 24


@dataclass(frozen=True)
class Documented:
    """A docstring in parts.

    Attributes
    ----------
    text : before the first section, and what follows one
    tables : by section, text by name
    returns : of `Returns` or `Yields`
    """

    text: str
    tables: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    returns: str = ""

    @property
    def parameters(self) -> dict[str, str]:
        """What is said of parameters; those of a class are its attributes."""
        return {**self.tables.get("Attributes", {}), **self.tables.get("Parameters", {})}


def read(docstring: str) -> Documented:
    """The parts of a docstring in the numpydoc format, without its examples."""
    lines = inspect.cleandoc(docstring).splitlines()
    heads = [k for k in range(len(lines) - 1) if lines[k] in SECTIONS and set(lines[k + 1]) == {"-"}]
    heads.append(len(lines))
    text, tables, returns = ["\n".join(lines[: heads[0]])], {}, ""
    for start, end in pairwise(heads):
        body = lines[start + 2 : end]
        if lines[start] == "Examples":
            continue
        rows = body[: body.index("")] if "" in body else body
        text.append("\n".join(body[len(rows) :]))
        if lines[start] in TABLES:
            tables[lines[start]] = dict(_rows(rows))
        else:
            returns = " ".join(" ".join(rows).split())
    return Documented("\n".join(text).strip(), tables, returns)


def _rows(lines: list[str]) -> Iterator[tuple[str, str]]:
    """`a, b : text` with indented lines that go on with it; a text for each name."""
    found: list[tuple[str, str]] = []
    for line in lines:
        names, colon, text = line.partition(" : ")
        if line.startswith(" "):
            found[-1] = (found[-1][0], f"{found[-1][1]} {line.strip()}".rstrip())
        elif colon:
            found.append((names, text))
        else:
            raise ValueError(f"`{line}` in a docstring; expected `name : text`, or four blanks before it")
    for names, text in found:
        for name in names.split(","):
            yield name.strip().lstrip("*"), text


@dataclass(frozen=True)
class Entry:
    """A function, a class or a method of the face.

    Attributes
    ----------
    name : as it is called: `sinan.trace`, `Estimate.states`
    what : itself
    owner : class that it is a method of
    """

    name: str
    what: Any
    owner: type | None = None

    @cached_property
    def signature(self) -> inspect.Signature | None:
        """Of a function, or of what makes one of a class; None: nothing is passed."""
        if not isinstance(self.what, staticmethod) and not callable(self.what):
            return None
        if getattr(self.what, "_is_protocol", False):
            return None
        function = self.what.__func__ if isinstance(self.what, staticmethod) else self.what
        return inspect.signature(function)

    @property
    def is_property(self) -> bool:
        """Whether it is read and not called."""
        return isinstance(self.what, property | cached_property)

    @property
    def is_made_by_others(self) -> bool:
        """Whether no user makes one: what functions return, and the interface of the models."""
        if not inspect.isclass(self.what):
            return False
        return issubclass(self.what, Answer | sinan.Step) or bool(getattr(self.what, "_is_protocol", False))

    @cached_property
    def documented(self) -> Documented:
        """Its docstring."""
        what = self.what.__func__ if isinstance(self.what, staticmethod) else self.what
        return read(inspect.getdoc(what) or "")

    @property
    def parameters(self) -> list[inspect.Parameter]:
        """Those that a user passes."""
        given = [] if self.signature is None else list(self.signature.parameters.values())
        is_bound = self.owner is not None and not isinstance(self.what, staticmethod)
        return given[1:] if is_bound else given

    def meaning(self, name: str) -> str:
        """What is said of a parameter, here or where the interface is; empty: nothing."""
        for entry in (self, *self.interfaces):
            if name in entry.documented.parameters:
                return entry.documented.parameters[name]
            owner = entry.what if entry.owner is None else None
            said = vars(owner).get(name) if inspect.isclass(owner) else None
            if isinstance(said, property) and said.__doc__:
                return said.__doc__
        return ""

    @property
    def comes_back(self) -> str:
        """Type of what is returned, or of a property; empty: nothing is said, or it is a class."""
        if inspect.isclass(self.what):
            return ""
        what = self.what
        for inside in ("fget", "func", "__func__"):
            what = getattr(what, inside, what)
        return _kind(getattr(what, "__annotations__", {}).get("return", ""))

    @property
    def returned(self) -> str:
        """Type and text of what comes back."""
        text = self.documented.returns or next((one.documented.returns for one in self.interfaces if one.owner), "")
        kind = self.comes_back
        if text.startswith(kind.removeprefix("Iterator[").removesuffix("]")) and kind:
            kind = ""
        return ": ".join(part for part in (_code(kind), _cell(text)) if part)

    @property
    def interfaces(self) -> list[Entry]:
        """The same of the classes that it goes back to: of an answer, `Answer`; of a sensor's model, `SensorModel`."""
        owner = self.owner or (self.what if inspect.isclass(self.what) else None)
        if owner is None:
            return []
        above = [one for one in owner.__mro__[1:] if one.__module__.startswith("sinan")]
        if hasattr(owner, "predict") and hasattr(owner, "jacobian"):
            above.append(sinan.SensorModel)
        if self.owner is None:
            return [Entry(one.__name__, one) for one in above]
        key = self.name.rpartition(".")[2]
        return [Entry(self.name, vars(one)[key], one) for one in above if key in vars(one)]

    @property
    def members(self) -> list[Entry]:
        """Methods and properties of a class, in the order of the source; what it inherits of the project last."""
        if not inspect.isclass(self.what) or issubclass(self.what, Exception):
            return []
        found: dict[str, Any] = {}
        for one in self.what.__mro__:
            if one.__module__.startswith("sinan"):
                found |= {k: v for k, v in vars(one).items() if _is_member(k, v) and k not in found}
        known = {f.name for f in dataclasses.fields(self.what)} if dataclasses.is_dataclass(self.what) else set()
        return [Entry(f"{self.what.__name__}.{k}", v, self.what) for k, v in found.items() if k not in known]


def _is_member(name: str, value: object) -> bool:
    return not name.startswith("_") and (
        inspect.isfunction(value) or isinstance(value, property | cached_property | staticmethod)
    )


def entries() -> list[Entry]:
    """Every function and class of the face and of `sinan.testing`, and the version, a property of the module."""
    found = [Entry(f"sinan.{name}", getattr(sinan, name)) for name in sinan.__all__ if name != "testing"]
    found += [Entry(f"sinan.testing.{name}", getattr(sinan.testing, name)) for name in sinan.testing.__all__]
    return [*found, Entry("sinan.__version__", property(sinan_version), type(sinan))]


def undocumented() -> list[str]:
    """`function(parameter)` of which nothing is said."""
    everything = [one for entry in entries() for one in (entry, *entry.members)]
    return [
        f"{entry.name}({parameter.name})"
        for entry in everything
        if callable(entry.what) or isinstance(entry.what, staticmethod)
        for parameter in entry.parameters
        if not entry.meaning(parameter.name)
    ]


def page() -> str:
    """All of them, in the order of `sinan.__all__`."""
    return HEAD + "\n".join(_section(entry) for entry in entries()) + "\n" + _types()


def _types() -> str:
    """Classes of the project that signatures name and the face has not: where they are."""
    found: dict[str, type] = {}
    for entry in (one for top in entries() for one in (top, *top.members)):
        names = vars(sys.modules[(entry.owner or entry.what).__module__])
        said = [_kind(p.annotation) for p in entry.parameters] + [entry.comes_back]
        for word in set(re.findall(r"[A-Z]\w+", " ".join(said))):
            one = names.get(word)
            if inspect.isclass(one) and one.__module__.startswith("sinan.") and word not in sinan.__all__:
                found[word] = one
    rows = [
        f"| `{name}` | `{one.__module__}` | {_cell(read(inspect.getdoc(one) or '').text.partition(chr(10))[0])} |"
        for name, one in sorted(found.items())
    ]
    return "\n".join(["## Other types in signatures", "", "| type | module | |", "| --- | --- | --- |", *rows, ""])


def _section(entry: Entry) -> str:
    lines = [f"## `{entry.name}`", ""]
    if not callable(entry.what) and not entry.is_property:  # the catalogue
        return "\n".join([*lines, _prose(inspect.getdoc(type(entry.what)) or ""), ""])
    lines += _described(entry)
    for member in entry.members:
        lines += [f"### `{member.name}`", "", *_described(member)]
    return "\n".join(lines)


def _described(entry: Entry) -> list[str]:
    """Signature, text, table of parameters, what comes back, errors."""
    said, given = entry.documented, entry.parameters
    lines = [] if entry.signature is None or entry.is_made_by_others else ["```python", *_call(entry), "```", ""]
    lines += [_prose(said.text), ""]
    if given and entry.is_made_by_others:
        lines += ["| attribute | type | meaning |", "| --- | --- | --- |"]
        lines += [f"| `{p.name}` | {_code(_kind(p.annotation))} | {_cell(entry.meaning(p.name))} |" for p in given] + [
            ""
        ]
    elif given:
        lines += ["| parameter | type | default | meaning |", "| --- | --- | --- | --- |"]
        lines += [_row(entry, p) for p in given] + [""]
    names = {p.name for p in given}
    further = {name: text for name, text in said.tables.get("Attributes", {}).items() if name not in names}
    if further:
        lines += ["| attribute | meaning |", "| --- | --- |"]
        lines += [f"| `{name}` | {_cell(text)} |" for name, text in further.items()] + [""]
    if entry.returned:
        word = "Type" if entry.is_property else "Yields" if "Iterator" in entry.comes_back else "Returns"
        lines += [f"**{word}** {entry.returned}", ""]
    lines += [f"**Raises** `{name}`: {_cell(text)}\n" for name, text in said.tables.get("Raises", {}).items()]
    return lines


def _call(entry: Entry) -> list[str]:
    """How it is called, without types, in lines that fit."""
    words, star = [], False
    for p in entry.parameters:
        if p.kind is p.KEYWORD_ONLY and not star:
            words, star = [*words, "*"], True
        name = {p.VAR_POSITIONAL: "*", p.VAR_KEYWORD: "**"}.get(p.kind, "") + p.name
        words.append(name if p.default is p.empty else f"{name}={_default(p)}")
    name = entry.name.removeprefix("sinan.") if entry.owner else entry.name
    line = f"{name}({', '.join(words)})"
    if len(line) <= 100:
        return [line]
    return [f"{name}(", *(f"    {word}," for word in words), ")"]


def _default(parameter: inspect.Parameter) -> str:
    text = repr(parameter.default)
    return text if len(text) <= LONGEST_DEFAULT and "<" not in text else "..."


def _row(entry: Entry, p: inspect.Parameter) -> str:
    default = "" if p.default is p.empty else _default(p)
    cells = [
        f"`{p.name}`",
        _code(_kind(p.annotation)),
        _code("" if default == "..." else default),
        _cell(entry.meaning(p.name)),
    ]
    return f"| {' | '.join(cells)} |"


def _kind(annotation: object) -> str:
    """A type as the source says it."""
    return "" if annotation is inspect.Parameter.empty else str(annotation)


def _code(text: str) -> str:
    return f"`{text}`".replace("|", "\\|") if text else ""


def _cell(text: str) -> str:
    return _marked(" ".join(text.split()))


def _prose(text: str) -> str:
    """Paragraphs; those that are equations as they stand."""
    parts = [part for part in re.split(r"\n\s*\n", text) if part.strip()]
    return "\n\n".join(_equation(part) if _is_equation(part) else _marked(" ".join(part.split())) for part in parts)


def _is_equation(part: str) -> bool:
    return " = " in part and not part.rstrip().endswith((".", ":", ";")) and not part.lstrip().startswith(("`", ">>>"))


def _equation(part: str) -> str:
    return "\n".join(["```", *(line.rstrip() for line in inspect.cleandoc(part).splitlines()), "```"])


def _marked(text: str) -> str:
    """As Markdown: outside of code, signs that would be taken for marks are escaped."""
    parts = re.split(r"(`[^`]*`)", text)
    escape: Callable[[str], str] = lambda part: re.sub(r"([*<|\\_\[\]$])", r"\\\1", part)  # noqa: E731
    return "".join(p.replace("|", "\\|") if p.startswith("`") else escape(p) for p in parts)
