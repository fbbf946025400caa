"""Pages that are made of the code, whenever the site is built: they cannot be older than it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import commands_page
import constants_page
import effect_pages
import face_page
import notebooks
from sphinx.application import Sphinx

FOLDER = "_generated"


def pages() -> dict[str, Callable[[], str]]:
    """Name of the page, without its suffix, and what writes its text."""
    made: dict[str, Callable[[], str]] = {
        "commands": commands_page.page,
        "constants": constants_page.page,
        "face": face_page.page,
    }
    return made | {name: partial(str, text) for name, text in (effect_pages.pages() | notebooks.pages()).items()}


def write(app: Sphinx) -> None:
    """Write every page that has changed, and take away those that are no longer made."""
    folder = Path(app.srcdir) / FOLDER
    made = {folder / f"{name}.md": text() for name, text in pages().items()}
    for path, text in made.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
    for old in set(folder.rglob("*.md")) - set(made):
        old.unlink()


def setup(app: Sphinx) -> dict[str, bool]:
    """Before anything is read."""
    app.connect("builder-inited", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
