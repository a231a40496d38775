"""Manipulators and their states, drawn by hypothesis."""

import math
from dataclasses import dataclass, fields
from typing import Any

from hypothesis import strategies as st

from emla_cosim.study.machines.motion import FORMER_NAMES
from tests.support.manipulator_geometry import HDRM, Manipulator


@dataclass(frozen=True)
class Moment:
    """Strokes in m, speeds, accelerations, and the payload in kg."""

    q: list[float]
    v: list[float]
    a: list[float]
    payload: float


STROKES = st.tuples(*(st.floats(low, high) for low, high in zip(HDRM.q_LB, HDRM.q_UB, strict=True))).map(list)
"""Strokes within the box of Table II."""


def named_values(p: Manipulator) -> dict[str, float]:
    """Return parameters by FMI name."""
    values = dict[str, float]()
    for field in fields(Manipulator):
        name, value = FORMER_NAMES[field.name], getattr(p, field.name)
        if isinstance(value, tuple):
            values |= {f"{name}[{i}]": x for i, x in enumerate(value, 1)}
        else:
            values[name] = value
    return values


def three(largest: float) -> Any:
    return st.lists(st.floats(-largest, largest), min_size=3, max_size=3)


MOMENTS = st.builds(Moment, STROKES, three(0.3), three(5.0), st.floats(0.0, 1000.0))


@st.composite
def machines(draw: Any) -> Manipulator:
    """Manipulators whose triangles close over the strokes of Table II, and turn as they like."""

    def lengths(low: float, high: float) -> tuple[float, float, float]:
        return tuple(draw(st.floats(low, high)) for _ in range(3))

    angle, offset, mass = st.floats(-math.pi, math.pi), st.floats(-1.0, 1.0), st.floats(1.0, 300.0)
    return Manipulator(
        lift_a=draw(st.floats(1.1, 1.2)),
        lift_b=draw(st.floats(0.40, 0.45)),
        lift_L_0=draw(st.floats(0.83, 0.9)),
        lift_delta=draw(angle),
        lift_epsilon=draw(angle),
        tilt_a=draw(st.floats(1.23, 1.28)),
        tilt_b=draw(st.floats(0.44, 0.48)),
        tilt_L_0=draw(st.floats(0.9, 1.02)),
        tilt_delta=draw(angle),
        tilt_epsilon=draw(angle),
        lift_length=draw(st.floats(0.5, 3.0)),
        lift_m=draw(mass),
        lift_c=draw(offset),
        lift_J=draw(mass),
        outer_m=draw(mass),
        outer_c=draw(offset),
        outer_J=draw(mass),
        reach=draw(st.floats(0.5, 3.0)),
        inner_m=draw(mass),
        inner_c=draw(offset),
        inner_J=draw(mass),
        payload_J=draw(st.floats(0.0, 1.0)),
        M_BS=lengths(1.0, 300.0),
        tube_share=draw(st.floats(0.0, 1.0)),
        motor_m=lengths(0.0, 100.0),
        housing_c=lengths(-0.5, 1.0),
        housing_J=lengths(0.0, 20.0),
        tube_c=lengths(-0.5, 1.0),
        tube_J=lengths(0.0, 20.0),
        gravity=draw(st.floats(0.0, 20.0)),
    )
