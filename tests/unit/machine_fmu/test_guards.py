"""Machines that leave the poses that they can follow do not start, or report it while they run."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import pytest

from emla_cosim.study.machines.schema import load_machine
from fmublock import Instance
from machine_fmu import assemble, find_closure, load_block
from machine_fmu.pose import Pose, direction
from tests.support.in_process import started


def move(instance: Instance, target: Sequence[float], steps: int) -> list[str]:
    """Move the actuators to other strokes in steps of 1 ms, and return what the instance reports."""
    reports, start = [], instance["x_L"]
    for i in range(steps):
        before, now = (
            [a + share * (b - a) for a, b in zip(start, target, strict=True)]
            for share in (i / steps, (i + 1) / steps)
        )
        instance["x_L"] = now
        instance["v_L"] = [(b - a) / 1e-3 for a, b in zip(before, now, strict=True)]
        instance.do_step(instance.time, 1e-3)
        reports += instance.left_limits()
    return reports


def machine_load(name: str, values: Mapping[str, Any] | None = None) -> Instance:
    return started(load_block(load_machine(name), "Load"), values)


def strokes_at(name: str, changes: Mapping[int, float]) -> list[float]:
    """Strokes of a machine with other coordinates than in the assembly."""
    machine = load_machine(name)
    mechanism, closure = assemble(machine), find_closure(machine)
    pose = Pose(mechanism).with_numbers({**dict(enumerate(closure.assembly)), **changes})
    return [direction(pose, bar).length - bar.length for bar in mechanism.actuators]


def test_pose_of_other_strokes_is_reported() -> None:
    """Newton's method does not follow a jump of half a metre in one step."""
    platform = machine_load("stewart")
    assert move(platform, strokes_at("stewart", {2: 1.45}), 10) == []
    assert platform["closure.residual"] == 1e-12
    reports = move(platform, strokes_at("stewart", {0: 0.5, 5: 1.2}), 1)
    assert reports[0].startswith("Load: closure.residual = ")
    assert "left its limits, -1e-06 to 1e-06" in reports[0]


@pytest.mark.slow
def test_singular_pose_is_reported() -> None:
    """The arms of the table become vertical, where nothing tells to which side they fall."""
    table = machine_load("lift_table")
    assert move(table, strokes_at("lift_table", {0: math.radians(75.0)}), 100) == []
    reports = move(table, strokes_at("lift_table", {0: math.radians(89.9)}), 150)
    assert reports[0].startswith("Load: closure.singularity = 0.99")


def test_cardan_angles() -> None:
    """Here with a low limit, which legs of this platform reach."""
    platform = machine_load("stewart", {"cardan.angle_max": 0.1})
    reports = move(platform, strokes_at("stewart", {4: 0.15}), 40)
    assert [report.partition(" = ")[0] for report in reports] == ["Load: cardan.angle[1]"]
    assert platform["cardan.angle"] == pytest.approx([0.15])


def test_machines_without_need_have_no_guards() -> None:
    names = {s.name for s in load_block(load_machine("hdrm"), "Load").layout().scalars}
    assert not any(name.startswith(("closure.", "cardan.")) for name in names)
