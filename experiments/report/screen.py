"""Figures for the screen: those of the pages, known to pyplot, so that a notebook or `plt.show` shows them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

from sinan.experiments.report import figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Drawn = TypeVar("Drawn")


def axes(draw: Callable[[], Figure]) -> list[Axes]:
    """The axes of what a function draws, those that are visible, row by row; `axes[0].figure` is the figure.

    Parameters
    ----------
    draw : makes its figure by `figures.blank`
    """
    return [one for one in on_screen(draw).axes if one.get_visible()]


def on_screen(draw: Callable[[], Drawn]) -> Drawn:
    """What a function gives whose figures pyplot is to know."""
    token = figures.ON_SCREEN.set(True)
    try:
        return draw()
    finally:
        figures.ON_SCREEN.reset(token)
