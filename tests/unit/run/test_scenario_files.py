"""Scenario files: each key sets its option, options of the command override keys, one message per mistake."""

import json
import re
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest

import emla_cosim as ec
from emla_cosim.run.run_setup import plan_run
from emla_cosim.run.scenarios.scenario_file import SCENARIOS
from emla_cosim.study.joints.schema import list_joint_names
from emla_cosim.study.loading import load
from emla_cosim.study.machines.systems import BUILT_IN
from tests.support.commands import Emla
from tests.support.paths import ROOT
from tests.support.tiers import mostly_slow

SHORT_RUN = 'system = "lift"\nstop_time = 0.002\nplots = false\noutput = "out"\n'
ORDER = ["lift.disturbance", "lift.plant", "lift.observer", "lift.controller", "lift.reference"]


@pytest.fixture(autouse=True)
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files of these tests lie in an empty current folder."""
    monkeypatch.chdir(tmp_path)


def write(text: str, path: str = "my.toml") -> str:
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text(text, encoding="utf-8")
    return path


def write_parameters(values: Mapping[str, tuple[float, str]], path: str = "my.ssv") -> str:
    """Write a parameter set of Reals in kN, mm and s."""
    parameters = "".join(
        f'<ssv:Parameter name="{name}"><ssv:Real value="{value}" unit="{unit}"/></ssv:Parameter>'
        for name, (value, unit) in values.items()
    )
    return write(
        '<ssv:ParameterSet version="1.0" name="my"'
        ' xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"'
        ' xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">'
        f"<ssv:Parameters>{parameters}</ssv:Parameters><ssv:Units>"
        '<ssc:Unit name="kN"><ssc:BaseUnit kg="1" m="1" s="-2" factor="1e3"/></ssc:Unit>'
        '<ssc:Unit name="mm"><ssc:BaseUnit m="1" factor="1e-3"/></ssc:Unit>'
        '<ssc:Unit name="s"><ssc:BaseUnit s="1"/></ssc:Unit>'
        "</ssv:Units></ssv:ParameterSet>",
        path,
    )


def run_record(emla: Emla, *arguments: str, output: str = "out") -> dict[str, Any]:
    """Return run.json of a run that succeeds."""
    result = emla("run", *arguments)
    assert result.exit_code == 0, result.output
    return json.loads(Path(output, "run.json").read_text())


def settings(text: str, fmus: Path, **options: Any) -> dict[str, Any]:
    """Return the settings that run.json of a scenario file would have."""
    with load(write(text), **options).prepare(fmus=fmus) as simulation:
        record = simulation.run().record
    assert record["status"] == "completed"
    return record["settings"]


def error_of(call: Callable[[], Any]) -> str:
    with pytest.raises(ec.CommandError) as caught:
        call()
    return str(caught.value)


# ---- every key ---------------------------------------------------------------------------------------

FAULT = {
    "signal": "lift.plant.x_measured", "kind": "offset", "start": 1e-3, "duration": None, "value": 1e-6,
}  # fmt: skip
FIXED = {
    "stop_time": ("0.003", {"stop_time_s": 0.003}),
    "start_time": ("0.001", {"start_time_s": 0.001}),
    "step_size": ("5e-5", {"step_size_s": 5e-5}),
    "output_interval": ("2e-4", {"output_interval_s": pytest.approx(2e-4)}),
    "stop_when": ('["lift.plant.x_L < 0"]', {}),
    "algorithm": ('"strong"', {}),
    "extrapolation": ('"fmu"', {}),
    "coupling_tolerance": ("1e-5", {}),
    "order": (str(ORDER), {}),
    "real_time": ("100", {"real_time_factor": 100.0}),
    "controller": ('"rsba"', {}),
    "gains": ('"published"', {}),
    "follow_models": ("true", {}),
    "isolate": ('["lift.observer"]', {}),
    "fmi_tolerance": ("1e-5", {}),
    "integrate_together": ("false", {}),
    "estimate_coupling": ("false", {}),
    "integrator": ('"adams"', {}),
    "integrator_step": ("1e-3", {"integrator_step_s": 1e-3}),
    "lenient": ("true", {}),
    "criteria": ('{ "lift.position_window" = "2 mm" }', {}),
    "set": ('{ "lift.plant.motor.R_s" = 0.2 }', {}),
    "replace": (
        '{ "lift.plant" = "my.fmu" }',
        {"replace": {"lift.plant": {"fmu": "my.fmu", "mapping": None}}},
    ),
    "fault": (
        '[{ signal = "lift.plant.x_measured", kind = "offset", value = 1e-6, start = 1e-3 }]',
        {"fault": [FAULT]},
    ),
    "kind": ('{ "lift.plant" = "cs" }', {}),
}
CONTROLLED = {
    "error_tolerance": ("0.01", {}),
    "step_size_control": ('"error"', {}),
    "largest_step": ("2e-4", {"largest_step_s": 2e-4}),
    "flavour": ('"python"', {}),
}
MULTIPLES = {
    "step_multiples": ('{ "lift.controller" = 2 }', {}),
    "flavour": ('"native"', {}),
}
"""Keys with a value, and the settings in run.json if they are not the key with this value."""

_ELSEWHERE = """
    system description mapping output output_format plot_format plots require signals animate actuator sheet
    input report parameters bonds roles trajectory no_event_mode load_control notch mode
    supply
"""
ELSEWHERE = set(_ELSEWHERE.split())
"""Keys of other tests: `parameters` in test_parameter_tables.py, `mapping` in test_replacement.py,
`trajectory` in test_machine.py, `actuator` in test_actuator.py, `input` in test_inputs.py,
`sheet` in test_actuator_factors.py, `roles` in test_roles.py, `bonds` in test_coupling_of_runs.py,
`no_event_mode` in test_no_event_mode.py, `load_control` and `notch` in test_load_control.py,
`mode` in test_machine_systems.py, `supply` in test_supply.py."""


@pytest.mark.parametrize(
    "keys",
    [FIXED, pytest.param(CONTROLLED, marks=pytest.mark.slow), MULTIPLES],  # compiles the loop anew
    ids=lambda keys: next(iter(keys)),
)
def test_keys_reach_the_run(keys: dict[str, tuple[str, dict[str, Any]]], python_fmu_folder: Path) -> None:
    Path("my.fmu").write_bytes((python_fmu_folder / "EmlaPlant/EmlaPlant.fmu").read_bytes())
    head = 'system = "lift"\n' + ("" if "stop_time" in keys else "stop_time = 0.002\n")
    before = settings(f"{head}stop_time = 0.003\n" if "stop_time" in keys else head, python_fmu_folder)
    lines = [f"{key} = {value}\n" for key, (value, _) in keys.items()]
    after = settings(head + "".join(lines), python_fmu_folder)
    for key, (value, recorded) in keys.items():
        expected = recorded or tomllib.loads(f"{key} = {value}")
        for name, setting in expected.items():
            assert after[name] == setting
            assert before.get(name) != setting or key in ("stop_time", "controller", "flavour"), key


def test_unknown_key_lists_all_keys() -> None:
    text = error_of(lambda: load(write(f"{SHORT_RUN}qqqqqq = 1\n")))
    key_list = re.search(r"; use (.*)\.$", text)
    assert key_list is not None
    assert set(re.split(r", | and ", key_list[1])) == {*FIXED, *CONTROLLED, *MULTIPLES, *ELSEWHERE}


def test_gains_are_those_of_the_key_or_of_the_option() -> None:
    def beta(source: str, **options: Any) -> Any:
        return load(source, **options).system.component("lift.controller").parameters["beta[1]"]

    path = write(f'{SHORT_RUN}gains = "published"\n')
    assert beta(path) == beta("lift", gains="published") != beta("lift", gains="robust")
    assert beta(path, gains="robust") == beta("lift", gains="robust")


def test_controller_without_gains_has_its_recommended_gains() -> None:
    """The gains of the scenario's file are for another controller."""
    assert load("lift").options.gains == "robust"
    scenario = load("lift", controller="foc")
    assert scenario.options.gains is None
    assert scenario.system == load("lift", controller="foc", gains="damped").system
    assert load("lift", controller="rsba", gains="robust").system == load("lift").system


@pytest.mark.parametrize("controller", ["rsba", "foc", "cac", "anatc"])
def test_controllers_of_loads_that_are_not_rigid_have_the_gains_for_them(controller: str) -> None:
    expected = load("study-compliant", controller=controller, gains="compliant").system
    assert load("study-compliant", controller=controller).system == expected
    assert load("study-compliant", controller=controller, gains="damped").system != expected


def test_description_goes_into_a_package(emla: Emla) -> None:
    write(f'{SHORT_RUN}description = "A lift of my own"\n')
    assert emla("export", "my.toml", "my.ssp").exit_code == 0
    scenario = load("my.ssp")
    assert repr(scenario) == "<Scenario my: 5 components; A lift of my own>"
    assert (scenario.options.stop_time, scenario.options.step_size) == (0.002, 1e-4)


def test_output_keys_and_their_options(emla: Emla) -> None:
    write('system = "lift"\nstop_time = 0.002\noutput = "mine"\nplots = true\nsignals = ["lift.plant.?_L"]\n')
    run_record(emla, "my.toml", output="mine")
    columns = ["time", *(f"lift.plant.{name}" for name in ("x_L", "v_L", "a_L", "P_L"))]
    assert polars.read_csv("mine/results.csv").columns == columns
    assert Path("mine/tracking.png").exists()
    options = ("--no-plots", "--signals", "lift.plant.i_q", "--output", "other")
    run_record(emla, "my.toml", *options, output="other")
    table = polars.read_csv("other/results.csv")
    assert table.columns == ["time", "lift.plant.i_q"]
    assert not Path("other/tracking.png").exists()
    text = 'system = "lift"\nstop_time = 0.002\nplots = false\nsignals = ["lift.plant.i_q"]\n'
    write(f'{text}output_format = "parquet"\n', "heavy.toml")
    assert run_record(emla, "heavy.toml", output="results/heavy")["scenario"] == "heavy"  # the file's name
    assert polars.read_parquet("results/heavy/results.parquet").equals(table)


# ---- files, options and packages ---------------------------------------------------------------------


def test_tables_are_merged(emla: Emla, fmu_folder: Path) -> None:
    plant, observer = (f"{fmu_folder}/{m}/{m}.fmu" for m in ("EmlaPlant", "EmlaObserver"))
    write(
        f'{SHORT_RUN}[set]\nlift.plant.motor.R_s = 0.2\n"lift.plant.screw.M_BS" = 100\n'
        '[step_multiples]\n"lift.observer" = 2\n"lift.controller" = 4\n'
        f'[replace]\n"lift.plant" = "gone.fmu"\n"lift.observer" = "{observer}"\n'
    )
    options = {
        "--set": "lift.plant.motor.R_s=0.3",
        "--step-multiple": "lift.controller=2",
        "--replace": f"lift.plant={plant}",
    }
    actual = run_record(emla, "my.toml", *(x for pair in options.items() for x in pair))["settings"]
    assert actual["set"] == {"lift.plant.motor.R_s": "0.3", "lift.plant.screw.M_BS": 100}
    assert actual["step_multiples"] == {"lift.observer": 2, "lift.controller": 2}
    replaced = {name: r["fmu"] for name, r in actual["replace"].items()}
    assert replaced == {"lift.plant": plant, "lift.observer": observer}


@pytest.fixture(scope="module")
def package(fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("package") / "lift.ssp"
    times = {"start_time": 0.003, "stop_time": 0.005, "step_size": 5e-5}
    return load("lift", fmus=fmu_folder, **times).export(path)


def test_paths_are_relative_to_the_file(emla: Emla, package: Path, fmu_folder: Path) -> None:
    write_parameters({"lift.disturbance.load.level[1]": (40.0, "kN")}, "deep/my.ssv")
    Path("deep/lift.ssp").symlink_to(package)
    Path("deep/Plant.fmu").symlink_to(fmu_folder / "EmlaPlant/EmlaPlant.fmu")
    write(
        'system = "lift.ssp"\nplots = false\noutput = "../out"\nparameters = ["my.ssv"]\n'
        '[replace]\n"lift.plant" = { fmu = "Plant.fmu" }\n',
        "deep/my.toml",
    )
    record = run_record(emla, "deep/my.toml")
    components = record["components"]
    assert components["lift.disturbance"]["parameters"]["load.level[1]"] == 40e3
    assert components["lift.plant"]["fmu"] == "deep/Plant.fmu"


@pytest.mark.parametrize(
    ("keys", "options", "expected"),
    [
        ("", {}, (0.003, 0.005, 5e-5)),
        ("start_time = 0.001\nstop_time = 0.002", {"start_time": 0.0015}, (0.0015, 0.002, 5e-5)),
        ("start_time = 0.0\n", {}, (0.0, 0.005, 5e-5)),
    ],
)
def test_times_of_a_package_are_overridden_by_file_and_options(
    keys: str, options: dict[str, Any], expected: tuple[float, ...], package: Path
) -> None:
    with load(write(f'system = "{package}"\n{keys}\n'), **options).prepare() as simulation:
        result = simulation.run()
    actual = result.record["settings"]
    assert tuple(actual[f"{name}_s"] for name in ("start_time", "stop_time", "step_size")) == expected
    assert (result.time[0], result.time[-1]) == pytest.approx(expected[:2])


def test_gains_are_for_built_in_systems(package: Path, fmu_folder: Path) -> None:
    fmu = fmu_folder / "Reference" / "Reference.fmu"
    for option, value in (("gains", "robust"), ("controller", "rsba")):
        path = write(f'system = "{package}"\n{option} = "{value}"\n')
        for source, options in ((path, {}), (package, {option: value}), (fmu, {option: value})):
            text = error_of(lambda s=source, o=options: load(s, **o))
            assert f"has its own gains; --{option} is for built-in systems" in text


# ---- mistakes ----------------------------------------------------------------------------------------

NO_SYSTEM = [
    ('systm = "lift"', "has the unknown entry 'systm'", "did you mean 'system'?"),
    ("stop_time = 1", "my.toml' lacks system", 'write system = "study"'),
    ("", "my.toml' lacks system"),
    ('system = "winch"', "names the system 'winch'", "one of study, study-drive, study-compliant, lift"),
    ('system = "crane.ssp"', "there is no file 'crane.ssp'"),
    ("system = 1", "'system' of the scenario 'my.toml' is 1; it must be a text"),
    ('system = "lift"\nsystem = "tilt"', "my.toml' is not TOML", "line 2"),
    ("system = lift", "my.toml' is not TOML", "line 1"),
]
OF_LIFT = [
    ("stop-time = 1", "has the unknown entry 'stop-time'", "did you mean 'stop_time'?"),
    ('controller = "robust"', "'robust' is a set of gains, not a controller", 'write gains = "robust"'),
    ("description = 3", "'description'", "must be a text"),
    ('stop_time = "1 m"', "'stop_time'", "has the units m and s"),
    ('plots = "no"', "'plots'", "must be true or false"),
    ('signals = "lift.*"', "'signals'", "must be a list"),
    ("signals = [1]", "'0' in 'signals'", "is 1; it must be a text"),
    ("set = 1", "'set'", "must be a table"),
    ('[set]\n"lift.plant.start.x_L" = [1]', "no variable 'start.x_L[1]'; did you mean start.x_L"),
    ("[set]\nlift.plant.motor.R_s = []", "'lift.plant.motor.R_s' in 'set'", "must be"),
    ('[step_multiples]\n"lift.plant" = 2.5', "'lift.plant'", "must be a whole number"),
    ('[replace]\n"lift.plant" = 1', "'lift.plant' in 'replace'", "must be a path, or"),
    (
        '[replace]\n"lift.plant" = { fmu = "x.fmu", map = "y" }',
        "unknown entry 'map'",
        "did you mean 'mapping'?",
    ),
    ('[replace]\n"lift.plant" = "gone.fmu"', "no FMU file 'gone.fmu'"),
    ('[replace]\n"lift.pump" = "gone.fmu"', "no component 'lift.pump'"),
]
MISTAKES = [*NO_SYSTEM, *((f'system = "lift"\n{row[0]}', *row[1:]) for row in OF_LIFT)]


@pytest.mark.parametrize(
    ("text", "words"), [(text, words) for text, *words in MISTAKES], ids=lambda x: str(x).replace("\n", "; ")
)
def test_mistake_in_a_file(text: str, words: list[str], fmu_folder: Path) -> None:
    def use() -> None:
        scenario = load(write(f"{text}\n"))
        plan_run(scenario.options, scenario.name)
        scenario.prepare(fmus=fmu_folder).close()

    actual = error_of(use)
    for word in words:
        assert word in actual


def test_files_that_cannot_be_read() -> None:
    Path("folder.toml").mkdir()
    Path("latin.toml").write_bytes('description = "Förderer"'.encode("latin-1"))
    for path, words in (
        ("gone.toml", "the scenario 'gone.toml' cannot be read: No such file"),
        ("folder.toml", "the scenario 'folder.toml' cannot be read: Is a dir"),
        ("latin.toml", "the scenario 'latin.toml' is not a text in UTF-8."),
    ):
        assert words in error_of(lambda p=path: load(p))


# ---- built-in scenarios ------------------------------------------------------------------------------

SLOW = {"crane", "stewart", "lift_table"}
"""Machines of which others, such as excavator, have the kind of file."""


@pytest.mark.parametrize("name", mostly_slow(SCENARIOS, SCENARIOS.keys() - SLOW))
def test_built_in_scenario_is_a_file_and_a_system(name: str) -> None:
    """A copy of its file is the same scenario, and a file with the system alone has its options."""
    study = ROOT / "orchestration/emla_cosim/study"
    folders = {**dict.fromkeys(list_joint_names(), "joints"), **dict.fromkeys(BUILT_IN, "machines")}
    source = study / folders.get(name, "scenarios") / f"{name}.toml"
    expected = load(name)
    assert load(write(source.read_text(encoding="utf-8"), f"copy/{name}.toml")) == expected
    of_file = load(write(f'system = "{name}"\n'))
    assert (of_file.system, of_file.options, of_file.name) == (expected.system, expected.options, "my")


def test_built_in_name_has_priority_over_a_folder() -> None:
    Path("lift").mkdir()
    assert load("lift").system.components
    assert "'lift' has no 'SystemStructure.ssd'" in error_of(lambda: load("lift/"))


# ---- parameter files ---------------------------------------------------------------------------------


def test_parameters_are_converted_to_the_units_of_their_variables(emla: Emla) -> None:
    write_parameters(
        {"lift.disturbance.load.level[1]": (40.0, "kN"), "lift.plant.start.x_L": (241.5, "mm")}, "one.ssv"
    )
    write_parameters(
        {"lift.plant.start.x_L": (242.0, "mm"), "lift.observer.start.x_hat": (242.0, "mm")}, "two.ssv"
    )
    options = ("--stop-time", "0.001", "--no-plots", "--parameters", "one.ssv", "--parameters", "two.ssv")
    values = ("--set", "lift.observer.start.x_hat=0.2425", "--output", "out")
    record = run_record(emla, "lift", *options, *values)
    parameters = {name: component["parameters"] for name, component in record["components"].items()}
    assert parameters["lift.disturbance"]["load.level[1]"] == 40e3
    assert parameters["lift.plant"]["start.x_L"] == 0.242  # of the later file
    assert parameters["lift.observer"]["start.x_hat"] == "0.2425"  # of --set
    first = polars.read_csv("out/results.csv").row(0, named=True)
    assert (first["lift.plant.x_L"], first["lift.observer.x_hat"]) == (0.242, 0.2425)
    assert first["lift.disturbance.F_L"] == 40e3


@pytest.mark.parametrize(
    ("name", "unit", "words"),
    [
        ("lift.plant.x", "mm", ["lift.plant has no variable 'x'", "x_L"]),
        ("lift.plant.start.x_L", "s", ["'lift.plant.start.x_L' of 'my.ssv' has the units s and m"]),
        ("lift.plant.start.x_L", "inch", ["units inch and m: inch is not defined in the Units of 'my.ssv'"]),
        ("lift.plant.tau_m", "mm", ["lift.plant.tau_m"]),
    ],
)
def test_parameters_that_do_not_match(name: str, unit: str, words: list[str], fmu_folder: Path) -> None:
    path = write_parameters({name: (1.0, unit)})
    text = error_of(lambda: load("lift", parameters=[path]).prepare(fmus=fmu_folder))
    for word in words:
        assert word in text


def test_unreadable_parameter_files(fmu_folder: Path) -> None:
    write("<a/>", "other.ssv")
    for name, words in (("other.ssv", "is not a ParameterSet"), ("gone.ssv", "cannot be read: No such file")):
        assert words in error_of(lambda n=name: load("lift", parameters=[n]).prepare(fmus=fmu_folder))


# ---- signals -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def lift(fmu_folder: Path) -> ec.Simulation:
    return load("lift", fmus=fmu_folder, stop_time=0.001).prepare()


@pytest.mark.parametrize(
    ("patterns", "expected"),
    [
        ("*.x_?", "lift.reference.x_d lift.plant.x_L"),
        ("lift.plant.i_q *.x_d", "lift.reference.x_d lift.plant.i_q"),
        ("lift.controller.theta[1]", "lift.controller.theta[1]"),
    ],
)
def test_patterns_select_signals(patterns: str, expected: str, lift: ec.Simulation) -> None:
    """In the order of the system; a name with brackets means itself."""
    assert lift.run(signals=patterns.split()).names == expected.split()


def test_metrics_need_no_recorded_signals(lift: ec.Simulation) -> None:
    few, all_metrics = (
        lift.run(stop_time=0.4, signals=s).metrics["joints"] for s in (["lift.plant.x_L"], ["*"])
    )
    np.testing.assert_equal(few, all_metrics)


def test_pattern_without_a_signal(lift: ec.Simulation) -> None:
    for pattern, words in (
        ("lift.plant.xL", "did you mean lift.plant.x_L"),
        ("crane.*", "without --signals, all outputs are kept."),
    ):
        text = error_of(lambda p=pattern: lift.run(signals=["lift.plant.*", p]))
        assert f"no signal matches '{pattern}'; {words}" in text
