"""The figure of the first page: `python docs/make/ten_minutes_figure.py`. It is what the page's own lines draw."""

from __future__ import annotations

from pathlib import Path

from drawing import keep

import sinan

PATH = Path(__file__).parents[1] / "figures" / "ten_minutes.png"

if __name__ == "__main__":
    keep(sinan.estimate(sinan.simulate("figure_eight", seed=1)).plot_biases()[0].figure, PATH)
