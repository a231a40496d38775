"""The base of the manipulator's blocks, which declares its parameters."""

from typing import Any

from fmublock import Block, Input, Parameter

from . import refusals
from .parameters import HDRM, PAYLOAD


class Machine(Block):
    """Base of the manipulator's blocks: the parameters of HdrmParameters, with the same attributes."""

    payload = Input(
        PAYLOAD,
        unit="kg",
        nominal=100.0,
        minimum=0.0,
        name="payload.m",
        symbol="m",
        description="Mass at the tip",
    )

    lift_a = Parameter(
        HDRM.lift_a,
        unit="m",
        minimum=1e-3,
        name="lift.a",
        symbol="a",
        description="Distance of the fixed pin from the turning point",
    )
    lift_b = Parameter(
        HDRM.lift_b,
        unit="m",
        minimum=1e-3,
        name="lift.b",
        symbol="b",
        description="Distance of the boom pin from the turning point",
    )
    lift_L_0 = Parameter(
        HDRM.lift_L_0,
        unit="m",
        minimum=1e-3,
        name="lift.L_0",
        symbol="L_0",
        description="Distance of the pins at stroke 0",
    )
    lift_delta = Parameter(
        HDRM.lift_delta,
        unit="rad",
        name="lift.delta",
        symbol=r"\delta",
        description="Direction of the fixed pin relative to the carrier of the turning point",
    )
    lift_epsilon = Parameter(
        HDRM.lift_epsilon,
        unit="rad",
        name="lift.epsilon",
        symbol=r"\varepsilon",
        description="Direction of the boom pin relative to the boom",
    )
    tilt_a = Parameter(
        HDRM.tilt_a,
        unit="m",
        minimum=1e-3,
        name="tilt.a",
        symbol="a",
        description="Distance of the fixed pin from the turning point",
    )
    tilt_b = Parameter(
        HDRM.tilt_b,
        unit="m",
        minimum=1e-3,
        name="tilt.b",
        symbol="b",
        description="Distance of the boom pin from the turning point",
    )
    tilt_L_0 = Parameter(
        HDRM.tilt_L_0,
        unit="m",
        minimum=1e-3,
        name="tilt.L_0",
        symbol="L_0",
        description="Distance of the pins at stroke 0",
    )
    tilt_delta = Parameter(
        HDRM.tilt_delta,
        unit="rad",
        name="tilt.delta",
        symbol=r"\delta",
        description="Direction of the fixed pin relative to the carrier of the turning point",
    )
    tilt_epsilon = Parameter(
        HDRM.tilt_epsilon,
        unit="rad",
        name="tilt.epsilon",
        symbol=r"\varepsilon",
        description="Direction of the boom pin relative to the boom",
    )

    lift_length = Parameter(
        HDRM.lift_length, unit="m", minimum=1e-3, name="lift_boom.length", description="Length from O1 to O2"
    )
    lift_m = Parameter(HDRM.lift_m, unit="kg", minimum=0.0, name="lift_boom.m", description="Mass")
    lift_c = Parameter(HDRM.lift_c, unit="m", name="lift_boom.c", description="Centre of mass from O1")
    lift_J = Parameter(
        HDRM.lift_J,
        unit="kg.m2",
        minimum=0.0,
        name="lift_boom.J",
        description="Inertia about the centre of mass",
    )
    outer_m = Parameter(HDRM.outer_m, unit="kg", minimum=0.0, name="outer_boom.m", description="Mass")
    outer_c = Parameter(HDRM.outer_c, unit="m", name="outer_boom.c", description="Centre of mass from O2")
    outer_J = Parameter(
        HDRM.outer_J,
        unit="kg.m2",
        minimum=0.0,
        name="outer_boom.J",
        description="Inertia about the centre of mass",
    )
    reach = Parameter(
        HDRM.reach,
        unit="m",
        minimum=1e-3,
        name="inner_boom.reach",
        description="Distance of the tip from O2 at stroke 0",
    )
    inner_m = Parameter(HDRM.inner_m, unit="kg", minimum=0.0, name="inner_boom.m", description="Mass")
    inner_c = Parameter(
        HDRM.inner_c,
        unit="m",
        name="inner_boom.c",
        description="Centre of mass behind the tip",
    )
    inner_J = Parameter(
        HDRM.inner_J,
        unit="kg.m2",
        minimum=0.0,
        name="inner_boom.J",
        description="Inertia about the centre of mass",
    )
    payload_J = Parameter(
        HDRM.payload_J,
        unit="m2",
        minimum=0.0,
        name="payload.J",
        description="Inertia about the tip per mass",
    )

    M_BS = Parameter(
        HDRM.M_BS,
        shape=3,
        unit="kg",
        minimum=0.0,
        name="screw.M_BS",
        description="Mass of an actuator without its motor",
    )
    tube_share = Parameter(
        HDRM.tube_share,
        minimum=0.0,
        maximum=1.0,
        name="tube.share",
        description="Fraction of M_BS in the tube, which moves with the screw",
    )
    motor_m = Parameter(
        HDRM.motor_m,
        shape=3,
        unit="kg",
        minimum=0.0,
        name="motor.m",
        description="Mass, which is fixed to the housing",
    )
    housing_c = Parameter(
        HDRM.housing_c,
        shape=3,
        unit="m",
        name="housing.c",
        description="Centre of mass of housing and motor from the fixed pin (telescope: from O2)",
    )
    housing_J = Parameter(
        HDRM.housing_J,
        shape=3,
        unit="kg.m2",
        minimum=0.0,
        name="housing.J",
        description="Inertia of housing and motor about their centre of mass",
    )
    tube_c = Parameter(
        HDRM.tube_c,
        shape=3,
        unit="m",
        name="tube.c",
        description="Centre of mass of the tube behind the boom pin (telescope: behind the tip)",
    )
    tube_J = Parameter(
        HDRM.tube_J,
        shape=3,
        unit="kg.m2",
        minimum=0.0,
        name="tube.J",
        description="Inertia of the tube about its centre of mass",
    )
    q_LB = Parameter(HDRM.q_LB, shape=3, unit="m", name="screw.q_LB", description="Lower end of a stroke")
    q_UB = Parameter(HDRM.q_UB, shape=3, unit="m", name="screw.q_UB", description="Upper end of a stroke")
    gravity = Parameter(HDRM.gravity, unit="m/s2", symbol="g", description="Gravitational acceleration")

    def conditions(self, v: Any) -> dict[str, Any]:
        """Require that triangles close over the whole stroke, and that the payload is not negative."""
        mass = {f"{fmi_name('payload')} must not be negative": v.payload >= 0.0}
        return {**refusals.geometry(v, fmi_name), **mass}


def closes_at(v: Any, q: Any, name: str) -> dict[str, Any]:
    """Return conditions that the triangles of a machine close at the strokes q with this name."""
    lift = refusals.closes(v, "lift", q[0], f"{name}[1]", fmi_name)
    return {**lift, **refusals.closes(v, "tilt", q[1], f"{name}[2]", fmi_name)}


def fmi_name(attribute: str, element: int | None = None) -> str:
    """Return the FMI name of one of these variables, or of an element of it, counted from 0."""
    name = str(vars(Machine)[attribute].name)
    return name if element is None else f"{name}[{element + 1}]"
