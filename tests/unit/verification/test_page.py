"""The report as a page: its content, valid HTML, and harmless texts."""

import json
import re
from typing import Any

import html5lib
import numpy as np
import pytest

from emla_cosim.verification.page import render_page
from emla_cosim.verification.report import Report
from emla_cosim.verification.verdict import passed
from emla_cosim.views.pages.curve_data import thin_points
from emla_cosim.views.pages.page import Plots
from emla_cosim.views.pages.plot_data import as_json
from emla_cosim.views.pages.text import format_number, make_visible, shorten_text
from emla_cosim.views.panels import Band, Line, Plot
from tests.support.reports import examined, finding, hostile, ordinary, report, ten

XHTML = "{http://www.w3.org/1999/xhtml}"


def parsed(text: str) -> Any:
    """The page as a strict parser of HTML5 reads it."""
    return html5lib.HTMLParser(strict=True).parse(text)


def elements(root: Any, tag: str, **attributes: str) -> list[Any]:
    found = root.iter(f"{XHTML}{tag}")
    return [
        e for e in found if all(e.get(n.strip("_").replace("_", "-")) == v for n, v in attributes.items())
    ]


def text_of(element: Any) -> str:
    return " ".join(" ".join(element.itertext()).split())


@pytest.mark.parametrize("make", [ordinary, hostile, report])
def test_page_is_html5(make: Any) -> None:
    root = parsed(render_page(make()))
    ids = [e.get("id") for e in root.iter() if e.get("id")]
    assert len(ids) == len(set(ids))
    for link in elements(root, "a"):
        assert link.get("href")[1:] in ids
    for control in root.iter():
        if "aria-controls" in control.attrib:
            assert control.get("aria-controls") in ids


def test_page_shows_the_findings() -> None:
    root = parsed(render_page(ordinary()))
    assert text_of(elements(root, "h1")[0]) == "1 of 2 FMUs failed"
    assert [text_of(h) for h in elements(root, "h2")] == ["build/Plant.fmu", "other/Plant.fmu"]
    restored, tube = elements(root, "details", data_verdict="failed")
    assert text_of(restored[0]) == "failed Something is as it should be x is 2 where it was 1. state.restored"
    assert text_of(restored[1]) == (
        "v is 3, was 4. What to do Do it right. "
        "The function returns a new instance of an FMU. FMI 2.0.4, 2.1.5 What was done Look at it. "
        "Repeat it emla verify build/Plant.fmu --only state.restored --explain Took 0.12 s."
    )
    names = [text_of(b) for b in elements(tube, "button")]
    assert names == ["motor.v", "motor.i", "x"]  # what left its tube first is first
    buttons = [text_of(b) for b in elements(root, "button") if b.get("aria-pressed")]
    assert buttons == ["3 passed", "1 warning", "2 failed", "1 skipped"]
    matrix = elements(root, "table")[0]
    assert [[text_of(cell) for cell in row] for row in elements(matrix, "tr")] == [
        ["FMU", "archive", "description", "state", "reference", "time"],
        ["build/Plant.fmu", "passed", "warning 1", "failed 1", "failed 1", "1.5 s"],
        ["other/Plant.fmu", "passed", "", "", "passed", "1.5 s"],
    ]


def test_report_of_one_fmu_has_no_matrix() -> None:
    root = parsed(render_page(Report(ordinary().examined[:1], "0", "then")))
    assert "card overview" not in [s.get("class") for s in elements(root, "section")]
    assert text_of(elements(root, "h1")[0]) == "The FMU failed"


@pytest.mark.parametrize(
    ("paths", "headline"),
    [
        (["a.fmu"], "The FMU passed"),
        (["a.fmu", "b.ssp"], "All 2 FMUs passed"),
        (["a.ssp"], "The system passed"),
        (["a.ssp", "b.ssp"], "All 2 systems passed"),
        ([], "All 0 FMUs passed"),
    ],
)
def test_headline_names_fmus_or_systems(paths: list[str], headline: str) -> None:
    given = report(*(examined(path, [finding("a.b", passed("It is."))]) for path in paths))
    assert text_of(elements(parsed(render_page(given)), "h1")[0]) == headline


def test_hostile_texts_make_no_elements() -> None:
    text = render_page(hostile())
    root = parsed(text)
    assert not elements(root, "img")
    allowed = {"theme.js", "curves.js", "plots.js", "search.js", "page.js"}
    assert len([s for s in elements(root, "script") if not s.get("type")]) == len(allowed)
    assert not [e for e in root.iter() for name in e.attrib if name.startswith("on")]
    assert "{{7*7}}" in text_of(elements(root, "main")[0])
    rest = re.sub(r'<script type="text/plain" id="bokeh">.*?</script>', "", text, flags=re.DOTALL)
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202e\ud800-\udfff]", rest)
    assert r"over\u202eride" in text_of(elements(root, "main")[0])
    assert len(text_of(elements(root, "h2")[1])) < 200 and text_of(elements(root, "h2")[1]).endswith("xx.fmu")


def test_page_loads_nothing() -> None:
    root = parsed(render_page(ordinary()))
    policy = elements(root, "meta", http_equiv="Content-Security-Policy")[0].get("content")
    assert policy.startswith("default-src 'none';") and "http" not in policy
    for element in root.iter():
        for name in ("src", "href", "action", "data", "poster"):
            assert element.get(name, "#").startswith(("#", "data:")), element.attrib


def test_pages_are_small() -> None:
    assert len(render_page(ten()).encode()) < 5e6
    without_plots = render_page(report())
    assert "Anaconda" not in without_plots and len(without_plots) < 40_000


# ---- plots -----------------------------------------------------------------------------------------


def drawn(plot: Plot) -> dict[str, Any]:
    def refuse(name: str) -> None:
        raise AssertionError(name)

    return json.loads(as_json(plot), parse_constant=refuse)


def test_thinning_keeps_extremes_and_gaps() -> None:
    rng = np.random.default_rng(1)
    curve = rng.normal(size=100_000)
    curve[70_000], curve[31_234], curve[5_000:5_400] = 50, -50, np.nan
    kept = thin_points(curve)
    assert len(kept) <= 1202 and {0, 31_234, 70_000, 99_999} <= set(kept)
    assert np.isnan(curve[kept]).any()
    for part in np.array_split(np.arange(100_000), 400)[::37]:
        assert np.nanmax(curve[part]) == np.nanmax(curve[kept[np.isin(kept, part)]])
    assert list(thin_points(curve[:800])) == list(range(800))


def test_curves_are_accurate_to_a_pixel() -> None:
    time = np.linspace(0, 100, 700)
    values = 1e4 + np.sin(time)
    band = Band("tube", time, values - 1e-6, values + 1e-6)
    found = drawn(Plot("m", (Line("result", time, values),), band))
    assert np.allclose(found["lines"][0]["y"], values, rtol=0, atol=2e-8)
    assert found["lines"][0]["x"] == {"first": 0, "last": 100, "count": 700}
    assert found["y"][0] < 9999 < 10001 < found["y"][1]


def test_uneven_times() -> None:
    time = np.sort(np.concatenate([np.linspace(0, 1, 50), np.linspace(1e-4, 2e-4, 7), [0.5]]))
    late = 1e6 + np.cumsum([0, 1e-3, 1e-3, 2e-3])
    for times, error in ((time, 1e-6), (late, 1e-5)):
        found = drawn(Plot("", (Line("a", times, times),)))["lines"][0]["x"]
        assert np.allclose(found, times, rtol=0, atol=error)


def test_differences_of_long_curves() -> None:
    """They are taken before points are left out: neither curve alone knows what the other was."""
    time = np.linspace(0, 100, 200_000)
    reference = np.sin(40 * time)
    values = reference + 1e-3 * np.sin(time)
    values[123_456] += 0.01
    band = Band("tube", time, reference - 1e-3, reference + 1e-3)
    found = drawn(
        Plot("m", (Line("result", time, values), Line("reference", time, reference)), band, against=1)
    )
    line = found["lines"][0]
    off = np.array(line["y"]) - np.array(line["base"])
    at = np.interp(line["x"], time, values - reference)
    assert np.allclose(off, at, rtol=0, atol=2e-5) and off.max() > 9e-3
    width = np.array(found["band"]["upper"]) - np.array(found["band"]["base"])
    assert np.allclose(width, 1e-3, rtol=0, atol=2e-5)
    assert len(line["x"]) <= 2402 and found["base"] == "reference"


def test_range_ignores_a_diverging_line() -> None:
    time = np.linspace(0, 1, 50)
    band = Band("tube", time, np.full(50, -1.0), np.full(50, 1.0))
    runaway = np.where(time > 0.5, 1e6, 0.0)
    low, high = drawn(Plot("m", (Line("result", time, runaway),), band))["y"]
    assert (low, high) == pytest.approx((-1.2, 3.2))


@pytest.mark.parametrize("value", [np.nan, np.inf, 1.7e308, -1.7e308])
def test_values_beyond_any_axis_are_left_out(value: float) -> None:
    time = np.arange(4.0)
    found = drawn(Plot("", (Line("a", time, np.array([0.0, value, 1.0, 2.0])),), mark=(1.0, "worst")))
    assert (found["lines"][0]["y"], found["lines"][0]["missing"]) == ([0, None, 1, 2], 1)
    assert np.isfinite(found["y"]).all() and (found["mark"]["x"], found["mark"]["y"]) in [(0, 0), (2, 1)]
    nothing = drawn(Plot("", (Line("a", time, np.full(4, value)),), mark=(1.0, "worst")))
    assert nothing["mark"] is None and np.isfinite(nothing["y"]).all()


def test_lines_without_points_and_without_height() -> None:
    none = np.array([])
    assert drawn(Plot("", (Line("a", none, none),)))["lines"][0]["y"] == []
    low, high = drawn(Plot("", (Line("a", np.arange(3.0), np.full(3, 1e15)),)))["y"]
    assert low < 1e15 < high


def test_plots_of_one_shape_share_a_figure() -> None:
    line = Line("a", np.arange(2.0), np.arange(2.0))
    plots = Plots()
    names = [plots.add(Plot("", lines)) for lines in ((line,), (line,), (line, line))]
    assert names == ["plot-1", "plot-2", "plot-3"]
    assert re.findall(r'id="(figure[^"]*)"', str(plots.scripts())) == ["figure-1-0-0", "figure-2-0-0"]


# ---- texts -----------------------------------------------------------------------------------------


def test_texts_and_numbers() -> None:
    assert make_visible("a\x1b[31m\u202eb\udc80\tc\r\nd") == "a\\x1b[31m\\u202eb\\udc80\tc\n\nd"
    assert make_visible("µ עברית 你好") == "µ עברית 你好"
    assert shorten_text("abc" * 100, 20) == "abcabcabcabcabc … bcabc"
    assert shorten_text("abc", 3) == "abc"
    values = (1 / 3, 1e-9, float("nan"), float("-inf"), 500, 10**400, True, "x\x07")
    assert [format_number(v) for v in values] == [
        "0.3333", "1e-09", "not a number", "-∞", "500", "∞", "True", "x\\x07",
    ]  # fmt: skip
