"""The blocks of machine files: their names, the file in the cache, and FMUs by `emla build`."""

from pathlib import Path

import pytest

import emla_cosim as ec
from emla_cosim.fmu.models import MODELS
from emla_cosim.study.machines.blocks import build_machine_blocks, find_machine_blocks
from emla_cosim.study.machines.machine_file import load_machine_file
from emla_cosim.study.machines.schema import load_machine, read_machine_text
from fmublock import Instance, load_block
from machine_fmu import Trajectory
from tests.support.commands import Emla
from tests.unit.study.test_machine_files import LIFT


def test_manipulator_is_the_file_of_that_name() -> None:
    blocks = ec.read_machine_blocks("hdrm")
    assert blocks.all == (MODELS["HdrmManipulator"], MODELS["HdrmPlant"], Trajectory)
    assert find_machine_blocks("hdrm") == {x.__name__: x.__name__ for x in blocks.all}
    assert blocks.model(blocks.plant) == "HdrmPlant"


def test_changed_copy_of_the_manipulator_has_blocks_of_its_own(tmp_path: Path) -> None:
    """A machine with the manipulator's name is not the manipulator."""
    path, text = tmp_path / "hdrm.toml", read_machine_text("hdrm")
    path.write_text(text, encoding="utf-8")
    assert ec.read_machine_blocks(path).all == ec.read_machine_blocks("hdrm").all
    path.write_text(
        text.replace('"lift_boom.m" = { value = 160.0', '"lift_boom.m" = { value = 3000.0'), encoding="utf-8"
    )
    blocks = ec.read_machine_blocks(path)
    assert [block.__name__ for block in blocks.all] == ["HdrmLoad", "HdrmPlant", "HdrmTrajectory"]
    assert blocks.model(blocks.plant) == f"{blocks.file}:HdrmPlant"
    force = {path: Instance(ec.read_machine_blocks(path).load())["F_L"][0] for path in (path, "hdrm")}
    assert force[path] > 1.2 * force["hdrm"]


@pytest.mark.parametrize(
    ("name", "expected"),
    [("lift_table", "LiftTable"), ("my-press 2", "MyPress2"), ("3_axes", "Machine3Axes"), ("---", "Machine")],
)
def test_names_of_blocks(name: str, expected: str) -> None:
    blocks = build_machine_blocks(load_machine("lift_table"), name)
    names = [block.__name__ for block in blocks.all]
    assert names == [f"{expected}Load", f"{expected}Plant", f"{expected}Trajectory"]
    assert blocks.model(blocks.load) == f"{blocks.file}:{expected}Load"
    assert load_block(blocks.model(blocks.load)).layout().scalars[0].name == "payload.m"


def test_trajectory_rests_at_the_start() -> None:
    blocks = ec.read_machine_blocks("crane")
    motion, load = Instance(blocks.trajectory()), Instance(blocks.load())
    assert "coefficient.luff[1]" in {s.name for s in motion.layout.scalars}
    motion.enter_initialization()
    assert motion["x_d"] == pytest.approx(load["x_L"])
    assert motion["v_d"] == [0.0] * 3


def test_plant_has_the_mechanics_of_the_joints() -> None:
    file, plant = load_machine_file("crane"), Instance(ec.read_machine_blocks("crane").plant())
    emlas = [joint.emla for joint in file.joints.values()]
    assert plant["motor.J_m"] == [emla.J_m for emla in emlas]
    assert plant["screw.lead"] == [emla.lead for emla in emlas]


def test_changed_machine_gets_its_own_file(tmp_path: Path) -> None:
    path = tmp_path / "boom.toml"
    path.write_text(LIFT, encoding="utf-8")
    first = ec.read_machine_blocks(path)
    assert ec.read_machine_blocks(path).all == first.all
    path.write_text(LIFT.replace("120 kg", "130 kg"), encoding="utf-8")
    changed = ec.read_machine_blocks(path)
    assert changed.file != first.file
    assert [Instance(blocks.load())["boom.m"] for blocks in (first, changed)] == [120.0, 130.0]


@pytest.mark.slow
def test_build_command(emla: Emla, tmp_path: Path) -> None:
    (tmp_path / "boom.toml").write_text(LIFT, encoding="utf-8")
    built = emla("build", "boom.toml", "--platform", "linux64", "--output", "out")
    assert built.exit_code == 0, built.output
    names = {path.stem for path in (tmp_path / "out").rglob("*.fmu")}
    assert names == {"BoomLoad", "BoomPlant", "BoomTrajectory"}
    completed = emla("build", "boom.toml:BoomPlant", "--platform", "linux64", "--fmi", "3", "--output", "one")
    assert completed.exit_code == 0, completed.output
    assert [path.stem for path in (tmp_path / "one").rglob("*.fmu")] == ["BoomPlant"]


@pytest.mark.parametrize(
    ("argument", "expected"),
    [
        ("boom.toml:Boom", "there is no block of this machine 'Boom'; choose from BoomLoad, BoomPlant and"),
        ("none.toml", "the machine 'none.toml' cannot be read"),
        ("boom", "there is no model 'boom'; choose from"),
    ],
)
def test_wrong_machines_to_build(argument: str, expected: str, emla: Emla, tmp_path: Path) -> None:
    (tmp_path / "boom.toml").write_text(LIFT, encoding="utf-8")
    result = emla("build", argument, "--output", "out")
    assert result.exit_code == 2
    assert expected in " ".join(result.output.split())
