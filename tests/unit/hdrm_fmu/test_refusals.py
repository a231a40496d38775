"""Parameters of a manipulator that cannot be are refused."""

from dataclasses import replace
from typing import Any

import pytest

from hdrm_fmu import HDRM


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
