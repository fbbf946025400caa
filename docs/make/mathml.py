"""Formulas as MathML, which browsers draw by themselves: no script, no font and nothing from another server."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from docutils.utils.math import MathError, latex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging

_LOGGER = logging.getLogger(__name__)


def _drawn(node: nodes.Element, as_block: bool) -> str:
    """MathML of a formula; one that cannot be read is a warning with its place."""
    text = node.astext()
    try:
        return str(latex2mathml.tex2mathml("{}" * text.startswith(("^", "_")) + text, as_block=as_block))
    except (MathError, IndexError) as error:
        _LOGGER.warning("%s in %r", error, text, location=node)
        return ""


def visit_inline(translator: Any, node: nodes.Element) -> None:
    """A formula within a line."""
    translator.body.append(_drawn(node, False))
    raise nodes.SkipNode


def visit_display(translator: Any, node: nodes.Element) -> None:
    """A formula on a line of its own, with its number at the right."""
    number = f'<span class="eqno">({node["number"]})</span>' if node.get("number") else ""
    anchor = f' id="{node["ids"][0]}"' if node.get("ids") else ""
    translator.body.append(f'<div class="math-display"{anchor}>{_drawn(node, True)}{number}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Name it as a renderer: `html_math_renderer = "mathml"`."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
