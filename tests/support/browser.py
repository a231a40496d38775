"""Chromium, as people have it, without a window."""

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest


@contextmanager
def chromium() -> Iterator[Any]:
    """A driver of a browser that tells what its console says; skips where it is not installed."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="The extra 'test' is not installed.")
    browser, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not browser or not driver:
        pytest.skip("Chromium with its driver is not installed (Debian: chromium and chromium-driver).")
    options = webdriver.ChromeOptions()
    options.binary_location = browser
    for argument in (
        "headless=new",
        "no-sandbox",
        "disable-dev-shm-usage",
        "disable-gpu",
        "window-size=1400,1000",
    ):
        options.add_argument(f"--{argument}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    opened = webdriver.Chrome(options, webdriver.ChromeService(driver))
    try:
        yield opened
    finally:
        opened.quit()


class Page:
    """A page in a file, opened with nothing remembered."""

    def __init__(self, browser: Any, path: Path) -> None:
        self.browser = browser
        browser.get_log("browser")
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})
        browser.get(path.as_uri())
        browser.execute_script("localStorage.clear()")

    def run(self, script: str, *arguments: Any) -> Any:
        return self.browser.execute_script(script, *arguments)

    def until(self, script: str) -> Any:
        """What the script returns once that is something; AssertionError after 20 s."""
        end = time.monotonic() + 20
        while not (value := self.run(script)):
            assert time.monotonic() < end, (script, self.complaints())
            time.sleep(0.02)
        return value

    def count(self, selector: str) -> int:
        """How many elements of it are to be seen."""
        script = "return [...document.querySelectorAll(arguments[0])].filter(e => e.checkVisibility()).length"
        return self.run(script, selector)

    def click(self, selector: str) -> None:
        self.run("document.querySelector(arguments[0]).click()", selector)

    def type(self, text: str) -> None:
        field = self.browser.find_element("css selector", "input[type=search]")
        field.clear()
        field.send_keys(text)

    def draw(self, plot: str) -> None:
        """Look at a plot until it is drawn."""
        self.run(f"document.getElementById('{plot}').scrollIntoView({{block: 'center'}})")
        self.until(f"return document.getElementById('{plot}').dataset.drawn === 'yes'")

    def canvas(self, plot: str) -> Any:
        """The element of a plot that takes the mouse."""
        self.until(f"return document.querySelector('#{plot} > div').offsetHeight > 200")
        return self.browser.find_element("css selector", f"#{plot} > div")

    def range(self, plot: str, axis: str = "x") -> list[float]:
        span = f"{figure_of(plot)}.{axis}_range"
        return self.run(f"return [{span}.start, {span}.end]")

    def pixels(self, plot: str, color: tuple[int, int, int]) -> int:
        """How many points of a plot's picture have about this colour."""
        return self.run(
            """
            const found = [], seek = (root) => { for (const e of root.querySelectorAll("*")) {
              if (e.tagName === "CANVAS") found.push(e); if (e.shadowRoot) seek(e.shadowRoot); } };
            seek(document.getElementById(arguments[0]));
            let count = 0;
            for (const canvas of found.filter((c) => c.width && c.height)) {
              const copy = document.createElement("canvas"), { width, height } = canvas;
              Object.assign(copy, { width, height });
              const context = copy.getContext("2d", { willReadFrequently: true });
              context.drawImage(canvas, 0, 0);
              const { data } = context.getImageData(0, 0, width, height);
              for (let k = 0; k < data.length; k += 4)
                count += data[k + 3] > 200
                  && [0, 1, 2].every((i) => Math.abs(data[k + i] - arguments[1][i]) < 12);
            }
            return count;""",
            plot,
            color,
        )

    def complaints(self) -> list[str]:
        lines = [line["message"] for line in self.browser.get_log("browser")]
        return [line for line in lines if "setting log level" not in line]  # Bokeh says so


def figure_of(plot: str) -> str:
    """What a script calls the Bokeh figure of a plot."""
    root = f"JSON.parse(document.querySelector('#{plot} script').textContent).root_id"
    return f"Bokeh.documents.map((drawn) => drawn.get_model_by_id({root})).find(Boolean)"
