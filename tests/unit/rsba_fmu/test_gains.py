"""The repaired gains against the rules that they were made by."""

from collections.abc import Mapping
from dataclasses import fields

import pytest

from emla_cosim.study.joints.schema import load_joint
from emla_cosim.study.systems import STUDY
from rsba_fmu.gains import RsbaGains
from tests.support.joint_data import COMPENSATED, DAMPED, EMLAS, PUBLISHED, ROBUST

LOADS = {**{joint: load_joint(joint).load.largest for joint in STUDY}, "prototype": 75e3}
"""The largest load of each joint in N."""
FASTEST = {**dict.fromkeys(STUDY, 0.25 / 1e-4), "prototype": 0.4 * 1e3}
"""How fast the current loops are in rad/s: a part of the rate of samples."""


@pytest.mark.parametrize("joint", ROBUST)
def test_each_loop_is_at_least_twice_as_fast_as_the_one_around_it(joint: str) -> None:
    """Those of the currents are the fastest, at the said part of the rate of samples."""
    position, speed, i_q, i_d = (0.5 * beta for beta in ROBUST[joint].beta)
    assert speed >= 2.0 * position
    assert i_q >= (2.0 if joint in STUDY else 1.3) * speed  # which a sample of delay at 1 kHz leaves
    assert i_q == i_d == FASTEST[joint]


@pytest.mark.parametrize("joint", STUDY)
def test_adaptation_forgets_within_a_second(joint: str) -> None:
    """Time constant 1 / (delta sigma) of (32) without an error; it grows as published for the lift."""
    gains = ROBUST[joint]
    assert [delta * sigma for delta, sigma in zip(gains.delta, gains.sigma, strict=True)] == [1.0] * 4
    assert gains.zeta == PUBLISHED["lift"].zeta


REPAIRS = {"feed_acceleration", "freeze_adaptation", "limit_acceleration", "limit_current", "limit_voltage"}
COMPENSATIONS = {"limit_speed", "compensate", "weaken_field", "measure_supply"}
"""Switches that the sets turn on; x_2d_in_a_1 is one that they turn off."""


@pytest.mark.parametrize(
    ("gains", "on"),
    [
        (PUBLISHED, {"x_2d_in_a_1"}),
        (ROBUST, REPAIRS),
        (COMPENSATED, REPAIRS | COMPENSATIONS),
        (DAMPED, REPAIRS | COMPENSATIONS),
    ],
    ids=["published", "robust", "compensated", "damped"],
)
def test_each_set_has_its_switches(gains: Mapping[str, RsbaGains], on: set[str]) -> None:
    for joint in gains:
        switches = [f.name for f in fields(RsbaGains) if f.type is bool]
        assert {name for name in switches if getattr(gains[joint], name)} == on


@pytest.mark.parametrize("joint", ROBUST)
def test_motor_can_brake_with_a_max_against_its_load(joint: str) -> None:
    """Torque that is left beside the load's, per equivalent inertia (5)."""
    emla = EMLAS[joint]
    spare_torque = emla.tau_max - emla.D_eq * abs(LOADS[joint])
    assert 0.0 < ROBUST[joint].a_max <= spare_torque / emla.A_eq
