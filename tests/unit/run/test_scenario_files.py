"""Scenario files: every key does what it says, the command wins, and what is wrong gets one sentence."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import polars
import pytest

from emla_cosim.run.options import Options
from emla_cosim.run.scenarios.built_in import SCENARIOS
from emla_cosim.run.scenarios.scenario_file import parse_scenario
from emla_cosim.study.joints.joint_files import list_joint_names
from emla_cosim.study.loading import load
from tests.support.commands import Emla, sentence
from tests.support.paths import ROOT

SHORT = 'system = "lift"\nstop_time = 0.002\nplots = false\noutput = "out"\n'
ORDER = ["lift.disturbance", "lift.plant", "lift.observer", "lift.controller", "lift.reference"]


def write(text: str, path: str = "my.toml") -> None:
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text(text, encoding="utf-8")


def write_parameters(values: Mapping[str, tuple[float, str]], path: str = "my.ssv") -> None:
    """A parameter set of Reals in kN, mm and s."""
    parameters = "".join(
        f'<ssv:Parameter name="{name}"><ssv:Real value="{value}" unit="{unit}"/></ssv:Parameter>'
        for name, (value, unit) in values.items()
    )
    write(
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


def ran(emla: Emla, *arguments: str, output: str = "out") -> dict[str, Any]:
    """run.json of a run that goes well."""
    result = emla("run", *arguments)
    assert result.exit_code == 0, result.output
    return json.loads(Path(output, "run.json").read_text())


def start_value(record: dict[str, Any], path: str) -> Any:
    component, name = re.fullmatch(r"(\w+\.\w+)\.(.+)", path).groups()  # pyright: ignore
    return record["components"][component]["parameters"].get(name)


# ---- every key -------------------------------------------------------------------------------------

SETTINGS: dict[str, tuple[str, str, Any]] = {
    "stop_time": ("stop_time = 0.003", "stop_time_s", 0.003),
    "start_time": ("start_time = 0.001", "start_time_s", 0.001),
    "stop_when": (
        'stop_when = ["lift.plant.x_L < 0"]',
        "stop_when",
        ["lift.plant.x_L < 0"],
    ),
    "step_size": ("step_size = 5e-5", "step_size_s", 5e-5),
    "algorithm": ('algorithm = "jacobi"', "algorithm", "jacobi"),
    "extrapolation": ('extrapolation = "fmu"', "extrapolation", "fmu"),
    "coupling_tolerance": (
        'coupling_tolerance = 1e-6\nalgorithm = "strong"',
        "coupling_tolerance",
        1e-6,
    ),
    "error_tolerance": ("error_tolerance = 0.01", "error_tolerance", 0.01),
    "step_size_control": (
        'error_tolerance = 0.01\nstep_size_control = "error"',
        "step_size_control",
        "error",
    ),
    "output_interval": ("output_interval = 2e-4", "output_interval_s", pytest.approx(2e-4)),
    "order": (f"order = {ORDER}", "order", ORDER),
    "real_time": ("real_time = 100", "real_time_factor", 100.0),
    "flavour": ('flavour = "python"', "flavour", "python"),
    "largest_step": ("error_tolerance = 0.01\nlargest_step = 2e-4", "largest_step_s", 2e-4),
    "criteria": ('[criteria]\n"lift.position_window" = "2 mm"', "criteria", {"lift.position_window": "2 mm"}),
    "step_multiples": ('[step_multiples]\n"lift.controller" = 2', "step_multiples", {"lift.controller": 2}),
    "set": ('[set]\n"lift.plant.motor.R_s" = 0.2', "set", {"lift.plant.motor.R_s": 0.2}),
    "replace": (
        '[replace]\n"lift.plant" = "my.fmu"',
        "replace",
        {"lift.plant": {"fmu": "my.fmu", "mapping": None}},
    ),
    "fault": (
        '[[fault]]\nsignal = "lift.plant.x_measured"\nkind = "offset"\nvalue = 1e-6\nstart = 1e-3',
        "fault",
        [
            {
                "signal": "lift.plant.x_measured",
                "kind": "offset",
                "start": 1e-3,
                "duration": None,
                "value": 1e-6,
            }
        ],
    ),
    "controller": ('controller = "rsba"', "controller", "rsba"),
    "gains": ('gains = "published"', "gains", "published"),
    "follow_models": ("follow_models = true", "follow_models", True),
    "isolate": ('isolate = ["lift.plant"]', "isolate", ["lift.plant"]),
    "fmi_tolerance": ("fmi_tolerance = 1e-5", "fmi_tolerance", 1e-5),
    "integrate_together": ("integrate_together = false", "integrate_together", False),
    "integrator": ('integrator = "adams"', "integrator", "adams"),
    "integrator_step": ("integrator_step = 1e-3", "integrator_step_s", 1e-3),
    "kind": ('[kind]\n"lift.plant" = "cs"', "kind", {"lift.plant": "cs"}),
    "lenient": ("lenient = true", "lenient", True),
}
"""Keys by what they bring to the settings in run.json."""

ELSEWHERE = {
    "system",
    "description",
    "mapping",
    "output",
    "output_format",
    "plot_format",
    "plots",
    "require",
    "signals",
} | {
    "animate",
    "actuator",
    "sheet",
    "input",
    "report",
    "parameters",
    "bonds",
    "roles",
    "trajectory",
}
"""Keys of the tests below; `parameters` is in test_parameter_tables.py, `mapping` in test_replacement.py,
`trajectory` in test_machine.py, `actuator` in test_actuator.py, `input` in test_inputs.py,
`sheet` in sweep/test_actuator_factors.py, `roles` in test_roles.py, `bonds` in test_coupling_of_runs.py."""


@pytest.mark.parametrize("key", SETTINGS)
def test_a_key_reaches_the_run(key: str, emla: Emla, python_fmu_folder: Path, tmp_path: Path) -> None:
    line, setting, expected = SETTINGS[key]
    write_parameters({"lift.plant.start.x_L": (0.24, "mm")})
    (tmp_path / "my.fmu").write_bytes((python_fmu_folder / "EmlaPlant/EmlaPlant.fmu").read_bytes())
    given = re.sub(f"^{key} = .*\n", "", SHORT, flags=re.MULTILINE)
    write(given)
    assert ran(emla, "my.toml")["settings"].get(setting) != expected
    write(f"{given}{line}\n")
    record = ran(emla, "my.toml")
    assert record["settings"][setting] == expected
    assert record["status"] == "completed"


def test_an_animation_can_be_asked_for(emla: Emla) -> None:
    write(f"{SHORT}animate = true\n")
    assert "cannot be animated" in sentence(emla("run", "my.toml"), 2)


def test_these_are_all_keys(emla: Emla) -> None:
    write(f"{SHORT}qqqqqq = 1\n")
    text = sentence(emla("run", "my.toml"), 2)
    named = re.search(r"known keys: (.*)\.$", text)
    assert named is not None
    assert set(re.split(r", | and ", named[1])) == {*SETTINGS, *ELSEWHERE}


def test_the_gains_are_those_named(emla: Emla) -> None:
    write(f'{SHORT}gains = "published"\n')
    beta = {
        name: load("lift", gains=name).system.component("lift.controller").parameters["beta[1]"]
        for name in ("published", "robust")
    }
    assert beta["published"] != beta["robust"]
    for options, expected in ((), "published"), (("--gains", "robust"), "robust"):
        assert start_value(ran(emla, "my.toml", *options), "lift.controller.beta[1]") == beta[expected]


@pytest.mark.parametrize("system", SCENARIOS)
def test_a_file_with_a_system_alone_is_the_scenario_of_that_name(system: str, tmp_path: Path) -> None:
    path = tmp_path / "my.toml"
    path.write_text(f'system = "{system}"\n', encoding="utf-8")
    expected, found = load(system), load(path)
    assert found.system == expected.system
    assert found.options == expected.options
    assert found.name == "my"


def test_the_description_goes_into_a_package(emla: Emla) -> None:
    write(f'{SHORT}description = "A lift of my own"\n')
    assert emla("export", "my.toml", "my.ssp").exit_code == 0
    scenario = load("my.ssp")
    assert (scenario.name, scenario.description) == ("my", "A lift of my own")
    assert (scenario.options.stop_time, scenario.options.step_size) == (0.002, 1e-4)


def test_the_output_is_as_the_file_says(emla: Emla) -> None:
    write('system = "lift"\nstop_time = 0.002\noutput = "mine"\nplots = true\nsignals = ["lift.plant.?_L"]\n')
    ran(emla, "my.toml", output="mine")
    assert polars.read_csv("mine/results.csv").columns == [
        "time", "lift.plant.x_L", "lift.plant.v_L", "lift.plant.a_L", "lift.plant.P_L",
    ]  # fmt: skip
    assert Path("mine/tracking.png").exists()
    ran(emla, "my.toml", "--no-plots", "--signals", "lift.plant.i_q", "--output", "other", output="other")
    assert polars.read_csv("other/results.csv").columns == ["time", "lift.plant.i_q"]
    assert not Path("other/tracking.png").exists()
    write(f'{SHORT}signals = ["lift.plant.i_q"]\noutput_format = "parquet"\n')
    ran(emla, "my.toml")
    table = polars.read_csv("other/results.csv", schema_overrides=[polars.Float64] * 2)
    assert polars.read_parquet("out/results.parquet").equals(table)


def test_without_an_output_the_file_gives_the_folder_its_name(emla: Emla) -> None:
    write('system = "lift"\nstop_time = 0.001\nplots = false\n', "heavy.toml")
    assert ran(emla, "heavy.toml", output="results/heavy")["scenario"] == "heavy"


# ---- the file and the command ----------------------------------------------------------------------

OPTIONS = {
    "stop_time": ("--stop-time", "0.004", "stop_time_s", 0.004),
    "step_size": ("--step-size", "2e-5", "step_size_s", 2e-5),
    "algorithm": ("--algorithm", "strong", "algorithm", "strong"),
    "extrapolation": ("--extrapolation", "master", "extrapolation", "master"),
    "coupling_tolerance": ("--coupling-tolerance", "1e-5", "coupling_tolerance", 1e-5),
    "error_tolerance": ("--error-tolerance", "0.02", "error_tolerance", 0.02),
    "output_interval": ("--output-interval", "4e-4", "output_interval_s", pytest.approx(4e-4)),
    "order": ("--order", ",".join(reversed(ORDER)), "order", ORDER[::-1]),
    "real_time": ("--realtime", "50", "real_time_factor", 50.0),
    "flavour": ("--flavour", "native", "flavour", "native"),
}


@pytest.mark.parametrize("key", OPTIONS)
def test_the_command_wins(key: str, emla: Emla) -> None:
    option, value, setting, expected = OPTIONS[key]
    given = re.sub(f"^{key} = .*\n", "", SHORT, flags=re.MULTILINE)
    write(f"{given}{SETTINGS[key][0]}\n")
    assert ran(emla, "my.toml", option, value)["settings"][setting] == expected


def test_tables_are_merged(emla: Emla, fmu_folder: Path) -> None:
    plant, observer = (f"{fmu_folder}/{m}/{m}.fmu" for m in ("EmlaPlant", "EmlaObserver"))
    write(
        f'{SHORT}[set]\n"lift.plant.motor.R_s" = 0.2\n"lift.plant.screw.M_BS" = 100\n'
        '[step_multiples]\n"lift.observer" = 2\n"lift.controller" = 4\n'
        f'[replace]\n"lift.plant" = "gone.fmu"\n"lift.observer" = "{observer}"\n'
    )
    options = {
        "--set": "lift.plant.motor.R_s=0.3",
        "--step-multiple": "lift.controller=2",
        "--replace": f"lift.plant={plant}",
    }
    settings = ran(emla, "my.toml", *(x for pair in options.items() for x in pair))["settings"]
    assert settings["set"] == {"lift.plant.motor.R_s": "0.3", "lift.plant.screw.M_BS": 100}
    assert settings["step_multiples"] == {"lift.observer": 2, "lift.controller": 2}
    replaced = {name: r["fmu"] for name, r in settings["replace"].items()}
    assert replaced == {"lift.plant": plant, "lift.observer": observer}


def test_a_file_does_what_options_do(emla: Emla) -> None:
    write(
        'system = "lift"\nstop_time = 0.02\nplots = false\noutput = "file"\nalgorithm = "jacobi"\n'
        'step_size = 5e-5\n[set]\n"lift.plant.motor.R_s" = 0.2\n"lift.disturbance.d_2.is_force" = true\n'
    )
    ran(emla, "my.toml", output="file")
    options = ("--stop-time", "0.02", "--algorithm", "jacobi", "--step-size", "5e-5", "--no-plots")
    values = ("--set", "lift.plant.motor.R_s=0.2", "--set", "lift.disturbance.d_2.is_force=true")
    ran(emla, "lift", *options, *values, "--output", "options", output="options")
    assert Path("file/results.csv").read_bytes() == Path("options/results.csv").read_bytes()


def test_paths_are_relative_to_the_file(emla: Emla, fmu_folder: Path) -> None:
    write_parameters({"lift.disturbance.load.level[1]": (40.0, "kN")}, "deep/my.ssv")
    assert emla("export", "lift", "deep/lift.ssp", "--stop-time", "0.002").exit_code == 0
    Path("deep/Plant.fmu").write_bytes((fmu_folder / "EmlaPlant/EmlaPlant.fmu").read_bytes())
    write(
        'system = "lift.ssp"\nplots = false\noutput = "../out"\nparameters = ["my.ssv"]\n'
        '[replace]\n"lift.plant" = { fmu = "Plant.fmu" }\n',
        "deep/my.toml",
    )
    record = ran(emla, "deep/my.toml")
    assert start_value(record, "lift.disturbance.load.level[1]") == 40e3
    assert record["components"]["lift.plant"]["fmu"] == "deep/Plant.fmu"


def test_a_file_wins_over_the_package_that_it_names(emla: Emla) -> None:
    times = ("--start-time", "0.003", "--stop-time", "0.005", "--step-size", "5e-5")
    assert emla("export", "lift", "lift.ssp", *times).exit_code == 0
    of_package = 'system = "lift.ssp"\nplots = false\noutput = "out"\n'
    of_file = f"{of_package}start_time = 0.001\nstop_time = 0.002\nstep_size = 1e-4\n"
    for text, options, expected in (
        (of_package, (), (0.003, 0.005, 5e-5)),
        (of_file, (), (0.001, 0.002, 1e-4)),
        (of_file, ("--start-time", "0.0015"), (0.0015, 0.002, 1e-4)),
        (f"{of_package}start_time = 0.0\n", (), (0.0, 0.005, 5e-5)),
    ):
        write(text)
        settings = ran(emla, "my.toml", *options)["settings"]
        assert tuple(settings[f"{name}_s"] for name in ("start_time", "stop_time", "step_size")) == expected
        rows = polars.read_csv("out/results.csv")["time"]
        assert (rows[0], rows[-1]) == pytest.approx(expected[:2])


# ---- what is wrong ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('system = "lift"\nstop-time = 1\n', ["has the key 'stop-time'", "did you mean 'stop_time'?"]),
        ('system = "lift"\nspeed = 1\n', ["has the key 'speed'"]),
        ('systm = "lift"\n', ["has the key 'systm'", "did you mean 'system'?"]),
        ("stop_time = 1\n", ["my.toml' has no system", 'write system = "study"']),
        ("", ["my.toml' has no system"]),
        (
            'system = "crane"\n',
            ["names the system 'crane'", "one of study, study-drive, study-compliant, lift"],
        ),
        ('system = "crane.ssp"\n', ["there is no file 'crane.ssp'"]),
        ("system = 1\n", ["'system' of the scenario 'my.toml' is 1; it must be a text"]),
        ('system = "lift"\ncontroller = "pid"\n', ["no controller 'pid'", "choose from rsba"]),
        (
            'system = "lift"\ncontroller = "robust"\n',
            ["'robust' is a set of gains, not a controller", 'write gains = "robust"'],
        ),
        (
            'system = "lift"\ngains = "pid"\n',
            ["no set of gains 'pid'", "damped, compensated, robust, published and compliant"],
        ),
        ('system = "lift"\ncoupling_tolerance = 1e-6\n', ["gauss-seidel has no coupling tolerance"]),
        ('system = "lift"\noutput_format = "xls"\n', ["no output format 'xls'", "csv and parquet"]),
        (
            'system = "lift"\n[mapping]\n"lift.plant" = "my.ssm"\n',
            ["--mapping lift.plant=my.ssm needs --replace lift.plant=FILE.fmu"],
        ),
        ('system = "lift"\ndescription = 3\n', ["'description'", "must be a text"]),
        ('system = "lift"\nstop_time = "1 m"\n', ["'stop_time'", "has the units m and s"]),
        ('system = "lift"\nstop_time = true\n', ["'stop_time'", "is True; it must be a number"]),
        ('system = "lift"\nstop_time = -1.0\n', ["stop time -1 s"]),
        ('system = "lift"\nplots = "no"\n', ["'plots'", "must be true or false"]),
        ('system = "lift"\nflavour = "java"\n', ["no flavour 'java'"]),
        ('system = "lift"\nalgorithm = "euler"\n', ["no algorithm 'euler'"]),
        ('system = "lift"\nsignals = "lift.*"\n', ["'signals'", "must be a list"]),
        ('system = "lift"\nsignals = [1]\n', ["'0' in 'signals'", "is 1; it must be a text"]),
        ('system = "lift"\nsignals = ["lift.*", "tilt.*"]\n', ["no signal matches 'tilt.*'"]),
        ('system = "lift"\norder = "lift.plant"\n', ["'order'", "must be a list"]),
        ('system = "lift"\nset = 1\n', ["'set'", "must be a table"]),
        (
            'system = "lift"\n[set]\n"lift.plant.start.x_L" = [1]\n',
            ["no variable 'start.x_L[1]'; did you mean start.x_L"],
        ),
        (
            'system = "lift"\n[set]\nlift.plant.motor.R_s = []\n',
            ["'lift.plant.motor.R_s' in 'set'", "must be"],
        ),
        ('system = "lift"\n[set]\n"lift.plant.x" = 1\n', ["lift.plant has no variable 'x'"]),
        ('system = "lift"\n[set]\n"lift.plant.motor.R_s" = -1\n', ["motor.R_s = -1 Ohm", "at least 0 Ohm"]),
        (
            'system = "lift"\n[step_multiples]\n"lift.plant" = 2.5\n',
            ["'lift.plant'", "must be a whole number"],
        ),
        (
            'system = "lift"\n[replace]\n"lift.plant" = 1\n',
            ["'lift.plant' in 'replace'", "must be a path, or"],
        ),
        ('system = "lift"\n[replace]\n"lift.plant" = { file = "x" }\n', ["must be a path, or { fmu"]),
        ('system = "lift"\n[replace]\n"lift.plant" = { fmu = "x.fmu", map = "y" }\n', ["{ fmu = "]),
        ('system = "lift"\n[replace]\n"lift.plant" = { fmu = 1 }\n', ["'fmu' in 'lift.plant' in 'replace'"]),
        ('system = "lift"\n[replace]\n"lift.plant" = "gone.fmu"\n', ["no FMU file 'gone.fmu'"]),
        ('system = "lift"\n[replace]\n"lift.pump" = "gone.fmu"\n', ["no component 'lift.pump'"]),
        ('system = "lift"\nparameters = "my.ssv"\n', ["'parameters'", "must be a list"]),
        ('system = "lift"\nparameters = ["gone.ssv"]\n', ["parameter set 'gone.ssv' cannot be read"]),
        ('system = "lift"\nsystem = "tilt"\n', ["my.toml' is not TOML", "line 2"]),
        ("system = lift\n", ["my.toml' is not TOML", "line 1"]),
    ],
    ids=lambda x: x.replace("\n", "; ") if isinstance(x, str) else "",
)
def test_what_is_wrong_gets_one_sentence(emla: Emla, text: str, words: list[str]) -> None:
    write(text)
    found = sentence(emla("run", "my.toml"), 2)
    for word in words:
        assert word in found
    assert not Path("results").exists() or not any(Path("results").rglob("results.csv"))


def test_files_that_cannot_be_read(emla: Emla) -> None:
    assert "the scenario 'gone.toml' cannot be read: No such file" in sentence(emla("run", "gone.toml"), 2)
    Path("folder.toml").mkdir()
    assert "the scenario 'folder.toml' cannot be read: Is a dir" in sentence(emla("run", "folder.toml"), 2)
    Path("latin.toml").write_bytes('description = "Förderer"'.encode("latin-1"))
    assert "the scenario 'latin.toml' is not a text in UTF-8." in sentence(emla("run", "latin.toml"), 2)


def test_gains_are_for_built_in_systems(emla: Emla) -> None:
    assert emla("export", "lift", "lift.ssp").exit_code == 0
    for option, value in (("gains", "robust"), ("controller", "rsba")):
        write(f'system = "lift.ssp"\n{option} = "{value}"\n')
        for arguments in (["my.toml"], ["lift.ssp", f"--{option}", value]):
            text = sentence(emla("run", *arguments), 2)
            assert f"has its own gains; --{option} is for built-in systems" in text


# ---- the built-in ones -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCENARIOS)
def test_built_in_scenarios_are_such_files(name: str, tmp_path: Path) -> None:
    """Copied to a folder of one's own, they are the same."""
    study = ROOT / "orchestration/emla_cosim/study"
    source = study / ("joints" if name in list_joint_names() else "scenarios") / f"{name}.toml"
    copy = tmp_path / f"{name}.toml"
    copy.write_bytes(source.read_bytes())
    assert load(copy) == load(name)


def test_a_built_in_name_wins_over_a_folder_of_that_name(emla: Emla) -> None:
    Path("lift").mkdir()
    ran(emla, "lift", "--stop-time", "0.001", "--no-plots", output="results/lift")
    assert "'lift' has no 'SystemStructure.ssd'" in sentence(emla("run", "lift/"), 2)


# ---- parameter files -------------------------------------------------------------------------------


def test_parameters_are_converted_to_the_units_of_their_variables(emla: Emla) -> None:
    write_parameters(
        {"lift.disturbance.load.level[1]": (40.0, "kN"), "lift.plant.start.x_L": (241.5, "mm")}, "one.ssv"
    )
    write_parameters(
        {"lift.plant.start.x_L": (242.0, "mm"), "lift.observer.start.x_hat": (242.0, "mm")}, "two.ssv"
    )
    options = ("--stop-time", "0.001", "--no-plots", "--parameters", "one.ssv", "--parameters", "two.ssv")
    record = ran(emla, "lift", *options, "--set", "lift.observer.start.x_hat=0.2425", output="results/lift")
    assert start_value(record, "lift.disturbance.load.level[1]") == 40e3
    assert start_value(record, "lift.plant.start.x_L") == 0.242  # the later file
    assert start_value(record, "lift.observer.start.x_hat") == "0.2425"  # --set
    first = polars.read_csv("results/lift/results.csv").row(0, named=True)
    assert (first["lift.plant.x_L"], first["lift.observer.x_hat"]) == (0.242, 0.2425)
    assert first["lift.disturbance.F_L"] == 40e3


@pytest.mark.parametrize(
    ("name", "unit", "words"),
    [
        ("lift.plant.x", "mm", ["lift.plant has no variable 'x'", "x_L"]),
        ("lift.pump.x_L", "mm", ["no component 'lift.pump'"]),
        ("x_L", "mm", ["'x_L' is not a variable", "write it as lift.reference.VARIABLE"]),
        ("lift.plant.start.x_L", "s", ["'lift.plant.start.x_L' of 'my.ssv' has the units s and m"]),
        ("lift.plant.start.x_L", "inch", ["has the units inch and m, one of which is not defined"]),
        ("lift.plant.tau_m", "mm", ["lift.plant.tau_m"]),
    ],
)
def test_parameters_that_do_not_fit(emla: Emla, name: str, unit: str, words: list[str]) -> None:
    write_parameters({name: (1.0, unit)})
    text = sentence(emla("run", "lift", "--parameters", "my.ssv"), 2)
    for word in words:
        assert word in text


def test_parameter_files_that_are_none(emla: Emla) -> None:
    write("not XML")
    Path("my.toml").rename("my.ssv")
    assert "'my.ssv' is not well-formed XML" in sentence(emla("run", "lift", "--parameters", "my.ssv"), 2)
    write("<a/>", "my.ssv")
    assert "'my.ssv' is not a ParameterSet" in sentence(emla("run", "lift", "--parameters", "my.ssv"), 2)
    assert "cannot be read: No such file" in sentence(emla("run", "lift", "--parameters", "gone.ssv"), 2)


# ---- signals ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("patterns", "expected"),
    [
        (["lift.plant.x_L"], ["lift.plant.x_L"]),
        (["*.x_?"], ["lift.reference.x_d", "lift.plant.x_L"]),
        (["lift.plant.i_q", "lift.reference.*"], [
            "lift.reference.x_d", "lift.reference.v_d", "lift.reference.a_d", "lift.plant.i_q",
        ]),
        (["lift.controller.theta[1]"], ["lift.controller.theta[1]"]),
    ],
)  # fmt: skip
def test_signals_are_chosen_by_patterns(emla: Emla, patterns: list[str], expected: list[str]) -> None:
    """In the order of the system; a name with brackets means itself."""
    options = ("--stop-time", "0.4", "--no-plots", "--output", "out")
    ran(emla, "lift", *options, *(x for p in patterns for x in ("--signals", p)))
    assert polars.read_csv("out/results.csv").columns == ["time", *expected]
    metrics = json.loads(Path("out/metrics.json").read_text())["joints"]["lift"]
    for name in ("reason", "trip", "excursions", "oscillation"):
        assert metrics.pop(name) is None
    for name in ("standstill_error_m", "standstill_error_rms_m"):
        assert metrics.pop(name) is None  # the reference moves until 0.8 s
    assert None not in metrics.values()  # which need no signal in results.csv


def test_a_pattern_without_a_signal(emla: Emla) -> None:
    for pattern, words in (
        ("lift.plant.xL", "did you mean lift.plant.x_L"),
        ("crane.*", "without --signals, all outputs are kept."),
    ):
        text = sentence(emla("run", "lift", "--signals", "lift.plant.*", "--signals", pattern), 2)
        assert f"no signal matches '{pattern}'; {words}" in text


def test_names_with_dots_need_no_quotes() -> None:
    text = 'system = "lift"\n[set]\nlift.plant.motor.R_s = 0.2\n[step_multiples]\nlift.observer = 2\n'
    options = parse_scenario(text, "my.toml", Path()).options
    assert options == {"set": {"lift.plant.motor.R_s": 0.2}, "step_multiples": {"lift.observer": 2}}


def test_layers_of_options_merge() -> None:
    """Tables, those of the algorithm too, grow; everything else is what the later layer says."""
    options = Options()
    for layer in (
        {"set": {"a.x": 1, "a.y": 2}, "algorithm": "jacobi", "signals": ["x"], "step_multiples": {"a": 2}},
        {"set": {"a.y": 3}, "signals": ["y"], "step_multiples": {"b": 4}},
        {},
    ):
        options = options.updated(layer)
    assert (options.set, options.algorithm, options.signals) == ({"a.x": 1, "a.y": 3}, "jacobi", ["y"])
    assert options.own == {"step_multiples": {"a": 2, "b": 4}}
    in_effect = {option.name: value for option, value in options.in_effect()}
    assert (in_effect["set"], in_effect["step_multiples"]) == (options.set, {"a": 2, "b": 4})


def test_a_controller_without_gains_comes_with_its_recommended_ones() -> None:
    """Not with those that the scenario's file has for another one."""
    assert load("lift").options.gains == "robust"
    chosen = load("lift", controller="foc")
    assert chosen.options.gains is None
    assert chosen.system == load("lift", controller="foc", gains="damped").system
    assert load("lift", controller="rsba", gains="robust").system == load("lift").system
