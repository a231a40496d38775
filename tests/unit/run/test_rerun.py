"""`emla rerun`: the same rows to the last bit, and a message on what has changed since."""

import hashlib
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import emla_cosim as ec
from emla_cosim.fmu.models import fmu_path
from emla_cosim.run.run_setup import plan_run
from tests.support.commands import Emla, sentence
from tests.support.paths import ROOT

SAME = "results.csv is the same as that of out, to the last bit"
SHORT_RUN = ("--stop-time", "0.002", "--no-plots", "--output", "out")


def changed_record(change: Callable[[dict[str, Any]], Any]) -> None:
    path = Path("out/run.json")
    record = json.loads(path.read_text())
    change(record)
    path.write_text(json.dumps(record))


def test_rerun_gives_the_same_rows_in_a_new_folder(emla: Emla) -> None:
    """Built-in, with all kinds of options."""
    options = ("--set", "tilt.plant.motor.R_s=0.2", "--fault", "tilt.plant.x_measured=offset:1e-3@0.001")
    more = ("--gains", "robust", "--algorithm", "jacobi", "--signals", "tilt.*")
    assert emla("run", "tilt", *SHORT_RUN, *options, *more).exit_code == 0
    before = {p.name: p.read_bytes() for p in Path("out").iterdir()}
    result = emla("rerun", "out", "--no-plots")
    assert result.exit_code == 0, result.output
    assert result.stdout.splitlines()[-1] == SAME
    assert "Differences from" not in result.stdout
    assert Path("out-again/results.csv").read_bytes() == before["results.csv"]
    assert {p.name: p.read_bytes() for p in Path("out").iterdir()} == before
    record, repeated = (json.loads(Path(f"{name}/run.json").read_text()) for name in ("out", "out-again"))
    for part in ("source", "changed", "settings", "components", "connections"):
        assert repeated[part] == record[part]


def test_rerun_from_another_folder(
    emla: Emla, fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A scenario file, a package, and an FMU in the place of a component."""
    Path("mine.toml").write_text('system = "lift"\nstop_time = 0.002\n[set]\n"lift.plant.motor.R_s" = 0.3\n')
    shutil.copy(fmu_path("FocController", "native", fmu_folder), "drive.fmu")
    assert emla("export", "lift", "lift.ssp").exit_code == 0
    runs = {
        "file": ("mine.toml", "--no-plots"),
        "package": ("lift.ssp", *SHORT_RUN[:3]),
        "fmu": ("lift", *SHORT_RUN[:3], "--controller", "drive.fmu"),
        "block": ("lift", *SHORT_RUN[:3], "--replace", "lift.controller=drive.fmu", "--gains", "robust"),
    }
    for name, arguments in runs.items():
        assert emla("run", *arguments, "--output", name).exit_code == 0
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    for name in runs:
        result = emla("rerun", f"../{name}/run.json", "--no-plots")
        assert result.exit_code == 0, result.output
        assert "to the last bit" in result.stdout and "Differences from" not in result.stdout
        repeated = tmp_path / f"{name}-again/results.csv"
        assert repeated.read_bytes() == (tmp_path / name / "results.csv").read_bytes()


def test_options_override_the_record(emla: Emla) -> None:
    assert emla("run", "lift", *SHORT_RUN, "--set", "lift.plant.motor.R_s=0.2").exit_code == 0
    options = ("--step-size", "5e-5", "--output-interval", "1e-4")
    result = emla("rerun", "out", *options, "--set", "lift.plant.motor.L_q=1e-3", *SHORT_RUN[2:3])
    assert result.exit_code == 0, result.output
    assert "to the last bit" not in result.stdout and "Differences from" not in result.stdout
    settings = json.loads(Path("out-again/run.json").read_text())["settings"]
    assert (settings["step_size_s"], settings["stop_time_s"]) == (5e-5, 0.002)
    assert settings["set"] == {"lift.plant.motor.R_s": "0.2", "lift.plant.motor.L_q": "1e-3"}
    scenario = ec.load("out-again/run.json", stop_time=1.0)
    assert (scenario.options.stop_time, scenario.options.step_size, scenario.name) == (1.0, 5e-5, "lift")
    assert scenario.options.set == settings["set"]


def test_original_is_replaced_only_on_request(emla: Emla) -> None:
    assert emla("run", "lift", *SHORT_RUN).exit_code == 0
    message = sentence(emla("run", "out/run.json", "--output", "out"), 2)
    assert "is also the scenario 'out/run.json'" in message
    result = emla("rerun", "out", "--output", "out")
    assert result.exit_code == 0 and "to the last bit" in result.stdout
    assert not Path("out-again").exists()


def test_differences_are_listed_in_one_sentence(emla: Emla) -> None:
    text = 'system = "lift"\nstop_time = 0.01\n'
    Path("mine.toml").write_text(text)
    assert emla("run", "mine.toml", "--no-plots", "--output", "out").exit_code == 0
    Path("mine.toml").write_text(text + "step_size = 5e-5\n")

    def older(record: dict[str, Any]) -> None:
        assert record["source"] == str(Path("mine.toml").absolute()) and record["changed"] == {}
        assert record["source_sha256"] == hashlib.sha256(text.encode()).hexdigest()
        record["versions"]["numpy"] = "1.0"
        record["components"]["lift.plant"]["sha256"] = "0" * 64

    changed_record(older)
    result = emla("rerun", "out", "--no-plots")
    (line,) = (x for x in result.stdout.splitlines() if x.startswith("Differences from"))
    assert (
        line.startswith("Differences from out/run.json: numpy ")
        and " instead of 1.0, the content of '" in line
    )
    assert "mine.toml', the FMU of lift.plant and " in line and line.endswith("the setting step_size_s.")
    assert "differs from that of out" in result.stdout
    Path("mine.toml").unlink()
    assert "mine.toml' cannot be read" in sentence(emla("rerun", "out"), 2)


def test_resumed_run_is_repeated_from_its_start(emla: Emla) -> None:
    assert emla("run", "lift", *SHORT_RUN, "--checkpoint", "a.checkpoint").exit_code == 0
    more = ("--stop-time", "0.004", *SHORT_RUN[2:], "--resume", "a.checkpoint", "--realtime", "100")
    assert emla("run", "lift", *more).exit_code == 0
    result = emla("rerun", "out")
    assert result.stdout.splitlines()[-1] == SAME
    settings = json.loads(Path("out-again/run.json").read_text())["settings"]
    assert settings["resumed_from"] is None and settings["real_time_factor"] is None


def test_python_objects_need_a_replacement(emla: Emla, fmu_folder: Path) -> None:
    with ec.load("lift").prepare(fmus=fmu_folder, algorithm=ec.Jacobi()) as simulation:
        simulation.run(stop_time=0.001).save("out", plots=False)
    message = sentence(emla("rerun", "out"), 2)
    assert "has the algorithm emla_cosim.master.algorithms.registry.Jacobi, an object of Python" in message
    assert emla("rerun", "out", "--algorithm", "jacobi").exit_code == 0
    system = ec.load("lift").system
    with ec.load(system, stop_time=0.001, step_size=1e-4, fmus=fmu_folder).prepare() as simulation:
        simulation.run().save("out", plots=False)
    assert "a system that was made in Python" in sentence(emla("rerun", "out"), 2)


def test_record_has_the_options_of_all_calls(fmu_folder: Path) -> None:
    """Those of `load`, `prepare` and `run`, merged; an object of Python has the name of its class."""
    scenario = ec.load("lift", stop_time=0.5, set={"lift.plant.motor.R_s": 0.1}, algorithm=ec.Jacobi())
    with scenario.prepare(fmus=fmu_folder, set={"lift.plant.motor.L_q": 1e-3}) as simulation:
        first = simulation.run(stop_time=0.001, set={"lift.plant.motor.R_s": 0.2})
        second = simulation.run(stop_time=0.002)
    assert (first.record["source"], first.record["source_sha256"]) == ("lift", None)
    assert first.record["changed"] == {
        "set": {"lift.plant.motor.R_s": 0.2, "lift.plant.motor.L_q": 1e-3},
        "stop_time": 0.001,
        "algorithm": {"python": "emla_cosim.master.algorithms.registry.Jacobi"},
    }
    assert second.record["changed"]["set"]["lift.plant.motor.R_s"] == 0.1


@pytest.mark.parametrize(
    ("record", "words"),
    [
        ("[" * 100_000, "is not JSON"),
        ('{"a": ' + "9" * 5000 + "}", "is not JSON"),
        ("{}", "is not the record of a run"),
        ('{"settings": {}}', "is not the record of a run, or its run ended too early"),
        ('{"settings": {}, "source": 1}', "the source 1; it must be"),
        ('{"settings": {}, "source": "run.json", "changed": {}}', "the source 'run.json'"),
        ('{"settings": {}, "source": "lift"}', "no table 'changed'"),
        ('{"settings": {}, "source": "/dev/zero", "changed": {}}', "there is no scenario '/dev/zero'"),
        ('{"settings": {}, "source": "lift", "changed": {"nonsense": 1}}', "there is no option 'nonsense'"),
        ('{"settings": {}, "source": "lift", "changed": {"output": "/"}}', "'output', which no record has"),
        ('{"settings": {}, "source": "lift", "changed": {"stop_time": NaN}}', ""),
        ('{"settings": {}, "source": "lift", "changed": {"stop_time": []}}', "'stop_time' of the record"),
        (
            '{"settings": {}, "source": "lift", "changed": {"set": {"a": {"python": "b"}}}}',
            "object of Python",
        ),
        ('{"settings": {}, "source": "lift", "changed": {"parameters": ["/dev/zero"]}}', "it is a device"),
        (
            '{"settings": {}, "source": "lift", "changed": {"fault": [{"signal": 1}]}}',
            "'0' in 'fault' of the record",
        ),
    ],
)
def test_invalid_record(record: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text(record)
    with pytest.raises(ec.CommandError) as caught:
        scenario = ec.load(tmp_path / "run.json")
        plan_run(scenario.options, scenario.name)
        scenario.prepare()
    assert words in str(caught.value)


def test_unreadable_record(emla: Emla) -> None:
    assert "cannot be read" in sentence(emla("rerun", "out"), 2)
    Path("out").mkdir()
    assert "'out/run.json' cannot be read" in sentence(emla("rerun", "out"), 2)
    os.mkfifo("out/run.json")
    assert "'out/run.json' cannot be read: it is a pipe." in sentence(emla("rerun", "out"), 2)


def test_edited_record_can_be_rerun(emla: Emla) -> None:
    assert emla("run", "lift", *SHORT_RUN).exit_code == 0

    def spoil(record: dict[str, Any]) -> None:
        record |= {"versions": [], "components": {"lift.plant": 3}, "connections": {}, "source_sha256": 1}
        record["settings"] = {"set": 1, "trajectory": {"sha256": 1}, "order": [[]]}
        record["settings"] |= {str(n): n for n in range(100_000)}

    changed_record(spoil)
    result = emla("rerun", "out", "--no-plots")
    assert result.exit_code == 0, result.output
    assert "the FMU of lift.plant" in result.stdout and "the setting set" in result.stdout


def test_changed_input_data_is_reported(emla: Emla) -> None:
    for file in ("actuator.toml", "load.csv"):
        shutil.copy(ROOT / "tests" / "own_machine" / file, file)
    options = ("--actuator", "prototype=actuator.toml", "--input", "load.csv:prototype.disturbance.F_L=Force")
    assert emla("run", "prototype", *SHORT_RUN, *options).exit_code == 0
    assert emla("rerun", "out", "--no-plots").stdout.splitlines()[-1] == SAME
    with Path("load.csv").open("a") as stream:
        stream.write("9.000,0.000,20.00\n")
    output = emla("rerun", "out", "--no-plots").stdout
    assert "Differences from" in output
    assert f"the content of '{Path('load.csv').absolute()}'" in output
