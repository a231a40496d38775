"""Runs in Python: prepared once, run many times, with results in memory and one message per mistake."""

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

import emla_cosim as ec
from emla_cosim.base.units import LinearTransformation
from emla_cosim.fmu.models import fmu_path
from emla_cosim.system.model import Alias
from tests.support.commands import Emla
from tests.support.faulty_systems import faulty, line_with_a_fault
from tests.support.hand_written_fmus import Fault
from tests.support.toy import Toy

SHORT_RUN = {"stop_time": 0.02}
ORDER = [f"lift.{part}" for part in ("plant", "observer", "controller", "reference", "disturbance")]
Array = np.ndarray


@pytest.fixture(scope="module")
def lift(fmu_folder: Path) -> Iterator[ec.Simulation]:
    with ec.load("lift").prepare(fmus=fmu_folder, **SHORT_RUN) as simulation:
        yield simulation


def rows(result: ec.Result) -> bytes:
    """All bits of all rows."""
    return np.column_stack(list(result.read(["time", *result.names]).values())).tobytes()


def test_result_has_arrays_units_frames_and_metrics(lift: ec.Simulation) -> None:
    result = lift.run(stop_time=0.4, output_interval=1e-3)
    assert result.time == pytest.approx(np.arange(401) * 1e-3, abs=1e-15)
    assert result["lift.plant.x_L"].shape == (401,)
    assert str(result.units["lift.plant.x_L"]) == "m"
    errors = np.abs(result["lift.plant.x_L"] - result["lift.reference.x_d"])[result.time >= 0.3]
    metric = result.metrics["joints"]["lift"]["position_error_m"]
    assert errors.max() <= metric < 1.1 * errors.max()
    for frame in (result.to_polars(), result.to_pandas().reset_index()):
        assert list(frame.columns) == ["time", *result.names]
        assert np.array_equal(frame["lift.plant.v_L"].to_numpy(), result["lift.plant.v_L"])
    assert result.problem is None
    assert result.steps == 4000


def test_runs_do_not_affect_one_another(lift: ec.Simulation) -> None:
    first = lift.run()
    changed = lift.run(set={"lift.plant.motor.R_s": 0.3, "lift.disturbance.load.level[1]": 2e4})
    assert rows(changed) != rows(first)
    assert rows(lift.run()) == rows(first)
    assert rows(lift.run(fresh=True)) == rows(first)
    assert rows(lift.run(algorithm="jacobi")) != rows(first)
    assert rows(lift.run(algorithm=ec.Strong(extrapolation="fmu"), step_size=5e-4)) != rows(first)
    assert lift.run(stop_time=0.01, step_size=5e-5).steps == 200
    assert rows(lift.run()) == rows(first)


def test_run_in_parts_has_the_same_rows(lift: ec.Simulation) -> None:
    full_run = lift.run()
    lift.start()
    lift.advance(0.004)
    assert lift.time == pytest.approx(0.004, abs=1e-9)
    lift.advance(0.004)  # which is where it is
    middle = lift["lift.plant.x_L"]
    lift.advance(0.02)
    parts = lift.finish()
    assert rows(parts) == rows(full_run)
    assert middle == parts["lift.plant.x_L"][parts.time == 0.004][0]


def test_many_runs_leave_no_files_and_take_no_memory(
    fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with ec.load("lift").prepare(fmus=fmu_folder, stop_time=0.05) as simulation:
        simulation.run()
        before, memory_sizes = set(tmp_path.iterdir()), list[int]()
        for resistance in np.linspace(0.1, 0.2, 40):
            simulation.run(set={"lift.plant.motor.R_s": resistance})
            memory_sizes.append(psutil.Process().memory_info().rss)
        assert set(tmp_path.iterdir()) == before
    assert max(memory_sizes[20:]) - memory_sizes[19] < 2**20


def test_saved_result_has_the_files_of_the_command(fmu_folder: Path, emla: Emla, tmp_path: Path) -> None:
    """In one thread: whether more are tried depends on how busy the machine is, and run.json has it."""
    assert emla("run", "lift", "--stop-time", "0.4", "--threads", "1").exit_code == 0
    with ec.load("lift").prepare(fmus=fmu_folder, stop_time=0.4) as simulation:
        pictures = simulation.run(threads=1).save(tmp_path / "mine")
    command_folder = tmp_path / "results/lift"
    assert {p.name for p in (tmp_path / "mine").iterdir()} == {p.name for p in command_folder.iterdir()}
    assert {p.name for p in pictures} == {p.name for p in command_folder.glob("*.png")}
    assert (tmp_path / "mine/results.csv").read_bytes() == (command_folder / "results.csv").read_bytes()
    ours, record = (json.loads((f / "run.json").read_text()) for f in (tmp_path / "mine", command_folder))
    assert ours == record
    assert record["units"]["lift.plant.tau_m"] == "N.m"


def test_signal_that_was_not_recorded_is_named(lift: ec.Simulation) -> None:
    result = lift.run(signals=["lift.plant.*"])
    assert result.names and all(n.startswith("lift.plant.") for n in result.names)
    with pytest.raises(ec.CommandError, match=r"'lift\.plant\.xL' was not recorded; did you mean") as caught:
        result["lift.plant.xL"]
    assert caught.value.fields["near"][0] == "lift.plant.x_L"
    with pytest.raises(ec.CommandError, match=r"the signal 'lift\.x' was not recorded"):
        result.plot("lift.x")
    with pytest.raises(ec.CommandError, match="has no table"):
        lift.run(recorders=[]).time  # noqa: B018


def test_plots_have_a_panel_per_unit(lift: ec.Simulation) -> None:
    figure = lift.run().plot("lift.plant.x_L", "lift.reference.x_d", "lift.plant.i_?")
    assert [axes.get_ylabel() for axes in figure.axes] == ["m", "A"]
    labels = [[line.get_label() for line in axes.get_lines()] for axes in figure.axes]
    assert labels[0] == ["lift.plant.x_L", "lift.reference.x_d"]
    assert sorted(labels[1]) == ["lift.plant.i_d", "lift.plant.i_q"]
    assert figure._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]


# ---- options ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"stop": 1.0}, "there is no option 'stop'; did you mean 'stop_time'"),
        ({"stop_time": "soon"}, "the option 'stop_time' is 'soon'; it must be a number"),
        ({"stop_time": float("nan")}, "the stop time nan s"),
        ({"stop_time": -1.0}, "the stop time -1 s must be finite, and not before the start time 0 s"),
        ({"stop_time": 1e308}, "s are more than 1e+"),
        ({"step_size": 0.0}, "step size 0 s must be a positive"),
        ({"step_size": float("nan")}, "step size nan s"),
        ({"step_size": 3e-4, "stop_time": 1e-3}, "is not a whole number of steps"),
        ({"output_interval": 1.5e-4}, "output interval 0.00015 s"),
        ({"output_interval": -1.0}, "output interval -1 s must be positive and finite"),
        ({"real_time": 0.0}, "real-time factor 0 must be a positive number"),
        ({"algorithm": "euler"}, "there is no algorithm 'euler'; choose from jacobi"),
        ({"algorithm": "jacobi", "coupling_tolerance": 1e-6}, "jacobi has no coupling tolerance; strong has"),
        ({"algorithm": "strong", "coupling_tolerance": 0.0}, "coupling tolerance 0 must be between 0 and 1"),
        (
            {"algorithm": ec.Jacobi(), "step_multiples": {}},
            "is an object with its own options; leave out step_mult",
        ),
        ({"error_tolerance": 0.0}, "error tolerance 0 must be between 0 and 1"),
        ({"error_tolerance": 2.0}, "the error tolerance 2 must be between 0 and 1"),
        ({"order": ["lift.plant"]}, "must name every component once"),
        ({"order": [*ORDER[1:]]}, f"once (missing: {ORDER[0]})."),
        ({"order": [*ORDER, "lift.plant"]}, "once (unknown or named twice: lift.plant)."),
        ({"step_multiples": {"lift.pump": 2}}, "no component 'lift.pump'"),
        ({"step_multiples": {"lift.plant": 0}}, "step multiple 0 of lift.plant must be at least 1"),
        ({"step_multiples": {"lift.plant": 2}, "error_tolerance": 0.1}, "step multiples need fixed steps"),
        ({"set": {"lift.plant.R": 1.0}}, "lift.plant has no variable 'R'"),
        ({"set": {"lift.plant.motor.R_s": -1.0}}, "motor.R_s = -1 Ohm is out of range"),
        ({"set": {"lift.plant.gearbox.eta_GB": 2.0}}, "at most 1"),
        ({"set": {"lift.plant.motor.N_p": "2.5"}}, "motor.N_p = 2.5 is not a whole number"),
        ({"set": {"lift.plant.sensor.seed": 99999999999}}, "at most 2147483646"),
        ({"set": {"lift.plant.start.x_L": "nan"}}, "lift.plant.start.x_L = nan m is out of range"),
        ({"set": {"lift.observer.use_model": "maybe"}}, "= maybe is not a Boolean"),
        ({"set": {"lift.plant.x_L": 1.0}}, "it is computed by the FMU; did you mean lift.plant.start.x_L?"),
        ({"set": {"lift.plant.u_q": 1.0}}, "lift.plant.u_q cannot be set: it is driven by"),
        ({"set": {"lift.pump.p": 1.0}}, "there is no component 'lift.pump'"),
        ({"set": {"lift.plant": 1.0}}, "'lift.plant' is not a variable; write it as lift.reference.VARIABLE"),
        ({"flavour": "python"}, "'flavour' cannot change between runs"),
        ({"input": ["data.csv"]}, "'input' cannot change between runs"),
        ({"output": "here"}, "'output' is for the command line; use `save`"),
    ],
)
def test_invalid_option_gives_one_message(lift: ec.Simulation, options: dict[str, Any], words: str) -> None:
    with pytest.raises(ec.CommandError) as caught:
        lift.run(**options)
    assert words in str(caught.value)
    assert lift.run(stop_time=0.001).problem is None


@pytest.mark.parametrize("order", [ORDER, ORDER[::-1]])
def test_record_has_the_order_and_late_connections(order: list[str], lift: ec.Simulation) -> None:
    record = lift.run(stop_time=0.001, order=order).record
    ends = {  # the positions of both components, whose variables may have dots
        x: [order.index(".".join(end.split(".")[:2])) for end in x.split(" -> ")]
        for x in record["connections"]
    }
    stepping = record["stepping"]
    assert stepping["order"] == order
    assert stepping["late_connections"] == [x for x, (source, target) in ends.items() if source >= target]
    jacobi = lift.run(stop_time=0.001, algorithm="jacobi").record
    assert jacobi["stepping"]["late_connections"] == jacobi["connections"]


def test_record_has_the_loops_of_strong_coupling(lift: ec.Simulation) -> None:
    strong = lift.run(stop_time=0.001, algorithm="strong").record["stepping"]
    assert strong["late_connections"] == []
    (loop,) = strong["loops"]
    assert sorted(loop) == [f"lift.{part}" for part in ("controller", "disturbance", "observer", "plant")]
    assert strong["sweeps_over_loops"] >= strong["steps"] == 10


def test_numpy_numbers_are_numbers(lift: ec.Simulation) -> None:
    result = lift.run(stop_time=np.float64(0.02), step_multiples={"lift.observer": np.int64(2)})
    assert result.record["settings"]["step_multiples"] == {"lift.observer": 2}


# ---- stepping by hand ------------------------------------------------------------------------------


def test_free_inputs_can_be_set_between_steps(fmu_folder: Path) -> None:
    plant = fmu_path("EmlaPlant", "native", fmu_folder)
    system = ec.System.of({"plant": plant}, set={"plant.start.x_L": 0.25})
    with ec.load(system, stop_time=0.1, step_size=1e-4).prepare() as simulation:
        assert simulation.time == 0.0
        while simulation.time < 0.1:
            simulation["plant.u_q"] = 50.0 * (0.2 - simulation["plant.x_L"]) - 10.0 * simulation["plant.v_L"]
            simulation.advance(simulation.time + 1e-3)
        with pytest.raises(ec.CommandError, match=r"after the stop time 0\.1 s"):
            simulation.advance(0.2)
        result = simulation.finish()
    assert result.steps == 1000
    assert result["plant.inverter.u_q"][1] == pytest.approx(-2.5)
    assert result["plant.x_L"][-1] < 0.25


def test_values_read_and_set_during_a_run_are_in_the_units_of_the_system(faulty_fmu: Path) -> None:
    """Here in mm, in the FMU in m, with another zero: read, set and recorded alike."""
    to_m = LinearTransformation(1e-3, 0.5)
    aliases = {"place": Alias("y", to_m), "drive": Alias("u", to_m)}
    system = ec.System((replace(faulty("j.a", faulty_fmu), aliases=aliases),), ())
    with ec.load(system, stop_time=1.0, step_size=0.1).prepare() as simulation:
        simulation["j.a.drive"] = 1500.0
        assert simulation["j.a.drive"] == pytest.approx(1500.0)
        simulation.advance(0.5)
        position = simulation["j.a.place"]
        result = simulation.finish()
    assert position == pytest.approx(result["j.a.place"][-1])
    assert to_m(position) == pytest.approx(0.5 * 2.0)  # the FMU integrates 2 m


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("lift.plant.u_q", "driven by lift.controller.u_q"),
        ("lift.plant.motor.R_s", "not an input. Set start values with `set`"),
        ("lift.plant.nothing", "has no variable 'nothing'"),
    ],
)
def test_variables_that_cannot_be_set_between_steps(name: str, words: str, lift: ec.Simulation) -> None:
    lift.start()
    with pytest.raises(ec.CommandError, match=words):
        lift[name] = 1.0
    with pytest.raises(ec.CommandError, match=r"not a communication point; the step size is 0\.0001 s"):
        lift.advance(0.00015)
    assert lift.finish().steps == 0
    with pytest.raises(ec.CommandError, match="there is no current run"):
        lift.finish()


# ---- how a run ends --------------------------------------------------------------------------------


class Interrupting(ec.Recorder):
    """Presses Ctrl-C after the first steps, every time or once."""

    def __init__(self, once: bool = False) -> None:
        self.remaining = 1 if once else 10**9

    def pause(self, run: Any) -> None:
        if run.stepping.steps > 0 and not run.over and self.remaining:
            self.remaining -= 1
            signal.raise_signal(signal.SIGINT)


def test_ctrl_c_returns_the_results_so_far(lift: ec.Simulation) -> None:
    series = ec.TimeSeries()
    result = lift.run(stop_time=1000.0, recorders=[series, Interrupting()])
    assert result.problem is not None
    assert result.problem.startswith("interrupted at t = ")
    assert 0 < result.steps < 10_000_000
    assert result.time[-1] == pytest.approx(result.end_s)
    assert lift.run().problem is None


def test_ctrl_c_between_steps_by_hand_keeps_the_run(lift: ec.Simulation) -> None:
    lift.start(stop_time=100.0, recorders=[Interrupting(once=True)])
    with pytest.raises(KeyboardInterrupt):
        lift.advance(100.0)
    reached = lift.time
    assert 0.0 < reached < 100.0
    lift.advance(round(reached + 0.01, 4))
    assert lift.finish().end_s == pytest.approx(reached + 0.01)


def test_failed_run_raises_with_the_results_so_far(faulty_fmu: Path) -> None:
    system = line_with_a_fault(faulty_fmu, Fault.ERROR, 0.35)
    with ec.load(system, stop_time=1.0, step_size=0.1).prepare(output_interval=0.1) as simulation:
        for _ in range(2):
            with pytest.raises(ec.RunError, match=r"j\.bad answered doStep at t = 0\.3") as caught:
                simulation.run()
            fields = caught.value.fields
            assert fields["component"] == "j.bad"
            assert fields["status"] == "fmi2Error"
            assert fields["result"].time.tolist() == pytest.approx([0.0, 0.1, 0.2, 0.3])
        assert simulation.run(set={"j.bad.at": 10.0}).problem is None


SOURCES = [
    "", ".", "#", "a#b", "x\0y", "y" * 5000, "x\0y.fmu", "y" * 300 + ".fmu", "-", "study/", " study",
    "lift\n", "a.toml/b", "é.ssp", 3, None
]  # fmt: skip


@pytest.mark.parametrize("source", SOURCES)
def test_source_that_is_not_a_scenario(source: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ec.CommandError) as caught:
        ec.load(source)
    assert str(caught.value).count("\n") == str(source).count("\n")


# ---- systems -----------------------------------------------------------------------------------------


def test_removed_connection_frees_its_input(fmu_folder: Path) -> None:
    lift = ec.load("lift").system
    system = lift.without_connections("lift.plant.F_L")
    assert len(system.connections) == len(lift.connections) - 1
    with ec.load(system, stop_time=0.01, step_size=1e-4).prepare(fmus=fmu_folder) as simulation:
        simulation["lift.plant.F_L"] = 1e4
        simulation.advance(0.01)
        assert simulation["lift.plant.P_L"] == pytest.approx(1e4 * simulation["lift.plant.v_L"])


def rig() -> ec.System:
    """A system with a wrong connection."""
    components = {"rig.reference": "Reference", "rig.toy": Toy}
    return ec.System.of(components, ["rig.reference.a_d -> rig.toy.force"])


MISTAKES: list[tuple[Callable[[Path], Any], str]] = [
    (lambda fmus: rig().without_connections("rig.toy.x"), r"nothing drives rig\.toy\.x"),
    (lambda fmus: rig().without_connections("rig.pump.p"), "no component"),
    (
        lambda fmus: rig().with_connections("rig.toi.x -> rig.toy.force"),
        r"no component 'rig\.toi'; there are",
    ),
    (lambda fmus: rig().with_connections("rig.toy.x"), r"'rig\.toy\.x' is not a connection; write a\.out"),
    (lambda fmus: ec.load(rig(), step_size=1e-3).prepare(fmus=fmus), "joins the units m/s2 and N"),
    (lambda fmus: ec.load("lift", controller=str), "not a block of fmublock"),  # type: ignore
    (lambda fmus: ec.load("lift", controller="pid"), "no controller 'pid'; choose from rsba, foc, cac and"),
    (lambda fmus: ec.load("lift", controller=f"{fmus}/EmlaObserver/EmlaObserver.fmu"), "has no output 'u_q'"),
]


@pytest.mark.parametrize(("make", "words"), MISTAKES)
def test_mistake_in_a_system(make: Callable[[Path], Any], words: str, fmu_folder: Path) -> None:
    with pytest.raises(ec.CommandError, match=words):
        make(fmu_folder)


@pytest.mark.parametrize("name", ["block", "fmu"])
def test_controller_is_a_block_or_an_fmu(name: str, fmu_folder: Path) -> None:
    from rsba_fmu import RsbaController

    file = str(fmu_path("RsbaController", "native", fmu_folder))
    controller: Any = RsbaController if name == "block" else file
    scenario = ec.load("lift", controller=controller, gains="robust", stop_time=0.01)
    assert "beta[1]" not in scenario.system.component("lift.controller").parameters
    with scenario.prepare(fmus=fmu_folder) as simulation:
        assert simulation.run().problem is None


def test_replacement_is_a_text_a_path_or_a_table(fmu_folder: Path) -> None:
    plant = fmu_path("EmlaPlant", "native", fmu_folder)
    forms: list[Any] = [str(plant), plant, ec.Replacement(plant), {"fmu": str(plant)}]
    actual = [ec.load("lift", replace={"lift.plant": form}).options.replacements() for form in forms]
    assert [str(by_name["lift.plant"].fmu) for by_name in actual] == 4 * [str(plant)]


# ---- imports ---------------------------------------------------------------------------------------


UNKNOWN = ["run", "nothing.toml", "--set", "a.b=1", "--stop-time", "10 ms", "--no-plots", "--threads", "auto"]
HEAVY = {"matplotlib", "casadi", "networkx", "polars"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "absent"),
    [
        ("import emla_cosim", {"numpy", "fmpy", "click", *HEAVY}),
        ("from emla_cosim.cli.app import app; app(['--help'])", {"numpy", "fmpy", *HEAVY}),
        ("from emla_cosim.cli.app import app; app(['list'])", {"fmpy", *HEAVY}),
        (f"from emla_cosim.cli.app import app; app({UNKNOWN})", {"matplotlib", "casadi"}),
        ("import fmublock", {"numpy", *HEAVY}),
        ("import fmublock.table.building", {"matplotlib", "casadi"}),
    ],
)
def test_imports_are_late(code: str, absent: set[str]) -> None:
    report = "import atexit, sys; atexit.register(lambda: print('modules', *sys.modules, file=sys.stderr))"
    process = subprocess.run(
        [sys.executable, "-c", f"{report}; {code}"], capture_output=True, text=True, check=False
    )
    imported = {name.partition(".")[0] for name in process.stderr.rpartition("modules ")[2].split()}
    assert "emla_cosim" in imported or "fmublock" in imported, process.stderr
    assert not imported & absent


IMPORTS = """
import gc, os
from emla_cosim.cli.app import quick_imports
with quick_imports():
    import numpy
    assert not gc.isenabled()
print(gc.isenabled(), os.environ.get("OPENBLAS_NUM_THREADS"), len(os.listdir("/proc/self/task")))
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="Only Linux lists the threads of a process.")
@pytest.mark.parametrize(("variable", "most"), [({}, 1), ({"OPENBLAS_NUM_THREADS": "2"}, 2)])
def test_imports_start_no_threads(variable: dict[str, str], most: int) -> None:
    """A variable that says how many may run is as before afterwards."""
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"} | variable
    command = [sys.executable, "-c", IMPORTS]
    process = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    enabled, remaining, running = process.stdout.split()
    assert (enabled, remaining) == ("True", str(variable.get("OPENBLAS_NUM_THREADS")))
    assert int(running) <= most
