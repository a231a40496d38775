"""Where the manipulator of `hdrm.toml` is, against geometry written in another way."""

import math

import numpy as np
import pytest
from hypothesis import given, settings

from emla_cosim.study.machines.schema import load_machine
from machine_fmu.model import MachineModel
from tests.support.machines import STROKES, machines, named_values
from tests.support.manipulator_geometry import HDRM, Manipulator, joint_angles, points

FILE = load_machine("hdrm")
NAMES = {
    "A_1": "ground.A_1",
    "B_1": "lift_boom.B_1",
    "O_2": "outer_boom",
    "A_2": "lift_boom.A_2",
    "B_2": "outer_boom.B_2",
    "tip": "inner_boom",
}


def test_file_has_the_numbers_of_the_study() -> None:
    assert {name: number.value for name, number in MachineModel(FILE).machine.parameters.items()} == (
        pytest.approx(named_values(HDRM), rel=1e-15)
    )


def test_angles_of_the_study_match_its_triangles() -> None:
    """theta_1 = gamma_1 - 60 deg, theta_2 = gamma_2 - 150 deg."""
    strokes = np.array([(0.0, 0.0, 0.0), (0.244, 0.389, 0.499), HDRM.q_UB])
    frames = MachineModel(FILE).frames(strokes)
    for i, q in enumerate(strokes):
        theta_1, theta_12 = (
            math.degrees(math.atan2(*frames[boom][1][i][::-1, 0])) for boom in ("lift_boom", "outer_boom")
        )
        lift = (1.15**2 + 0.42**2 - (0.85 + q[0]) ** 2) / (2.0 * 1.15 * 0.42)
        tilt = (1.25**2 + 0.45**2 - (1.0 + q[1]) ** 2) / (2.0 * 1.25 * 0.45)
        expected = math.degrees(math.acos(lift)) - 60.0, math.degrees(math.acos(tilt)) - 150.0
        assert (theta_1, theta_12 - theta_1) == pytest.approx(expected, abs=1e-12)
        assert np.degrees(joint_angles(HDRM, q.tolist())) == pytest.approx(expected, abs=1e-12)


@given(q=STROKES, p=machines())
@settings(max_examples=25, deadline=None)
def test_points_follow_from_the_law_of_cosines(q: list[float], p: Manipulator) -> None:
    """For any manipulator: each number of the file is the one with its name."""
    positions = MachineModel(FILE, named_values(p)).points(np.array([q]), NAMES.values())
    expected = points(p, q)
    assert {name: complex(*positions[NAMES[name]][0]) for name in NAMES} == {
        name: pytest.approx(at, abs=1e-11) for name, at in expected.items()
    }
