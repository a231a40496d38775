"""`emla plot`: runs over one another, whatever they are called and however long they are."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest

from emla_cosim.errors import CommandError
from emla_cosim.results.kept import EVERYTHING, Window, kept_runs
from emla_cosim.results.overlay import chosen_signals, overlaid, picture_panels, signal_panels
from emla_cosim.study.registration import register
from tests.support.commands import Emla, sentence


def a_run(
    folder: str, columns: dict[str, Any], units: dict[str, str] | None = None, form: str = "csv"
) -> Path:
    """A folder of results as a run leaves it; without units it has no run.json."""
    place = Path(folder)
    place.mkdir()
    frame = polars.DataFrame(columns)
    if form == "csv":
        frame.write_csv(place / "results.csv")
    else:
        frame.write_parquet(place / "results.parquet")
    if units is not None:
        (place / "run.json").write_text(json.dumps({"units": units}))
    return place


@pytest.fixture
def two(emla: Emla) -> list[Path]:
    """Of different steps, lengths, forms and signals."""
    t, s = np.linspace(0, 1, 11), np.linspace(0, 2, 5001)
    units = {"a.x": "m", "a.v": "m/s"}
    return [
        a_run("first", {"time": t, "a.x": t**2, "a.v": 2 * t}, units),
        a_run("second", {"time": s, "a.x": np.sin(s)}, None, "parquet"),
    ]


def test_lines_are_the_values_of_each_run_at_its_own_times(two: list[Path]) -> None:
    runs = kept_runs(two)
    names = chosen_signals(runs, ["a.*"])
    panels = signal_panels(runs, names, EVERYTHING)
    assert [(p.title, p.label, len(p.traces)) for p in panels] == [("a.x", "m", 2), ("a.v", "m/s", 1)]
    axes = overlaid(panels, runs).axes[0]
    first, second = (np.asarray(line.get_xydata()) for line in axes.lines)
    np.testing.assert_array_equal(first, np.column_stack([np.linspace(0, 1, 11), np.linspace(0, 1, 11) ** 2]))
    assert len(second) < 2000
    np.testing.assert_array_equal(second[:, 1], np.sin(second[:, 0]))
    assert second[:, 1].max() == np.sin(np.linspace(0, 2, 5001)).max(), "no peak is lost"
    assert len({line.get_color() for line in axes.lines}) == 2


def test_one_run_has_a_panel_for_each_unit(two: list[Path]) -> None:
    runs = kept_runs(two[:1])
    panels = signal_panels(runs, chosen_signals(runs, ["*"]), Window(0.45, 0.75))
    assert [(p.label, [t.label for t in p.traces]) for p in panels] == [("m", ["a.x"]), ("m/s", ["a.v"])]
    np.testing.assert_allclose(panels[0].traces[0].time, [0.5, 0.6, 0.7])


def test_the_command_writes_a_picture_and_says_what_is_missing(emla: Emla, two: list[Path]) -> None:
    drawn = emla("plot", "first", "second", "--signals", "a.*", "--from", "1500 ms", "--output", "x.png")
    assert drawn.exit_code == 0, drawn.output
    assert drawn.stdout.splitlines() == [
        "Note: first has no rows in the time that is shown.",
        "Note: second has no a.v.",
        "Wrote x.png",
    ]
    assert Path("x.png").read_bytes().startswith(b"\x89PNG")


def test_the_pictures_of_runs_are_drawn_over_one_another(emla: Emla, fmu_folder: Path) -> None:
    for name, stop in (("short", "0.01"), ("long", "0.02")):
        assert emla("run", "lift", "--stop-time", stop, "--no-plots", "--output", name).exit_code == 0
    register()
    runs = kept_runs([Path("short"), Path("long")])
    title, panels = picture_panels(runs, EVERYTHING)["tracking"]
    assert (title, panels[0].column, panels[0].label) == ("Tracking", "lift", "position / m")
    for run, label in ((0, "screw"), (1, "screw")):
        drawn = next(t for t in panels[0].traces if (t.run, t.label) == (run, label))
        kept = runs[run].stored.read(["time", "lift.plant.x_L"])
        np.testing.assert_array_equal(drawn.time, kept["time"])
        np.testing.assert_array_equal(drawn.values, kept["lift.plant.x_L"])
    assert emla("plot", "short", "long", "--to", "0.015", "--output", "two.png").exit_code == 0
    assert Path("two-tracking.png").exists() and Path("two-errors.png").exists()


@pytest.mark.parametrize("name", ["$x_1$", "_hidden", "<b>&", "a\x1b[31m", "x" * 200, "ä\u202e", "[bold]"])
def test_names_are_shown_as_they_are(emla: Emla, name: str) -> None:
    values = [0.0, 1.0]
    run = a_run("a $run$", {"time": values, name: values, "y": [1e308, np.nan]}, {name: "$\\frac$"})
    runs = kept_runs([run, a_run("_b", {"time": values, name: [-1e308, 1e308]})])
    assert chosen_signals(runs, [name]) == [name]
    assert emla("plot", "a $run$", "_b", "--signals", "*").exit_code == 0
    figure = overlaid(signal_panels(runs, [name], EVERYTHING), runs)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["a $run$", "_b"]


def test_a_thousand_signals_are_too_many_and_choices_are_named(emla: Emla) -> None:
    many = {f"part{i % 3}.x{i}": [0.0, 1.0] for i in range(1000)}
    a_run("many", {"time": [0.0, 1.0], **many})
    told = sentence(emla("plot", "many", "--signals", "*"), 2)
    assert "1000 signals take 167 panels" in told and "part0.*, part1.*" in told
    assert len(told) < 400
    told = sentence(emla("plot", "many"), 2)
    assert "no run has signals whose role is known" in told and "part2.*" in told


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("nothing",), "there is no run at 'nothing'."),
        (("/dev/zero",), "the run, '/dev/zero', cannot be read: it is no file."),
        (("first", "--signals", "a.y"), "no signal is called 'a.y'; did you mean a."),
        (("first", "--from", "1", "--to", "0"), "--from 1 must be before --to 0."),
        (("first", "--from", "nan"), "--from is 'nan'; it must be a number"),
        (("first", "--to", "3 kg"), "of which one cannot become the other"),
        (("first", "--signals", "*", "--from", "7"), "there are no rows in the time"),
        (("first", "--signals", "*", "--output", "first/results.csv"), "must end in .png"),
        (("first", "--signals", "*", "--output", "none/x.png"), "there is no folder 'none'"),
        (("first", "milli", "--signals", "a.x"), "a.x is in m in first and mm in milli"),
        (("text", "--signals", "a.x"), "the run, 'text/results.csv', cannot be read"),
        (tuple(f"copy{i}" for i in range(7)), "7 runs are too many"),
    ],
)
def test_what_is_wrong_is_one_sentence(
    emla: Emla, two: list[Path], arguments: tuple[str, ...], said: str
) -> None:
    a_run("milli", {"time": [0.0], "a.x": [1.0]}, {"a.x": "mm"})
    a_run("text", {"time": [0.0], "a.x": ["one"]})
    if arguments[0] == "copy0":
        for name in arguments:
            a_run(name, {"time": [0.0], "a.x": [1.0]})
    assert said in sentence(emla("plot", *arguments), 2)


@pytest.mark.parametrize("record", ["", "[]", "{", '{"units": [], "components": {"a": 1}}', "[" * 100_000])
def test_a_record_that_is_none_takes_no_run_away(emla: Emla, two: list[Path], record: str) -> None:
    Path("first/run.json").write_text(record)
    run = kept_runs(two[:1])[0]
    assert run.unit("a.x") == "" and run.result().parameters == {}
    assert emla("plot", "first", "--signals", "*").exit_code == 0


def test_a_run_that_is_refused_elsewhere_is_refused_here(two: list[Path]) -> None:
    with pytest.raises(CommandError, match="must have 'time' as its first column"):
        Path("other.csv").write_text("Time,x\n0,1\n")
        kept_runs([Path("other.csv")])
