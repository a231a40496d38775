"""What joints idealise: read from the parameters of the run, and shown beside the verdict."""

import json
import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import emla_cosim as ec
from emla_cosim.fmu.models import MODELS, fmu_path
from emla_cosim.study.idealisations import list_idealisations
from emla_cosim.views.formatting import describe_idealisations
from emla_fmu import EmlaCompliantPlant, EmlaMotor, EmlaPlant
from fmublock import Block
from tests.support.commands import Emla
from tests.support.paths import FOREIGN_MAPPING

RIGID = {"compliance", "backlash"}
SWITCHES = {
    "friction": {"friction.F_C", "friction.F_S", "screw.B_BS"},
    "lead": {"screw.lead_error", "screw.wobble"},
    "losses": {"gearbox.directional"},
    "position noise": {"sensor.sigma"},
    "position resolution": {"sensor.resolution"},
    "eccentricity": {"sensor.eccentricity"},
    "current measurement": {"sensor.current.sigma", "sensor.current.resolution"},
    "computing delay": {"inverter.delay"},
    "dead time": {"inverter.dead_time"},
    "heating": {"motor.i_N"},
}
"""Parameters of the plant by what is idealised while they are 0."""


def values_of(block: type[Block], component: str, joint: int | None = None) -> dict[str, Any]:
    """The default parameters of a block by full name; of one joint where they are arrays."""
    scalars = [s for p in block.layout().parameters for s in p.scalars()]
    return {
        f"{component}.{s.name}": float(s.start)
        for s in scalars
        if joint is None or s.name.endswith(f"[{joint}]")
    }


def names_of(parameters: dict[str, Any], joint: str = "j", **roles: str) -> set[str]:
    names = {f"{joint}.{role}": name for role, name in roles.items()}
    return {item.name for item in list_idealisations(joint, parameters, names)}


def test_plant_with_its_defaults() -> None:
    assert names_of(values_of(EmlaPlant, "j.plant")) == {*SWITCHES, *RIGID}
    items = list_idealisations("j", values_of(EmlaPlant, "j.plant"))
    assert len({item.label for item in items}) == len(items)
    for item in items:
        set_ = set(re.findall(r"--set j\.plant\.(\S+)=", item.option))
        assert set_ == SWITCHES.get(item.name, set()), item.option


@pytest.mark.parametrize(
    ("name", "parameter"),
    [(name, x) for name, names in SWITCHES.items() for x in sorted(names) if x != "screw.B_BS"],
)
def test_each_of_its_options_removes_an_idealisation(name: str, parameter: str) -> None:
    default = values_of(EmlaPlant, "j.plant")
    assert names_of(default | {f"j.plant.{parameter}": 1e-6}) == {*SWITCHES, *RIGID} - {name}


def test_viscous_friction_leaves_out_coulomb_friction() -> None:
    items = list_idealisations("j", values_of(EmlaPlant, "j.plant") | {"j.plant.screw.B_BS": 150.0})
    (friction,) = (item for item in items if item.name == "friction")
    assert friction.label == "no Coulomb friction"
    assert friction.option == "--set j.plant.friction.F_C=VALUE --set j.plant.friction.F_S=VALUE"


def test_efficiency_of_1_has_no_losses_in_any_direction() -> None:
    for directional in (0.0, 1.0):
        changed = {"j.plant.gearbox.eta_GB": 1.0, "j.plant.gearbox.directional": directional}
        items = list_idealisations("j", values_of(EmlaPlant, "j.plant") | changed)
        (losses,) = (item for item in items if item.name == "losses")
        assert losses.label == "no losses" and losses.option == "--set j.plant.gearbox.eta_GB=VALUE"


def test_ideal_torque() -> None:
    changed = values_of(EmlaPlant, "j.plant") | {"j.plant.use_commanded_current": 1.0}
    assert names_of(changed) == {*SWITCHES, *RIGID, "torque"}


@pytest.mark.parametrize(
    ("stiffness", "backlash", "expected"),
    [(1e8, 1e-6, set()), (1e8, 0.0, {"backlash"}), (math.inf, 1e-6, {"compliance"}), (math.inf, 0.0, RIGID)],
)
def test_compliant_plant(stiffness: float, backlash: float, expected: set[str]) -> None:
    changed = {"j.plant.transmission.stiffness": stiffness, "j.plant.transmission.backlash": backlash}
    assert names_of(values_of(EmlaCompliantPlant, "j.plant") | changed) & RIGID == expected


def test_joint_of_a_machine() -> None:
    """Its mechanical half is an element of the machine's plant, which cannot be replaced joint by joint."""
    default = values_of(EmlaMotor, "tilt.motor") | values_of(MODELS["HdrmPlant"], "machine.plant", 2)
    roles = {"tilt.x_d": "machine.trajectory.x_d[2]"}
    items = {item.name: item.option for item in list_idealisations("tilt", default, roles)}
    assert items.keys() == {*SWITCHES, *RIGID} - {"losses"}  # this plant has no such switch
    assert items["friction"] == "--set machine.plant.screw.B_BS[2]=VALUE"
    assert items["lead"].startswith("--set tilt.motor.screw.lead_error=") and items["compliance"] == ""
    moving = list_idealisations("tilt", default | {"machine.plant.screw.B_BS[2]": 5.0}, roles)
    assert "friction" not in {item.name for item in moving}


def test_unknown_parameters_say_nothing() -> None:
    assert names_of({}) == names_of({"j.plant.gearbox.eta_GB": 0.9, "k.plant.friction.F_C": 0.0}) == set()
    assert names_of({"a.slip": 0.0, "a.other": 0.0}, F_C="a.slip") == {"friction"}
    assert names_of({"a.slip": 3.0}, F_C="a.slip") == set()


def line_of(text: str) -> str:
    (line,) = [line for line in text.splitlines() if line.startswith("Idealised: ")]
    return line


def test_options_in_metrics_remove_what_they_are_for(emla: Emla, fmu_folder: Path) -> None:
    run = ("run", "lift", "--stop-time", "0.01", "--no-plots", "--output", "o")
    assert emla(*run).exit_code == 0
    listed = json.loads(Path("o/metrics.json").read_text())["joints"]["lift"]["idealised"]
    arguments = [
        word.replace("VALUE", "1e-4" if entry["name"] == "computing delay" else "1e-9")
        for entry in listed
        if entry["name"] not in RIGID
        for word in entry["option"].split()
    ]
    changed = emla(*run, *arguments)
    assert changed.exit_code == 0, changed.output
    expected = "Idealised: rigid, no backlash (typical values: study-compliant; "
    assert line_of(changed.stdout).startswith(expected)
    (option,) = {entry["option"] for entry in listed if entry["name"] in RIGID}
    built = fmu_path("EmlaCompliantPlant", "native", Path("fmus")).as_posix()
    assert option == f"--replace lift.plant={built}"
    plant = fmu_path("EmlaCompliantPlant", "native", fmu_folder)
    backlash = ("--set", "lift.plant.transmission.backlash=1e-6")
    replaced = emla(*run, *arguments, "--replace", f"lift.plant={plant}", *backlash)
    assert replaced.exit_code == 0, replaced.output
    assert "Idealised" not in replaced.stdout


def test_unknown_parameters_of_a_replaced_plant(foreign_plant: Path, fmu_folder: Path) -> None:
    plant = ec.Replacement(foreign_plant, FOREIGN_MAPPING)
    with ec.load("lift", stop_time=0.01).prepare(
        fmus=fmu_folder, replace={"lift.plant": plant}
    ) as simulation:
        result = simulation.run()
    names = {item["name"] for item in result.metrics["joints"]["lift"]["idealised"]}
    assert names == {"friction", *RIGID}  # of these parameters alone, the mapping has our names


def described(**joints: list[str]) -> str | None:
    """The line on joints that idealise these labels."""
    figures = {
        joint: {"idealised": [{"label": label, "source": label[:1]} for label in labels]}
        for joint, labels in joints.items()
    }
    return describe_idealisations(SimpleNamespace(metrics={"joints": figures, "loads": {"a": {}}}))  # type: ignore[arg-type]


def test_line_on_several_joints() -> None:
    assert described(a=[], b=[]) is None
    end = "metrics.json has the option for each)"
    assert described(a=["x1"], b=["x1"]) == f"Idealised: x1 (typical values: x; {end}"
    assert described(a=["x1", "y2"], b=["y2"], c=["y2"]) == (
        f"Idealised: a: x1, y2; b and c: y2 (typical values: x, y; {end}"
    )
    assert described(a=[], b=["y2"]) == f"Idealised: b: y2 (typical values: y; {end}"
