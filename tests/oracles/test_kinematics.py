"""Where the manipulator is, against geometry written in another way and against differences."""

import math

import numpy as np
import pytest
from hypothesis import given, settings

from hdrm_fmu import HDRM, HdrmParameters, kinematics
from tests.support.machines import STROKES, machines


def test_angles_of_the_study_are_those_of_its_triangles() -> None:
    """theta_1 = gamma_1 - 60 deg, theta_2 = gamma_2 - 150 deg."""
    for q in ((0.0, 0.0, 0.0), (0.244, 0.389, 0.499), HDRM.q_UB):
        theta_1, theta_2 = (math.degrees(theta) for theta in kinematics.joint_angles(HDRM, q))
        lift = (1.15**2 + 0.42**2 - (0.85 + q[0]) ** 2) / (2.0 * 1.15 * 0.42)
        tilt = (1.25**2 + 0.45**2 - (1.0 + q[1]) ** 2) / (2.0 * 1.25 * 0.45)
        assert theta_1 == pytest.approx(math.degrees(math.acos(lift)) - 60.0, abs=1e-12)
        assert theta_2 == pytest.approx(math.degrees(math.acos(tilt)) - 150.0, abs=1e-12)


@given(q=STROKES, p=machines())
@settings(max_examples=50)
def test_lever_arms_are_the_slopes_of_strokes_over_angles(q: list[float], p: HdrmParameters) -> None:
    """By differences of fourth order of the angles, which are functions of the strokes."""
    h = 1e-4
    for i in range(2):
        angle = {}
        for k in (-2, -1, 1, 2):
            moved = [x + (k * h if i == j else 0.0) for j, x in enumerate(q)]
            angle[k] = kinematics.joint_angles(p, moved)[i]
        slope = (8.0 * (angle[1] - angle[-1]) - (angle[2] - angle[-2])) / (12.0 * h)
        assert kinematics.lever_arms(p, q)[i] == pytest.approx(1.0 / slope, rel=1e-8)


@given(q=STROKES, p=machines())
@settings(max_examples=50)
def test_posture_and_angles_say_the_same(q: list[float], p: HdrmParameters) -> None:
    """Directions come without the angles: booms, and the tip at their end."""
    theta_1, theta_2 = kinematics.joint_angles(p, q)
    O_2 = p.lift_length * np.exp(1j * theta_1)
    tip = O_2 + (p.reach + q[2]) * np.exp(1j * (theta_1 + theta_2))
    assert complex(*kinematics.tip(p, q)) == pytest.approx(tip, abs=1e-12)
    assert complex(*kinematics.posture(p, q).O_2) == pytest.approx(O_2, abs=1e-12)


@given(q=STROKES, p=machines())
@settings(max_examples=50)
def test_the_outline_has_the_lengths_of_the_machine(q: list[float], p: HdrmParameters) -> None:
    lines = {name: np.array(points) for name, points in kinematics.outline(p, q).items()}
    sides = {name: np.linalg.norm(np.diff(points, axis=0), axis=1) for name, points in lines.items()}
    L_1, L_2 = p.lift_L_0 + q[0], p.tilt_L_0 + q[1]
    expected = {
        "lift_boom": [p.lift_length],
        "outer_boom": [p.reach],
        "inner_boom": [q[2]],
        "lift_triangle": [p.lift_a, L_1, p.lift_b],
        "tilt_triangle": [p.tilt_a, L_2, p.tilt_b],
        "lift_actuator": [p.lift_L_0, q[0]],
        "tilt_actuator": [p.tilt_L_0, q[1]],
        "telescope_actuator": [p.reach, q[2]],
    }
    assert {n: pytest.approx(x, abs=1e-12) for n, x in expected.items()} == sides
    assert tuple(lines["inner_boom"][-1]) == kinematics.tip(p, q)
    # pins belong to the booms that they turn: the outline turns stiffly with them
    fixed = kinematics.joint_angles(p, q)[0] + p.lift_epsilon
    assert complex(*lines["lift_triangle"][2]) == pytest.approx(p.lift_b * np.exp(1j * fixed), abs=1e-12)
