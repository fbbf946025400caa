"""One self-contained HTML page: a headline, sentences, figures inside the file, tables."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from sinan.experiments.report.made import made
from sinan.sensors.files import write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STYLE = """
:root { --ink: #1c2733; --soft: #5b6b7b; --line: #d9e0e7; --accent: #0b6e99; --paper: #fbfcfd; }
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
  min-width: 11rem; }
.number b { display: block; font-size: 1.35rem; }
.number span { color: var(--soft); font-size: .88rem; }
figure { margin: 1rem 0; } figure img { width: 100%; height: auto; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; min-width: 50%; font-size: .92rem; }
th, td { text-align: left; padding: .35rem 1.4rem .35rem 0; border-bottom: 1px solid var(--line); vertical-align: top; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
tr.marked td { background: #fbe9c3; font-weight: 600; }
footer { color: var(--soft); font-size: .88rem; margin-top: 2.4rem; border-top: 1px solid var(--line);
  padding-top: .4rem; }
code { background: #eef2f5; padding: .1rem .3rem; border-radius: .25rem; }
"""


class Page:
    """A page that is filled from top to bottom and written once.

    Parameters
    ----------
    title : headline, also of the window
    lead : the sentence under it
    """

    def __init__(self, title: str, lead: str = "") -> None:
        self._title = title
        self._parts = [f"<h1>{_marked(title)}</h1>"]
        if lead:
            self._parts.append(f'<p class="lead">{_marked(lead)}</p>')

    def heading(self, text: str) -> None:
        """A section."""
        self._parts.append(f"<h2>{_marked(text)}</h2>")

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
            f'<figure><img alt="{text}" src="data:image/png;base64,{base64.b64encode(png(figure)).decode()}">'
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
            return "".join(f"<{tag}{m}>{c}</{tag}>" for m, c in zip(marks, texts, strict=True))

        kinds = [' class="marked"' if k in marked else "" for k in range(len(rows))]
        targets = [{i: column[k] for i, column in (links or {}).items()} for k in range(len(rows))]
        each = zip(kinds, rows, targets, strict=True)
        body = "".join(f"<tr{kind}>{row(cells, 'td', to)}</tr>" for kind, cells, to in each)
        self._parts.append(f'<div class="wide"><table><tr>{row(head, "th")}</tr>{body}</table></div>')

    def write(self, path: Path) -> None:
        """Write the page; its last line says what made it."""
        foot = f"<footer>{_marked(made())}</footer>"
        write_text(
            path,
            '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{html.escape(self._title.replace('`', ''))}</title><style>{_STYLE}</style></head>\n"
            f"<body>{chr(10).join([*self._parts, foot])}</body></html>\n",
        )


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
