"""A browser without a window, that reaches nothing but this machine."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

NO_BROWSER = "no browser: `apt-get install chromium chromium-driver`, `pip install selenium`"
_OPTIONS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-dev-shm-usage",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--hide-scrollbars",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1, EXCLUDE localhost",
)  # fmt: skip


class Browser:
    """Chromium with what it loaded and said.

    Parameters
    ----------
    driver : of selenium
    """

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def open(self, place: Path | str, width: int = 1280, script: bool = True) -> None:
        """Show a file or an address; what was loaded and said before is forgotten."""
        self.command("Emulation.setScriptExecutionDisabled", value=not script)
        self.command(
            "Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=width < 600
        )
        self.driver.get("about:blank")
        for kind in ("browser", "performance"):
            self.driver.get_log(kind)
        self.driver.get(place.as_uri() if isinstance(place, Path) else place)

    def command(self, name: str, **arguments: Any) -> Any:
        """One of the DevTools' protocol."""
        return self.driver.execute_cdp_cmd(name, arguments)

    def ask(self, expression: str, *arguments: Any) -> Any:
        """The value of a JavaScript expression."""
        return self.driver.execute_script(f"return {expression}", *arguments)

    def said(self) -> list[str]:
        """Errors and warnings on the console."""
        return [entry["message"] for entry in self.driver.get_log("browser")]

    def requests(self) -> list[str]:
        """Addresses that were asked for, but those within the page, and those that its policy kept it from."""

        messages = [json.loads(entry["message"])["message"] for entry in self.driver.get_log("performance")]
        of_kind = {kind: [m["params"] for m in messages if m["method"] == f"Network.{kind}"]
                   for kind in ("requestWillBeSent", "loadingFailed")}  # fmt: skip
        kept = {one["requestId"] for one in of_kind["loadingFailed"] if one.get("blockedReason") == "csp"}
        asked = [one["request"]["url"] for one in of_kind["requestWillBeSent"] if one["requestId"] not in kept]
        return [url for url in asked if not url.startswith(("data:", "about:"))]


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """One browser for all tests. Without one: skip, or fail where SINAN_REQUIRE_BROWSER is set."""
    chromium, driver = shutil.which("chromium") or shutil.which("chromium-browser"), shutil.which("chromedriver")
    try:
        from selenium import webdriver
        from selenium.webdriver.chrome.service import Service
    except ImportError:
        webdriver = None
    if chromium is None or driver is None or webdriver is None:
        if os.environ.get("SINAN_REQUIRE_BROWSER"):
            pytest.fail(NO_BROWSER)
        pytest.skip(NO_BROWSER)
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for option in (*_OPTIONS, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(option)
    options.set_capability("goog:loggingPrefs", {"browser": "WARNING", "performance": "ALL"})
    found = webdriver.Chrome(options=options, service=Service(driver))
    found.set_page_load_timeout(30)
    try:
        yield Browser(found)
    finally:
        found.quit()
