"""The page of a report in a browser: search, plots, zoom, keys, themes, and hostile texts."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from fmu_verify.report import Report
from tests.support.browser import Page, chromium, figure_of
from tests.support.reports import hostile, ordinary

TOOLTIP = """
const texts = (root) => [...root.querySelectorAll("*")].flatMap((e) => [
  ...(e.matches(".bk-tooltip-row-label, .bk-tooltip-row-value") ? [e.textContent.trim()] : []),
  ...(e.shadowRoot ? texts(e.shadowRoot) : [])]);
const text = () => { const list = texts(document.body); return list.length && list; }"""
"""Defines `text`, the texts at the pointer."""


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
    assert page.count(".finding") == 1 and page.count(".fmu") == 1 and page.count("[data-about]") == 1
    page.type("nonsense")
    assert page.count(".finding") == 0 and page.count(".nothing") == 1
    page.click(".nothing button")
    assert page.count(".nothing") == 0 and page.count("#fmu-2 .finding") == 0
    page.click("button[data-verdict=skipped]")
    page.click("button[data-verdict=warning]")
    assert page.count(".finding") == 2 and page.count("[data-about]") == 1
    page.click("button[data-verdict=warning]")
    assert page.count(".finding") == 1 and page.count(".finding.skipped") == 1


def test_plot_of_a_closed_signal_is_drawn_when_it_is_opened(opened: Open) -> None:
    page = opened(ordinary())
    assert page.count("#fmu-2 .plot") == 0
    for summary in ("#fmu-2", "[id='fmu-2-reference.tube']"):
        page.click(f"{summary} > summary")
    page.draw("plot-7")
    page.until("return document.querySelector('#plot-7 > div').offsetWidth > 300")
    x = f"{figure_of('plot-7')}.renderers[1].data_source.data.time"
    count, *ends = page.run(f"return [{x}.length, {x}[0], {x}.at(-1)]")
    assert count > 400 and ends == pytest.approx([0, 5])
    assert page.range("plot-7") == pytest.approx([-0.05, 5.05])
    page.run("await new Promise((done) => setTimeout(done, 300))")
    assert page.pixels("plot-7", (0x2F, 0x6D, 0xB3)) > 100


def test_plots_of_a_signal_zoom_together(opened: Open) -> None:
    from selenium.webdriver import ActionChains

    page = opened(ordinary())
    page.draw("plot-1")
    x, y = page.range("plot-1"), page.range("plot-1", "y")
    drag = ActionChains(page.browser).move_to_element_with_offset(page.canvas("plot-1"), -100, 0)
    drag.click_and_hold().move_by_offset(200, 50).release().perform()
    page.until(f"return {figure_of('plot-1')}.x_range.start > {x[0]} + 0.5")
    low, high = page.range("plot-1")
    assert x[0] + 0.5 < low < high < x[1] - 0.5
    assert page.range("plot-1", "y")[1] < y[1]
    assert page.range("plot-2") == [low, high] and page.range("plot-3") == pytest.approx(x)


def test_mouse_shows_values(opened: Open) -> None:
    from selenium.webdriver import ActionChains

    page = opened(ordinary())
    page.draw("plot-1")
    for move in (-5, 5):  # the first may come before the plot listens
        ActionChains(page.browser).move_to_element_with_offset(page.canvas("plot-1"), move, 0).perform()
        page.run("await new Promise((done) => setTimeout(done, 300))")
    text = page.until(f"{TOOLTIP}; return text()")
    assert 2 < float(text[text.index("time / s:") + 1]) < 3
    names = ("result, m:", "reference, m:", "tube:")
    assert all(re.match(r"-?[0-9.]+", text[text.index(name) + 1]) for name in names)


def test_deviations_and_tube_have_a_plot(opened: Open) -> None:
    page = opened(ordinary())
    page.draw("plot-2")
    band, line = (f"{figure_of('plot-2')}.renderers[{k}].data_source.data" for k in range(2))
    tube, drift = page.run(f"return [Math.max(...{band}.upper), {line}.y0.at(-1)]")
    assert 0.01 <= tube < 0.08 and 0.08 < drift < 0.1  # 3 tubes of 0.01 per second for 3 s


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
    assert page.run("return getComputedStyle(document.querySelector('#plot-1')).filter") != "none"
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
    page.run("for (const part of document.querySelectorAll('details')) part.open = true")
    for k in range(1, 15):
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
