"""Coefficients that follow from the parameters, against figures that the paper prints elsewhere."""

import pytest

from emla_fmu import motion_law
from tests.support.joint_data import EMLAS, LIFT, PROTOTYPE, TELESCOPE, TILT


@pytest.mark.parametrize(
    ("emla", "alpha", "inertia"), [(LIFT, 2199, 35.26), (TILT, 3142, 33.01), (TELESCOPE, 628, 0.582)]
)
def test_equivalent_coefficients(emla: object, alpha: float, inertia: float) -> None:
    assert emla.alpha_RL == pytest.approx(alpha, rel=1e-3)
    assert emla.A_eq == pytest.approx(inertia, rel=1e-3)
    # A_eq is torque per acceleration: alpha A_eq is the mass that the load feels
    assert emla.alpha_RL * emla.A_eq == pytest.approx(emla.alpha_RL**2 * emla.J_m + emla.M_BS, rel=1e-12)


def test_prototype_efficiency_makes_35_newton_metres_hold_75_kilonewtons() -> None:
    assert PROTOTYPE.D_eq * 75e3 == pytest.approx(35.0, rel=0.02)


@pytest.mark.parametrize("emla", EMLAS.values(), ids=EMLAS)
def test_inverter_can_drive_the_motor_at_full_speed(emla: object) -> None:
    assert emla.N_p * emla.alpha_RL * emla.v_max * emla.Phi_PM < emla.u_max


def test_stiffness_as_printed_ties_the_load_to_the_ground() -> None:
    """1e9 N m/m for realistic stiffnesses: a motor of 190 N m could not move a micrometre."""
    linear = motion_law.k_L(bearing=1e9, screw=5e8, nut=8e8, tube=2e9)
    assert linear == pytest.approx(1 / (1 / 1e9 + 1 / 5e8 + 1 / 8e8 + 1 / 2e9))
    stiffness = motion_law.C_eq(LIFT.alpha_RL, LIFT.rho, (1e5, 1e5, 1e5), linear)
    assert LIFT.tau_max / stiffness < 1e-6
