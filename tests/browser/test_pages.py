"""Pages as a browser shows them: nothing is loaded, nothing complains; one zooms, reads out, takes them along."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from sinan.experiments.commands.estimate import run as estimate
from sinan.experiments.report.page import Page
from sinan.experiments.review.curves import Curve, Event, Panel, Review, Section
from sinan.experiments.review.drawing import drawn
from sinan.experiments.scenarios import simulate_to_folder
from tests.browser.conftest import Browser

HOSTILE = '<img src=x onerror="window.hit=1">'
FIRST = ".panel[data-panel]"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of an estimate of a short flight."""
    folder = tmp_path_factory.mktemp("page")
    (folder / "short.toml").write_text('like = "figure_eight"\n[[manoeuvre]]\nkind = "hold"\nduration = 12.0\n')
    simulate_to_folder(str(folder / "short.toml"), folder / "flight", [], False, 0)
    estimate(str(folder / "flight"), "auto", None, None, None, folder / "page.html")
    return folder / "page.html"


def peak_page(path: Path, name: str = "value") -> Path:
    """A page whose one curve is flat but for a peak of one sample among 200 000."""
    t = np.linspace(0.0, 1000.0, 200_000)
    y = np.zeros(len(t))
    y[123_456] = 7.0
    panel = Panel("Peak", "m", (Curve(name, t, y),))
    page = Page("a peak")
    page.part(drawn(Review((0.0, 1000.0), (Section(name, (panel,)),), (Event("armed", 100.0, 700.0, name),))))
    page.write(path)
    return path


def test_page_loads_nothing_and_nothing_complains(browser: Browser, page: Path) -> None:
    browser.open(page)
    drawn_curves = browser.ask(
        "document.querySelectorAll('.review svg.area path.line, .review svg.area path.dots').length"
    )
    assert drawn_curves > 20
    assert browser.ask("document.querySelector('.review').classList.contains('live')")
    assert browser.requests() == [page.as_uri()]
    assert browser.said() == []


def test_page_has_names_for_those_who_do_not_see_it(browser: Browser, page: Path) -> None:
    browser.open(page)
    unnamed = """[...document.querySelectorAll('svg.area, img, button')].filter(
        e => !(e.getAttribute('aria-label') || e.getAttribute('alt') || e.textContent).trim()).length"""
    assert browser.ask(unnamed) == 0
    assert browser.ask("[...document.querySelectorAll('th')].every(e => e.getAttribute('scope') === 'col')")


@pytest.mark.parametrize("script", [True, False])
def test_page_fits_a_telephone(browser: Browser, page: Path, script: bool) -> None:
    browser.open(page, width=390, script=script)
    assert browser.command("Page.getLayoutMetrics")["cssContentSize"]["width"] == 390


def test_labels_of_axes_do_not_overlap(browser: Browser, page: Path) -> None:
    """Within each row of labels each begins where the one before has ended, on a telephone as on a screen."""
    overlapping = """[...document.querySelectorAll('.review .xs, .review .ys')].flatMap(row => {
        const boxes = [...row.querySelectorAll('span')].map(e => e.getBoundingClientRect()).filter(b => b.width);
        return boxes.flatMap((a, k) => boxes.slice(k + 1).filter(b =>
            a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1));
    }).length"""
    for width in (390, 1280):
        browser.open(page, width=width)
        assert browser.ask(overlapping) == 0


def view_of(browser: Browser) -> tuple[float, float]:
    """What the axis of time shows, once it is drawn."""
    wait = "const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done))"
    browser.driver.execute_async_script(wait)
    shown = browser.ask("document.querySelector('.review').dataset.view")
    first, last = map(float, shown.split())
    return first, last


def dragged(browser: Browser, panel: str, begin: float, end: float) -> None:
    """Drag over a panel, from one share of its width to another."""
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By

    area = browser.driver.find_element(By.CSS_SELECTOR, f"{panel} svg.area")
    browser.ask("arguments[0].scrollIntoView({block: 'center'})", area)
    width = area.rect["width"]
    actions = ActionChains(browser.driver, duration=20).move_to_element_with_offset(
        area, round((begin - 0.5) * width), 0
    )
    actions.click_and_hold().move_by_offset(round((end - begin) * width), 0).release().perform()


def test_drag_zooms_all_panels_and_a_double_click_shows_all(browser: Browser, tmp_path: Path) -> None:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By

    browser.open(peak_page(tmp_path / "page.html"))
    dragged(browser, FIRST, 0.5, 0.75)
    first, last = view_of(browser)
    assert first == pytest.approx(500.0, abs=5.0)
    assert last == pytest.approx(750.0, abs=5.0)
    ticks = browser.ask(
        "[...document.querySelectorAll('.panel[data-panel] .xs span:not(.unit)')].map(e => e.textContent)"
    )
    assert ticks[0] == "500"
    ActionChains(browser.driver).double_click(
        browser.driver.find_element(By.CSS_SELECTOR, f"{FIRST} svg.area")
    ).perform()
    assert view_of(browser) == (0.0, 1000.0)


@pytest.mark.parametrize(
    ("act", "width"),
    [
        ("document.querySelector('[aria-label=\"closer\"]').click()", 500.0),
        (
            "document.querySelector('.panel[data-panel] svg.area').dispatchEvent(new WheelEvent('wheel', "
            "{deltaY: -200, ctrlKey: true, clientX: 600, bubbles: true, cancelable: true}))",
            1000.0 * np.exp(-0.4),
        ),
    ],
)
def test_buttons_and_wheel_zoom(browser: Browser, tmp_path: Path, act: str, width: float) -> None:
    browser.open(peak_page(tmp_path / "page.html"))
    browser.ask(f"({act}, null)")
    first, last = view_of(browser)
    assert last - first == pytest.approx(width, rel=1e-3)


def highest(path: str) -> float:
    """The smallest second coordinate of a drawing, whose 0 is at its top."""
    return min(float(point.split(" ")[1]) for point in re.findall(r"[ML][\d.]+ -?[\d.]+", path))


def test_peak_of_one_sample_is_seen_at_every_zoom(browser: Browser, tmp_path: Path) -> None:
    """In the drawing without a script, and in that of the script."""
    path = peak_page(tmp_path / "page.html")
    static = re.search(r'<path class="line c0" d="([^"]*)"', path.read_text())
    assert static is not None
    assert highest(static[1]) < 20.0
    browser.open(path)
    dragged(browser, FIRST, 0.55, 0.7)
    view_of(browser)
    assert highest(browser.ask("document.querySelector('path.line.c0').getAttribute('d')")) < 20.0


def test_hover_reads_out_value_time_and_events(browser: Browser, tmp_path: Path) -> None:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By

    browser.open(peak_page(tmp_path / "page.html"))
    area = browser.driver.find_element(By.CSS_SELECTOR, f"{FIRST} svg.area")
    ActionChains(browser.driver).move_to_element(area).perform()
    read = "document.querySelector('.panel[data-panel] .key output').textContent"
    assert browser.ask(read) == "0"
    assert re.fullmatch(r"(499|500)(\.\d+)? s", browser.ask("document.querySelector('.tools output').textContent"))
    assert browser.ask("document.querySelector('.events output').textContent") == "value"
    assert browser.ask("getComputedStyle(document.querySelector('.cursor')).display") == "block"


def test_names_out_of_a_log_stay_text(browser: Browser, tmp_path: Path) -> None:
    browser.open(peak_page(tmp_path / "page.html", f"{HOSTILE}</script><script>window.hit=1</script>"))
    assert browser.ask("window.hit === undefined")
    assert browser.ask("document.querySelectorAll('.review img').length") == 0
    assert browser.said() == []


def test_page_runs_no_script_but_its_own(browser: Browser, tmp_path: Path) -> None:
    """Even where something were not escaped, the page's policy keeps it from running, and from loading anything."""
    path = peak_page(tmp_path / "page.html")
    text = path.read_text().replace("</h1>", f"</h1>{HOSTILE}<script>window.hit=1</script>", 1)
    path.write_text(text)
    browser.open(path)
    assert browser.ask("window.hit === undefined")
    assert browser.requests() == [path.as_uri()]


def test_print_is_a_few_pages_with_all_drawings(browser: Browser, page: Path) -> None:
    import base64

    browser.open(page)
    printed = base64.b64decode(browser.command("Page.printToPDF", printBackground=True)["data"])
    assert 3 <= len(re.findall(rb"/Type /Page\b", printed)) <= 25
