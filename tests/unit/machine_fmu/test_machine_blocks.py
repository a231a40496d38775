"""Blocks of machines: variables, equations on symbols and floats, and starts that are refused."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from emla_cosim.study.machines.schema import load_machine
from fmublock import Block, BlockError, Instance
from fmublock.symbolic import evaluate_symbolically
from machine_fmu import assemble, load_block, plant_block, reach_pose
from machine_fmu.model import MachineModel
from machine_fmu.pose import Pose
from tests.support.in_process import started


@cache
def make_block(name: str, kind: str) -> type[Block]:
    machine = load_machine(name)
    return load_block(machine, "Load") if kind == "load" else plant_block(machine, "Plant")


@pytest.mark.parametrize("kind", ["load", "plant"])
@pytest.mark.parametrize("name", ["crane", "lift_table"])
def test_symbols_and_floats_give_the_same_bits(name: str, kind: str) -> None:
    """After a step; these machines have triangles, loops, and a load that swings."""
    instance = Instance(make_block(name, kind)())
    layout = instance.layout
    for variable in layout.inputs:
        if variable.attribute not in ("payload", "x_L"):
            instance[str(variable.name)] = [0.3 + 0.1 * i for i in range(*variable.shape)]
    instance.enter_initialization()
    instance.exit_initialization()
    instance.do_step(0.0, 1e-3)
    values = np.array(instance.get(range(len(layout.scalars))))
    symbolic = evaluate_symbolically(instance.block)
    outputs = symbolic.outputs(instance.time, values).full().ravel()
    assert outputs.tolist() == values[list(layout.references(layout.outputs))].tolist()


def test_pose_follows_the_strokes() -> None:
    """What Newton's method finds is a state, which stays close to the solution."""
    instance = started(make_block("lift_table", "load"))
    start = instance["x_L"][0]
    heights = [instance["tip.y"]]
    for i in range(60):
        instance["x_L"] = [start + 1e-4 * (i + 1)]
        instance["v_L"] = [0.1]
        instance.do_step(i * 1e-3, 1e-3)
        heights.append(instance["tip.y"])
    assert np.all(np.diff(heights[1:]) > 0.0)
    block: Any = instance.block
    mechanism = assemble(block.machine)
    lengths = {"lift": mechanism.bars[0].length + instance["x_L"][0]}
    expected = reach_pose(mechanism, block.closure, lengths)
    assert instance["pose"] == pytest.approx([expected[i] for i in block.closure.iterated], abs=1e-3)
    end = mechanism.payload
    assert end is not None
    pose = Pose(mechanism).with_numbers(dict(enumerate(expected)))
    assert instance["tip.y"] == pytest.approx(pose.point(end)[1], abs=1e-12)


def test_swinging_load_comes_to_rest() -> None:
    """By the damping of its joint; without, it would swing on."""
    swings = {}
    for damping in (0.0, 500.0):
        values = {"hook.damping": damping, "solver.internal_step": 0.03, "start.passive.q": [-0.6]}
        instance = started(make_block("crane", "load"), values)
        speeds = []
        for i in range(70):
            instance.do_step(i * 0.03, 0.03)
            speeds.append(abs(instance["passive.v"][0]))
        swings[damping] = max(speeds[45:]), max(speeds[:25])
    assert swings[0.0][0] == pytest.approx(swings[0.0][1], rel=0.02)
    assert swings[500.0][0] < 0.3 * swings[500.0][1]


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("hdrm", {"screw.q_UB[1]": 0.9}, "the triangle of 'lift' cannot close at the stroke screw.q_UB[1]."),
        ("hdrm", {"tilt.L_0": 0.79}, "the triangle of 'tilt' cannot close at the stroke screw.q_LB[2]."),
        ("hdrm", {"screw.q_LB[3]": 1.5}, "the stroke is empty: screw.q_UB[3] must be above screw.q_LB[3]."),
        ("hdrm", {"payload.m": -470.0}, "payload.m must not be negative."),
        ("hdrm", {"inner_boom.m": -1.0}, "inner_boom.m = -1 is outside its range, 0 to inf."),
        ("hdrm", {"screw.M_BS[2]": -80.0}, "screw.M_BS[2] = -80 is outside its range, 0 to inf."),
        ("hdrm", {"x_L[2]": 0.8}, "the triangle of 'tilt' cannot close at the stroke x_L[2]."),
        (
            "crane",
            {"jib.foot.y": 0.25},
            "the points of 'telescope' must be along the slide of 'extension', as in the file.",
        ),
        (
            "crane",
            {"payload.m": 0.0, "hook.m": 0.0, "hook.J": 0.0},
            "the passive joint 'hook' moves no mass; give its body",
        ),
        ("lift_table", {"start.pose": [0.6, 2.0, -2.0, 0.6]}, "start.pose of "),
        (
            "lift_table",
            {"closure.singularity_max": 0.0},
            "the pose at the start is singular, or beyond a singular one",
        ),
        ("stewart", {"cardan.angle_max": 0.0}, "the angle 'platform.y' must be below cardan.angle_max"),
    ],
)
def test_impossible_machines_do_not_start(name: str, values: dict[str, Any], expected: str) -> None:
    with pytest.raises(BlockError) as refused:
        started(make_block(name, "load"), values)
    assert str(refused.value).startswith(f"Load: {expected}")


@pytest.mark.parametrize("name", ["excavator", "lift_table", "stewart"])
def test_force_of_a_process_does_the_work_of_its_actuators(name: str) -> None:
    """At rest, by differences of the tip: actuators carry what moves it against the force."""
    machine = load_machine(name)
    assert machine.payload is not None
    model = MachineModel(machine)
    pushed = replace(machine, payload=replace(machine.payload, has_force=True))
    load = np.array([3e3, -7e3, 2e3][: machine.dimensions])
    forces = []
    for F in (0.0 * load, load):
        forces.append(started(load_block(pushed, "Load"), {"payload.F": F.tolist()})["F_L"])
    h, start = 1e-4, np.array(model.start)
    moves = np.eye(len(start)) * h
    slopes = (model.tip(start + moves) - model.tip(start - moves)) / (2.0 * h)
    difference = np.array(forces[1]) - forces[0]
    assert difference == pytest.approx(-slopes @ load, rel=1e-5)
