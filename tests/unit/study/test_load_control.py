"""Control of loads that are not rigid: what a scenario gets for it, and what a result says about it."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

import emla_cosim as ec
from emla_cosim.analyses.compare.result import LOAD_FIGURES, choose_position_error
from emla_cosim.recorders.metrics import TRACKED
from emla_cosim.study.actuator.model_parameters import follow_plant_changes
from emla_cosim.study.figures import JOINT_FIGURES
from emla_cosim.study.joints.schema import load_joint, read_joint_text
from emla_cosim.study.registration import find_seeds
from emla_cosim.study.roles import find_variable, list_role_patterns
from emla_cosim.views.formatting import describe_idealisations

STIFFNESS, FORCE = 104461742.9276628, 57e3
"""Of the lift, in N/m and N."""


@pytest.fixture(scope="module")
def motor(fmu_folder: Path) -> Iterator[ec.Simulation]:
    with ec.load(
        "study-compliant", fmus=fmu_folder, stop_time=0.8, notch={"lift": "20 Hz"}
    ).prepare() as simulation:
        yield simulation


@pytest.fixture(scope="module")
def result(motor: ec.Simulation) -> ec.Result:
    return motor.run(output_interval=1e-3)


def message(name: str, **options: Any) -> str:
    with pytest.raises(ec.CommandError) as caught:
        ec.load(name, **options)
    return str(caught.value)


def parameters(name: str, component: str, **options: Any) -> dict[str, Any]:
    system = ec.load(name, **options).system
    return dict(next(c.parameters for c in system.components if c.name == component))


# ---- options ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"notch": {"lft": 5}}, "the joint 'lft' of a notch does not exist; did you mean lift?"),
        ({"notch": {"lift": "5, 6, 7"}}, "it must be one or 2 positive frequencies"),
        ({"notch": {"lift": -5.0}}, "it must be one or 2 positive frequencies"),
        ({"notch": {"lift": True}}, "'lift' in the option 'notch' is True; it must be a number or a text"),
        ({"notch": {"lift": [5.0, 6.0]}}, "it must be a number or a text"),
        ({"notch": {"lift": "5 kg"}}, "the notch of lift has the units kg and Hz"),
        ({"load_control": "motor"}, "the load of lift is rigid"),
        ({"load_control": "sensors"}, "sensors"),
    ],
)
def test_wrong_options(options: dict[str, Any], words: str) -> None:
    assert words in message("lift", **options)


def test_notch_of_a_joint_overrides_that_of_all() -> None:
    notch = {"*": 5, "tilt": "6 Hz, 1200 rpm"}
    assert parameters("study", "lift.command", notch=notch)["notch.frequency[1]"] == 5.0
    tilt = parameters("study", "tilt.command", notch=notch)
    assert (tilt["notch.frequency[1]"], tilt["notch.frequency[2]"]) == (6.0, pytest.approx(20.0))


def test_notch_makes_no_loop_through_a_machine_that_replays_the_motion() -> None:
    """The plant would feed the command, the command the machine, and this the plant with its force."""
    connections = {str(x) for x in ec.load("hdrm-replay", notch={"*": 5}).system.connections}
    assert "lift.command.x_s -> machine.manipulator.x_L[1]" in connections
    assert not any(text.endswith("command.x_1") for text in connections)


def test_explicit_order_gets_the_command_before_its_controller() -> None:
    order = ec.load("prototype", notch={"prototype": 5}).options.class_options["order"]
    assert list(order[-2:]) == ["prototype.command", "prototype.controller"]
    assert "prototype.command" not in ec.load("prototype").options.class_options["order"]


def test_encoder_at_the_load_with_load_control_is_refused() -> None:
    set_ = {"tilt.plant.sensor.at_load": "true"}
    assert "use --load-control none" in message("study-compliant", set=set_)
    assert ec.load("study-compliant", set=set_, load_control="none").notes == ()


# ---- stale models ----------------------------------------------------------------------------------


def test_models_of_the_load_are_reported_and_follow(fmu_folder: Path) -> None:
    set_ = {"lift.plant.transmission.stiffness": "80 N/um"}
    (note,) = ec.load("study-compliant", set=set_, load_control="sensor").notes
    for name in ("command.model.stiffness", "load_observer.model.stiffness", "command.approach.duration"):
        assert f"lift.{name}" in note
    assert "lift.plant.start.deflection" in note and "--actuator" not in note
    set_["lift.disturbance.load.level[*]"] = "30 kN"
    followed = ec.load("study-compliant", set=set_, follow_models=True, fmus=fmu_folder, stop_time=1e-3)
    assert followed.notes == ()
    with followed.prepare() as simulation:
        values = simulation.run(recorders=[]).parameters
        command = next(c.parameters for c in simulation.system.components if c.name == "lift.command")
    assert command["F_hat"] == 30e3 and values["lift.command.model.stiffness"] == pytest.approx(80e6)
    assert values["lift.plant.start.deflection"] == pytest.approx(30e3 / 80e6 + 1.4e-6)
    expected = 3.0 * 2.0 * np.pi * np.sqrt(43.46e3 / 80e6)
    assert values["lift.command.approach.duration"] == pytest.approx(expected)


@pytest.mark.parametrize(("component", "name"), [("command", "feedback.k_0"), ("load_observer", "l_3")])
def test_feedback_of_the_load_keeps_its_poles_relative_to_the_load(component: str, name: str) -> None:
    """With the gains of another frequency, a boom on a load sensor swings ever more."""
    boom = replace(load_joint("tilt").compliant_load, mass=5e3, structure=2e6)
    set_ = {"tilt.plant.load.m": boom.mass, "tilt.plant.transmission.stiffness": boom.stiffness}
    scenario = ec.load("study-compliant", set=set_, follow_models=True, load_control="sensor")
    feedback = load_joint("tilt").load_feedback
    expected = {
        "feedback.k_0": feedback.gains(boom.omega)["k_0"],
        "l_3": (feedback.observer * boom.omega) ** 3,
    }
    values = follow_plant_changes(scenario.system, scenario.options)
    assert values[f"tilt.{component}.{name}"] == pytest.approx(expected[name])
    assert f"tilt.{component}.{name}" not in follow_plant_changes(
        scenario.system, scenario.options.merged({"set": {f"tilt.{component}.{name}": 1.0}})
    )


def test_feedback_at_its_limit_is_reported(fmu_folder: Path) -> None:
    set_ = {"lift.command.feedback.limit": "0.1 um"}
    run = ec.load("study-compliant", load_control="sensor", set=set_, fmus=fmu_folder, stop_time=0.5)
    with run.prepare() as simulation:
        remarks = simulation.run(recorders=[]).remarks
    assert any("The feedback of lift's load reached its limit of 0.1 µm" in remark for remark in remarks)


# ---- results ---------------------------------------------------------------------------------------


def test_load_comes_first(result: ec.Result) -> None:
    assert list(result.metrics)[:2] == ["loads", "joints"]
    (error, *_) = (panel.label for panel in JOINT_FIGURES["errors"].panels)
    assert error.startswith("load position")
    labels = [display.label for display in result.displays["joints"]]
    assert "screw position error" in labels and "position error" not in labels
    tracked = {joint: pair for find in TRACKED.values() for joint, pair in find(result.names, {}).items()}
    assert tracked["lift"] == ("lift.plant.load.x", "lift.command.x_s")


def test_errors_are_those_from_the_motion_after_the_notch(result: ec.Result) -> None:
    signals = ("plant.load.x", "command.x_s", "plant.x_L", "command.x_c")
    data = result.read(["time", *(f"lift.{name}" for name in signals)])
    load, joint = result.metrics["loads"]["lift"], result.metrics["joints"]["lift"]
    for figures, since, position, reference in (
        (load, "load_evaluated_from_s", "lift.plant.load.x", "lift.command.x_s"),
        (joint, "evaluated_from_s", "lift.plant.x_L", "lift.command.x_c"),
    ):
        late = data["time"] >= figures[since] - 1e-9
        largest = np.abs(np.subtract(data[position], data[reference]))[late].max()
        names = [n for n in figures if n.endswith("position_error_m") and "observer" not in n]
        (error,) = (figures[name] for name in names)
        assert error == pytest.approx(largest, rel=0.05)
    assert load["load_position_error_m"] < 10e-6
    delay = 1e3 * 2.0 * 0.98 / (np.pi * 20.0)
    (remark,) = (text for text in result.remarks if "notches delay" in text)
    assert remark.startswith(f"lift: notches delay its motion by {delay:.4g} ms")
    assert "lift.command.x_s" in remark and remark in result.record["remarks"]


def test_assumed_load_force_is_reported_with_its_effect(result: ec.Result, fmu_folder: Path) -> None:
    (entry,) = (x for x in result.metrics["joints"]["lift"]["idealised"] if x["name"] == "load force")
    micrometres = 1e6 * 0.1 * FORCE / STIFFNESS
    assert f"{micrometres:.4g} µm" in entry["label"] and entry["option"] == "--load-control sensor"
    assert entry["label"] in str(describe_idealisations(result))
    soft = {"lift.plant.transmission.stiffness": 0.5 * STIFFNESS}  # which the load control does not know
    with ec.load("study-compliant", fmus=fmu_folder, stop_time=1e-3, set=soft).prepare() as simulation:
        idealised = simulation.run(recorders=[]).metrics["joints"]["lift"]["idealised"]
    assert f"{2.0 * micrometres:.4g} µm" in next(x["label"] for x in idealised if x["name"] == "load force")
    for sensors in ("none", "sensor"):
        scenario = ec.load("study-compliant", fmus=fmu_folder, stop_time=1e-3, load_control=sensors)
        with scenario.prepare() as simulation:
            rerun = simulation.run(recorders=[])
        assert "load force" not in {x["name"] for x in rerun.metrics["joints"]["lift"]["idealised"]}
        if sensors == "sensor":
            assert "lift.plant.load.sensor.seed" in find_seeds(rerun.parameters)


def test_screw_that_does_not_follow_its_command_is_reported_with_its_name(motor: ec.Simulation) -> None:
    late = motor.run(recorders=[], criteria={"lift.position_window": 1e-9})
    reason = late.metrics["joints"]["lift"]["reason"]
    assert "lift has not settled: its position error from lift.command.x_c was" in reason


def test_roles_of_the_commanded_motion_fall_back_to_the_reference() -> None:
    assert find_variable("lift", "x_c", ["lift.reference.x_d"]) == "lift.reference.x_d"
    assert find_variable("lift", "x_c", ["lift.reference.x_d", "lift.command.x_c"]) == "lift.command.x_c"
    assert {"*.command.x_s", "*.reference.x_d"} <= set(list_role_patterns("x_s"))


def test_measured_motion_reaches_the_load(fmu_folder: Path) -> None:
    """Positions of a table alone: speed and acceleration are the derivatives of its spline."""
    time = np.linspace(0.0, 1.0, 501)
    s = np.clip(time / 0.9, 0.0, 1.0)
    x: Any = 0.244 + 0.02 * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    columns = {"x_d": "x", "v_d": "der(x)", "a_d": "der(der(x))"}
    signals = {f"lift.reference.{name}": ec.Column(text) for name, text in columns.items()}
    motion = ec.Input(data={"time": time, "x": x}, signals=signals, interpolation="cubic")
    scenario = ec.load(
        "study-compliant", fmus=fmu_folder, input=[motion], stop_time=1.0, notch={"lift": 20.0}
    )
    with scenario.prepare() as simulation:
        figures = simulation.run(recorders=[]).metrics
    assert figures["joints"]["lift"]["held"] and figures["loads"]["lift"]["load_position_error_m"] < 10e-6


@pytest.mark.usefixtures("scheduler")
def test_comparison_has_the_figures_of_loads(fmu_folder: Path) -> None:
    options: dict[str, Any] = {"fmus": fmu_folder, "stop_time": 0.6, "seeds": 1, "workers": 1}
    compared = ec.compare("study-compliant", controllers=["rsba"], gains=["compliant"], **options)
    assert set(LOAD_FIGURES) <= set(compared.rows.columns)
    assert choose_position_error(compared.rows.rows(named=True)).label == "load position error"
    text = compared.markdown()
    assert "lift: load position error / µm" in text and "lift: screw position error / µm" in text
    rigid = ec.compare("lift", controllers=["rsba"], **options)
    assert not set(LOAD_FIGURES) & set(rigid.rows.columns)
    assert choose_position_error(rigid.rows.rows(named=True)).label == "position error"


# ---- joint files and data sheets -------------------------------------------------------------------


def write_rig(folder: Path) -> Path:
    """Write a copy of the prototype that always has its load."""
    file = folder / "rig.toml"
    file.write_text(read_joint_text("prototype").replace("\nmass = ", "\nalways = true\nmass = ", 1))
    return file


def test_joint_file_that_is_always_compliant(tmp_path: Path, fmu_folder: Path) -> None:
    with ec.load(write_rig(tmp_path), fmus=fmu_folder, stop_time=1.0).prepare() as simulation:
        models = {c.name: c.model for c in simulation.system.components}
        assert models["rig.plant"] == "EmlaCompliantPlant" and "rig.command" in models
        metrics = simulation.run(recorders=[]).metrics
    assert metrics["joints"]["rig"]["held"] and metrics["loads"]["rig"]["load_position_error_m"] < 10e-6


def test_parts_of_an_actuator_replace_those_of_the_joint() -> None:
    sheet = {"lift.compliance.nut": "500 N/um", "lift.compliance.backlash": "20 um"}
    stiffness = 1.0 / (1.0 / 1500e6 + 1.0 / 1310e6 + 1.0 / 500e6 + 1.0 / 140e6)
    plant = parameters("study-compliant", "lift.plant", sheet=sheet)
    assert plant["transmission.stiffness"] == pytest.approx(stiffness)
    assert plant["transmission.backlash"] == 20e-6
    assert plant["start.deflection"] == pytest.approx(FORCE / stiffness + 10e-6)
    assert parameters("study-compliant", "lift.command", sheet=sheet)["model.backlash"] == 20e-6
    assert "transmission.stiffness" not in parameters("study", "lift.plant", sheet=sheet)


def test_stiffness_of_a_data_sheet_for_a_rigid_load_is_reported() -> None:
    (note,) = ec.load("lift", sheet={"lift.compliance.nut": "500 N/um"}).notes
    assert note == "lift: compliance.nut is not used, because the load is rigid here"


def test_deflection_counts_for_the_stroke() -> None:
    sheet = {"lift.screw.stroke": "270.2 mm"}
    ec.load("study", sheet=sheet)
    assert "the commanded screw of lift goes from 244.5 to 270.5 mm" in message(
        "study-compliant", sheet=sheet
    )


def test_missing_parts_of_an_actuator_are_reported(tmp_path: Path) -> None:
    file = tmp_path / "act.toml"
    tables = load_joint("prototype").actuator.tables
    texts = [
        f"[{table}]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in entries.items())
        for table, entries in tables.items()
        if entries
    ]
    file.write_text("\n".join(texts))
    rig = write_rig(tmp_path)
    notes = ec.load(rig, actuator={"rig": file}).notes
    (note,) = (text for text in notes if "between motor and load" in text)
    assert note.startswith(
        "rig: bearing, screw, nut and backlash between motor and load are those of the joint"
    )
