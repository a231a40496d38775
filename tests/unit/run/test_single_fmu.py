"""One FMU as a scenario: the name of its component, its times, and short names of variables."""

import json
import zipfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from emla_cosim.base.errors import CommandError
from emla_cosim.run.scenarios.loading import make_component_name
from emla_cosim.study.loading import load
from emla_cosim.system.fault import Fault
from emla_cosim.system.model import System
from fmublock.archive import write_archive
from tests.support.commands import Emla
from tests.support.hand_written_fmus import build_all_types_fmu

DESCRIPTION = "modelDescription.xml"
EXPERIMENT = '<DefaultExperiment startTime="0" stopTime="10.0" tolerance="1e-06" stepSize="0.001" />'
NO_STOP = "the FMU has no stop time; without --stop-time it runs for 10 s"


@pytest.fixture(scope="module")
def reference(fmu_folder: Path) -> Path:
    return fmu_folder / "Reference" / "Reference.fmu"


def with_description(fmu: Path, target: Path, *edits: tuple[str, str]) -> Path:
    """The FMU with other text in its model description; what is replaced has to be there."""
    with zipfile.ZipFile(fmu) as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    text = content[DESCRIPTION].decode()
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    target.parent.mkdir(parents=True, exist_ok=True)
    write_archive(target, {**content, DESCRIPTION: text.encode()})
    return target


def experiment(**times: float | str) -> tuple[str, str]:
    """Another default experiment."""
    attributes = " ".join(f'{name}="{time}"' for name, time in times.items())
    return EXPERIMENT, f"<DefaultExperiment {attributes} />"


def test_fmu_runs_like_a_system_of_one_component(reference: Path) -> None:
    scenario = load(
        reference, stop_time=2.0, set={"Reference.waypoint[1]": 0.0, "Reference.waypoint[2]": 0.3}
    )
    assert (scenario.name, scenario.notes) == ("Reference", ())
    result = scenario.prepare().run()
    assert result.steps == 2000
    assert str(result.units["Reference.v_d"]) == "m/s"
    same = System.of({"Reference": reference})
    values = {"Reference.waypoint[1]": 0.0, "Reference.waypoint[2]": 0.3}
    in_system = load(same, stop_time=2.0, step_size=1e-3, set=values).prepare().run()
    assert (result["Reference.x_d"] == in_system["Reference.x_d"]).all()
    assert result["Reference.x_d"].max() > 0.0


@pytest.mark.parametrize(
    ("attributes", "times", "notes"),
    [
        ({"startTime": 1, "stopTime": 3, "stepSize": 0.5}, (1.0, 3.0, 0.5), 0),
        ({"stopTime": 5}, (0.0, 5.0, 0.005), 1),
        ({"stepSize": 0.1}, (0.0, 10.0, 0.1), 1),
        ({"stopTime": 1, "stepSize": 0.3}, (0.0, 1.0, 0.25), 1),
        ({"startTime": 9, "stopTime": 3, "stepSize": 0.5}, (9.0, 19.0, 0.5), 1),
        ({"stopTime": "INF", "stepSize": "NaN"}, (0.0, 10.0, 0.01), 2),
        ({"stopTime": 2, "stepSize": -1}, (0.0, 2.0, 0.002), 1),
        ({"stopTime": 31536000, "stepSize": 3600}, (0.0, 31536000.0, 3600.0), 0),
    ],
)
def test_times_are_those_of_the_default_experiment(
    attributes: dict[str, float | str], times: tuple[float, ...], notes: int, reference: Path, tmp_path: Path
) -> None:
    scenario = load(with_description(reference, tmp_path / "x.fmu", experiment(**attributes)))
    options = scenario.options
    assert (options.start_time, options.stop_time, options.step_size) == times
    assert len(scenario.notes) == notes


def test_options_replace_a_missing_experiment(reference: Path, tmp_path: Path) -> None:
    fmu = with_description(reference, tmp_path / "x.fmu", (EXPERIMENT, ""))
    assert load(fmu).options.step_size == 0.01
    options = load(fmu, stop_time=2.0).options
    assert (options.stop_time, options.step_size) == (2.0, 0.002)
    assert not load(fmu, stop_time=2.0, step_size=0.5).notes


def test_long_steps_have_a_row_each(reference: Path) -> None:
    assert len(load(reference, stop_time=31536000.0, step_size=86400.0).prepare().run().time) == 366


@pytest.mark.parametrize(
    ("stop_time", "step_size", "rows", "text"),
    [
        (
            1e-3,
            1e-6,
            101,
            "the run is short: its rows are every 1e-05 s, not every 1 ms (--output-interval).",
        ),
        (
            2e-3,
            1e-4,
            21,
            "the run is short: its rows are after each step, not every 1 ms (--output-interval).",
        ),
        (0.01, 1e-4, 11, ""),
        (2e-3, 2e-3, 2, ""),
    ],
)
def test_short_runs_have_rows(
    stop_time: float, step_size: float, rows: int, text: str, reference: Path
) -> None:
    with load(reference, stop_time=stop_time, step_size=step_size).prepare() as simulation:
        result, with_interval = simulation.run(), simulation.run(output_interval=stop_time)
    assert len(result.time) == rows and result.time[-1] == stop_time
    assert [x for x in result.remarks if "is short" in x] == ([text] if text else [])
    assert len(with_interval.time) == 2 and not any("is short" in x for x in with_interval.remarks)


@pytest.mark.parametrize("options", [{}, {"algorithm": "strong"}, {"error_tolerance": 1e-3}], ids=str)
def test_run_without_a_span_has_the_initial_row(options: dict[str, Any], emla: Emla, reference: Path) -> None:
    times = {"start_time": 2.0, "stop_time": 2.0}
    with load(reference, **times, **options).prepare() as simulation:
        result = simulation.run()
    assert (list(result.time), result.steps, result.problem) == ([2.0], 0, None)
    assert result.signals["Reference.x_d"]["final"] == result["Reference.x_d"][0]
    assert emla("export", "lift", "lift.ssp").exit_code == 0
    for source in (str(reference), "lift.ssp"):
        assert emla("run", source, "--stop-time", "0", "--no-plots", "--output", "out").exit_code == 0
        assert len(Path("out/results.csv").read_text().splitlines()) == 2


def test_times_that_do_not_fit_are_explained(reference: Path, tmp_path: Path) -> None:
    def notes(**times: float) -> tuple[str, ...]:
        return tuple(load(with_description(reference, tmp_path / "x.fmu", experiment(**times))).notes)

    stop = (
        "the stop time of the FMU, 3 s, is not after the start at 9 s; without --stop-time it runs for 10 s"
    )
    step = "the step size of the FMU, 5 s, does not fit into 1 s; without --step-size it is 0.001 s"
    assert notes(startTime=9, stopTime=3, stepSize=0.5) == (stop,)
    assert notes(stopTime=1, stepSize=5) == (step,)


@pytest.mark.parametrize(
    ("model", "name"),
    [
        ("Modelica.Blocks.Examples.PID_Controller", "PID_Controller"),
        ("Müller·Kupplung", "Müller_Kupplung"),
        ("2ndOrder", "model_2ndOrder"),
        ("a=b,c@d#*?[1]", "a_b_c_d_1"),
        ("", "model"),
    ],
)
def test_component_has_the_name_of_the_model(model: str, name: str) -> None:
    assert make_component_name(model) == name


@given(st.text(max_size=80))
@example("study")
def test_any_model_name_gives_a_valid_component_name(model: str) -> None:
    name = make_component_name(model)
    assert 0 < len(name) < 80
    assert not set(name) & set(".=,@:*?[] \t\n")
    assert System.of({name: "x.fmu"}).split(f"{name}.a.b")[1] == "a.b"


@pytest.mark.parametrize("name", ["a#b.fmu", "with space.FMU", "[bold]é.ssp.fmu"])
def test_files_may_have_any_name(name: str, emla: Emla, reference: Path, tmp_path: Path) -> None:
    model = ('modelName="Reference"', 'modelName="[bold]&#233; é"')
    file = with_description(reference, tmp_path / name, model)
    options = ("--no-plots", "--stop-time", "0.01", "--output", "out", "--set", "bold_é_é.period=2")
    result = emla("run", str(file), *options)
    assert result.exit_code == 0, result.output
    assert json.loads(Path("out/run.json").read_text(encoding="utf-8"))["scenario"] == "bold_é_é"
    assert Path("out/results.csv").read_text(encoding="utf-8").startswith("time,bold_é_é.x_d")


def test_scenario_file_of_an_fmu(reference: Path, tmp_path: Path) -> None:
    with_description(reference, tmp_path / "x.fmu")
    file = tmp_path / "mine.toml"
    file.write_text('system = "x.fmu"\nstop_time = 0.5\n[set]\nReference.period = 3.0\n')
    scenario = load(file)
    assert (scenario.name, scenario.options.stop_time) == ("mine", 0.5)
    assert dict(scenario.options.set) == {"Reference.period": 3.0}


def test_fmu_can_be_exported(reference: Path, tmp_path: Path) -> None:
    package = load(reference, set={"Reference.period": 3.0}).export(tmp_path / "x.ssp")
    repeated = load(package)
    assert repeated.options.stop_time == 10.0
    assert repeated.system.component("Reference").parameters["period"] == 3.0


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (('fmiVersion="2.0"', 'fmiVersion="3.0"'), "is not a valid FMU"),
        (('fmiVersion="2.0"', 'fmiVersion="9"'), "Unsupported FMI version"),
        (("<ModelVariables>", "<ModelVariables"), "is not an FMU that can be read"),
    ],
)
def test_invalid_fmu(edit: tuple[str, str], says: str, reference: Path, tmp_path: Path) -> None:
    with pytest.raises(CommandError, match=says):
        load(with_description(reference, tmp_path / "x.fmu", edit))


def test_short_names_work_with_inputs_and_faults(fmu_folder: Path, tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    table.write_text("time,load\n0,0.1\n1,0.1\n", encoding="utf-8")
    scenario = load(
        fmu_folder / "EmlaPlant" / "EmlaPlant.fmu",
        stop_time=0.01,
        input=[f"{table}:F_L=load"],
        fault=[Fault("EmlaPlant.u_q", "constant", 0.0, value=2.0)],
        set={"motor.R_s": 0.5},
        signals=["i_q"],
    )
    with scenario.prepare() as simulation:
        first = simulation.run()
        second = simulation.run(set={"motor.R_s": 0.25})
        assert simulation.select_signals(["F_L"]) == ["EmlaPlant.F_L"]
    assert len(first.record["components"]) > 1
    resistances = [r.record["components"]["EmlaPlant"]["parameters"]["motor.R_s"] for r in (first, second)]
    assert resistances == [0.5, 0.25]
    assert (first["EmlaPlant.i_q"] != second["EmlaPlant.i_q"]).any()


def test_short_names_do_not_hide_added_components(fmu_folder: Path) -> None:
    system = System.of({"plant": fmu_folder / "EmlaPlant" / "EmlaPlant.fmu"}).with_main()
    merged = system + System.of({"input": "x.fmu"})
    for name, component in (("R_s", "plant"), ("input.R_s", "input"), ("plant.R_s", "plant")):
        actual, variable = merged.split(name)
        assert (actual.name, variable) == (component, "R_s")


@pytest.fixture(scope="module")
def silent(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU without outputs."""
    folder = tmp_path_factory.mktemp("silent")
    built = build_all_types_fmu(folder / "AllTypes.fmu")
    with zipfile.ZipFile(built) as archive:
        text = archive.read(DESCRIPTION).decode()
    structure = text[text.index("<ModelStructure>") : text.index("</fmiModelDescription>")]
    local = ('causality="output"', 'causality="local"')
    return with_description(built, folder / "silent.fmu", local, (structure, "<ModelStructure/>"))


def test_local_variables_are_recorded_without_outputs(silent: Path, emla: Emla) -> None:
    result = emla("run", str(silent), "--no-plots", "--output", "out")
    (remark,) = json.loads(Path("out/run.json").read_text(encoding="utf-8"))["remarks"]
    assert remark.startswith("No FMU has an output of a number; the local variables are recorded instead.")
    assert remark in " ".join(result.output.split())
    header = Path("out/results.csv").read_text(encoding="utf-8").partition("\n")[0]
    assert header.startswith("time,AllTypes.x,AllTypes.half,AllTypes.count,")
    assert result.exit_code == 0
    result = emla("run", str(silent), "--no-plots", "--output", "out", "--signals", "half")
    assert "recorded instead" not in result.output
    assert json.loads(Path("out/run.json").read_text(encoding="utf-8"))["remarks"] == []


def test_system_without_outputs_is_reported(silent: Path) -> None:
    system = System.of({"a": silent, "b": silent})
    result = load(system, step_size=0.1, stop_time=0.2).prepare().run()
    assert result.record["remarks"] == result.remarks and "recorded instead" in result.remarks[0]
    assert {"a.x", "b.x"} <= set(result.names)


def test_states_are_recorded_without_outputs(fmu_folder: Path, tmp_path: Path) -> None:
    """Of a Model Exchange FMU whose outputs are locals: the states, not their derivatives or other locals."""
    plant = fmu_folder / "EmlaPlant" / "EmlaPlant.fmu"
    with zipfile.ZipFile(plant) as archive:
        text = archive.read(DESCRIPTION).decode()
    outputs = text[text.index("<Outputs>") : text.index("</Outputs>") + len("</Outputs>")]
    edits = [('causality="output"', 'causality="local"'), (outputs, "")]
    path = with_description(plant, tmp_path / "EmlaPlant.fmu", *edits)
    result = load(str(path), step_size=1e-3, stop_time=0.002, lenient=True).prepare().run()
    assert "the continuous states are recorded instead" in result.remarks[-1]
    assert "EmlaPlant.x_L" in result.names and "EmlaPlant.a_L" not in result.names
