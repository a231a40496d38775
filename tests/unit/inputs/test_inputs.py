"""Data drive signals of a system: what receivers get, in whatever way the system is run."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest

import emla_cosim as ec
from emla_cosim.analyses.execution.worker_payload import Preparation
from emla_cosim.base.errors import CommandError
from emla_cosim.base.progress import Progress
from emla_cosim.inputs.loaded_input import LoadedInput, find_data_end
from emla_cosim.inputs.wired_inputs import wire_inputs
from emla_cosim.master.assembly import Assembly
from emla_cosim.recorders.parquet_file import ParquetFile
from emla_cosim.run.preparation import limit_to_data_end, prepare_system
from emla_cosim.system.model import Alias
from tests.support.commands import Emla
from tests.support.faulty_systems import faulty

STOP = 0.05
LOAD = "lift.disturbance.F_L"
T = np.linspace(0.0, 0.04, 41)
F = 3.0 + np.cos(300.0 * T)
"""A load in kN."""


@pytest.fixture
def measured(tmp_path: Path) -> Path:
    file = tmp_path / "measured.csv"
    polars.DataFrame({"t [ms]": 1e3 * T, "Force [kN]": F, "x [mm]": 240.0 + T, "other": T}).write_csv(file)
    return file


def lift(fmu_folder: Path, *inputs: Any, **options: Any) -> ec.Scenario:
    return ec.load("lift", **{"fmus": fmu_folder, "stop_time": STOP, "input": list(inputs), **options})


def ran(scenario: ec.Scenario, **options: Any) -> ec.Result:
    with scenario.prepare() as simulation:
        return simulation.run(**options)


def notes_of(scenario: ec.Scenario) -> str:
    progress, notes = Progress(), list[str]()
    progress.note = lambda sentence: notes.append(sentence)
    prepare_system(scenario.system, scenario.options, progress)
    return " ".join(notes)


def change_first_value(file: Path) -> None:
    file.write_text(file.read_text().replace("\n0.0,", "\n0.0,1", 1))


# ---- what receivers get ------------------------------------------------------------------------


def test_column_drives_all_receivers_of_an_output(fmu_folder: Path, measured: Path) -> None:
    scenario = lift(fmu_folder, ec.Input(measured, {LOAD: "Force"}, end="repeat"))
    result = ran(scenario)
    points = np.mod(result["time"], T[-1])
    np.testing.assert_allclose(result[f"input.{LOAD}"], np.interp(points, T, 1e3 * F), rtol=1e-9)
    assert str(result.units[f"input.{LOAD}"]) == "N"
    readers = [c for c in result.record["connections"] if c.startswith(f"input.{LOAD}")]
    assert [c.partition(" -> ")[2].partition(" ")[0] for c in readers] == ["lift.plant.F_L"]
    assert f"still computes {LOAD}" in notes_of(scenario)
    same = ran(lift(fmu_folder, ec.Input(measured, {"lift.plant.F_L": "Force"}, end="repeat")))
    np.testing.assert_array_equal(result["lift.plant.x_L"], same["lift.plant.x_L"])


def test_column_with_its_derivatives_replaces_a_reference(fmu_folder: Path) -> None:
    original = ran(lift(fmu_folder))
    names = [f"lift.reference.{n}" for n in ("x_d", "v_d", "a_d")]
    data = {"time": original["time"], "x [mm]": 1e3 * original[names[0]]}
    signals = {name: "der(" * k + "x" + ")" * k for k, name in enumerate(names)}
    result = ran(lift(fmu_folder, ec.Input(data=data, signals=signals, interpolation="cubic")))
    assert result.record["components"]["lift.reference"]["parameters"] == {}
    for name, tolerance in zip(names, (1e-12, 1e-7, 1e-3), strict=True):
        size = np.abs(original[name]).max()
        np.testing.assert_allclose(result[name][3:-3], original[name][3:-3], rtol=0, atol=tolerance * size)
    figures, expected = result.metrics["joints"]["lift"], original.metrics["joints"]["lift"]
    assert figures["torque_peak_N_m"] == pytest.approx(expected["torque_peak_N_m"], rel=1e-3)


def test_metrics_follow_the_reference_from_data(fmu_folder: Path) -> None:
    data = {"time": T, "x": 0.3 + 0.0 * T}
    result = ran(lift(fmu_folder, ec.Input(data=data, signals={"lift.reference.x_d": "x"})))
    assert (result["input.lift.reference.x_d"] == 0.3).all()
    assert np.abs(result["lift.plant.x_L"][0] - 0.3) > 0.05  # far from it, unlike from that of the scenario
    figures = result.metrics["joints"]["lift"]
    assert np.isnan(figures["convergence_time_s"]) or figures["convergence_time_s"] >= 0.0
    assert not figures["held"]


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_own_results_can_be_read_back(form: str, fmu_folder: Path, tmp_path: Path) -> None:
    options, file = {"output_interval": 1e-4, "stop_time": 0.02}, tmp_path / f"results.{form}"
    with lift(fmu_folder, **options).prepare() as simulation:
        first = simulation.run()
        if form == "csv":
            first.save(tmp_path, plots=False)
        else:
            simulation.run(recorders=[ParquetFile(file)])
    second = ran(lift(fmu_folder, f"{file}:lift.reference.*", **options))
    for name in ("lift.reference.x_d", "lift.plant.x_L", "lift.controller.u_q"):
        np.testing.assert_array_equal(first[name], second[name])


def test_fault_comes_after_the_data(fmu_folder: Path, measured: Path) -> None:
    fault = ec.Fault("lift.plant.F_L", "constant", 0.02, value=0.0)
    result = ran(lift(fmu_folder, ec.Input(measured, {LOAD: "Force"}), fault=[fault]))
    failed = result["time"] >= 0.02 - 1e-9
    y = result["lift.plant_F_L_fault.y"]
    assert not y[failed][1:].any() and y[~failed].all()


def test_several_inputs_drive_several_signals(fmu_folder: Path, measured: Path) -> None:
    data = {"time": T, "sag": 0.0 * T}
    sources = [
        ec.Input(measured, {"lift.reference.v_d": ec.Column("x", "mm", 1)}, interpolation="cubic"),
        ec.Input(data=data, signals={"lift.plant.supply.sag": "sag"}),
    ]
    result = ran(lift(fmu_folder, *sources, stop_time=0.001))
    assert {"input.lift.reference.v_d", "input_2.lift.plant.supply.sag"} <= set(result.names)
    first, second = json.loads(json.dumps(result.record["settings"]["input"]))
    assert first["signals"] == {"lift.reference.v_d": "der(x [mm])"}
    assert second["data"] == "given in Python"


def test_only_the_start_value_of_the_driven_input_is_dropped(faulty_fmu: Path) -> None:
    """Also where a name here is that of another variable of the FMU."""
    aliases = {"u": Alias("a"), "drive": Alias("u")}
    start_values = {"u": 0.5, "drive": 4.0, "b": 2.0}
    sink = replace(faulty("j.sink", faulty_fmu), parameters=start_values, aliases=aliases)
    table = LoadedInput.of(ec.Input(data={"t": [0.0, 1.0], "x": [1.0, 1.0]}, signals={"j.sink.drive": "x"}))
    system = ec.System((sink,), ())
    with Assembly(system, {"j.sink": faulty_fmu}) as assembly:
        interfaces = {name: file.interface for name, file in assembly.files.items()}
        placed = wire_inputs(system, [table], interfaces, ())
    assert placed.system.component("j.sink").parameters == {"u": 0.5, "b": 2.0}


# ---- the end of the data -----------------------------------------------------------------------


def test_run_stops_at_the_last_point_within_the_data(fmu_folder: Path, measured: Path) -> None:
    source = ec.Input(measured, {LOAD: "Force"}, end="stop")
    scenario = lift(fmu_folder, source, stop_time=1.0, step_size=3e-4)
    result = ran(scenario, output_interval=3e-4)
    assert result.end_s == pytest.approx(0.0399, abs=1e-12)
    assert result.problem is None and result.times.stop == result.end_s
    assert "the run stops where the data of" in notes_of(scenario)
    assert limit_to_data_end(scenario.options.updated({"stop_time": 0.03})).stop_time == 0.03
    with scenario.prepare() as simulation:
        ended = simulation.run(stop_time=0.06)
    assert ended.problem is None and ended.end_s == pytest.approx(0.0399, abs=1e-12)
    assert "the data end at t = 0.04 s" in ended.remarks[0]
    with pytest.raises(CommandError, match=r"leaves no step for a run from t = 0\.0399 s"):
        limit_to_data_end(scenario.options.updated({"start_time": 0.0399}))


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_first_data_with_end_stop_end_the_run(order: tuple[int, int], fmu_folder: Path) -> None:
    """The third ends before both, but holds its last value."""
    signals = ("lift.plant.supply.sag", LOAD, "lift.plant.fault.R_s")
    sources = [
        ec.Input(data={"t": [0.0, until], "x": [0.0, 1.0]}, signals={signal: "x"}, end=end)
        for signal, until, end in zip(signals, (0.02, 0.03, 0.01), ("stop", "stop", "hold"), strict=True)
    ]
    two = [sources[i] for i in order]
    assert limit_to_data_end(lift(fmu_folder, *two).options).stop_time == pytest.approx(0.02)
    assert find_data_end([sources[2], *two], 0.0) == pytest.approx(0.02)
    assert find_data_end([sources[2], sources[1]], 0.0) == pytest.approx(0.03)
    assert find_data_end([sources[2]], 0.0) is None


# ---- in files, workers and checkpoints ---------------------------------------------------------


SCENARIO_FILE = f"""
system = "lift"
stop_time = 0.01

[[input]]
file = "measured.csv"
time = "t"
interpolation = "cubic"
end = "repeat"
signals = {{ "{LOAD}" = "Force [kN]", "lift.plant.supply.sag" = {{ column = "other", unit = "1" }} }}
"""


def test_scenario_file_names_its_data_and_run_json_their_hash(emla: Emla, measured: Path) -> None:
    Path("there").mkdir()
    content = measured.rename("there/measured.csv").read_bytes()
    Path("there/mine.toml").write_text(SCENARIO_FILE)
    result = emla("run", "there/mine.toml", "--no-plots", "--output", "out")
    assert result.exit_code == 0, result.output
    (recorded,) = json.loads(Path("out/run.json").read_text())["settings"]["input"]
    assert recorded["end"] == "repeat" and recorded["signals"][LOAD] == "Force [kN]"
    assert recorded["sha256"] == hashlib.sha256(content).hexdigest()


def test_workers_get_the_data_inside_the_fmus(fmu_folder: Path, measured: Path) -> None:
    first = Preparation.of(lift(fmu_folder, ec.Input(measured, {LOAD: "Force"})))
    assert first.options.input == [] and "input" in first.fmus
    change_first_value(measured)
    second = Preparation.of(lift(fmu_folder, ec.Input(measured, {LOAD: "Force"})))
    assert first.identity != second.identity


def test_run_continues_with_the_same_data_only(fmu_folder: Path, measured: Path, tmp_path: Path) -> None:
    def run(**options: Any) -> ec.Result:
        source = ec.Input(measured, {LOAD: "Force"}, end="repeat")
        return ran(lift(fmu_folder, source, output_interval=1e-3, **options))

    checkpoint = tmp_path / "c"
    run(stop_time=0.02, checkpoint=checkpoint)
    full_run, name = run(), "lift.plant.x_L"
    np.testing.assert_array_equal(run(resume=checkpoint)[name], full_run[name][20 + 1 :])
    measured.write_text(measured.read_text().replace("other", "another"))  # the same numbers
    np.testing.assert_array_equal(run(resume=checkpoint)[name], full_run[name][20 + 1 :])
    change_first_value(measured)
    with pytest.raises(CommandError, match="FMUs"):
        run(resume=checkpoint)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "name"),
    [
        (("sweep", "lift", "--vary", "lift.plant.motor.R_s=0.1:0.2:2"), "variants.parquet"),
        (("compare", "lift"), "comparison.csv"),
    ],
)
def test_many_runs_do_not_overwrite_their_data(
    emla: Emla, measured: Path, command: tuple[str, ...], name: str
) -> None:
    table = measured.with_name(name)
    before = measured.read_bytes()
    measured.rename(table)
    measured.symlink_to(table)
    output = ("--stop-time", "0.01", "--output", str(table.parent))
    for more, words in (((), "was not written by emla"), (("--overwrite",), "is also the input")):
        refused = emla(*command, *output, "--input", f"{measured}:{LOAD}=Force", *more)
        assert refused.exit_code == 2 and words in refused.stderr
        assert measured.is_symlink() and table.read_bytes() == before


# ---- messages ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("signals", "options", "message"),
    [
        ({LOAD: "Farce"}, {}, "has no column 'Farce'; did you mean Force?"),
        ({LOAD: "x"}, {}, "for lift.disturbance.F_L has the units mm and N"),
        ({LOAD: "Force [N]"}, {}, "is declared to be in N; its header says otherwise"),
        ({LOAD: "der(Force)"}, {}, "needs cubic interpolation"),
        ({LOAD: "der(der(der(Force)))"}, {"interpolation": "cubic"}, "it must be 0, 1 or 2"),
        ({"lift.plant.F": "Force"}, {}, "lift.plant has no variable 'F'"),
        ({"lift.plan.F_L": "Force"}, {}, "there is no component 'lift.plan'"),
        ({"lift.plant.screw.lead": "x"}, {}, "is a parameter; data can drive an input"),
        ({"lift.plant.tau_m": "other"}, {}, "lift.plant.tau_m is not connected"),
        ({}, {}, "drives no signal: its columns are called Force, x and other"),
        ({}, {"columns": ["lift.*"]}, "has no column 'lift.*'"),
        ({LOAD: "Force"}, {"time": "when"}, "has no column 'when'; it has 't', 'Force', 'x' and 'other'"),
    ],
)
def test_invalid_signals_and_columns(
    fmu_folder: Path, measured: Path, signals: dict[str, str], options: dict[str, Any], message: str
) -> None:
    with pytest.raises(CommandError) as error:
        lift(fmu_folder, ec.Input(measured, signals, **options)).prepare()
    assert message in str(error.value) and "\n" not in str(error.value)


def test_two_values_for_one_signal_are_refused(fmu_folder: Path, measured: Path) -> None:
    source = ec.Input(measured, {LOAD: "Force"})
    with pytest.raises(CommandError, match="is driven by two columns"):
        lift(fmu_folder, source, source).prepare()
    source = ec.Input(measured, {"lift.plant.F_L": "Force"})
    with pytest.raises(CommandError, match="cannot be set: it is driven by input"):
        lift(fmu_folder, source, set={"lift.plant.F_L": 1.0}).prepare()
    for twice in (f"{LOAD}=Force,{LOAD}=other", f"{LOAD}=Force,end=stop,end=hold"):
        with pytest.raises(CommandError, match="twice"):
            ec.Input.of_text(f"measured.csv:{twice}")


@pytest.mark.parametrize("header", ["F", "F [kN]"])
def test_values_that_overflow_are_refused_with_their_row(
    fmu_folder: Path, tmp_path: Path, header: str
) -> None:
    file = tmp_path / "huge.csv"
    file.write_text(f"time,{header}\n0,1\n1,-1e308\n")
    with pytest.raises(CommandError, match=r"has -1e\+308 in row 2 of the column 'F.*must be within"):
        lift(fmu_folder, ec.Input(file, {LOAD: "F"})).prepare()


def test_columns_without_a_signal_are_noted(fmu_folder: Path) -> None:
    data = {"time": T, LOAD: F, "lift.plant.nothing": F, "remark": F}
    notes = notes_of(lift(fmu_folder, ec.Input(data=data)))
    assert "has columns that drive nothing: lift.plant.nothing, remark." in notes
    many = {f"other_{i}": F for i in range(20)}
    notes = notes_of(lift(fmu_folder, ec.Input(data={"time": T, LOAD: F, **many})))
    assert "other_6, other_7 and 12 more." in notes
