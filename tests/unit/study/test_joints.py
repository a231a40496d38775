"""A joint is one file: a copy is a new scenario, and missing or wrong entries are named."""

import math
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

import emla_cosim as ec
from emla_cosim.base.toml_structs import read_toml
from emla_cosim.study.controllers import CONTROLLERS
from emla_cosim.study.joints.schema import JointFile, load_joint, parse_joint, read_joint_text
from tests.support.paths import ROOT
from tests.support.tiers import mostly_slow

TILT = read_joint_text("tilt")


def read(text: str, name: str = "slew") -> JointFile:
    label = f"the joint file '{name}.toml'"
    return parse_joint(read_toml(text, label), label, name, Path())


def without(text: str, *lines: str) -> str:
    """Return the text without the lines that begin so."""
    remaining = [line for line in text.splitlines() if not line.startswith(lines)]
    assert len(remaining) == len(text.splitlines()) - len(lines)
    return "\n".join(remaining)


def without_table(text: str, name: str) -> str:
    """Return the text without a table and the tables inside it."""
    parts = re.split(r"^(?=\[)", text, flags=re.M)
    return "".join(part for part in parts if not re.match(rf"\[{re.escape(name)}[.\]]", part))


def message(text: str) -> str:
    with pytest.raises(ec.CommandError) as caught:
        read(text)
    return str(caught.value)


def parameters(scenario: ec.Scenario) -> list[Mapping[str, Any]]:
    return [component.parameters for component in scenario.system.components]


# ---- a copy is a new scenario -----------------------------------------------------------------------


@pytest.fixture
def slew(tmp_path: Path) -> Path:
    file = tmp_path / "slew.toml"
    file.write_text(TILT)
    return file


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_copied_joint_has_the_values_of_its_model(controller: str, slew: Path) -> None:
    for gains in CONTROLLERS[controller].gains:
        tilt = ec.load("tilt", controller=controller, gains=gains)
        copy = ec.load(slew, controller=controller, gains=gains)
        for actual, expected in ((copy.system.components, tilt.system.components),
                                (copy.system.connections, tilt.system.connections)):  # fmt: skip
            assert [repr(x).replace("slew", "tilt") for x in actual] == list(map(repr, expected))


def test_scenario_file_names_a_joint_file(slew: Path) -> None:
    scenario = slew.with_name("fast.toml")
    scenario.write_text('system = "slew.toml"\ncontroller = "foc"\nstop_time = 0.1\n')
    scenario_ = ec.load(scenario)
    assert scenario_.options.stop_time == 0.1 and scenario_.options.step_size == 1e-4
    assert {c.name for c in scenario_.system.components} >= {"slew.plant", "slew.controller"}


@pytest.mark.slow
def test_file_in_the_folder_of_joints_is_a_scenario(tmp_path: Path) -> None:
    """In a copy of the package, to which one file is added."""
    shutil.copytree(ROOT / "orchestration", tmp_path / "orchestration")
    (tmp_path / "orchestration" / "emla_cosim" / "study" / "joints" / "slew.toml").write_text(TILT)
    program = """
import emla_cosim as ec
from emla_cosim.run.scenarios.scenario_file import SCENARIOS, TUNINGS

slew, tilt = ec.load("slew"), ec.load("tilt")
assert "slew" in SCENARIOS and {"rsba-slew", "foc-slew", "cac-slew", "anatc-slew"} <= set(TUNINGS)
assert 'scenario = "slew"' in TUNINGS["foc-slew"]()
assert [c.parameters for c in slew.system.components] == [c.parameters for c in tilt.system.components]
joints = {c.name.partition(".")[0] for c in ec.load("study").system.components}
assert joints == {"lift", "tilt", "telescope"}, joints
print(ec.__file__)
"""
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path / "orchestration"), str(ROOT / "src")])}
    process = subprocess.run(
        [sys.executable, "-c", program], env=env, capture_output=True, text=True, check=False
    )
    assert process.returncode == 0, process.stderr
    assert str(tmp_path) in process.stdout


# ---- gains are needed only for the controller that is chosen -----------------------------------------


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_missing_gains_are_named_for_that_controller_only(controller: str, slew: Path) -> None:
    slew.write_text(without_table(TILT, f"gains.{controller}"))
    for name, controller_ in CONTROLLERS.items():
        for gains in controller_.gains:
            if name != controller:
                assert ec.load(slew, controller=name, gains=gains)
                continue
            problem = rf"has no gains '{gains}' for the controller '{name}'; add \[gains.{name}.{gains}\]\."
            with pytest.raises(ec.CommandError, match=problem):
                ec.load(slew, controller=name, gains=gains)


def test_missing_set_lists_the_sets(slew: Path) -> None:
    slew.write_text(without_table(TILT, "gains.rsba.robust"))
    sets = "damped, compensated, published and compliant"
    with pytest.raises(ec.CommandError, match=rf"or choose {sets} with --gains\.$"):
        ec.load(slew)


def test_controller_block_needs_observer_gains_in_the_joint_file(slew: Path) -> None:
    from rsba_fmu import FocController

    assert ec.load(slew, controller=FocController, gains="robust")
    slew.write_text(without_table(without_table(TILT, "observer.compensated"), "gains"))
    with pytest.raises(ec.CommandError, match=r"lacks observer gains .* \[observer.compensated\]"):
        ec.load(slew, controller=FocController)


def test_gains_of_python_that_leave_out_the_joint_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    tilt = load_joint("tilt")
    gain_set = tilt.gain_set("foc", "tuned")
    gains = ec.Gains({"tilt": gain_set.observer.gains}, {"tilt": gain_set.controller})
    monkeypatch.setitem(ec.CONTROLLERS, "mine", ec.Controller(CONTROLLERS["foc"].model, {"own": gains}))
    (k_p,) = (values["k_p"] for values in parameters(ec.load("tilt", controller="mine")) if "k_p" in values)
    assert k_p == 415.0
    with pytest.raises(ec.CommandError, match=r"'own' of the controller 'mine' .* joint 'lift'"):
        ec.load("lift", controller="mine")


# ---- what is missing or wrong is refused by name -----------------------------------------------------

LACKING_TABLES = {
    "run": "lacks the table [run], the options of its scenario",
    "actuator": "lacks the table [actuator], the data of motor",
    "actuator.motor": "[actuator] of the joint file 'slew.toml' cannot be used for 7 reasons:",
    "actuator.sensor": "cannot be used: [sensor] lacks bits or steps or resolution",
    "start": "lacks the table [start], the start position of the screw",
    "reference": "lacks the table [reference], the motion of the joint",
    "load": "lacks the table [load], the load force",
    "observer": "'observer' in [gains.rsba.compensated] of the joint file 'slew.toml' is",
}


LACKING_ENTRIES = {
    "kind =": 'lacks kind; write kind = "joint"',
    "description =": "lacks description",
    "sample_time = 1e-4  #": "lacks sample_time, the sample time of observer and controller; write",
    "stop_time =": "[run] of the joint file 'slew.toml' lacks stop_time, the stop time in s; write",
    "step_size =": "[run] of the joint file 'slew.toml' lacks step_size",
    "J_m =": '[motor] lacks J_m, the rotor inertia; write J_m = "9.6 kg cm^2"',
    "x_L =": "[start] of the joint file 'slew.toml' lacks x_L, the initial screw position; write x_L = 0.24",
    "q_E =": "lacks q_E, the end of the reference; write q_E = 0.27.",
    "v_peak =": "[reference] of the joint file 'slew.toml' has neither v_peak nor duration",
    "level =": "lacks level, the load force; write level = 57000.",
    "beta_1 =": "[gains.rsba.robust] of the joint file 'slew.toml' lacks beta_1; write beta_1 = ...",
    "zeta =": "[gains.rsba.published] of the joint file 'slew.toml' lacks zeta; write zeta = [..., ...,",
    "k_p = 415.0": "[gains.foc.tuned] of the joint file 'slew.toml' lacks k_p",
    "eta_hat_start =": "[observer.published] of the joint file 'slew.toml' lacks eta_hat_start",
}


WRONG = {
    "unknown table": ("[load]", "[laod]", "has the unknown entry 'laod'; did you mean 'load'?"),
    "unknown entry": ("q_E =", "q_F =", "has the unknown entry 'q_F'; did you mean"),
    "unknown gain": ("beta_2 =", "beta2 =", "has the unknown entry 'beta2'; did you mean 'beta_2'?"),
    "unknown set": ("gains.rsba.robust", "gains.rsba.robst", "unknown entry 'robst'; did you mean 'robust'?"),
    "unknown controller": ("[gains.cac.tuned]", "[gains.cca.tuned]", "entry 'cca'; did you mean 'cac'?"),
    "unknown rule": ('rule = "rule"', 'rule = "rules"', "is 'rules'; it must be 'tuned' or 'rule'"),
    "unknown option": ("stop_time =", "stop_tim =", "entry 'stop_tim'; did you mean 'stop_time'?"),
    "unknown parameter": ("high = 2.0", "hi = 2.0", "has the unknown entry 'd_2.hi'; did you mean"),
    "text": ("x_L = 0.385", 'x_L = "far"', "'x_L' in [start] of the joint file 'slew.toml' is 'far'"),
    "another unit": ("x_L = 0.385", 'x_L = "3 kg"', "'x_L' in [start]"),
    "infinite": ("q_S = 0.389", "q_S = inf", "it must be a finite number"),
    "not positive": ("v_peak = 0.0808", "v_peak = 0.0", "it must be more than 0"),
    "length": ("low = 0.0", "low = [0.0]", "'d_2.low' in [disturbance]"),
    "array": ("amplitude = [0.8, 0.95]", "amplitude = [0.8]", "it must be a list of 2 numbers"),
    "both": ("v_peak = 0.0808", "duration = 1.0\nv_peak = 0.0808", "has both v_peak and duration"),
    "zero": ("sample_time = 1e-4\nobserver", "sample_time = 0.0\nobserver", "values that cannot be used"),
    "levels": ("level = 25e3", "level = [25e3, 30e3]", "has 2 levels and 0 times in start"),
    "elsewhere": ("F_2 = 0.01", "F_2 = 0.01\n[plant.motor]\nR_s = 1.0", "it follows from [actuator]"),
    "seed": ("seed = 715827883", 'seed = "x"', "it must be a whole number"),
    "control": ("[start]", "[actuator.control]\nk_1 = 0.05\n[start]", "[gains] of a joint file has all"),
    "drive": ("[start]", '[drive.motor]\nR = "1 Ohm"\n[start]', "entry 'motor'; use always, inverter"),
    "no table": ("[paper.study]", "[paper.x]\nrsba = 1\n[paper.study]", "it must be a table, [paper.x.rsba]"),
}


def test_missing_and_wrong_entries_are_named() -> None:
    for table, words in LACKING_TABLES.items():
        assert words in message(without_table(TILT, table))
    for line, words in LACKING_ENTRIES.items():
        assert words in message(without(TILT, line))
    for old, new, words in WRONG.values():
        assert old in TILT
        assert words in message(TILT.replace(old, new, 1))


def test_kind_distinguishes_joints_from_scenarios(slew: Path) -> None:
    slew.write_text(without(TILT, "kind ="))
    with pytest.raises(ec.CommandError, match=r"the key '\w+' of a joint; write kind = \"joint\""):
        ec.load(slew)
    slew.write_text(TILT.replace('kind = "joint"', 'kind = "jont"'))
    with pytest.raises(ec.CommandError, match=r"'jont'; choose from joint"):
        ec.load(slew)


def test_name_of_the_file_must_name_a_joint(slew: Path) -> None:
    odd = slew.rename(slew.with_name("my slew.toml"))
    with pytest.raises(ec.CommandError, match=r"'my slew' is invalid; use letters, digits and _"):
        ec.load(odd)


# ---- the parts of a file ----------------------------------------------------------------------------


def test_actuator_can_be_a_file_of_its_own(slew: Path) -> None:
    tables = re.split(r"^(?=\[)", TILT, flags=re.M)
    inline = [part for part in tables if part.startswith("[actuator.")]
    slew.with_name("motor.toml").write_text("".join(part.replace("[actuator.", "[") for part in inline))
    rest = [part for part in tables if not part.startswith("[actuator.")]
    slew.write_text('actuator = "motor.toml"\n' + "".join(rest))
    assert parameters(ec.load(slew)) == parameters(ec.load("tilt"))


def test_realistic_drive_with_changes_of_the_file(slew: Path) -> None:
    slew.write_text(f'{TILT}\n[drive]\nalways = true\ninverter = {{ delay = "0.2 ms" }}\n')
    plant, default = (
        next(dict(c.parameters) for c in scenario.system.components if c.name.endswith(f"{joint}.plant"))
        for scenario, joint in ((ec.load(slew), "slew"), (ec.load("study-drive", gains="robust"), "tilt"))
    )
    assert plant.pop("inverter.delay") == pytest.approx(2e-4)
    assert default.pop("inverter.delay") == 1e-4
    assert plant == default


def _entries(content: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inner = content.items() if isinstance(content, dict) else enumerate(content)
    actual = []
    for key, value in inner:
        actual += _entries(value, (*path, key)) if isinstance(value, (dict, list)) else [(*path, key)]
    return actual


ODD_VALUES = [*((odd, 1) for odd in (10**400, -(10**400), "nan", -1, "", True)), ("nan", 5)]


@pytest.mark.parametrize(("odd", "step"), mostly_slow(ODD_VALUES, ODD_VALUES[-1:]))
def test_odd_value_in_any_entry_is_used_or_refused(odd: Any, step: int) -> None:
    for path in _entries(tomllib.loads(read_joint_text("tilt")))[::step]:
        content = tomllib.loads(read_joint_text("tilt"))
        inner: Any = content
        for key in path[:-1]:
            inner = inner[key]
        inner[path[-1]] = math.nan if odd == "nan" else odd
        try:
            parse_joint(content, "the joint file", "tilt", Path())
        except ec.CommandError as error:
            assert "the joint file" in str(error), path


def test_deeply_nested_actuator_file_is_refused(tmp_path: Path) -> None:
    content = tomllib.loads(read_joint_text("tilt")) | {"actuator": "deep.toml"}
    (tmp_path / "deep.toml").write_text("a = " + 3000 * "[" + 3000 * "]")
    with pytest.raises(ec.CommandError, match=r"deep\.toml' is not TOML"):
        parse_joint(content, "the joint file", "tilt", tmp_path)


# ---- experiments ------------------------------------------------------------------------------------

EXPERIMENT = """
[experiment.one.reference]
way_points = [0.3, 0.4, 0.3]
v_peak = 0.05
period = 8.0

[experiment.one.load]
level = 1e3
"""


def test_motion_of_an_experiment_peaks_at_its_speed_and_repeats() -> None:
    """A quintic move of d in T peaks at 15 d / (8 T): 3.75 s for each of two moves, then dwells of 0.25 s."""
    task = read(TILT + EXPERIMENT).experiment("one")
    actual = task.reference.parameters()
    assert actual["duration"][:2] == pytest.approx([3.75, 3.75])
    assert actual["start"][:2] == pytest.approx([0.0, 4.0])
    assert (actual["x"][:3], actual["x"][-1], actual["period"]) == ([0.3, 0.4, 0.3], 0.3, 8.0)
    assert task.load.level == (1e3,)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("period = 8.0", "period = 7.0", "is 7 s, but the moves take 7.5 s in total"),
        ("[0.3, 0.4, 0.3]", "[0.3, 0.3]", "of the joint file 'slew.toml' has the way_points [0.3, 0.3]"),
        ("[0.3, 0.4, 0.3]", "[0.3]", "must be 2 to"),
        ("v_peak = 0.05", "", "lacks v_peak, the peak speed of every move"),
        ("level = 1e3", "", "lacks level, the load force"),
        ("[experiment.one.load]\nlevel = 1e3", "", "lacks the table [experiment.one.load]"),
    ],
)
def test_wrong_experiments(old: str, new: str, expected: str) -> None:
    assert expected in message(TILT + EXPERIMENT.replace(old, new))


def test_missing_experiment_is_named() -> None:
    with pytest.raises(ec.CommandError, match=re.escape("lacks the table [experiment.two]")):
        read(TILT).experiment("two")
