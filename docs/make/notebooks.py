"""The notebooks: `python docs/make/notebooks.py [NAME ...]` runs them as a reader would, and says how long each took.

They are kept as text (`docs/notebooks/*.py`, jupytext's py:percent) and run in a fresh kernel; an error in a cell ends
the run. The site shows their text; `jupytext --to ipynb docs/notebooks/NAME.py` makes a notebook to open.
"""

from __future__ import annotations

import re
import sys
import time
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1] / "notebooks"
ORDER = ("first_filter", "observable_bias", "close_the_loop", "dgps")
LONGEST = 300  # s, of a cell: the first that flies compiles the filter


def names() -> list[str]:
    """Of all notebooks."""
    return sorted(path.stem for path in FOLDER.glob("*.py"))


def execute(name: str) -> Any:
    """Run a notebook; itself with its outputs.

    Raises
    ------
    nbclient.exceptions.CellExecutionError : a cell fails
    """
    import jupytext
    from nbclient import NotebookClient

    notebook = jupytext.read(FOLDER / f"{name}.py")
    return NotebookClient(notebook, timeout=LONGEST, kernel_name="python3").execute()


def pages() -> dict[str, str]:
    """The text of each as a page of the site."""
    index = ["# Notebooks\n", "Kept as text, run by the tests.\n", "```{toctree}", *ORDER, "```", ""]
    return {f"notebooks/{name}": page(name) for name in names()} | {"notebooks/index": "\n".join(index)}


def page(name: str) -> str:
    """Its prose, its cells as code, and how to run it."""
    text = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
    cells = re.split(r"^# %%", text.split("# ---\n", 2)[2], flags=re.MULTILINE)[1:]
    parts = []
    for cell in cells:
        head, _, body = cell.partition("\n")
        if "[markdown]" in head:
            prose = "\n".join(line.removeprefix("#").removeprefix(" ") for line in body.strip().splitlines())
            parts.append(prose.replace("](../", "](../../"))
        else:
            parts.append(f"```python\n{body.strip()}\n```")
    opened = f"jupytext --to ipynb docs/notebooks/{name}.py"
    link = f"{{download}}`docs/notebooks/{name}.py <../../notebooks/{name}.py>`"
    parts.insert(1, f"*To run it: {link}; `{opened}` makes a notebook of it. Its last cell checks what it says.*")
    return "\n\n".join(parts) + "\n"


def main(chosen: list[str]) -> None:
    """Run those, or all."""
    for name in chosen or names():
        begun = time.perf_counter()
        execute(name)
        sys.stdout.write(f"{name}: {time.perf_counter() - begun:.1f} s\n")


if __name__ == "__main__":
    main(sys.argv[1:])
