"""Machines whose pose Newton's method finds, in steps that are repeated."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import emla_cosim as ec
from emla_cosim.study.machines.schema import load_machine
from fmublock import Block, Input, Output, Parameter, State
from tests.support.in_process import started
from tests.support.machine_states import Case, MachineState

MASS, STIFFNESS, DAMPING = 2000.0, 4e5, 2e4
"""Of the actuator: kg, N/m and N s/m."""


class Push(Block):
    """An actuator that pulls its stroke to another one."""

    F_L = Input(unit="N", description="Load force")
    x_0 = Parameter(0.1, unit="m", description="Stroke at the start")
    x_E = Parameter(0.2, unit="m", description="Stroke without force")
    x = State(x_0, unit="m", description="Stroke")
    v = State(unit="m/s", description="Speed")
    a = Output(unit="m/s2", description="Acceleration")

    def acceleration(self, v: Any) -> Any:
        return (STIFFNESS * (v.x_E - v.x) - DAMPING * v.v - v.F_L) / MASS

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": v.v, "v": self.acceleration(v)}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"a": self.acceleration(v)}


def test_strong_coupling_repeats_steps_with_the_pose() -> None:
    """The force needs the acceleration at once, so that each step is repeated from saved states."""
    case, load = Case.of("lift_table"), ec.read_machine_blocks("lift_table").load
    (start,) = load.layout().inputs[1].start
    values: dict[str, Any] = {"x_0": start, "x_E": start + 0.2}
    system = ec.System((ec.Component("push", Push, values), ec.Component("table", load, {})), ())
    system = system.with_connections(
        "push.x -> table.x_L[1]",
        "push.v -> table.v_L[1]",
        "push.a -> table.a_L[1]",
        "table.F_L[1] -> push.F_L",
    )
    results = []
    for step in (1e-3, 5e-4):
        with ec.load(system, stop_time=0.2, step_size=step, algorithm="strong").prepare() as simulation:
            results.append(simulation.run())

    def slope(_: float, y: np.ndarray) -> list[float]:
        x, v = y.tolist()
        dynamics = case.dynamics(MachineState([x], [], [v], [], []))
        force = STIFFNESS * (values["x_E"] - x) - DAMPING * v
        return [v, *dynamics.forward([v], [force], [MASS])]

    expected = solve_ivp(slope, (0.0, 0.2), [start, 0.0], method="DOP853", rtol=1e-5, atol=1e-7).y[0, -1]
    wide, narrow = (result["push.x"][-1] for result in results)
    assert abs(expected - start) > 0.03
    assert narrow == pytest.approx(expected, abs=2e-3)
    assert 2.0 * narrow - wide == pytest.approx(expected, abs=2e-5)  # the error halves with the step
    assert results[0]["table.closure.residual"].max() < 1e-9


def test_step_after_a_restored_state_has_the_same_bits() -> None:
    for name in ("lift_table", "stewart"):
        block = ec.read_machine_blocks(name).plant
        instance = started(block, {"tau_m": [10.0] * len(load_machine(name).actuators)})
        instance.do_step(0.0, 1e-3)
        before = instance.get_state()
        references = range(len(instance.layout.scalars))
        instance.do_step(1e-3, 1e-3)
        first = instance.get(references)
        instance.set_state(before)
        instance.do_step(1e-3, 1e-3)
        assert instance.get(references) == first
        assert instance["closure.residual"] < 1e-9
