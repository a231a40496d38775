"""FMUs of FMI 3.0 run without event mode, although they have it: by command, file and Python."""

import json
import shutil
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from emla_cosim.system.model import System
from tests.support.commands import Emla, sentence
from tests.support.hand_written_fmus import (
    build_all_types_3_fmu,
    build_event_fmu,
    build_integrated_fmu,
    build_strict_fmu,
)
from tests.support.tiers import mostly_slow

VALUES = {"a.period": 0.3, "a.threshold": 0.35}
TIMES: dict[str, Any] = {"step_size": 0.125, "stop_time": 2.0}
REMARK = "a runs without event mode, as the option 'no_event_mode' says."


@pytest.fixture(autouse=True)
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("events")


@pytest.fixture(scope="module")
def events(folder: Path) -> Path:
    """An FMU that counts in `updates` how often its event mode updates discrete states."""
    return build_event_fmu(folder / "Events.fmu")


@pytest.fixture(scope="module")
def system(events: Path) -> System:
    return System.of({"a": events}, [], VALUES)


def run(system: System, **options: Any) -> ec.Result:
    with ec.load(system, **{**TIMES, **options}).prepare() as simulation:
        return simulation.run()


# ---- runs --------------------------------------------------------------------------------------------

WAYS: list[dict[str, Any]] = [
    {},
    {"isolate": True},
    {"algorithm": "strong"},
    {"algorithm": "jacobi"},
    {"error_tolerance": 1e-3},
]


@pytest.mark.parametrize("options", mostly_slow(WAYS, WAYS[:2]), ids=str)
def test_events_are_handled_inside_of_steps(events: Path, system: System, options: dict[str, Any]) -> None:
    """FMPy without event mode and early return has the same bits at the same steps."""
    result = run(system, no_event_mode=True, **options)
    assert result.remarks == [REMARK]
    assert set(result["a.updates"].tolist()) == {0.0}
    assert run(system, **options)["a.updates"][-1] > 0.0
    if "error_tolerance" in options:
        return
    fmpy_result = fmpy.simulate_fmu(
        str(events),
        stop_time=2.0,
        output_interval=0.125,
        start_values={"period": 0.3, "threshold": 0.35},
        output=["x", "bounces", "count"],
        use_event_mode=False,
        early_return_allowed=False,
    )
    for name in ("x", "bounces", "count"):
        assert np.array_equal(result[f"a.{name}"], fmpy_result[name]), name


@pytest.mark.parametrize("selection", [["a"], ["a*"], ["b", "a"], True])
def test_components_by_name_pattern_or_all(events: Path, selection: Any) -> None:
    """A pattern passes over FMUs without event mode."""
    fmus = {"a": events, "b": events, "a2": build_strict_fmu(Path("Strict.fmu"))}
    result = run(System.of(fmus, ["a2.x -> b.u"]), no_event_mode=selection)
    without = {"a": result["a.updates"][-1] == 0.0, "b": result["b.updates"][-1] == 0.0}
    assert without == {"a": True, "b": selection in (["b", "a"], True)}
    names = "a and b run" if without["b"] else "a runs"
    assert result.remarks == [f"{names} without event mode, as the option 'no_event_mode' says."]
    assert result.record["settings"]["no_event_mode"] == (["*"] if selection is True else selection)


@pytest.mark.parametrize("isolate", mostly_slow([[], ["b"]], [[]]))
def test_discrete_inputs_change_before_steps(events: Path, isolate: list[str]) -> None:
    """The FMU refuses them in step mode if it has event mode, and latches them at its own events."""
    system = System.of({"a": events, "b": events}, ["a.count -> b.n"], {**VALUES, "b.period": 0.125})
    result = run(system, no_event_mode=["b"], isolate=isolate)
    assert np.array_equal(result["b.latched"][1:], result["a.count"][1:])
    assert result["b.updates"][-1] == 0.0 < result["a.updates"][-1]


def test_false_and_an_empty_list_keep_event_mode(system: System) -> None:
    for off in (False, []):
        result = run(system, no_event_mode=off)
        assert result.remarks == [] and result["a.updates"][-1] > 0.0


def test_resumed_run_is_the_same(system: System) -> None:
    full_run = run(system, no_event_mode=True)
    run(system, no_event_mode=True, stop_time=0.625, checkpoint="kept")
    resumed = run(system, no_event_mode=["a"], resume="kept")
    assert np.array_equal(resumed["a.x"], full_run["a.x"][-len(resumed["a.x"]) :])
    with pytest.raises(CommandError, match="other uses of event mode, of a"):
        run(system, resume="kept")
    run(system, stop_time=0.625, checkpoint="with")
    with pytest.raises(CommandError, match="other uses of event mode, of a"):
        run(system, resume="with", no_event_mode=True)


def test_option_is_fixed_when_a_simulation_is_prepared(system: System) -> None:
    options: dict[str, Any] = {"no_event_mode": True}
    with ec.load(system, **TIMES).prepare(**options) as simulation:
        assert simulation.run().remarks == simulation.run(fresh=True).remarks == [REMARK]
    with ec.load(system, **TIMES).prepare() as simulation, pytest.raises(CommandError, match="prepare"):
        simulation.run(**options)


def test_replacement_runs_without_event_mode(events: Path, system: System) -> None:
    shutil.copy(events, "Other.fmu")
    result = run(system, replace={"a": "Other.fmu"}, no_event_mode=["a"])
    assert result.remarks == [REMARK] and result["a.updates"][-1] == 0.0


# ---- refusals ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("selection", [True, ["tick*"]])
def test_fmus_with_clocks_are_refused(events: Path, folder: Path, selection: Any) -> None:
    fmus = {"a": events, "ticking": build_event_fmu(folder / "Clocked.fmu", clock="periodic")}
    with pytest.raises(CommandError) as caught:
        run(System.of(fmus, [], VALUES), no_event_mode=selection)
    assert str(caught.value) == (
        "ticking cannot run without event mode: its FMU has the clock 'tick'. In the option 'no_event_mode', "
        "name other components only."
    )
    assert run(System.of(fmus, [], VALUES), no_event_mode=["a"]).remarks == [REMARK]


def test_what_has_no_event_mode_is_refused(folder: Path) -> None:
    fmus = {
        "two": build_strict_fmu(folder / "Two.fmu"),
        "three": build_all_types_3_fmu(folder / "Three.fmu"),
        "early": build_event_fmu(folder / "Early.fmu", events=False),
        "me": build_integrated_fmu(folder / "Integrated.fmu", version=3),
    }
    for names, listed in (
        (True, "two, three, early and me"),
        (["two", "early"], "two"),
        (["me"], "me"),
    ):
        message = f"no FMU has event mode in co-simulation among {listed}; change the option 'no_event_mode'"
        with pytest.raises(CommandError, match=message):
            run(System.of(fmus), no_event_mode=names)


def test_wrong_names_are_reported_before_fmus_are_built() -> None:
    with pytest.raises(CommandError, match=r"no component matches 'lift.plan'; did you mean lift.plant"):
        ec.load("lift", fmus="nothing", no_event_mode=["lift.plan"]).prepare()
    assert not Path("nothing").exists()


# ---- commands and files ------------------------------------------------------------------------------

STOP = ("--step-size", "0.125", "--stop-time", "1", "--set", "Events.period=0.3", "--no-plots")


def record(folder: str) -> dict[str, Any]:
    return json.loads(Path(folder, "run.json").read_text())


@pytest.mark.parametrize("flag", [["--no-event-mode"], ["--no-event-mode", "Ev*"]], ids=str)
def test_run_and_rerun(emla: Emla, events: Path, flag: list[str]) -> None:
    message = "Events runs without event mode, as the option 'no_event_mode' says."
    result = emla("run", str(events), *STOP, "--output", "out", *flag)
    assert result.exit_code == 0, result.output
    assert message in " ".join(result.output.split())
    value = flag[1:] or ["*"]
    assert record("out")["settings"]["no_event_mode"] == value
    assert record("out")["changed"]["no_event_mode"] == value
    assert message in record("out")["remarks"]
    repeated = emla("rerun", "out", "--no-plots")
    assert repeated.exit_code == 0, repeated.output
    assert "results.csv is the same" in repeated.stdout
    assert message in record("out-again")["remarks"]


@pytest.mark.parametrize(("value", "recorded"), [("true", ["*"]), ('["Events"]', ["Events"])])
def test_scenario_file(emla: Emla, events: Path, value: str, recorded: list[str]) -> None:
    Path("mine.toml").write_text(
        f'system = "{events}"\nstep_size = 0.125\nstop_time = 1.0\nplots = false\nno_event_mode = {value}\n'
    )
    result = emla("run", "mine.toml", "--output", "out")
    assert result.exit_code == 0, result.output
    assert record("out")["settings"]["no_event_mode"] == recorded
    assert any("without event mode" in text for text in record("out")["remarks"])
    assert "without event mode" in emla("info", "mine.toml").output
    for file in ("mine.ssp", "mine.c"):
        assert "cannot hold --no-event-mode" in sentence(emla("export", "mine.toml", file), 2)


def test_wrong_component_on_the_command_line(emla: Emla, events: Path) -> None:
    result = emla("run", str(events), *STOP, "--output", "out", "--no-event-mode", "Evens")
    assert "no component matches 'Evens'; did you mean Events?" in sentence(result, 2)


# ---- exports and sweeps ------------------------------------------------------------------------------


@pytest.mark.parametrize("fmi", mostly_slow([2, 3], [3]))
def test_system_without_event_mode_can_be_exported_as_an_fmu(system: System, fmi: int) -> None:
    """Those with event mode are refused."""
    ours = run(system, no_event_mode=True)
    scenario = ec.load(system, no_event_mode=True, **TIMES)
    fmu = scenario.export("system.fmu", outputs=["*"], fmi=fmi)
    fmpy_result = fmpy.simulate_fmu(str(fmu), stop_time=2.0, step_size=0.125, output_interval=0.125)
    for name in ("a.x", "a.count", "a.updates"):
        assert np.array_equal(fmpy_result[name], ours[name]), name
    with pytest.raises(CommandError, match="an SSP cannot hold --no-event-mode"):
        scenario.export("system.ssp")
    assert ec.load(system, no_event_mode=False, **TIMES).export("system.ssp").exists()


def test_sweeps_run_without_event_mode(system: System, on_one_cluster: None) -> None:
    """A sweep is not continued with event mode."""
    options: dict[str, Any] = {**TIMES, "vary": {"a.period": [0.3, 0.4]}, "output": "out"}
    options["metrics"] = ["n = last(a.updates)"]
    actual = ec.sweep(system, no_event_mode=True, **options)
    assert actual.variants["n"].to_list() == [0.0, 0.0]
    with pytest.raises(CommandError):
        ec.sweep(system, resume=True, **options)
    options["output"] = "other"
    assert min(ec.sweep(system, **options).variants["n"].to_list()) > 0.0


def test_frequency_responses_have_the_remark(system: System) -> None:
    actual = ec.linearize(
        system, perturb="a.u", read="a.x", stop_time=2.0, step_size=1e-2, no_event_mode=True
    )
    assert actual.remarks[0] == REMARK
