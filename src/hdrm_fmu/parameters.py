"""Geometry and masses of the manipulator.

The paper prints no link data. Every number here is assumed, except for M_BS and the strokes (its Tables II
and IV) and the payload. With these numbers the static forces of all three actuators are within the bounds of
Table II over the whole range of strokes.
"""

import math
from dataclasses import dataclass, fields

from . import refusals

Three = tuple[float, float, float]
"""One value for each actuator: lift, tilt, telescope."""


@dataclass(frozen=True)
class HdrmParameters:
    """A planar manipulator of lift boom, outer boom and telescoping inner boom, moved by three actuators.

    The lift boom turns about O1, the outer boom about O2 at the lift boom's end, the inner boom slides in
    the outer one. Lift and tilt actuator each close a triangle: from the turning point to the fixed pin
    (side a), to the boom pin (side b), and the actuator itself between the pins (L_0 + stroke). Angles count
    anticlockwise; x is horizontal, y is up. All centres of mass lie on the axes of booms and actuators.
    """

    lift_a: float = 1.15  # assumed
    """Distance of the lift actuator's fixed pin from O1, m."""
    lift_b: float = 0.42  # assumed
    """Distance of the lift actuator's boom pin from O1, m."""
    lift_L_0: float = 0.85  # assumed
    """Distance of the lift actuator's pins at stroke 0, m."""
    lift_delta: float = math.radians(-70.0)  # assumed
    """Direction of the lift actuator's fixed pin from O1, against the horizontal, rad."""
    lift_epsilon: float = math.radians(-10.0)  # assumed
    """Direction of the lift actuator's boom pin from O1, against the lift boom's axis, rad."""
    tilt_a: float = 1.25  # assumed
    """Distance of the tilt actuator's fixed pin, which is on the lift boom, from O2, m."""
    tilt_b: float = 0.45  # assumed
    """Distance of the tilt actuator's boom pin, which is on the outer boom, from O2, m."""
    tilt_L_0: float = 1.00  # assumed
    """Distance of the tilt actuator's pins at stroke 0, m."""
    tilt_delta: float = math.radians(-170.0)  # assumed
    """Direction of the tilt actuator's fixed pin from O2, against the lift boom's axis, rad."""
    tilt_epsilon: float = math.radians(-20.0)  # assumed
    """Direction of the tilt actuator's boom pin from O2, against the outer boom's axis, rad."""

    lift_length: float = 1.80  # assumed
    """Length of the lift boom from O1 to O2, m."""
    lift_m: float = 160.0  # assumed
    """Mass of the lift boom, kg."""
    lift_c: float = 0.85  # assumed
    """Centre of mass of the lift boom, from O1, m."""
    lift_J: float = 43.2  # assumed
    """Inertia of the lift boom about its centre of mass, kg m2."""
    outer_m: float = 120.0  # assumed
    """Mass of the outer boom, kg."""
    outer_c: float = 0.65  # assumed
    """Centre of mass of the outer boom, from O2, m."""
    outer_J: float = 22.5  # assumed
    """Inertia of the outer boom about its centre of mass, kg m2."""
    reach: float = 1.65  # assumed
    """Distance of the tip from O2 at stroke 0 of the telescope, m."""
    inner_m: float = 60.0  # assumed
    """Mass of the inner boom, kg."""
    inner_c: float = 0.75  # assumed
    """Centre of mass of the inner boom, behind the tip, m."""
    inner_J: float = 11.25  # assumed
    """Inertia of the inner boom about its centre of mass, kg m2."""
    payload_J: float = 0.06  # assumed; 28.2 kg m2 of 470 kg
    """Inertia of the payload about the tip per mass of it, m2."""

    M_BS: Three = (156.5, 83.6, 30.4)  # Table IV
    """Mass of the actuators without their motors, kg."""
    tube_share: float = 0.3  # assumed
    """Fraction of M_BS in the tube, which moves with the screw; the rest is housing."""
    motor_m: Three = (45.0, 30.0, 12.0)  # assumed
    """Mass of the motors, which are fixed to the housings, kg."""
    housing_c: Three = (0.34, 0.40, 0.50)  # assumed
    """Centre of mass of housing and motor, from the fixed pin (telescope: from O2), m."""
    housing_J: Three = (9.3, 7.4, 2.8)  # assumed: slender, as long as the actuator (1 m for the telescope)
    """Inertia of housing and motor about their centre of mass, kg m2."""
    tube_c: Three = (0.34, 0.40, 0.75)  # assumed
    """Centre of mass of the tube, behind the boom pin (telescope: behind the tip), m."""
    tube_J: Three = (2.8, 2.1, 0.8)  # assumed: slender, as the housing
    """Inertia of the tube about its centre of mass, kg m2."""

    q_LB: Three = (0.0, 0.0, 0.0)  # Table II
    """Lower end of the strokes, m."""
    q_UB: Three = (0.522, 0.611, 1.0)  # Table II
    """Upper end of the strokes, m."""
    gravity: float = 9.81
    """Gravitational acceleration, m/s2."""

    def __post_init__(self) -> None:
        """Raise ValueError for a parameter out of range or a geometry that is not possible."""
        for part in fields(self):
            value = getattr(self, part.name)
            for i, x in enumerate(value if isinstance(value, tuple) else (value,)):
                name = _named(part.name, i) if isinstance(value, tuple) else part.name
                low, high = RANGES.get(part.name, (-math.inf, math.inf))
                if not (low <= x <= high and math.isfinite(x)):
                    raise ValueError(f"{name} = {x:.9g} is outside its range, {low:.9g} to {high:.9g}.")
        for sentence, holds in refusals.geometry(self, _named).items():
            if not holds:
                raise ValueError(f"{sentence}.")


def _named(attribute: str, element: int | None = None) -> str:
    return attribute if element is None else f"{attribute}[{element + 1}]"


_SIDES = ("lift_a", "lift_b", "lift_L_0", "tilt_a", "tilt_b", "tilt_L_0", "lift_length", "reach")
_BODIES = ("lift_m", "lift_J", "outer_m", "outer_J", "inner_m", "inner_J", "payload_J")
_ACTUATORS = ("M_BS", "motor_m", "housing_J", "tube_J")
RANGES = {
    **dict.fromkeys(_SIDES, (0.001, math.inf)),
    **dict.fromkeys((*_BODIES, *_ACTUATORS), (0.0, math.inf)),
    "tube_share": (0.0, 1.0),
}
"""Lowest and highest values by attribute; other attributes may be any finite number."""

HDRM = HdrmParameters()
"""The manipulator of the study."""

PAYLOAD = 470.0
"""Payload of the study, kg."""
