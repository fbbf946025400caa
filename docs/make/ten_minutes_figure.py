"""The figures of the first page: `python docs/make/ten_minutes_figure.py`. The page's own lines draw them."""

from __future__ import annotations

import re
from pathlib import Path

import matplotlib as mpl
from drawing import keep

DOCS = Path(__file__).parents[1]
FIGURES = DOCS / "figures"
PAGE = DOCS / "ten_minutes.md"
#: By number of the block of lines that draws it: the measured flight's needs its data set (`SINAN_DATA`).
DRAWN = {0: "ten_minutes_measured.png", 2: "ten_minutes.png"}


def blocks() -> list[str]:
    """The Python lines of the page, in the order in which they are typed."""
    return re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


def main() -> None:
    """Run what draws, and keep the last figure of each."""
    from matplotlib import pyplot

    for number, name in DRAWN.items():
        pyplot.close("all")
        exec(compile(blocks()[number], f"ten_minutes.md, {number}", "exec"), {})
        keep(pyplot.gcf(), FIGURES / name)


if __name__ == "__main__":
    mpl.use("agg")
    main()
