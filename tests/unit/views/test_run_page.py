"""The page of a run has the content of its files, and works in a real browser."""

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import html5lib
import numpy as np
import pytest
from selenium.webdriver import ActionChains, Keys
from selenium.webdriver.common.actions.wheel_input import ScrollOrigin

from emla_cosim.base.units import SiUnit
from emla_cosim.pages.page import Plots
from emla_cosim.recorders.recorder import RunLayout
from emla_cosim.recorders.table import TimeSeries
from emla_cosim.run.result import Result
from emla_cosim.ssp.diagram import build_diagrams, group_connections
from emla_cosim.study.loading import load
from emla_cosim.views.run_page.page import render_page
from emla_cosim.views.run_page.picture_plots import build_pictures
from emla_cosim.views.run_page.signals import list_signal_rows
from tests.support.browser import Page, chromium, figure_of
from tests.support.commands import Emla
from tests.support.tiers import mostly_slow

SCRIPT = "</script><script>document.title = 'taken'</script>"


@pytest.fixture(scope="module")
def result(fmu_folder: Path) -> Result:
    """One second of the study, for all tests here."""
    with load("study", gains="robust", fmus=fmu_folder, stop_time=1.0).prepare() as simulation:
        return simulation.run()


@pytest.fixture(scope="module")
def folder(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run as it is saved with its page."""
    path = tmp_path_factory.mktemp("study")
    result.save(path, plots=False, report=True)
    return path


@pytest.fixture(scope="module")
def lift_folder(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with the metrics of one joint, which has a third of the plots."""
    path = tmp_path_factory.mktemp("lift")
    lift = {"joints": {"lift": result.metrics["joints"]["lift"]}}
    replace(result, metrics=lift).save(path, plots=False, report=True)
    return path


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


@pytest.fixture
def opened(browser: Any, folder: Path) -> Iterator[Page]:
    page = Page(browser, folder / "report.html")
    yield page
    assert page.complaints() == []


def select(opened: Page, signal: str) -> str:
    """Select a signal, or no longer, and return the id of its plot once that is drawn."""
    boxes = "[...document.querySelectorAll('input[data-signal]')]"
    box = f"{boxes}.find((box) => box.closest('label').innerText.trim() === arguments[0])"
    plot = opened.run(f"const box = {box}; box.click(); return box.dataset.plot", signal)
    if opened.count(f"#{plot}"):
        opened.draw(plot)
    return plot


def visible_curves(plot: str) -> str:
    """What a script calls the renderers of a plot that are visible."""
    return f"{figure_of(plot)}.renderers.filter((curve) => curve.visible)"


def rebuilt(result: Result, names: list[str], rows: np.ndarray, **changed: Any) -> Result:
    """The result with other signals in its table."""
    table = TimeSeries()
    table.begin(RunLayout(names, [None] * len(names), result.times, range(len(names))))
    if len(rows):
        table.write(rows)
    table.end()
    return replace(result, table=table, metrics={}, displays={}, units=dict.fromkeys(names), **changed)


# ---- what it says ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def page(lift_folder: Path) -> ElementTree.Element:
    """The elements of the page, which is valid HTML."""
    text = (lift_folder / "report.html").read_text(encoding="utf-8")
    return html5lib.HTMLParser(strict=True, namespaceHTMLElements=False).parse(text)


def cells(row: ElementTree.Element) -> list[str]:
    """The texts of the cells of a row."""
    return [" ".join("".join(cell.itertext()).split()) for cell in row]


def test_page_is_small_and_its_links_have_targets(lift_folder: Path, page: ElementTree.Element) -> None:
    assert (lift_folder / "report.html").stat().st_size < 5e6
    ids = [e.get("id") for e in page.iter() if e.get("id")]
    assert len(ids) == len(set(ids))
    links = [a.get("href", "") for a in page.iter("a")]
    assert links and all(link[1:] in ids for link in links)


def test_metrics_are_those_of_metrics_json(
    page: ElementTree.Element, lift_folder: Path, result: Result
) -> None:
    header, *rows = (cells(row) for row in page.findall(".//*[@id='figures']//tr"))
    content = json.loads((lift_folder / "metrics.json").read_text())["joints"]
    assert header[1:-1] == list(content)
    texts = {row[0]: row[1:-1] for row in rows}
    for display in result.displays["joints"]:
        for joint, text in zip(content, texts[display.label], strict=True):
            value = content[joint][display.name]
            # none, as the run is short
            words = {"True": "yes", "False": "no", "None": "none"}.get(str(value))
            number = 0.0 if words else display.factor * value
            assert text == words or float(text.replace(",", "")) == pytest.approx(number, rel=1e-3)


def test_idealisations_are_those_of_metrics_json(page: ElementTree.Element, lift_folder: Path) -> None:
    _, *rows = (cells(row) for row in page.findall(".//*[@id='idealised']//tr"))
    joints = json.loads((lift_folder / "metrics.json").read_text())["joints"]
    expected = [(j, x["sentence"], x["option"], x["source"]) for j in joints for x in joints[j]["idealised"]]
    assert [tuple(row) for row in rows] == expected and len(expected) > 5
    (line,) = page.findall(".//*[@id='idealised']/p")
    assert "".join(line.itertext()).startswith("Idealised: no friction, exact lead, rigid, ")


def test_signal_metrics_match_their_rows(page: ElementTree.Element, result: Result) -> None:
    rows = {cells(row)[0]: cells(row) for row in page.findall(".//*[@data-entry]")}
    assert list(rows) == result.names
    values = result["lift.plant.i_q"]
    expected = [values.min(), values.max(), math.sqrt(np.mean(values**2)), values[-1]]
    row = rows["lift.plant.i_q"]
    # metrics use every communication point, rows every tenth
    assert [float(text) for text in row[1:5]] == pytest.approx(expected, rel=5e-3)
    assert row[5] == "A"


def test_settings_and_components_are_those_of_run_json(page: ElementTree.Element, lift_folder: Path) -> None:
    record = json.loads((lift_folder / "run.json").read_text())
    (main,) = page.iter("main")
    message = "".join(main.itertext())
    assert all(name in message for name in record["settings"])
    for name, component in record["components"].items():
        assert name in message and component["sha256"] in message
        for variable, change in component["changed"].items():
            assert f"{name}.{variable}" in message
            assert change["value"] == component["parameters"][variable] != change["default"]
    assert all(connection in message for connection in record["connections"])
    boxes = [box.findtext("{*}title", "") for box in page.findall(".//*[@class='box']")]
    assert [box.partition(":")[0] for box in boxes] == list(record["components"])


@pytest.fixture(scope="module")
def few_rows(result: Result) -> Result:
    """The run with a small table, whose page is made in a moment."""
    small = rebuilt(result, ["a.x"], np.array([[0.0, 1.0], [1.0, 2.0]]))
    return replace(small, metrics=result.metrics, displays=result.displays)


def test_failure_is_shown_first(few_rows: Result) -> None:
    failed = replace(few_rows, problem="the run ended at t = 1 s: <b>it broke</b>.", remarks=["It diverged."])
    text = render_page(failed, ["a unit is <i>odd</i>"])
    assert '<h1 class="failed">' in text and "&lt;b&gt;it broke" in text and "&lt;i&gt;odd" in text
    assert text.index("it broke") < text.index("It diverged.") < text.index("position error")


def test_options_are_shown_and_files_without_folders(few_rows: Result) -> None:
    files = {"input": [{"file": "/a/folder/load.csv", "end": "hold"}], "parameters": ["/a/folder/more.ssv"]}
    changed = {**files, "set": {"a.b": 2}, "gains": "x"}
    text = render_page(replace(few_rows, record={**few_rows.record, "changed": changed}))
    for words in ("input</bdi> <b><bdi>load.csv</bdi></b>", "more.ssv</bdi>", "gains</bdi>"):
        assert f"<bdi>{words}" in text
    assert "<bdi>set a.b</bdi> <b><bdi>2</bdi></b>" in text and "/a/folder" not in text


# ---- what it does ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_plots_of_a_joint_zoom_together(opened: Page) -> None:
    opened.draw("plot-1")
    before = opened.range("plot-1")
    drag = ActionChains(opened.browser).move_to_element_with_offset(opened.canvas("plot-1"), -80, 0)
    drag.click_and_hold().move_by_offset(60, 50).release().perform()
    opened.until(f"return {figure_of('plot-1')}.x_range.end < {0.9 * before[1]}")
    low, high = opened.range("plot-1")
    assert before[0] < low < high < before[1]
    assert opened.range("plot-4") == [low, high]  # of the same joint, two joints later
    assert opened.range("plot-2")[1] == pytest.approx(before[1])


@pytest.mark.slow
def test_the_wheel_zooms_with_control_and_scrolls_without(opened: Page) -> None:
    opened.draw("plot-1")
    before = opened.range("plot-1")
    origin = ScrollOrigin.from_element(opened.canvas("plot-1"))
    ActionChains(opened.browser).scroll_from_origin(origin, 0, -100).perform()
    assert opened.range("plot-1") == before
    zooming = ActionChains(opened.browser).key_down(Keys.CONTROL).scroll_from_origin(origin, 0, -300)
    zooming.key_up(Keys.CONTROL).perform()
    opened.until(f"return {figure_of('plot-1')}.x_range.end < {before[1]}")


@pytest.mark.slow
def test_transient_keeps_its_shape(opened: Page, result: Result) -> None:
    plot = select(opened, "lift.plant.i_q")
    data = f"{visible_curves(plot)}[0].data_source.data"
    x, y = opened.run(f"return [[...{data}.time], [...{data}.value]]")
    is_early = (result.time < 0.1) & np.isfinite(result["lift.plant.i_q"])
    drawn_values = np.interp(result.time[is_early], x, y)
    size = np.ptp(result["lift.plant.i_q"])
    assert np.abs(drawn_values - result["lift.plant.i_q"][is_early]).max() < 0.03 * size


def test_signal_metrics_are_those_of_metrics_json(result: Result, lift_folder: Path) -> None:
    """From every communication point: rows alone would miss what is between them."""
    data = result.read(["time", *result.names])
    rows = {row.name: asdict(row) for row in list_signal_rows(result, data, Plots())}
    content = json.loads((lift_folder / "metrics.json").read_text())["signals"]
    assert {name: {figure: row[figure] for figure in content[name]} for name, row in rows.items()} == content
    assert any(figures["maximum"] > data[name].max() for name, figures in content.items())


def test_constant_picture_is_left_out(result: Result) -> None:
    table = result.read(["time", *result.names])
    data = {name: 0.0 * x if ".theta[" in name else x for name, x in table.items()}
    lift = replace(result, metrics={"joints": {"lift": result.metrics["joints"]["lift"]}})
    with_all, _ = build_pictures(lift, table, Plots())
    without, _ = build_pictures(lift, data, Plots())
    assert {p.title for p in with_all} - {p.title for p in without} == {"Adaptation of the controller"}


@pytest.mark.slow
def test_signals_are_found_and_drawn_by_unit(opened: Page, result: Result) -> None:
    opened.type("LIFT plant i_")
    names = opened.run(
        "return [...document.querySelectorAll('[data-entry]')].filter((row) => row.checkVisibility())"
        ".map((row) => row.querySelector('label').innerText.trim())"
    )
    assert "lift.plant.i_q" in names and all("lift" in n and "i_" in n for n in names)
    assert opened.run("return document.querySelector('.shown').innerText").startswith(f"{len(names)} of ")
    assert opened.count("[data-signals]") == 0
    plots = {select(opened, name) for name in ("lift.plant.i_q", "lift.plant.i_d", "lift.plant.v_L")}
    assert opened.count("[data-signals]") == len(plots) == 2
    plot = select(opened, "lift.plant.v_L")  # again: it is hidden
    assert opened.count("[data-signals]") == 1
    (current,) = plots - {plot}
    assert opened.run(f"return {visible_curves(current)}.map((curve) => curve.name)") == [
        "lift.plant.i_q",
        "lift.plant.i_d",
    ]
    opened.type("nonsense")
    assert opened.count("[data-entry]") == 0 and opened.count(".nothing") == 1


@pytest.mark.slow
def test_reference_is_shown_with_its_tube(browser: Any, result: Result, folder: Path) -> None:
    comparisons = result.compare(folder)[:3]
    record = {**result.record, "reference": {"run": "earlier"}}
    path = folder / "compared.html"
    path.write_text(render_page(replace(result, comparisons=comparisons, record=record)), encoding="utf-8")
    opened = Page(browser, path)
    assert opened.count("details.signal.passed") == 3
    plot = opened.run("return document.querySelector('details.signal .plot').id")
    opened.draw(plot)
    labels = opened.run(f"return {figure_of(plot)}.above[0].items.map((item) => item.label.value)")
    assert {"tube", "result", "reference"} <= set(labels)
    assert opened.complaints() == []


# ---- what others put into it -------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("rows", [0, 3000])
def test_hostile_content_does_nothing(browser: Any, result: Result, tmp_path: Path, rows: int) -> None:
    names = [f"a.{SCRIPT}", "a.<!--<script>", "a.{{7*7}}\u202e"]
    time = np.linspace(0, 1, rows)
    values = np.column_stack(
        [time, np.where(time > 0.5, np.nan, 1e308 * np.sin(9 * time)), np.full(rows, np.inf), 1e-320 * time]
    )
    hostile = {"fmu": SCRIPT, "sha256": SCRIPT, "changed": {}}
    components = {f"a{SCRIPT}": hostile, "b": {"fmu": "", "sha256": ""}}
    record = {**result.record, "components": components, "connections": [f"a{SCRIPT}.x -> b.y", SCRIPT]}
    hostile_result = rebuilt(result, names, values, name=SCRIPT, remarks=[SCRIPT], record=record, steps=rows)
    hostile_result = replace(hostile_result, units=dict.fromkeys(names, SiUnit(SCRIPT)))
    (tmp_path / "page.html").write_text(render_page(hostile_result, [SCRIPT]), encoding="utf-8")
    opened = Page(browser, tmp_path / "page.html")
    assert opened.browser.title.startswith("</script>")
    assert opened.run("return document.querySelectorAll('[data-signal]').length") == (3 if rows else 0)
    if rows:
        select(opened, f"a.{SCRIPT}")
    assert opened.browser.title.startswith("</script>") and opened.complaints() == []


@pytest.mark.parametrize(("signals", "rows"), mostly_slow([(1500, 2000), (3, 200_000)], [(3, 200_000)]))
def test_size_of_the_page_is_bounded(signals: int, rows: int, result: Result) -> None:
    values = np.random.default_rng(1).normal(size=(rows, signals))
    table = np.column_stack([np.arange(float(rows)), values])
    page = render_page(rebuilt(result, [f"a.s{k}" for k in range(signals)], table))
    assert len(page.encode()) < 5e6
    assert ("500 more signals" in page) == (signals == 1500)


def test_system_without_pictures_is_shown_by_unit(result: Result) -> None:
    time = np.linspace(0, 1, 50)
    names = ["pump.p", "pump.q", "valve.p", "valve.still"]
    plain_result = rebuilt(result, names, np.column_stack([time, time, 2 * time, 3 * time, 0 * time]))
    units = {"pump.p": SiUnit("Pa"), "pump.q": SiUnit("m3/s"), "valve.p": SiUnit("Pa"), "valve.still": None}
    constant = {"valve.still": {"minimum": 0.0, "maximum": 0.0}}
    plain_result = replace(plain_result, units=units, signals=constant)
    plots = Plots()
    build_pictures(plain_result, plain_result.read(["time", *names]), plots)
    figures = plots.figures.values()
    actual = [(x.yaxis.axis_label, [item.label.value for item in x.legend[0].items]) for x in figures]
    assert actual == [("Pa", ["pump.p", "valve.p"]), ("m3/s", ["pump.q"])]


def test_large_diagram_has_parts() -> None:
    sixty = [f"joint{k // 6}.part{k % 6}" for k in range(60)]
    joined = group_connections(sixty, [f"{a}.out -> {b}.in" for a, b in pairwise(sixty)])
    diagrams = build_diagrams(dict.fromkeys(sixty, "an FMU"), joined)
    assert [d.title for d in diagrams] == ["Overview", *(f"joint{k}" for k in range(10))]
    assert len(diagrams[0].boxes) == 10 and len(diagrams[0].lines) == 9
    assert all(len(d.boxes) == 6 and len(d.lines) == 5 for d in diagrams[1:])
    assert build_diagrams(dict.fromkeys([f"c{k}" for k in range(500)], "an FMU"), []) == []
    assert build_diagrams({}, []) == []


def test_labels_count_signals() -> None:
    names = dict.fromkeys(["a", "b", "c"], "an FMU")
    joined = group_connections(
        names, ["a.long_name_of_an_output -> b.in", "b.one_output -> c.x", "b.other_one -> c.y"]
    )
    labels = [line.label for d in build_diagrams(names, joined) for line in d.lines]
    assert labels == ["1 signal", "2 signals"]


def test_connections_are_grouped_by_components() -> None:
    actual = group_connections(
        ["a", "a.b", "c -> d"], ["a.b.x -> a.y", "a.x -> a.b.y value * 2", "a.z -> a.b.w", "nonsense"]
    )
    assert [(w.source, w.target, w.signals) for w in actual] == [
        ("a.b", "a", (("x", "y"),)),
        ("a", "a.b", (("x", "y"), ("z", "w"))),
    ]


def test_command_writes_the_page(emla: Emla, tmp_path: Path) -> None:
    options = ("run", "lift", "--stop-time", "0.01", "--no-plots", "--output", "out")
    result = emla(*options, "--report")
    assert result.exit_code == 0 and "Report: out/report.html" in result.output
    assert "emla rerun run.json" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert emla(*options).exit_code == 0
    assert not (tmp_path / "out" / "report.html").exists()  # that of an earlier run is not left
