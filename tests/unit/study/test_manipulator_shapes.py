"""The drawn manipulator has the actuators, the reach and the payload of the kinematics."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from matplotlib.path import Path

from emla_cosim.study.sketch.shapes import build_shapes
from emla_cosim.study.sketch.workspace import outline_workspace
from hdrm_fmu import HDRM, HdrmParameters
from hdrm_fmu.kinematics import joint_angles, outline, tip

STROKES = np.random.default_rng(3).uniform(HDRM.q_LB, HDRM.q_UB, (40, 3))

OTHERS = (
    HDRM,
    replace(HDRM, lift_length=1.2, reach=2.4),
    replace(HDRM, lift_delta=math.radians(-110.0), tilt_epsilon=math.radians(10.0)),
    replace(HDRM, q_LB=(0.1, 0.2, 0.3), q_UB=(0.2, 0.25, 0.4)),
    replace(HDRM, q_UB=(0.0001, 0.611, 1.0)),
)
"""Machines whose reach has other forms: a ring that is thin, turned, small, or hardly lifted."""


def middle(line: np.ndarray) -> np.ndarray:
    return line.min(axis=0) / 2 + line.max(axis=0) / 2


@pytest.mark.parametrize("q", STROKES[:3].tolist())
def test_pins_and_payload_are_where_the_kinematics_have_them(q: list[float]) -> None:
    lines, drawn = outline(HDRM, q), build_shapes(HDRM, q)
    assert middle(drawn["O_2"]) == pytest.approx(lines["lift_boom"][1])
    assert middle(drawn["B_2"]) == pytest.approx(lines["tilt_actuator"][2])
    assert drawn["payload"].mean(axis=0) == pytest.approx(tip(HDRM, q), abs=1e-12)


@pytest.mark.parametrize("q", STROKES[:3].tolist())
def test_actuators_are_as_long_as_their_pins_are_apart(q: list[float]) -> None:
    drawn = build_shapes(HDRM, q)
    for joint, number, rest in (("lift", 1, HDRM.lift_L_0), ("tilt", 2, HDRM.tilt_L_0)):
        pins = [middle(drawn[f"{end}_{number}"]) for end in "AB"]
        assert math.dist(*pins) == pytest.approx(rest + q[number - 1], abs=1e-12)
        tube = drawn[f"{joint}_tube"]
        length = max(math.dist(a, b) for a in tube for b in tube)
        assert length == pytest.approx(rest + q[number - 1] + 0.06, abs=2e-3)  # and its round ends
        housing = drawn[f"{joint}_housing"]
        assert max(math.dist(a, b) for a in housing for b in housing) == pytest.approx(rest + 0.12, abs=2e-3)


def test_the_box_grows_with_the_payload() -> None:
    sides = [
        np.ptp(build_shapes(HDRM, STROKES[0], kg)["payload"], axis=0).max() for kg in (0.0, 470.0, 8 * 470.0)
    ]
    assert sides[0] == 0.0
    assert sides[2] == pytest.approx(2.0 * sides[1])


def test_base_does_not_move() -> None:
    bases = [build_shapes(HDRM, q)["base"] for q in STROKES[:5].tolist()]
    assert all(np.array_equal(base, bases[0]) for base in bases)


@pytest.mark.parametrize("p", OTHERS)
def test_the_workspace_has_every_point_that_the_tip_reaches(p: HdrmParameters) -> None:
    strokes = np.random.default_rng(5).uniform(p.q_LB, p.q_UB, (3000, 3))
    points = [tip(p, q) for q in (*strokes.tolist(), *product(*zip(p.q_LB, p.q_UB, strict=True)))]
    line = Path(outline_workspace(p))
    found = [line.contains_points(points, radius=r) for r in (1e-4, -1e-4)]  # outwards is one of them
    assert np.logical_or(*found).all()


@pytest.mark.parametrize("p", OTHERS)
def test_the_tip_reaches_every_point_of_the_boundary(p: HdrmParameters) -> None:
    line = outline_workspace(p)
    angles = np.array([joint_angles(p, q) for q in (p.q_LB, p.q_UB)])
    lift = np.linspace(angles[0, 0], angles[1, 0], 4001)
    ends = p.lift_length * np.column_stack([np.cos(lift), np.sin(lift)])
    for point in line[::7]:
        boom = point - ends
        reach = np.hypot(*boom.T)
        tilt = np.arctan2(boom[:, 1], boom[:, 0]) - lift
        tilt = tilt - 2.0 * math.pi * np.round((tilt - angles[:, 1].mean()) / (2.0 * math.pi))
        off = np.abs(np.clip(tilt, *angles[:, 1]) - tilt) * reach
        off += np.abs(np.clip(reach, p.reach + p.q_LB[2], p.reach + p.q_UB[2]) - reach)
        assert off.min() < 2e-3


def test_outline_of_the_workspace_is_closed() -> None:
    line = outline_workspace(HDRM)
    steps = np.hypot(*np.diff(line, axis=0, append=line[:1]).T)
    assert steps.max() < 0.15
