"""What swings freely hangs at rest, follows motions so, and takes no energy."""

from dataclasses import replace

import numpy as np
import pytest

from emla_cosim.study.machines.motion import find_start
from emla_cosim.study.machines.schema import load_machine
from machine_fmu import Machine
from machine_fmu.model import MachineModel

G = 9.81
STEP = 1e-4


def crane(assembly: float | None = None) -> Machine:
    machine = load_machine("crane")
    if assembly is None:
        return machine
    hook = machine.bodies["hook"]
    hook = replace(hook, joint=replace(hook.joint, assembly=(assembly,)))
    return replace(machine, bodies={**machine.bodies, "hook": hook})


def motion(machine: MachineModel, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    draw = np.random.default_rng(seed)
    q = draw.uniform(machine.q_LB, machine.q_UB, (20, 3))
    return q, draw.uniform(-0.05, 0.05, (20, 3)), draw.uniform(-0.2, 0.2, (20, 3))


@pytest.mark.parametrize("assembly", [-3.1, -1.5, 0.0, 1.5, 3.1])
def test_hook_hangs_down_from_any_assembly(assembly: float) -> None:
    machine = MachineModel(crane(assembly))
    q, *_ = motion(machine, 1)
    points = machine.points(q, ["hook", "hook.load"])
    assert points["hook.load"] - points["hook"] == pytest.approx(np.tile([0.0, -0.8], (20, 1)), abs=1e-9)


def test_forces_of_a_motion_change_the_energy() -> None:
    machine = MachineModel(crane())
    q, v, a = motion(machine, 2)

    def energy(t: float) -> np.ndarray:
        return machine.energy(q + t * v + 0.5 * t * t * a, v + t * a)

    power = np.sum(machine.forces(q, v, a) * v, axis=1)
    assert (energy(STEP) - energy(-STEP)) / (2 * STEP) == pytest.approx(power, abs=1e-6 * abs(power).max())


def test_deflection_is_the_acceleration_of_the_suspension_over_gravity() -> None:
    machine = MachineModel(crane())
    q, v, a = motion(machine, 3)
    before, now, after = (
        machine.points(q + t * v + 0.5 * t * t * a, ["hook"])["hook"][:, 0] for t in (-STEP, 0.0, STEP)
    )
    acceleration = (before - 2.0 * now + after) / STEP**2
    assert abs(machine.swing(q, v, a)[:, 0]) == pytest.approx(abs(acceleration) / G, abs=1e-5)


def test_rate_of_a_load_that_hangs_is_not_that_of_its_boom() -> None:
    """A load that hangs does not turn: as a mass at its suspension, it adds no moment of its own."""
    machine = MachineModel(crane())
    q, v, a = motion(machine, 4)
    lighter, heavier = (machine.forces(q, v, a, m) for m in (200.0, 210.0))
    slopes = np.stack(
        [(machine.tip(q + STEP * e) - machine.tip(q - STEP * e)) / (2.0 * STEP) for e in np.eye(3)], axis=2
    )
    before, now, after = (machine.tip(q + t * v + 0.5 * t * t * a) for t in (-STEP, 0.0, STEP))
    force = 10.0 * ((before - 2.0 * now + after) / STEP**2 + [0.0, G])
    assert heavier - lighter == pytest.approx(np.einsum("rij,ri->rj", slopes, force), rel=1e-4, abs=0.5)


def test_run_starts_where_the_load_hangs() -> None:
    machine = crane(1.5)
    model = MachineModel(machine)
    start = find_start(machine, model.start, "crane")
    assert start.values["start.passive.q[1]"] == pytest.approx(model.hanging(np.array([model.start]))[0, 0])
