"""The paper's manipulator by its numbers, and its points by the law of cosines."""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Manipulator:
    """Numbers of the manipulator as `hdrm.toml` has them, written a second time.

    `former_names` has the names of the file. Tuples are of lift, tilt and telescope. Lift and tilt close a
    triangle each, with the sides a (to the fixed pin), b (to the boom pin) and L_0 + stroke.
    """

    lift_a: float = 1.15
    lift_b: float = 0.42
    lift_L_0: float = 0.85
    lift_delta: float = math.radians(-70.0)
    lift_epsilon: float = math.radians(-10.0)
    tilt_a: float = 1.25
    tilt_b: float = 0.45
    tilt_L_0: float = 1.00
    tilt_delta: float = math.radians(-170.0)
    tilt_epsilon: float = math.radians(-20.0)
    lift_length: float = 1.80
    lift_m: float = 160.0
    lift_c: float = 0.85
    lift_J: float = 43.2
    outer_m: float = 120.0
    outer_c: float = 0.65
    outer_J: float = 22.5
    reach: float = 1.65
    inner_m: float = 60.0
    inner_c: float = 0.75
    inner_J: float = 11.25
    payload_J: float = 0.06
    M_BS: tuple[float, float, float] = (156.5, 83.6, 30.4)
    tube_share: float = 0.3
    motor_m: tuple[float, float, float] = (45.0, 30.0, 12.0)
    housing_c: tuple[float, float, float] = (0.34, 0.40, 0.50)
    housing_J: tuple[float, float, float] = (9.3, 7.4, 2.8)
    tube_c: tuple[float, float, float] = (0.34, 0.40, 0.75)
    tube_J: tuple[float, float, float] = (2.8, 2.1, 0.8)
    q_LB: tuple[float, float, float] = (0.0, 0.0, 0.0)
    q_UB: tuple[float, float, float] = (0.522, 0.611, 1.0)
    gravity: float = 9.81


HDRM = Manipulator()


def joint_angles(p: Manipulator, q: Sequence[float]) -> tuple[float, float]:
    """Angles of the lift boom against the horizontal and of the outer boom against the lift boom, rad."""

    def angle(a: float, b: float, L: float) -> float:
        return math.acos((a * a + b * b - L * L) / (2.0 * a * b))

    return (
        p.lift_delta + angle(p.lift_a, p.lift_b, p.lift_L_0 + q[0]) - p.lift_epsilon,
        p.tilt_delta + angle(p.tilt_a, p.tilt_b, p.tilt_L_0 + q[1]) - p.tilt_epsilon,
    )


def points(p: Manipulator, q: Sequence[float]) -> dict[str, complex]:
    """The moving points in the complex plane."""
    theta_1, theta_2 = joint_angles(p, q)
    along, boom = cmath.exp(1j * theta_1), cmath.exp(1j * (theta_1 + theta_2))
    elbow = p.lift_length * along
    return {
        "A_1": p.lift_a * cmath.exp(1j * p.lift_delta),
        "B_1": p.lift_b * along * cmath.exp(1j * p.lift_epsilon),
        "O_2": elbow,
        "A_2": elbow + p.tilt_a * along * cmath.exp(1j * p.tilt_delta),
        "B_2": elbow + p.tilt_b * boom * cmath.exp(1j * p.tilt_epsilon),
        "tip": elbow + (p.reach + q[2]) * boom,
    }
