"""How large a page of a log over time is, and how fast it opens and zooms: our own drawing, Plotly and Bokeh.

`python -m sinan.experiments.benchmarks.pages FOLDER`, with Chromium, its driver and selenium; Plotly and Bokeh where
they are installed. Each page has the same panels and the same points: 60 curves of 200 000 samples, thinned alike.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from sinan.experiments.report.page import Page
from sinan.experiments.review.curves import Curve, Panel, Review, Section, thinned
from sinan.experiments.review.drawing import drawn, pieces_for

PANELS, CURVES, SAMPLES = 20, 3, 200_000
_OPTIONS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--no-first-run")
#: What shows half of the time, and tells by `arguments[0]` when it is on the screen.
ZOOMS = {
    "own": "document.querySelector('[aria-label=\"closer\"]').click(); {then}",
    "plotly": "const plot = document.querySelector('.js-plotly-plot'); "
    "Plotly.relayout(plot, {{'xaxis.range': [250, 750]}}).then(() => {{ {then} }})",
    "bokeh": "const first = Bokeh.documents[0].roots()[0].children[0][0]; "
    "first.x_range.setv({{start: 250, end: 750}}); {then}",
}


def review() -> Review:
    """Noise about slow waves."""
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 1000.0, SAMPLES)
    panels = []
    for k in range(PANELS):
        waves = [np.sin(t / (5.0 + k + j)) + rng.normal(0.0, 0.3, SAMPLES) for j in range(CURVES)]
        curves = tuple(Curve("xyz"[j], t, wave, colour=j) for j, wave in enumerate(waves))
        panels.append(Panel(f"panel {k}", "m", curves))
    return Review((0.0, 1000.0), (Section("all", tuple(panels)),))


def own(path: Path, log: Review) -> None:
    """As the pages of sinan have it."""
    page = Page("a log over time")
    page.part(drawn(log))
    page.write(path)


def plotly(path: Path, log: Review) -> None:
    """Subplots with one axis, the library inlined."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=PANELS, cols=1, shared_xaxes=True, vertical_spacing=0.005)
    for row, panel in enumerate(log.panels, 1):
        for curve in panel.curves:
            x, y = thinned(curve.x, curve.y, pieces_for(log))
            figure.add_trace(Scatter(x=x.astype("f4"), y=y.astype("f4"), mode="lines", name=curve.name), row=row, col=1)
    figure.update_layout(height=170 * PANELS)
    figure.write_html(path, include_plotlyjs=True)


def bokeh(path: Path, log: Review) -> None:
    """A column of figures with one range, the library inlined."""
    from bokeh.layouts import gridplot
    from bokeh.models import Range1d
    from bokeh.plotting import figure, output_file, save
    from bokeh.resources import INLINE

    shared, figures = Range1d(0.0, 1000.0), []
    for panel in log.panels:
        one = figure(width=900, height=170, x_range=shared, title=panel.title)
        for curve in panel.curves:
            x, y = thinned(curve.x, curve.y, pieces_for(log))
            one.line(x.astype("f4"), y.astype("f4"), legend_label=curve.name)
        figures.append([one])
    output_file(path, mode="inline")
    save(gridplot(figures), path, INLINE, "a log over time")


def opened_and_zoomed(driver: Any, path: Path, zoom: str) -> tuple[float, float]:
    """Seconds until a page is drawn, and until half of it is."""
    frames = "requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 0)))"
    began = time.perf_counter()
    driver.get(path.as_uri())
    driver.execute_async_script(f"const done = arguments[0]; {frames}")
    opened = time.perf_counter() - began
    driver.execute_script("scrollTo(0, 800)")
    began = time.perf_counter()
    driver.execute_async_script(f"const done = arguments[0]; {zoom.format(then=frames)}")
    return opened, time.perf_counter() - began


def main(folder: Path) -> None:
    """A line for each way, of those that are there."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for option in (*_OPTIONS, f"--user-data-dir={tempfile.mkdtemp()}"):
        options.add_argument(option)
    log, ways = review(), dict[str, Callable[[Path, Review], None]](own=own, plotly=plotly, bokeh=bokeh)
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    driver.set_script_timeout(120)
    try:
        for name, write in ways.items():
            path = folder / f"{name}.html"
            began = time.perf_counter()
            try:
                write(path, log)
            except ImportError:
                print(f"{name}: not installed")
                continue
            written = time.perf_counter() - began
            opened, zoomed = opened_and_zoomed(driver, path.resolve(), ZOOMS[name])
            took = f"written in {written:.2f} s, opened in {opened:.2f} s, zoomed in {zoomed:.2f} s"
            print(f"{name}: {path.stat().st_size / 1e6:.2f} MB, {took}")
    finally:
        driver.quit()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
