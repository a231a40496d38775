"""A machine that cannot be is refused with a sentence that names its parameters."""

from dataclasses import replace
from typing import Any

import pytest

from fmublock import BlockError, Instance
from hdrm_fmu import HDRM, HdrmManipulator, HdrmPlant

FAR = "the lift triangle cannot close: lift.L_0 + screw.q_UB[1] must be below lift.a + lift.b"
NEAR = "the tilt triangle cannot close: tilt.L_0 + screw.q_LB[2] must be above |tilt.a - tilt.b|"
NONSENSE: dict[str, tuple[dict[str, Any], str]] = {
    "far": ({"screw.q_UB[1]": 0.9}, FAR),
    "flat": ({"lift.L_0": 1.05}, FAR),  # 1.05 + 0.522 against 1.15 + 0.42
    "near": ({"tilt.L_0": 0.79}, NEAR),
    "wide": ({"tilt.b": 0.2}, NEAR),
    "no stroke": ({"screw.q_LB[3]": 1.5}, "the stroke is empty: screw.q_UB[3] must be above screw.q_LB[3]"),
    "mass": ({"inner_boom.m": -1.0}, "inner_boom.m = -1 is outside its range, 0 to inf"),
    "actuator": ({"screw.M_BS[2]": -80.0}, "screw.M_BS[2] = -80 is outside its range, 0 to inf"),
    "payload": ({"payload.m": -470.0}, "payload.m must not be negative"),
}
CLOSED = "the {0} triangle cannot close: {0}.L_0 + {1} must be below {0}.a + {0}.b"
STARTS = {
    HdrmManipulator: ("x_L[2]", CLOSED.format("tilt", "x_L[2]")),
    HdrmPlant: ("start.x_L[1]", CLOSED.format("lift", "start.x_L[1]")),
}


def refusal(block: Any, values: dict[str, Any]) -> str:
    instance = Instance(block(), "machine")
    for name, value in values.items():
        instance[name] = value
    instance.enter_initialization()
    with pytest.raises(BlockError) as refused_by:
        instance.exit_initialization()
    return str(refused_by.value)


@pytest.mark.parametrize("block", [HdrmManipulator, HdrmPlant])
@pytest.mark.parametrize("name", NONSENSE)
def test_blocks_refuse_impossible_machines(block: Any, name: str) -> None:
    values, sentence = NONSENSE[name]
    assert refusal(block, values) == f"machine: {sentence}."


@pytest.mark.parametrize("block", STARTS)
def test_blocks_refuse_to_start_where_a_triangle_is_open(block: Any) -> None:
    name, sentence = STARTS[block]
    assert refusal(block, {name: 0.8}) == f"machine: {sentence}."


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"q_UB": (0.9, 0.6, 1.0)},
            "cannot close: lift_L_0 + q_UB[1] must be below lift_a + lift_b.",
        ),
        ({"q_LB": (0.0, 0.7, 0.0)}, "the stroke is empty: q_UB[2] must be above q_LB[2]."),
        ({"motor_m": (45.0, -30.0, 12.0)}, "motor_m[2] = -30 is outside its range, 0 to inf."),
        ({"tube_share": 1.5}, "tube_share = 1.5 is outside its range, 0 to 1."),
        ({"reach": 0.0}, "reach = 0 is outside its range, 0.001 to inf."),
        ({"gravity": float("nan")}, "gravity = nan is outside its range, -inf to inf."),
    ],
)
def test_parameters_refuse_impossible_machines(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError) as refused_by:
        replace(HDRM, **changes)
    assert str(refused_by.value).endswith(sentence)
