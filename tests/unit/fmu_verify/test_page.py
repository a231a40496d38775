"""The report as a page: its content, valid HTML, and harmless texts."""

import re
from typing import Any

import html5lib
import numpy as np
import pytest

from emla_cosim.base.tolerances import Tube
from emla_cosim.pages.bokeh_plots import build_figure
from emla_cosim.pages.comparisons import build_comparison_rows
from emla_cosim.pages.page import Plots
from emla_cosim.pages.panels import Band, Limit, Line, Plot, condense_curves
from emla_cosim.pages.text import format_number, make_visible, shorten_text
from fmu_verify.check import passed
from fmu_verify.page import render
from fmu_verify.report import Report
from tests.support.reports import comparison, examined, finding, hostile, ordinary, report, ten

XHTML = "{http://www.w3.org/1999/xhtml}"


def parsed(text: str) -> Any:
    """The page as a strict parser of HTML5 reads it."""
    return html5lib.HTMLParser(strict=True).parse(text)


def elements(root: Any, tag: str, **attributes: str) -> list[Any]:
    matches = root.iter(f"{XHTML}{tag}")
    return [
        e for e in matches if all(e.get(n.strip("_").replace("_", "-")) == v for n, v in attributes.items())
    ]


def text_of(element: Any) -> str:
    return " ".join(" ".join(element.itertext()).split())


@pytest.mark.parametrize("make", [ordinary, hostile, report])
def test_page_is_html5(make: Any) -> None:
    root = parsed(render(make()))
    ids = [e.get("id") for e in root.iter() if e.get("id")]
    assert len(ids) == len(set(ids))
    for link in elements(root, "a"):
        assert link.get("href")[1:] in ids
    for control in root.iter():
        if "aria-controls" in control.attrib:
            assert control.get("aria-controls") in ids


def test_page_shows_the_findings() -> None:
    root = parsed(render(ordinary()))
    assert text_of(elements(root, "h1")[0]) == "1 of 2 FMUs failed"
    assert [text_of(h) for h in elements(root, "h2")] == ["build/Plant.fmu", "other/Plant.fmu"]
    restored, tube = elements(root, "details", data_entry="failed")
    assert text_of(restored[0]) == "failed Something is as it should be x is 2 where it was 1. state.restored"
    assert text_of(restored[1]) == (
        "v is 3, was 4. What to do Do it right. "
        "The function returns a new instance of an FMU. FMI 2.0.4, 2.1.5 What was done Look at it. "
        "Repeat it emla verify build/Plant.fmu --only state.restored --explain Took 0.12 s."
    )
    names = [text_of(c) for c in elements(tube, "code")[1:4]]
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
    root = parsed(render(Report(ordinary().examined[:1], "0", "then")))
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
    report_ = report(*(examined(path, [finding("a.b", passed("It is."))]) for path in paths))
    assert text_of(elements(parsed(render(report_)), "h1")[0]) == headline


def test_hostile_texts_make_no_elements() -> None:
    text = render(hostile())
    root = parsed(text)
    assert not elements(root, "img")
    scripts = {"theme.js": 1, "plots.js": 1, "search.js": 1, "Bokeh": 2}
    assert len([s for s in elements(root, "script") if not s.get("type")]) == sum(scripts.values())
    assert not [e for e in root.iter() for name in e.attrib if name.startswith("on")]
    assert "{{7*7}}" in text_of(elements(root, "main")[0])
    rest = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202e\ud800-\udfff]", rest)
    assert r"over\u202eride" in text_of(elements(root, "main")[0])
    assert len(text_of(elements(root, "h2")[1])) < 200 and text_of(elements(root, "h2")[1]).endswith("xx.fmu")


def test_page_loads_nothing() -> None:
    root = parsed(render(ordinary()))
    policy = elements(root, "meta", http_equiv="Content-Security-Policy")[0].get("content")
    assert policy.startswith("default-src 'none';") and "http" not in policy
    for element in root.iter():
        for name in ("src", "href", "action", "data", "poster"):
            assert element.get(name, "#").startswith(("#", "data:")), element.attrib


@pytest.mark.slow
def test_pages_of_many_fmus_are_small() -> None:
    assert len(render(ten()).encode()) < 5e6


def test_pages_without_plots_are_small() -> None:
    without_plots = render(report())
    assert "Anaconda" not in without_plots and len(without_plots) < 40_000


# ---- plots -----------------------------------------------------------------------------------------


def drawn(plot: Plot, most: int = 800) -> Any:
    return build_figure(plot, most)


def curve(figure: Any, number: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of a line of a figure."""
    lines = [r for r in figure.renderers if r.glyph.__class__.__name__ in ("Line", "Step")]
    data = lines[number].data_source.data
    return data["time"], data[f"y{number}"]


def labels(figure: Any) -> list[str]:
    return [item.label.value for item in figure.legend[0].items]


def test_few_points_keep_peaks_and_gaps() -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(size=100_000)
    values[70_000], values[31_234], values[5_000:5_400] = 50, -50, np.nan
    curves = condense_curves(np.arange(100_000.0), [values, -values], 1000)
    assert len(curves) <= 1002 and {0, 31_234, 70_000, 99_999, 4_999, 5_400} <= set(curves.tolist())
    assert np.isnan(values[curves]).any()
    assert list(condense_curves(np.arange(90.0), [values[:90]], 1000)) == list(range(90))


def test_curves_are_accurate_to_a_pixel() -> None:
    time = np.linspace(0, 100, 700)
    values = 1e4 + np.sin(time)
    band = Band("tube", time, values - 1e-6, values + 1e-6)
    figure = drawn(Plot("m", (Line("result", time, values),), band))
    assert np.interp(time, *curve(figure)) == pytest.approx(values, rel=0, abs=2e-4)
    assert np.isin(curve(figure)[1], values).all()  # 32 bits are too few for these
    assert figure.y_range.start < 9999 < 10001 < figure.y_range.end


def test_reference_with_other_times_is_shown_at_common_times() -> None:
    time, rough = np.linspace(0, 1, 101), np.linspace(0.2, 2, 4)
    figure = drawn(Plot("m", (Line("result", time, time), Line("reference", rough, -rough))))
    at, values = curve(figure, 1)
    inside = np.isfinite(values)
    assert (at[inside].min(), at.max()) == pytest.approx((0.2, 2))
    assert values[inside] == pytest.approx(-at[inside])


def test_deviations_of_long_curves() -> None:
    """They are taken before points are left out: neither curve alone knows what the other was."""
    time = np.linspace(0, 100, 200_000)
    reference = np.sin(40 * time)
    values = reference + 1e-3 * np.sin(time)
    values[123_456] += 0.01
    edges = reference - 1e-3, reference + 1e-3
    plots = Plots()
    build_comparison_rows([comparison("x", "m", time, values, reference, *edges, Tube(1e-3, 0.0))], plots)
    figure = plots.figures["plot-2"]
    at, off = curve(figure)
    assert off == pytest.approx(np.interp(at, time, values - reference), abs=1e-4) and off.max() > 9e-3
    assert figure.renderers[0].data_source.data["upper"] == pytest.approx(1e-3, abs=2e-5)
    assert len(at) <= 802 and labels(figure)[:2] == ["tube", "result"]
    assert plots.subjects["plot-1"] == plots.subjects["plot-2"]


def test_range_ignores_a_diverging_line() -> None:
    time = np.linspace(0, 1, 50)
    band = Band("tube", time, np.full(50, -1.0), np.full(50, 1.0))
    figure = drawn(Plot("m", (Line("result", time, np.where(time > 0.5, 1e6, 0.0)),), band))
    assert (figure.y_range.start, figure.y_range.end) == pytest.approx((-1.2, 3.2))


@pytest.mark.parametrize("value", [np.nan, np.inf, 1.7e308, -1.7e308])
def test_values_beyond_any_axis_are_left_out(value: float) -> None:
    time = np.arange(4.0)
    figure = drawn(Plot("", (Line("a", time, np.array([0.0, value, 1.0, 2.0])),), mark=(1.0, "worst")))
    assert np.array_equal(curve(figure)[1], [0, np.nan, 1, 2], equal_nan=True)
    assert labels(figure) == ["a, 1 point not drawn", "worst at 0 s"]
    assert np.isfinite([figure.y_range.start, figure.y_range.end]).all()
    nothing = drawn(Plot("", (Line("a", time, np.full(4, value)),), mark=(1.0, "worst")))
    assert labels(nothing) == ["a, 4 points not drawn"] and np.isfinite(nothing.y_range.start)


def test_lines_without_points_and_without_height() -> None:
    none = np.array([])
    assert len(curve(drawn(Plot("", (Line("a", none, none),))))[1]) == 0
    span = drawn(Plot("", (Line("a", np.arange(3.0), np.full(3, 1e15)),))).y_range
    assert span.start < 1e15 < span.end


def test_limits_are_shown_where_they_are_near() -> None:
    line = Line("a", np.arange(3.0), np.array([0.0, 1.0, 0.5]))
    figure = drawn(Plot("x / m", (line,), limits=(Limit("stroke", None, 1.2), Limit("end", -50.0, None))))
    assert labels(figure) == ["a", "stroke … 1.2", "end -50 …"]
    assert -0.5 < figure.y_range.start and figure.y_range.end == pytest.approx(1.26)


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
