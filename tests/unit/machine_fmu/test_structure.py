"""The order in which equations determine unknowns."""

import pytest

from machine_fmu.structure import Step, StructureError, order_steps


def test_each_step_follows_its_inputs() -> None:
    steps = order_steps([{0, 1}, {0}, {1, 2}], {0, 1, 2})
    assert steps == [Step((1,), (0,)), Step((0,), (1,)), Step((2,), (2,))]


def test_equations_that_need_each_other_are_one_step() -> None:
    steps = order_steps([{0, 1}, {2}, {0, 1}, {1, 2, 3}], {0, 1, 2, 3})
    assert {step.equations for step in steps} == {(0, 2), (1,), (3,)}
    assert [step.equations for step in steps].index((3,)) == 2


def test_unknowns_without_an_equation() -> None:
    with pytest.raises(StructureError) as error:
        order_steps([{0}, {0}], {0, 1})
    assert (error.value.equations, error.value.unknowns) == ((1,), (1,))
