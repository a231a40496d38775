"""The manipulator's points, written a second time."""

import cmath
import math
from typing import Any

from hdrm_fmu.parameters import HdrmParameters


def points(p: HdrmParameters, q: Any) -> dict[str, complex]:
    """The moving points in the complex plane, from the law of cosines."""

    def angle(a: float, b: float, L: float) -> float:
        return math.acos((a * a + b * b - L * L) / (2.0 * a * b))

    theta_1 = p.lift_delta + angle(p.lift_a, p.lift_b, p.lift_L_0 + q[0]) - p.lift_epsilon
    along = cmath.exp(1j * theta_1)
    boom = along * cmath.exp(
        1j * (p.tilt_delta + angle(p.tilt_a, p.tilt_b, p.tilt_L_0 + q[1]) - p.tilt_epsilon)
    )
    elbow = p.lift_length * along
    return {
        "A_1": p.lift_a * cmath.exp(1j * p.lift_delta),
        "B_1": p.lift_b * along * cmath.exp(1j * p.lift_epsilon),
        "O_2": elbow,
        "A_2": elbow + p.tilt_a * along * cmath.exp(1j * p.tilt_delta),
        "B_2": elbow + p.tilt_b * boom * cmath.exp(1j * p.tilt_epsilon),
        "tip": elbow + (p.reach + q[2]) * boom,
    }
