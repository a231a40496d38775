"""Names with the special characters of every format are read as they were written, or are refused."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest

import emla_cosim as ec
import emla_cosim.views.folder
from emla_cosim.inputs.stored_runs import open_stored_run
from emla_cosim.recorders.parquet_file import ParquetFile
from emla_cosim.run.scenarios.scenario import Scenario
from emla_cosim.views.plots.overlay import plot_signals
from tests.support.commands import Emla, sentence
from tests.support.few_figures import DRAWN, draw_few
from tests.support.tiers import mostly_slow

QUOTED = 'a","b it\'s [red]x[/red]'
MATHS = ["$x^2$ and \\frac{", "_hidden", "ünïcödé 电 😀"]
"""Names that pictures may take for formulas, for what is to be hidden, and that a font may lack."""
PATTERNS = [QUOTED, "[/", "back\\n{0}%s\\", "*?[x]#", "--option"]
"""Names that a terminal, a command or a search may take for something else."""
NAMES = (*MATHS, *PATTERNS, "<&amp;>]]><!--", " =1+1 blank ", "a -> b", "/abs/x=y:z", "time")
UNSEEN = ("tab\there", "line\nbreak", "nul\0", "\x1b[31m", "\ud800", "\u2028")


def renamed(*names: str) -> ec.System:
    """A lift of each name, all in one system."""
    system = ec.load("lift").system

    def called(thing: Any, name: str, *fields: str) -> Any:
        return replace(thing, **{f: f"{name}.{getattr(thing, f).removeprefix('lift.')}" for f in fields})

    return ec.System(
        tuple(called(c, n, "name") for n in names for c in system.components),
        tuple(called(x, n, "source", "target") for n in names for x in system.connections),
    )


def scenario(fmus: Path, *names: str) -> Scenario:
    return ec.load(renamed(*names), stop_time=0.002, step_size=1e-4, fmus=fmus)


SET = {f"{name}.plant.motor.R_s": 0.15 for name in NAMES}
POSITIONS = [f"{name}.plant.x_L" for name in NAMES]


def test_tables_records_and_packages_keep_names(fmu_folder: Path, tmp_path: Path) -> None:
    original = scenario(fmu_folder, *NAMES)
    with original.prepare() as simulation:
        result = simulation.run(set=SET)
        simulation.run(recorders=[ParquetFile(tmp_path / "r.parquet")], signals=POSITIONS)
    expected = ["time", *result.names]
    assert len(expected) == len(set(expected)) > 30 * len(NAMES)
    result.save(folder := tmp_path / "out", plots=False)
    with (folder / "results.csv").open(newline="", encoding="utf-8") as stream:
        header, *rows = csv.reader(stream)
    assert header == expected
    assert {len(row) for row in rows} == {len(expected)}
    for most in (None, 3):
        assert list(open_stored_run(folder / "results.csv").read(expected, most)) == expected
    assert polars.read_parquet(tmp_path / "r.parquet").columns == ["time", *POSITIONS]
    units = json.loads(polars.read_parquet_metadata(tmp_path / "r.parquet")["units"])
    assert units == {"time": "s", **dict.fromkeys(POSITIONS, "m")}
    assert list(json.loads((folder / "metrics.json").read_text())["joints"]) == list(NAMES)
    record = json.loads((folder / "run.json").read_text())
    assert list(record["components"]) == [c.name for c in original.system.components]
    assert record["settings"]["set"] == SET

    back = ec.load(original.export(tmp_path / "x.ssp", set=SET))
    assert [c.name for c in back.system.components] == [c.name for c in original.system.components]
    assert set(map(str, back.system.connections)) == set(map(str, original.system.connections))
    assert [back.system.component(f"{n}.plant").parameters["motor.R_s"] for n in NAMES] == [0.15] * len(NAMES)
    result_of_package = back.prepare().run()
    for position in POSITIONS:
        assert np.array_equal(result_of_package[position], result[position]), position


@pytest.mark.parametrize("name", mostly_slow(MATHS, MATHS[:1]))
@pytest.mark.filterwarnings("error")
def test_pictures_show_names_unchanged(
    name: str, fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw_few(monkeypatch)
    drawn: list[Any] = []
    save = emla_cosim.views.folder.save
    monkeypatch.setattr(emla_cosim.views.folder, "save", lambda *a: (drawn.append(a[0]), save(*a)))
    run = scenario(fmu_folder, name).prepare().run(stop_time=0.01)
    run.save(tmp_path, plots=True)
    assert [figure.axes[0].get_title() for figure in drawn] == [name] * DRAWN
    assert not any(figure.axes[0].title.get_parse_math() for figure in drawn)
    signals = [f"{name}.plant.x_L", f"{name}.reference.x_d"]
    figure: Any = plot_signals(replace(run, name=name), signals)
    figure._repr_png_()
    legend = figure.axes[0].get_legend().get_texts()
    assert [text.get_text() for text in legend] == signals
    assert figure.get_suptitle() == name
    assert not any(text.get_parse_math() for text in (*legend, figure._suptitle))


@pytest.mark.parametrize("name", mostly_slow(PATTERNS, [QUOTED, "--option"]))
def test_scenario_files_and_the_terminal_keep_names(
    name: str, emla: Emla, fmu_folder: Path, tmp_path: Path
) -> None:
    scenario(fmu_folder, name).export(tmp_path / "x.ssp")
    key = json.dumps(f"{name}.plant.motor.R_s", ensure_ascii=False)  # as TOML quotes it too
    text = f'system = "x.ssp"\nstop_time = 0.01\nplots = false\n[set]\n{key} = 0.15\n'
    (tmp_path / "my.toml").write_text(text, encoding="utf-8")
    process = emla("run", "my.toml", "--output", "[red]", "--signals", f"{name}.plant.x_L")
    assert process.exit_code == 0, process.output
    assert any(
        name in line for line in process.stdout.splitlines() if line[:1] in "┃│|"
    )  # heads of the table
    assert "Wrote [red]/: results.csv" in process.stdout
    record = json.loads((tmp_path / "[red]/run.json").read_text())
    assert record["settings"]["set"] == {f"{name}.plant.motor.R_s": 0.15}
    refused = emla("run", "my.toml", "--signals", f"{name}.gone")
    assert f"no signal matches '{name}.gone'" in sentence(refused, 2)


@pytest.mark.parametrize("name", UNSEEN)
def test_names_with_control_characters_are_refused(name: str, fmu_folder: Path, tmp_path: Path) -> None:
    for use in (lambda s: s.prepare(), lambda s: s.export(tmp_path / "x.ssp")):
        with pytest.raises(ec.CommandError) as refused:
            use(scenario(fmu_folder, name))
        assert f"{f'{name}.reference'!r} needs another name: one line, without" in str(refused.value)


def test_description_that_xml_cannot_contain_is_refused(fmu_folder: Path, tmp_path: Path) -> None:
    odd = replace(scenario(fmu_folder, "lift"), description="rings a bell: \a")
    with pytest.raises(ec.CommandError, match=r"^the description 'rings a bell: \\x07' has a character that"):
        odd.export(tmp_path / "x.ssp")


def test_header_of_several_lines_is_read(tmp_path: Path) -> None:
    """Variables of other tools' FMUs may have such names."""
    names = ["time", 'say "x"', 'a"\n,"\r\nb', "c"]
    with (tmp_path / "results.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(names)
        writer.writerows([k, 2.5, 3.0 * k, float("nan")] for k in range(9))
    columns = open_stored_run(tmp_path / "results.csv").read([names[2], "gone", "time"], 3)
    assert {n: v.tolist() for n, v in columns.items()} == {
        names[2]: [0.0, 9.0, 18.0],
        "time": [0.0, 3.0, 6.0],
    }
