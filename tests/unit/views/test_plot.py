"""`emla plot`: signals of stored runs over one another; and pictures of systems without joints."""

import json
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from PIL import Image

import emla_cosim as ec
from emla_cosim.pages.panels import Line, Plot, condense_curves
from emla_cosim.study.loading import load
from emla_cosim.views.plots import panel_drawing, pictures, stacked
from emla_cosim.views.plots.overlay import overlay_runs, read_traces
from emla_cosim.views.plots.panel_drawing import draw_panels
from emla_cosim.views.plots.stacked import MOST_PANELS
from emla_cosim.views.plots.style import save
from tests.support.axis import axis
from tests.support.commands import Emla, sentence
from tests.support.tiers import mostly_slow

Columns = Mapping[str, Any]


def write_run(
    folder: Path, columns: Columns, units: Mapping[str, str] | None = None, form: str = "csv"
) -> Path:
    """A folder of results with these columns; without units it has no run.json."""
    folder.mkdir(parents=True)
    frame = polars.DataFrame({name: np.asarray(values, float) for name, values in columns.items()})
    write = frame.write_csv if form == "csv" else frame.write_parquet
    write(folder / f"results.{form}")
    if units is not None:
        (folder / "run.json").write_text(json.dumps({"units": units}))
    return folder


def drawn(*paths: Path, **how: Any) -> tuple[list[Any], list[str]]:
    """The axes of the picture of these runs, and its notes."""
    overlay = overlay_runs(read_traces(paths), **how)
    return [axes for axes in overlay.figure.axes if axes.get_visible()], list(overlay.notes)


def curves(axes: Any) -> dict[str, tuple[list[float], list[float]]]:
    return {line.get_label(): (list(line.get_xdata()), list(line.get_ydata())) for line in axes.get_lines()}


def test_runs_of_different_steps_are_overlaid(tmp_path: Path) -> None:
    a = write_run(tmp_path / "a", {"time": [0, 1, 2], "x": [1, 2, 3], "v": [0, 0, 0]}, {"x": "m", "v": "m/s"})
    b = write_run(tmp_path / "b", {"time": [0, 0.5], "x": [1, 5]}, form="parquet")
    c = write_run(tmp_path / "c", {"time": [0, 9], "x": [7, 8]}, {"x": "mm"})
    axes, notes = drawn(a, b, c)
    titles = [(x.get_title(loc="left"), x.get_ylabel()) for x in axes]
    assert titles == [("x", "m"), ("x", "mm"), ("v", "m/s")]
    assert curves(axes[0]) == {"a": ([0, 1, 2], [1, 2, 3]), "b": ([0, 0.5], [1, 5])}
    assert curves(axes[1]) == {"c": ([0, 9], [7, 8])}
    assert notes == ["b has no v.", "c has no v."]
    assert len({line.get_color() for x in axes for line in x.get_lines()}) == 3


def test_one_run_has_panels_by_unit_within_the_times(tmp_path: Path) -> None:
    columns = {"time": [0, 1, 2, 3], "a.x": [1, 2, 3, 4], "a.v": [0, 1, 0, 1], "b.x": [4, 3, 2, 1]}
    path = write_run(tmp_path / "a", columns, {"a.x": "m", "b.x": "m"})
    axes, notes = drawn(path, begin=1.0, end=2.0)
    assert [list(curves(x)) for x in axes] == [["a.x", "b.x"], ["a.v"]] and notes == []
    assert [x.get_ylabel() for x in axes] == ["m", ""]
    assert curves(axes[0])["b.x"] == ([1, 2], [3, 2])
    assert [list(curves(x)) for x in drawn(path, patterns=["b.*"])[0]] == [["b.x"]]


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_long_table_reports_rows_that_are_not_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, form: str
) -> None:
    monkeypatch.setattr(panel_drawing, "MOST_ROWS", 100)
    paths = [write_run(tmp_path / str(n), {"time": range(n), "x": range(n)}, form=form) for n in (101, 100)]
    axes, notes = drawn(*paths)
    assert notes == ["101: 51 of 101 rows drawn."]
    assert [len(x) for x, _ in curves(axes[0]).values()] == [51, 100]


def test_pictures_report_rows_that_are_not_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    with load("lift", stop_time=0.02).prepare() as simulation:
        result = simulation.run(output_interval=1e-4)

    def corner() -> set[str]:
        figures = [figure for _, figure in pictures.draw_figures(result) if figure]
        texts = [text.get_text() for figure in figures for text in figure.texts]
        return {text for text in texts if "rows" in text}

    assert corner() == set()
    monkeypatch.setattr(panel_drawing, "MOST_ROWS", 150)
    assert corner() == {"101 of 201 rows drawn"}


def test_default_signals_of_joints(tmp_path: Path) -> None:
    names = ("time", "lift.plant.x_L", "lift.plant.v_L", "lift.reference.x_d", "p")
    columns = {name: [0, 1] for name in names}
    path = write_run(tmp_path / "a", columns, {})
    axes, notes = drawn(path)
    assert [list(curves(x)) for x in axes] == [["lift.plant.x_L", "lift.reference.x_d"]]
    assert notes == ["2 of 4 signals are plotted; --signals selects others."]
    roles = {"j.x_L": "p", "j.x_d": "lift.plant.v_L"}
    (path / "run.json").write_text(json.dumps({"settings": {"roles": roles}}))
    assert {"p", "lift.plant.v_L"} <= curves(drawn(path)[0][0]).keys()


def test_peak_of_one_row_is_drawn() -> None:
    time = np.linspace(0, 1, 100_001)
    values = np.zeros(100_001)
    values[54_321] = 9.0
    figure = draw_panels([Plot("x", (Line("x", time, values, "#000000"),), column="a")], "", "")
    with BytesIO() as stream:
        save(figure, stream)
        pixels = np.asarray(Image.open(stream).convert("L"))
    inside = figure.axes[0].get_window_extent()
    middle = pixels[len(pixels) // 2, int(inside.x0) + 9 : int(inside.x1)]
    (peak,) = np.flatnonzero(middle == middle.min())[:1] / len(middle)
    assert peak == pytest.approx(0.54, abs=0.02) and middle.min() < 100


@pytest.mark.parametrize("level", [0.0, 3.0])
@pytest.mark.parametrize(
    "gaps", [[(333, 445)], [(0, 7), (500, 501), (990, 1000)], [(10, 20), (40, 50), (777, 790)]], ids=str
)
def test_condensed_curve_keeps_edges_of_gaps(gaps: list[tuple[int, int]], level: float) -> None:
    """Even of a curve that is the same everywhere: nothing else says where it begins and ends."""
    values = np.full(1000, level)
    for first, end in gaps:
        values[first:end] = np.nan
    edges = {i for first, end in gaps for i in (first - 1, first, end - 1, end) if 0 <= i < len(values)}
    actual = condense_curves(np.linspace(2.0, 3.0, 1000), [values], 200)
    assert edges <= set(actual.tolist())
    assert {0, 999} <= set(actual.tolist()) and len(actual) <= 200


FORMATS = [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")]


@pytest.mark.parametrize(("ending", "begin"), mostly_slow(FORMATS, FORMATS[2:]))
def test_format_of_the_ending_and_foreign_files(
    ending: str, begin: bytes, tmp_path: Path, emla: Emla, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_run(tmp_path / "a", {"time": [0, 1], "x": [2, 3]})
    name = f"plot.{ending}"
    content = list[bytes]()
    for _ in range(2):
        assert emla("plot", "a", "--output", name).exit_code == 0
        content.append(Path(name).read_bytes())
    assert content[0].startswith(begin) and content[0] == content[1]
    if ending != "png":  # people edit these
        Path(name).write_bytes(edited := content[0].replace(b"emla", b"EMLA", 1))
        assert emla("plot", "a", "--output", name).exit_code == 2
        assert Path(name).read_bytes() == edited
    Path(name).write_bytes(begin + b" of another program")
    assert emla("plot", "a", "--output", name).exit_code == 2
    assert Path(name).read_bytes() == begin + b" of another program"


@pytest.mark.parametrize(("layout", "width"), [("screen", 8.7), ("one-column", 3.46), ("two-columns", 7.13)])
def test_layouts_have_the_width_of_a_column(layout: str, width: float, tmp_path: Path) -> None:
    names = {f"machine.component.signal_{i}": [0, i] for i in range(3)}
    traces = read_traces([write_run(tmp_path / "a", {"time": [0, 1], **names})])
    figure = overlay_runs(traces, layout=layout).figure
    assert figure.get_figwidth() == pytest.approx(width)
    figure.draw_without_rendering()
    assert figure.axes[0].get_window_extent().width > 0.55 * figure.bbox.width  # the legend leaves room
    assert (figure.get_suptitle() == "a") is (layout == "screen")
    assert overlay_runs(traces, layout=layout, title="mine").figure.get_suptitle() == "mine"


@pytest.mark.parametrize("layout", ["one-column", "two-columns"])
@pytest.mark.parametrize("runs", [1, 2])
def test_legends_above_panels_cover_nothing(layout: str, runs: int, tmp_path: Path) -> None:
    """They name the signal of the panel, and do not take the height of its curves."""
    columns = {"time": [0, 1], **{f"telescope.controller.signal_{i}": [0, i] for i in range(6)}}
    paths = [write_run(tmp_path / name, columns, dict.fromkeys(columns, "m")) for name in ("first", "second")]
    figure = overlay_runs(read_traces(paths[:runs]), layout=layout).figure
    figure.draw_without_rendering()
    below = figure.bbox.y1
    for axes in figure.axes:
        legend, box = axes.get_legend(), axes.get_window_extent()
        assert legend is not None
        extent = legend.get_window_extent()
        assert box.y1 - 1.0 <= extent.y0 < extent.y1 <= below + 1.0
        assert extent.x1 <= figure.bbox.x1 + 1.0 and box.height > 0.6 * figure.dpi
        assert runs == 1 or (legend.get_title().get_text() in columns and not axes.get_title(loc="left"))
        below = box.y0


def test_result_prints_as_a_table(fmu_folder: Path) -> None:
    result = ec.load("lift", stop_time=0.4, fmus=fmu_folder).prepare().run()
    text = str(result)
    error = result.metrics["joints"]["lift"]["position_error_m"]
    row = next(line for line in text.splitlines() if "position error" in line)
    assert f"{1e6 * error:.4g}" in row and "µm" in row
    assert len(text) < 2000 and "\x1b" not in text
    assert repr(result) == "<Result of lift: until 0.4 s, 4000 steps, 50 signals>"


def test_number_of_panels_is_bounded(tmp_path: Path) -> None:
    columns = {"time": [0, 1], **{f"s{i}.{'n' * 300}": [i, i] for i in range(1000)}}
    path = write_run(tmp_path / "a", columns)
    with pytest.raises(ec.CommandError, match=r"1000 signals need 167 panels, but a plot has at most 24;"):
        drawn(path, patterns=["*"])
    axes, notes = drawn(path)
    assert len(axes) == MOST_PANELS
    assert notes == ["144 of 1000 signals are plotted; --signals selects others."]
    assert len(drawn(path, path)[0]) == MOST_PANELS


@pytest.mark.parametrize("name", ["$x^2$", "_hidden", "*?[x]#", "line\nbreak"])
def test_names_are_not_markup(name: str, tmp_path: Path) -> None:
    path = write_run(tmp_path / "$a_b$", {"time": [0, 1], name: [0, 1]}, {name: "$m"})
    axes, _ = drawn(path, patterns=[name])
    axes[0].figure._repr_png_()
    texts = axes[0].get_legend().get_texts()
    assert [text.get_text() for text in texts] == [name] and not any(text.get_parse_math() for text in texts)


def test_unfinished_table_is_drawn(tmp_path: Path) -> None:
    path = write_run(tmp_path / "a", {"time": [0, 1], "x": [2, 3]})
    with (path / "results.csv").open("a") as stream:
        stream.write("2.0,4")
    assert curves(drawn(path)[0][0]) == {"x": ([0, 1], [2, 3])}


@pytest.mark.parametrize(
    "content", ["[]", "{", '{"units": 3, "settings": []}', '{"units": {"x": 3}}', "[" * 9999]
)
def test_invalid_record_leaves_units_unknown(content: str, tmp_path: Path) -> None:
    path = write_run(tmp_path / "a", {"time": [0, 1], "x": [2, 3]})
    (path / "run.json").write_text(content)
    assert [x.get_ylabel() for x in drawn(path)[0]] == [""]


WRONG = [
    (["nowhere"], "the run, 'nowhere', does not exist."),
    (["empty"], "the run, 'empty', has no results.csv or results.parquet."),
    (["a", "--signals", "y"], "no signal matches 'y'; there are x."),
    (["a", "--from", "nan"], "--from is 'nan'; it must be a number, or a number and a unit"),
    (
        ["a", "--from", "9 h"],
        "there are no rows to plot: the tables are empty, or have none between these times.",
    ),
    (["a", "--from", "1", "--to", "1"], "the plot begins at 1 s, which must be before its end, 1 s."),
    (["a", "--output", "a/results.csv"], "the plot file 'a/results.csv' must end in .png, .pdf or .svg."),
    (["b.png", "--output", "b.png"], "the run 'b.png' has no column called time or t"),
    (["a", "--output", "no/b.png"], "the plot 'no/b.png' cannot be written: there is no folder 'no'."),
    (["header"], "there are no rows to plot: the tables are empty, or have none between these times."),
    (["text"], "there are no numbers to plot in text."),
    (["a"] * 13, "13 runs are too many: a plot shows up to 12."),
]


@pytest.mark.parametrize(("arguments", "words"), WRONG)
def test_mistake_gives_one_message(arguments: list[str], words: str, emla: Emla) -> None:
    write_run(Path("a"), {"time": [0, 1], "x": [2, 3]})
    write_run(Path("header"), {"time": [], "x": []})
    Path("empty").mkdir()
    Path("b.png").write_text("x,y\n1,2\n")
    Path("text").mkdir()
    polars.DataFrame({"time": [0.0], "x": ["far"]}).write_parquet("text/results.parquet")
    before = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    text = sentence(emla("plot", *arguments), 2)
    assert text.startswith(f"Error: {words}")
    assert before == {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}


def test_table_with_the_name_of_a_picture_is_not_overwritten(emla: Emla) -> None:
    Path("b.png").write_text("time,x\n1,2\n")
    text = sentence(emla("plot", "b.png", "--output", "./b.png"), 2)
    assert "the plot 'b.png' is also read. Choose another file." in text
    assert emla("plot", "b.png").exit_code == 0 and Path("plot.png").read_bytes().startswith(b"\x89PNG")


def test_system_without_joints_has_a_picture(fmu_folder: Path, tmp_path: Path) -> None:
    with load(axis(tmp_path, fmu_folder)).prepare() as simulation:
        result = simulation.run()
    result.save(tmp_path / "o")
    assert [path.name for path in (tmp_path / "o").glob("*.png")] == ["signals.png"]
    (group,) = stacked.group_signals(result)
    panels = group.panels(result, result.read(["time", *result.names]))
    assert {p.label: [line.label for line in p.lines] for p in panels} == {
        "m": ["gantry.motion.x_d", "gantry.slide.place"],
        "m/s": ["gantry.motion.v_d", "gantry.slide.rate"],
        "m/s2": ["gantry.motion.a_d"],
        "N": ["gantry.slide.pull"],
    }


def test_large_system_has_a_picture_for_each_part(monkeypatch: pytest.MonkeyPatch, fmu_folder: Path) -> None:
    """The study without its metrics: by branch, by component where there is room for few."""
    monkeypatch.delitem(ec.METRICS, "joints")
    with load("study").prepare(fmus=fmu_folder, stop_time=0.01) as simulation:
        result = simulation.run()
    constant = {name for name in result.names if len(set(result[name])) == 1}

    def list_signals() -> list[list[str]]:
        return [list(stacked.ByUnit(i).signals(result)) for i in range(7)]

    branches = list_signals()
    assert branches[3:] == [[]] * 4 and constant
    for joint, signals in zip(("lift", "tilt", "telescope"), branches[:3], strict=True):
        assert signals == [n for n in result.names if n.startswith(f"{joint}.") and n not in constant]
    monkeypatch.setattr(stacked, "_MOST_SIGNALS", 12)
    parts = list_signals()
    components = [{name.rsplit(".", 1)[0].split(".")[1] for name in part} for part in parts[:3]]
    assert components == [{"reference"}, {"plant"}, {"disturbance"}]
    assert len(parts[1]) <= 12 and parts[5] and not parts[6]
