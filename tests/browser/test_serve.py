"""A log dropped into the page of `sinan serve`, in a browser: from the upload to the verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from scipy.io import savemat

from sinan.experiments.serve.jobs import Limits, Queue
from sinan.experiments.serve.server import Server
from tests.browser.conftest import Browser

HOSTILE = "<img src=x onerror=window.hit=1>.mat"
LIMIT = 90.0  # s, of what takes ten on a machine that has nothing else to do


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    """A server whose folder goes with the test."""
    queue = Queue(tmp_path / "jobs", Limits(size=100_000))
    with Server(0, queue) as found:
        Thread(target=found.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()
        try:
            yield found
        finally:
            found.shutdown()
            queue.close()


def poses(path: Path, seed: int) -> Path:
    """Readings of a magnetometer that was turned by hand, with soft iron."""
    rng = np.random.default_rng(seed)
    m = rng.normal(size=(3, 60))
    m /= np.linalg.norm(m, axis=0)
    bent = np.array([[1.0, 0.08, 0.0], [0.08, 1.0, 0.0], [0.0, 0.0, 1.0]]) @ m
    savemat(path, {"mag": bent + 0.01 * rng.normal(size=m.shape)})
    return path


def dropped(browser: Browser, server: Server, *logs: Path) -> None:
    """Choose files in the page."""
    from selenium.webdriver.common.by import By

    browser.open(server.url)
    browser.driver.find_element(By.ID, "file").send_keys("\n".join(map(str, logs)))


def waited(ready: Callable[[], object]) -> None:
    end = time.monotonic() + LIMIT
    while not ready():
        assert time.monotonic() < end
        time.sleep(0.1)


def states(browser: Browser) -> list[str]:
    return list(browser.ask("[...document.querySelectorAll('#jobs li')].map(e => e.dataset.state)"))


def test_two_logs_at_once_from_upload_to_verdict(browser: Browser, server: Server, tmp_path: Path) -> None:
    """One of them has a name that would be a picture with a script, were it not a text."""
    dropped(browser, server, poses(tmp_path / "first.mat", 1), poses(tmp_path / HOSTILE, 2))
    waited(lambda: "running" in states(browser))
    waited(lambda: states(browser) == ["done", "done"])
    names = browser.ask("[...document.querySelectorAll('#jobs b')].map(e => e.textContent)")
    assert sorted(names) == [HOSTILE, "first.mat"]
    assert browser.ask("document.querySelectorAll('#jobs .verdict.effects').length") == 2
    assert browser.said() == []
    browser.driver.get(browser.ask("[...document.querySelectorAll('#jobs li')].find(e => "
                                   "e.textContent.includes('onerror')).querySelector('a').href"))  # fmt: skip
    assert browser.ask("document.querySelector('.verdict').textContent") == "1 effect found"
    assert HOSTILE in browser.ask("document.querySelector('dl.facts').textContent")
    assert browser.ask("document.querySelector('.review').classList.contains('live')")
    assert browser.ask("window.hit === undefined")
    assert all(url.startswith(server.url) for url in browser.requests())
    assert browser.said() == []


def test_log_that_is_none_is_told_and_harms_no_other(browser: Browser, server: Server, tmp_path: Path) -> None:
    (tmp_path / "bad.bin").write_bytes(np.random.default_rng(3).bytes(5000))
    (tmp_path / "large.bin").write_bytes(bytes(200_000))
    dropped(browser, server, tmp_path / "bad.bin", tmp_path / "large.bin")
    waited(lambda: states(browser) == ["failed"])
    assert "bad.bin" in browser.ask("document.querySelector('#jobs .bad').textContent")
    assert "large.bin" in browser.ask("document.querySelector('#problem').textContent")
    browser.ask("document.querySelector('#jobs button').click()")
    waited(lambda: states(browser) == [])


def test_front_page_fits_a_telephone(browser: Browser, server: Server) -> None:
    browser.open(server.url, width=390)
    assert browser.command("Page.getLayoutMetrics")["cssContentSize"]["width"] == 390
    assert browser.said() == []
