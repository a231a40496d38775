"""A block as a running slave: phases, frozen outputs, discards, state."""

import math
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from scipy.integrate import solve_ivp

from fmublock import Block, Input, Output, Parameter, State
from fmublock.instance import BlockError, Instance, StepDiscardedError
from fmublock.symbolic import evaluate_symbolically
from tests.support.toy import Toy

REFERENCE = Toy.layout().reference


def running(**values: float) -> Instance:
    """A toy past initialization, with values set by FMI name."""
    instance = Instance(Toy(), "toy")
    for name, value in values.items():
        instance.set([REFERENCE(name)], [value])
    instance.enter_initialization()
    instance.exit_initialization()
    return instance


def test_arrays_and_names_follow_fmi() -> None:
    names = [s.name for s in Toy.layout().scalars]
    assert names[:9] == [
        "force", "body.mass", "spring.k[1]", "spring.k[2]", "shape", "damped", "count", "seed", "x_0",
    ]  # fmt: skip
    assert names[9:] == [
        "solver.internal_step", "x", "v[1]", "v[2]", "random", "step_count", "power", "inverse",
    ]  # fmt: skip


def test_a_state_can_start_from_a_parameter() -> None:
    instance = running(x_0=0.25, seed=11)
    assert instance.get([REFERENCE("x"), REFERENCE("random")]) == [0.25, 11.0]


def test_integration_agrees_with_scipy_and_is_of_fourth_order() -> None:
    """Against DOP853 at 1e-13; halving the internal step divides the error by 16."""

    def rhs(t: float, y: np.ndarray) -> list[float]:
        return [y[1], (0.5 - 3.0 * y[0] - 0.1 * y[1]) / 2.0, math.cos(t) - y[2] / 3.0]

    exact = solve_ivp(rhs, (0, 4), [0.125, 0.5, -0.5], method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    errors = []
    for internal_step in (0.2, 0.1, 0.05):
        instance = Instance(Toy())
        instance.set([REFERENCE("solver.internal_step")], [internal_step])
        instance.enter_initialization()
        instance.exit_initialization()
        instance.do_step(0.0, 4.0)
        found = instance.get([REFERENCE("x"), REFERENCE("v[1]"), REFERENCE("v[2]")])
        errors.append(np.abs(np.array(found) - exact).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx([4.0, 4.0], abs=0.2)


def test_a_step_is_divided_evenly_and_not_once_too_often() -> None:
    """0.3 / 0.1 is 2.9999... or 3.0000...4 in doubles; both mean three substeps."""
    calls: list[float] = []

    class Counting(Block):
        x = State(0.0)

        def derivatives(self, v: Any) -> dict[str, Any]:
            calls.append(v.time)
            return {"x": 1.0}

    instance = Instance(Counting())
    instance.set([Counting.layout().reference("solver.internal_step")], [0.1])
    instance.enter_initialization()
    instance.exit_initialization()
    instance.do_step(0.0, 0.3)
    assert len(calls) == 4 * 3


def test_outputs_are_frozen_between_steps() -> None:
    instance = running()
    instance.do_step(0.0, 0.1)
    power = instance.get([REFERENCE("power")])
    instance.set([REFERENCE("force")], [100.0])
    assert instance.get([REFERENCE("power")]) == power
    instance.do_step(0.1, 0.1)
    assert instance.get([REFERENCE("power")]) != power


def test_outputs_follow_what_is_set_during_initialization() -> None:
    instance = Instance(Toy())
    instance.enter_initialization()
    instance.set([REFERENCE("x_0")], [0.5])
    assert instance.get([REFERENCE("inverse")]) == [2.0]


def test_a_step_that_is_not_finite_leaves_everything_as_it_was() -> None:
    instance = running(x_0=0.5)
    instance.do_step(0.0, 0.01)
    before = instance.get_state()
    instance.set([REFERENCE("force")], [math.nan])
    with pytest.raises(StepDiscardedError, match=r"toy: step from t = 0.01 s .* discarded: x became nan"):
        instance.do_step(0.01, 0.01)
    after = instance.get_state()
    assert after["time"] == before["time"] == 0.01
    assert after["values"][1:] == before["values"][1:]  # all but the input that was set
    instance.set([REFERENCE("force")], [0.5])
    instance.do_step(0.01, 0.01)
    assert instance.get([REFERENCE("step_count")]) == [2.0]


@pytest.mark.parametrize("value", [0.0, 11.0, math.nan, math.inf])
def test_a_parameter_out_of_range_is_refused_when_initialization_ends(value: float) -> None:
    instance = Instance(Toy(), "toy")
    instance.enter_initialization()
    instance.set([REFERENCE("body.mass")], [value])
    with pytest.raises(BlockError, match=r"toy: body.mass = .* is outside its range, 0.1 to 10"):
        instance.exit_initialization()


@pytest.mark.parametrize("name", ["power", "x", "random"])
def test_what_the_block_computes_cannot_be_set(name: str) -> None:
    with pytest.raises(BlockError, match=f"{name} is computed"):
        Instance(Toy()).set([REFERENCE(name)], [1.0])


def test_parameters_cannot_be_set_after_initialization() -> None:
    with pytest.raises(BlockError, match=r"body.mass cannot be set after initialization"):
        running().set([REFERENCE("force"), REFERENCE("body.mass")], [1.0, 2.0])


@pytest.mark.parametrize(
    ("time", "step"), [(0.0, 0.0), (0.0, -0.1), (0.0, math.nan), (0.5, 0.1), (math.nan, 0.1)]
)
def test_steps_that_make_no_sense_are_refused(time: float, step: float) -> None:
    instance = running()
    before = instance.get_state()
    with pytest.raises(BlockError):
        instance.do_step(time, step)
    assert instance.get_state() == before


def test_calls_in_the_wrong_phase_are_refused() -> None:
    with pytest.raises(BlockError, match="cannot do a step in phase instantiated"):
        Instance(Toy()).do_step(0.0, 0.1)
    with pytest.raises(BlockError, match="cannot enter initialization mode in phase step"):
        running().enter_initialization()


@settings(max_examples=30)
@given(
    before=st.lists(st.floats(1e-3, 0.05), min_size=1, max_size=5),
    after=st.lists(st.floats(1e-3, 0.05), min_size=1, max_size=5),
    force=st.floats(-1.0, 1.0),
)
def test_a_saved_state_continues_bit_for_bit(before: list[float], after: list[float], force: float) -> None:
    instance = running()

    def go(steps: list[float]) -> None:
        for step in steps:
            instance.do_step(instance.time, step)

    go(before)
    instance.set([REFERENCE("force")], [force])
    saved = instance.get_state()
    go(after)
    once = instance.get_state()
    instance.set_state(saved)
    go(after)
    assert instance.get_state() == once


def test_an_equation_cannot_use_what_is_not_declared() -> None:
    class Wrong(Block):
        u = Input()
        y = Output()

        def outputs(self, v: Any) -> dict[str, Any]:
            return {"y": v.u + v.w}

    instance = Instance(Wrong())
    with pytest.raises(AttributeError, match="no variable 'w'"):
        instance.get([1])
    with pytest.raises(AttributeError, match="no variable 'w'"):
        evaluate_symbolically(Wrong())


def test_a_result_that_is_not_declared_or_missing_is_named() -> None:
    class Extra(Block):
        x = State(0.0)

        def derivatives(self, v: Any) -> dict[str, Any]:
            return {"x": v.x, "z": v.x}

    class Missing(Block):
        x = State(0.0)

    with pytest.raises(TypeError, match=r"Extra.derivatives returns z, not declared"):
        evaluate_symbolically(Extra())
    with pytest.raises(TypeError, match=r"Missing.derivatives gives no value for x"):
        evaluate_symbolically(Missing())


def test_names_must_differ_and_units_need_floats() -> None:
    class Twice(Block):
        a = Parameter(1.0, name="k")
        b = Parameter(2.0, name="k")

    with pytest.raises(TypeError, match="declares these names twice: k"):
        Twice.layout()
    with pytest.raises(TypeError, match="write its start value 1 as a float"):
        Parameter(1, unit="m")
