"""The page of a report in a browser: search, plots, zoom, keys, themes, and hostile texts."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from emla_cosim.verification.report import Report
from tests.support.browser import Page, chromium
from tests.support.reports import hostile, ordinary

FAILED = "fmu-1-reference.tube"
"""The finding of the ordinary report whose plots are open."""


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


Open = Callable[[Report], Page]


@pytest.fixture
def opened(browser: Any, tmp_path: Path) -> Iterator[Open]:
    pages = []

    def make(report: Report) -> Page:
        report.save_html(tmp_path / "report.html")
        pages.append(Page(browser, tmp_path / "report.html"))
        return pages[-1]

    yield make
    assert [page.complaints() for page in pages] == [[] for _ in pages]


def test_page_is_shown(opened: Open) -> None:
    page = opened(ordinary())
    assert page.browser.title == "1 of 2 FMUs failed · FMU verification"
    assert page.run("return document.querySelector('h1').innerText") == "1 of 2 FMUs failed"
    assert (
        page.count(".fmu") == 2 and page.count("#fmu-1 .finding") == 5 and page.count("#fmu-2 .finding") == 0
    )
    assert page.count(".finding .body") == 2  # those that failed
    assert page.run("return document.documentElement.scrollWidth <= innerWidth")


def test_search_and_verdicts_hide_rows(opened: Open) -> None:
    page = opened(ordinary())
    page.type("archive")
    assert page.count(".finding") == 2 and page.count(".fmu") == 2  # the closed one is opened
    assert page.run("return document.querySelector('.shown').innerText") == "2 of 7 checks"
    page.type("OTHER plant tube")
    assert page.count(".finding") == 1 and page.count(".fmu") == 1 and page.count("[data-fmu]") == 1
    page.type("nonsense")
    assert page.count(".finding") == 0 and page.count(".nothing") == 1
    page.click(".nothing button")
    assert page.count(".nothing") == 0 and page.count("#fmu-2 .finding") == 0
    page.click("button[data-verdict=skipped]")
    page.click("button[data-verdict=warning]")
    assert page.count(".finding") == 2 and page.count("[data-fmu]") == 1
    page.click("button[data-verdict=warning]")
    assert page.count(".finding") == 1 and page.count(".finding.skipped") == 1


def test_plots_are_drawn_when_visible(opened: Open) -> None:
    page = opened(ordinary())
    assert page.run("return typeof Bokeh") == "undefined" or page.count(f"[id='{FAILED}'] .plot") > 0
    assert page.count("#fmu-2 .plot") == 0
    page.click("[id='fmu-2'] summary")
    page.click("[id='fmu-2-reference.tube'] summary")
    page.draw("plot-4")
    page.until("return document.querySelector('[data-plot=plot-4] .legend').innerText.includes('reference')")
    line = "drawn.get(document.querySelector('[data-plot=plot-4]')).data.lines[0]"
    assert page.run(f"return [{line}.x.length, {line}.x[1], {line}.x.at(-1)]") == pytest.approx(
        [500, 5 / 499, 5]
    )
    assert page.pixels("plot-4", (0x2F, 0x6D, 0xB3)) > 100
    assert page.range("plot-4") == pytest.approx([-0.05, 5.05])


def test_button_opens_a_signal(opened: Open) -> None:
    page = opened(ordinary())
    assert page.run("return document.querySelector('[data-plot=plot-3]').checkVisibility()") is False
    page.click("button[aria-controls=plot-3]")
    page.draw("plot-3")
    assert page.run("return document.querySelector('button[aria-controls=plot-3]').ariaExpanded") == "true"


def test_zooming_changes_the_axes(opened: Open) -> None:
    from selenium.webdriver import ActionChains

    page = opened(ordinary())
    page.draw("plot-1")
    x, y = page.range("plot-1"), page.range("plot-1", "y")
    canvas = page.browser.find_element("css selector", "[data-plot=plot-1] .canvas")
    ActionChains(page.browser).move_to_element_with_offset(canvas, -100, -50).click_and_hold().move_by_offset(
        200, 80
    ).release().perform()
    page.until(
        f"return drawn.get(document.querySelector('[data-plot=plot-1]')).plot.x_range.start > {x[0]} + 0.5"
    )
    low, high = page.range("plot-1")
    assert x[0] + 0.5 < low < high < x[1] - 0.5
    assert page.range("plot-1", "y")[1] < y[1]
    figure = page.browser.find_element("css selector", "[data-plot=plot-1]")
    figure.send_keys("0")
    assert page.range("plot-1") == x and page.range("plot-1", "y") == y
    figure.send_keys("+")
    assert page.range("plot-1") == pytest.approx([x[0] + (x[1] - x[0]) / 4, x[1] - (x[1] - x[0]) / 4])


def test_mouse_shows_values(opened: Open) -> None:
    from selenium.webdriver import ActionChains

    page = opened(ordinary())
    page.draw("plot-1")
    canvas = page.browser.find_element("css selector", "[data-plot=plot-1] .canvas")
    ActionChains(page.browser).move_to_element(canvas).perform()
    found = page.until("return document.querySelector('[data-plot=plot-1] .at').innerText")
    assert 2 < float(found.split()[2]) < 3
    values = page.run(
        "return [...document.querySelectorAll('[data-plot=plot-1] .value')].map(v => v.innerText)"
    )
    assert all(values[:3]) and "…" in values[2]


def test_differences_from_a_thin_tube(opened: Open) -> None:
    page = opened(ordinary())
    page.draw("plot-1")
    assert page.run("return document.querySelector('[data-plot=plot-1] .difference').ariaPressed") == "true"
    data = "drawn.get(document.querySelector('[data-plot=plot-1]')).data"
    tube, drift = page.run(f"return [Math.max(...{data}.band.upper), {data}.lines[0].y.at(-1)]")
    assert 0.01 <= tube < 0.08 and 0.08 < drift < 0.1  # 3 tubes of 0.01 per second for 3 s
    page.click("[data-plot=plot-1] .difference")
    assert page.run(f"return Math.max(...{data}.lines[0].y)") > 0.5


def test_dark_and_light(opened: Open) -> None:
    page = opened(ordinary())
    ground = "return getComputedStyle(document.body).backgroundColor"
    page.draw("plot-1")
    light = page.run(ground)
    assert page.pixels("plot-1", (0xB0, 0x41, 0x3E)) > 100
    page.browser.execute_cdp_cmd(
        "Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": "dark"}]}
    )
    dark = page.run(ground)
    assert dark != light
    page.until("return document.querySelector('.theme').innerText === 'Light'")
    page.run("await new Promise(requestAnimationFrame)")
    assert page.pixels("plot-1", (0xE5, 0x7B, 0x76)) > 100
    page.click(".theme")
    assert page.run(ground) == light
    page.run("await new Promise(done => setTimeout(done, 500))")  # until the browser has stored it
    page.browser.refresh()
    page.until(f"{ground} === '{light}'")  # it is remembered
    page.click(".theme")
    assert page.run(ground) == dark


def test_link_opens_a_closed_finding(opened: Open) -> None:
    page = opened(ordinary())
    page.type("motor")
    page.run("location.hash = '#fmu-2-reference.tube'")
    page.until("return document.getElementById('fmu-2-reference.tube').checkVisibility()")
    assert page.count("[id='fmu-2-reference.tube'] .body") == 1


def test_keyboard_control(opened: Open) -> None:
    page = opened(ordinary())
    body = page.browser.find_element("css selector", "body")
    body.send_keys("/")
    assert page.run("return document.activeElement.type") == "search"
    page.browser.switch_to.active_element.send_keys("state")
    assert page.count(".finding") == 2
    page.browser.switch_to.active_element.send_keys("\ue00c")
    assert page.count(".finding") == 5
    summary = page.browser.find_element("css selector", "[id='fmu-1-archive.safe'] summary")
    summary.send_keys("\ue007")
    assert page.count("[id='fmu-1-archive.safe'] .body") == 1


def test_hostile_texts_are_harmless(opened: Open) -> None:
    page = opened(hostile())
    assert page.browser.title == "1 of 2 FMUs failed · FMU verification"
    for k in range(1, 8):
        page.run(f"document.getElementById('plot-{k}').hidden = false")
        page.draw(f"plot-{k}")
    assert page.browser.title == "1 of 2 FMUs failed · FMU verification"
    assert page.run("return document.documentElement.scrollWidth <= innerWidth")
    assert page.count("img") == 0


@pytest.mark.parametrize("width", [380, 1600])
def test_nothing_is_wider_than_the_window(opened: Open, width: int) -> None:
    page = opened(ordinary())
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    page.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    page.draw("plot-1")
    assert page.run("return document.documentElement.scrollWidth") <= width
    page.browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
