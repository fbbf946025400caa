"""One self-contained HTML page: a headline, sentences, figures inside the file, tables."""

from __future__ import annotations

import base64
import hashlib
import html
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from sinan.experiments.report.made import command, now, sinan_version
from sinan.sensors.files import write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_STYLE = """
:root { color-scheme: light; --ink: #1c2733; --soft: #5b6b7b; --line: #d9e0e7; --accent: #0b6e99; --paper: #fbfcfd; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 60rem; padding: 2rem 1.2rem 4rem; background: var(--paper); color: var(--ink);
  font: 1rem/1.55 system-ui, "Segoe UI", Roboto, "Noto Sans", sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.25; margin: 0 0 .4rem; }
h2 { font-size: 1.15rem; margin: 2.4rem 0 .6rem; border-bottom: 1px solid var(--line); padding-bottom: .25rem; }
p.lead { font-size: 1.12rem; margin: .3rem 0 1rem; }
h3 { font-size: 1rem; margin: 1.6rem 0 .3rem; }
summary { cursor: pointer; color: var(--accent); margin: .8rem 0; }
p.note, figcaption { color: var(--soft); font-size: .92rem; }
.numbers { display: flex; flex-wrap: wrap; gap: .8rem; margin: 1.2rem 0; }
.number { border: 1px solid var(--line); border-radius: .5rem; padding: .7rem 1rem; background: #fff;
  min-width: 11rem; flex: 1 1 15rem; max-width: 28rem; }
.number b { display: block; font-size: 1.25rem; }
.number span { color: var(--soft); font-size: .88rem; }
figure { margin: 1rem 0; } figure img { width: 100%; height: auto; }
nav { font-size: .95rem; margin: 1rem 0; } nav a { color: var(--accent); margin-right: 1.1rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; min-width: 50%; font-size: .92rem; }
ul.plain { margin: .3rem 0; padding-left: 1.2rem; }
.verdict { display: inline-block; font-weight: 700; padding: .1rem .7rem; border-radius: 1rem; margin: 0 0 .6rem;
  border: 2px solid #5b6b7b; background: #eef2f5; }
.verdict.effects { border-color: #0b6e99; background: #e3f1f7; }
.verdict.no_effect { border-color: #4d7c0f; background: #eef6e2; }
.verdict.ambiguous { border-color: #a8650a; background: #fdf3dd; }
.verdict.unexplained { border-color: #b23a22; background: #fbe9e5; }
dl.facts { display: grid; grid-template-columns: max-content minmax(0, 1fr); gap: .15rem 1rem; font-size: .9rem; }
dl.facts dt { color: var(--soft); } dl.facts dd { margin: 0; overflow-wrap: anywhere; }
th, td { text-align: left; padding: .35rem 1.4rem .35rem 0; border-bottom: 1px solid var(--line); vertical-align: top; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
tr.marked td { background: #fbe9c3; font-weight: 600; }
footer { color: var(--soft); font-size: .88rem; margin-top: 2.4rem; border-top: 1px solid var(--line);
  padding-top: .4rem; }
code { background: #eef2f5; padding: .1rem .3rem; border-radius: .25rem; overflow-wrap: anywhere; }
h1, p, li, figcaption, footer { overflow-wrap: anywhere; }
@media (max-width: 600px) {
  body { padding: 1.2rem .8rem 3rem; } h1 { font-size: 1.35rem; }
  figure .wide img { width: 40rem; } td:first-child { min-width: 6rem; } th, td { padding-right: .7rem; }
  .number { flex: 1 1 100%; } table { font-size: .85rem; }
  dl.facts { grid-template-columns: minmax(0, 1fr); } dl.facts dd { margin-bottom: .3rem; }
}
@media print {
  body { max-width: none; padding: 0; font-size: 10pt; background: #fff; }
  figure, tr, .number, dl.facts { break-inside: avoid; } h2, h3 { break-after: avoid; }
  nav { display: none; } .wide { overflow: visible; }
  details::details-content { content-visibility: visible; display: block; }
}
"""


@dataclass(frozen=True)
class Drawn:
    """Part of a page that was drawn elsewhere.

    Attributes
    ----------
    html : with all that comes out of a log escaped
    style, script : of it
    """

    html: str
    style: str
    script: str


class Page:
    """A page that is filled from top to bottom and written once.

    Parameters
    ----------
    title : headline, also of the window
    lead : the sentence under it
    """

    def __init__(self, title: str, lead: str = "") -> None:
        self._title = title
        self._sections: list[str] = []
        self._contents: int | None = None  # where the links go
        self._parts = [f"<h1>{_marked(title)}</h1>"]
        self._style, self._script = _STYLE, ""
        if lead:
            self._parts.append(f'<p class="lead">{_marked(lead)}</p>')

    def verdict(self, word: str, kind: str) -> None:
        """The verdict's word, above the title.

        Parameters
        ----------
        kind : of the verdicts of a trace, the one whose colour it has; another: grey
        """
        self._parts.insert(0, f'<p class="verdict {html.escape(kind)}">{html.escape(word)}</p>')

    def facts(self, pairs: Sequence[tuple[str, str]]) -> None:
        """Names and what each is, such as the log, its checksum, the command."""
        rows = "".join(f"<dt>{_marked(name)}</dt><dd>{_marked(value)}</dd>" for name, value in pairs)
        self._parts.append(f'<dl class="facts">{rows}</dl>')

    def rests_on(self, logs: Sequence[Mapping[str, str | None]], further: Sequence[tuple[str, str]] = ()) -> None:
        """What a result was made of and by what: the logs with their checksums, version, command, date."""
        pairs = [(f"log {k}" if len(logs) > 1 else "log", str(one["log"])) for k, one in enumerate(logs, 1)]
        sums = [(f"SHA-256 {k}" if len(logs) > 1 else "SHA-256", str(one["sha256"] or "of a stream: none"))
                for k, one in enumerate(logs, 1)]  # fmt: skip
        each = [pair for both in zip(pairs, sums, strict=True) for pair in both]
        self.facts([*each, *further, ("made by", f"sinan {sinan_version()}, {now()}"), ("command", f"`{command()}`")])

    def items(self, texts: Sequence[str]) -> None:
        """A list."""
        self._parts.append(f'<ul class="plain">{"".join(f"<li>{_marked(text)}</li>" for text in texts)}</ul>')

    def part(self, part: Drawn) -> None:
        """A part that brings its own style and script; a page has one."""
        self._parts.append(part.html)
        self._style, self._script = _STYLE + part.style, part.script

    def heading(self, text: str) -> None:
        """A section."""
        self._sections.append(text)
        place = "" if self._contents is None else f' id="section-{len(self._sections)}"'
        self._parts.append(f"<h2{place}>{_marked(text)}</h2>")

    def contents(self) -> None:
        """Links to the sections that follow, once all are there; a page has one such place."""
        self._contents, self._sections = len(self._parts), []
        self._parts.append("")

    def subheading(self, text: str) -> None:
        """A part of a section."""
        self._parts.append(f"<h3>{_marked(text)}</h3>")

    @contextmanager
    def folded(self, summary: str) -> Iterator[None]:
        """What is added inside is folded away behind one line."""
        self._parts.append(f"<details><summary>{_marked(summary)}</summary>")
        yield
        self._parts.append("</details>")

    def text(self, text: str, note: bool = False) -> None:
        """A paragraph; a note is set softer."""
        mark = ' class="note"' if note else ""
        self._parts.append(f"<p{mark}>{_marked(text)}</p>")

    def numbers(self, pairs: Sequence[tuple[str, str]]) -> None:
        """A row of large numbers, each (value, what it is)."""
        cells = [f'<div class="number"><b>{_marked(v)}</b><span>{_marked(k)}</span></div>' for v, k in pairs]
        self._parts.append(f'<div class="numbers">{"".join(cells)}</div>')

    def figure(self, figure: Figure, caption: str) -> None:
        """A figure, embedded, with a caption that is also its text for those who do not see it."""
        text = html.escape(caption)
        self._parts.append(
            f'<figure><div class="wide"><img alt="{text}" src="data:image/png;base64,'
            f'{base64.b64encode(png(figure)).decode()}"></div>'
            f"<figcaption>{_marked(caption)}</figcaption></figure>"
        )

    def table(
        self,
        head: Sequence[str],
        rows: Sequence[Sequence[str]],
        numeric: Sequence[int] = (),
        marked: Sequence[int] = (),
        links: Mapping[int, Sequence[str]] | None = None,
    ) -> None:
        """A table; columns in `numeric` are set to the right, rows in `marked` stand out, and those in `links` lead to
        another page, one a row.
        """

        def row(cells: Sequence[str], tag: str, to: Mapping[int, str] | None = None) -> str:
            marks = [' class="n"' if i in numeric else "" for i in range(len(cells))]
            texts = [_linked(_marked(c), (to or {}).get(i)) for i, c in enumerate(cells)]
            scope = ' scope="col"' if tag == "th" else ""
            return "".join(f"<{tag}{scope}{m}>{c}</{tag}>" for m, c in zip(marks, texts, strict=True))

        kinds = [' class="marked"' if k in marked else "" for k in range(len(rows))]
        targets = [{i: column[k] for i, column in (links or {}).items()} for k in range(len(rows))]
        each = zip(kinds, rows, targets, strict=True)
        body = "".join(f"<tr{kind}>{row(cells, 'td', to)}</tr>" for kind, cells, to in each)
        self._parts.append(f'<div class="wide"><table><tr>{row(head, "th")}</tr>{body}</table></div>')

    def write(self, path: Path) -> None:
        """Write the page; its last line says what made it.

        Its policy lets no browser load anything for it, nor run any script but its own: what a log calls itself stays
        text, whatever it is.
        """
        made = f"sinan {sinan_version()}, `{command()}`, {now()}"
        foot = f"<footer>{_marked(made)}</footer>"
        script = f"<script>{self._script}</script>" if self._script else ""
        if self._contents is not None:
            links = (f'<a href="#section-{k}">{_marked(one)}</a>' for k, one in enumerate(self._sections, 1))
            self._parts[self._contents] = f"<nav>{' '.join(links)}</nav>"
        page = (
            '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
            f'<meta http-equiv="Content-Security-Policy" content="{policy(self._script)}">'
            '<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">'
            f"<title>{html.escape(self._title.replace('`', ''))}</title><style>{self._style}</style></head>\n"
            f"<body>{chr(10).join([*self._parts, foot])}{script}</body></html>\n"
        )
        write_text(path, page.encode("utf-8", "backslashreplace").decode())  # a name of a file need not be UTF-8


def policy(script: str) -> str:
    """What a browser may do for a page: show what is in it, and run this script."""
    allowed = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    scripts = f"'sha256-{allowed}'" if script else "'none'"
    return f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {scripts}"


def _linked(text: str, to: str | None) -> str:
    return text if to is None else f'<a href="{html.escape(quote(to))}">{text}</a>'


def _marked(text: str) -> str:
    """Escaped; names of commands and effects in backticks as code, exponents raised, and no line break before a per
    cent sign or around an arrow.
    """
    text = re.sub(r"`([^`]+)`", r"<code>\1</code>", html.escape(text))
    text = re.sub(r"\^(-?\d+)", lambda found: f"<sup>{found[1].replace('-', '−')}</sup>", text)
    return text.replace(" %", "&nbsp;%").replace(" → ", "&nbsp;→&nbsp;")


def png(figure: Figure) -> bytes:
    """The figure as PNG."""
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=140, bbox_inches="tight", facecolor="white")
    return buffer.getvalue()
