"""The numbers of the paper's tables, written down from its pages, against what the scenarios simulate.

Rows are in the order of the paper; columns are lift, tilt and telescope. Its label of each table is
given, and the number of each equation as it is printed.
"""

import math
from collections.abc import Mapping
from typing import Any

import pytest

from emla_cosim.study.joints.schema import load_joint
from emla_cosim.study.loading import load
from tests.support.joint_data import EMLAS, PROTOTYPE, PUBLISHED

JOINTS = ("lift", "tilt", "telescope")
Row = tuple[float, float, float]

EMLA_DETAILS: Mapping[str, Row] = {
    "F_c": (89.8e3, 68.6e3, 6.1e3),
    "v_max": (136e-3, 100e-3, 210e-3),
    "M_BS": (156.5, 83.6, 30.4),
    "l": (0.02, 0.01, 0.01),
    "1/rho": (7, 5, 1),
    "J_m": (0.016, 0.0105, 0.00085),
    "tau_max": (190, 129, 32),
    "u_N": (315, 300, 600),
    "R_s": (0.14, 0.16, 0.35),
    "L_N": (2.4e-3, 3.2e-3, 12e-3),
    "Phi_PM": (0.15, 0.13, 0.12),
    "N_p": (8, 8, 6),
}
"""Table EMLA_details: technical data."""

GAINS: Mapping[str, Row] = {
    "x_L(0)": (0.24, 0.385, 0.5),
    "v_L(0)": (0, 0, 0),
    "i_q(0)": (0, 0, 0),
    "i_d(0)": (0, 0, 0),
    "beta_12": (3000, 2000, 800),
    "zeta_12": (100, 100, 0.001),
    "delta_12": (100, 100, 1),
    "sigma_12": (0.001, 0.001, 1),
    "beta_34": (1000, 750, 420),
    "zeta_34": (100, 80, 1),
    "delta_34": (110, 80, 0.5),
    "sigma_34": (0.01, 0.01, 1),
}
"""Table gains: initial values, and parameters of the RSBA control."""

OBSERVER = {
    "alpha_1": 0.3192,
    "alpha_2": 0.3129,
    "Q_11": 0.7752,
    "Q_12": -0.0775,
    "Q_22": 0.3949,
    "H_0": 20.0,  # of 20 cos(y)^4 + 20 sin(y)^4
    "ell": 1.0,
    "m_0": 200.0,
    "m_decay": 0.001,
}
"""(101) and (102), for all joints; and m = 200 exp(-0.001 t)."""

X_HAT, ETA_HAT = (0.24, 0.358, 0.5), (1, 0.5, 0.2)
"""(103): start values of the observer."""

MOTION: Mapping[str, Row] = {
    "q_S": (0.244, 0.389, 0.499),
    "q_E": (0.270, 0.442, 0.348),
    "v_E": (0.0607, -0.0808, -0.5477),
}
"""Table motion generation."""

EXPERIMENT = {
    "beta": (15.0, 1500.0, 5.0, 1.0),
    "zeta": (100.0, 100.0, 100.0, 100.0),
    "delta": (100.0, 100.0, 100.0, 100.0),
    "sigma": (0.001, 0.001, 0.001, 0.001),
}
"""Section V: parameters of the RSBA control in the experiments."""

TABLE_VII = {
    "PM Magnetic Flux": 0.134,
    "Number of Pole Pairs": 4,
    "Peak Torque": 77,
    "Maximum Speed": 3877,
    "Phase Resistance": 0.08,
    "Phase Inductance": 2.42e-3,
    "Gear Ratio": 7.7,
    "Screw Lead": 16e-3,
}
"""The experimental EMLA."""


STATES = ("x_L", "v_L", "i_q", "i_d")
PLANT_STARTS = [f"start.{state}" for state in STATES]


@pytest.fixture(scope="module")
def simulated() -> dict[str, Mapping[str, Any]]:
    """Start values of every component of the scenario with the paper's gains, by its name."""
    return {c.name: c.parameters for c in load("published").system.components}


def of(table: Mapping[str, Row], joint: str) -> dict[str, float]:
    """One column of a table."""
    return {row: values[JOINTS.index(joint)] for row, values in table.items()}


def joint_parameters(joint: str) -> dict[str, dict[str, float]]:
    """The printed numbers of a joint by component, under the names of our parameters."""
    e, g, m = of(EMLA_DETAILS, joint), of(GAINS, joint), of(MOTION, joint)
    motor = {"R_s": e["R_s"], "L_d": e["L_N"], "L_q": e["L_N"], "Phi_PM": e["Phi_PM"], "N_p": e["N_p"]}
    u_max = math.sqrt(2.0) * e["u_N"]
    k = JOINTS.index(joint)
    return {
        "plant": {
            **{f"start.{state}": g[f"{state}(0)"] for state in STATES},
            **{f"motor.{name}": value for name, value in motor.items()},
            "motor.J_m": e["J_m"],
            "gearbox.rho": 1.0 / e["1/rho"],
            "screw.lead": e["l"],
            "screw.M_BS": e["M_BS"],
            "inverter.u_max": u_max,
            **{f"uncertainty.F_{i}": 1 / part for i, part in ((2, 100), (3, 500), (4, 1000))},  # (100)
        },
        "controller": {
            **{
                f"{gain}[{i}]": g[f"{gain}_12" if i < 3 else f"{gain}_34"]
                for gain in ("beta", "zeta", "delta", "sigma")
                for i in range(1, 5)
            },
            **{f"model.{name}": value for name, value in motor.items()},
            "model.alpha_RL": 2.0 * math.pi * e["1/rho"] / e["l"],
            "limit.i_max": e["tau_max"] / (1.5 * e["N_p"] * e["Phi_PM"]),
            "limit.u_max": u_max,
        },
        "observer": {**OBSERVER, "start.x_hat": X_HAT[k], "start.eta_hat": ETA_HAT[k]},
        "reference": {"waypoint[1]": m["q_S"], **{f"waypoint[{i}]": m["q_E"] for i in range(2, 10)}},
    }


@pytest.mark.parametrize("joint", JOINTS)
def test_parameters_of_a_joint_match_the_tables(joint: str, simulated: dict[str, Mapping[str, Any]]) -> None:
    for component, expected in joint_parameters(joint).items():
        values = dict.fromkeys(PLANT_STARTS, 0.0) | dict(simulated[f"{joint}.{component}"])
        assert {name: values[name] for name in expected} == pytest.approx(expected, rel=1e-14), component


def test_gains_of_the_experiments() -> None:
    assert {name: getattr(PUBLISHED["prototype"], name) for name in EXPERIMENT} == EXPERIMENT


def test_experimental_emla() -> None:
    """With the flux read as rms, from which the rated torque follows."""
    printed = TABLE_VII
    expected = {
        "Phi_PM": math.sqrt(2.0) * printed["PM Magnetic Flux"],
        "N_p": printed["Number of Pole Pairs"],
        "tau_max": printed["Peak Torque"],
        "v_max": printed["Maximum Speed"] / 60.0 / printed["Gear Ratio"] * printed["Screw Lead"],
        "R_s": printed["Phase Resistance"],
        "L_d": printed["Phase Inductance"],
        "L_q": printed["Phase Inductance"],
        "rho": 1.0 / printed["Gear Ratio"],
        "lead": printed["Screw Lead"],
    }
    assert {name: getattr(PROTOTYPE, name) for name in expected} == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("joint", JOINTS)
def test_speeds_and_loads(joint: str) -> None:
    """The reference is as fast as printed, but within the EMLA's bound; the load is too."""
    printed = of(EMLA_DETAILS, joint)
    assert EMLAS[joint].v_max == printed["v_max"]
    assert load_joint(joint).reference.peak == min(abs(of(MOTION, joint)["v_E"]), printed["v_max"])
    assert abs(load_joint(joint).load.largest) <= printed["F_c"]
