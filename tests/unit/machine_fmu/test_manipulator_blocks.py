"""The blocks of the paper's manipulator: against Lagrange's equations, against three actuators, and over ten
seconds of free motion."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emla_cosim.fmu.models import MODELS
from emla_fmu import EmlaPlant
from fmublock import StepDiscardedError
from tests.support.in_process import started
from tests.support.joint_data import LIFT, TELESCOPE, TILT
from tests.support.machines import MOMENTS, Moment, three
from tests.support.reference_manipulator import LAGRANGIAN
from tests.support.sessions import Session

HdrmManipulator, HdrmPlant = MODELS["HdrmManipulator"], MODELS["HdrmPlant"]
EMLAS = (LIFT, TILT, TELESCOPE)
TORQUES = st.lists(st.floats(-100.0, 100.0), min_size=3, max_size=3)


def parameters(block: Any) -> dict[str, Any]:
    """Parameters by the last part of their name."""
    return {str(p.name).rpartition(".")[2]: p for p in block.layout().parameters}


# ---- the same numbers and equations as elsewhere -----------------------------------------------


def test_actuators_match_the_joints() -> None:
    actual = parameters(HdrmPlant)
    mechanics = ("J_m", "B_m", "J_c", "rho", "J_GB", "eta_GB", "lead", "M_BS", "B_BS", "C_eq")
    for name in (*mechanics, "q_LB", "q_UB", "v_max"):
        assert actual[name].start == [getattr(emla, name) for emla in EMLAS], name


@given(m=MOMENTS)
@settings(max_examples=25)
def test_equations_match_lagrange(m: Moment) -> None:
    load = started(HdrmManipulator, {"payload.m": m.payload, "x_L": m.q, "v_L": m.v, "a_L": m.a})
    forces = LAGRANGIAN.forces(m.q, m.v, m.a, m.payload)
    assert load["F_L"] == pytest.approx(forces, rel=1e-10, abs=1e-10 * max(map(abs, forces)))
    tip = LAGRANGIAN.at(m.q, m.v, m.payload)[3]
    assert (load["tip.x"], load["tip.y"]) == pytest.approx(tip, abs=1e-12)
    motion = {"start.x_L": m.q, "start.v_L": m.v, "tau_m": [20.0, -5.0, 2.0]}
    plant = started(HdrmPlant, {"payload.m": m.payload, **motion})
    given_force = LAGRANGIAN.forces(m.q, m.v, plant["a_L"], m.payload)
    assert plant["F_L"] == pytest.approx(given_force, rel=1e-10, abs=1e-9 * max(map(abs, given_force)))


# ---- the merged plant is three plants and a manipulator -----------------------------------------


@given(m=MOMENTS, tau_m=TORQUES, d_2=three(3.0), F_2=three(0.3))
@settings(max_examples=25)
def test_it_accelerates_as_three_plants_under_its_load_force(
    m: Moment, tau_m: list[float], d_2: list[float], F_2: list[float]
) -> None:
    more = {"screw.B_BS": [50.0, 40.0, 30.0], "screw.C_eq": [2.0, 1.0, 0.5], "uncertainty.F_2": F_2}
    start = {"payload.m": m.payload, "start.x_L": m.q, "start.v_L": m.v}
    merged = started(HdrmPlant, {"tau_m": tau_m, "d_2": d_2, **start, **more})
    for i, emla in enumerate(EMLAS):
        motor = {f"motor.{name}": getattr(emla, name) for name in ("N_p", "Phi_PM", "J_m")}
        screw = {"gearbox.rho": emla.rho, "screw.lead": emla.lead, "screw.M_BS": emla.M_BS}
        acting = {
            "i_q_ref": tau_m[i] / (1.5 * emla.N_p * emla.Phi_PM),
            "F_L": merged["F_L"][i],
            "d_2": d_2[i],
            "use_commanded_current": True,
        }
        changed_values = {name: values[i] for name, values in more.items()}
        start = {"start.x_L": m.q[i], "v_L": m.v[i]}
        plant = started(EmlaPlant, motor | screw | acting | changed_values | start)
        assert plant["tau_m"] == pytest.approx(tau_m[i], rel=1e-14)
        assert merged["a_L"][i] == pytest.approx(plant["a_L"], rel=1e-9, abs=1e-9)


# ---- energy -------------------------------------------------------------------------------------

HANGING = {
    "lift.delta": -np.pi,  # so that the booms hang down within the strokes
    "tilt.delta": -1.9,
    **{f"motor.J_m[{i}]": 0.0 for i in (1, 2, 3)},
    **{f"motor.B_m[{i}]": 0.0 for i in (1, 2, 3)},
    "start.x_L[1]": 0.15,
    "start.x_L[2]": 0.45,
    "start.x_L[3]": 0.2,
    "start.v_L[1]": 0.1,
    "start.v_L[2]": -0.1,
    "screw.C_eq[3]": 12.0,  # a spring that carries the payload
    "screw.q_UB[3]": 3.0,
    **{f"screw.v_max[{i}]": 10.0 for i in (1, 2, 3)},
    "solver.internal_step": 1e-4,
}


def test_energy_is_conserved_over_ten_seconds_of_free_motion(sessions: dict[str, Session]) -> None:
    """Booms that swing, and a payload on a spring, of which the block's energy knows nothing."""
    session = sessions["HdrmPlant"]
    session.log.all.clear()
    plant = session.instance("free", **HANGING)
    names = [f"x_L[{i}]" for i in (1, 2, 3)]
    rows = []
    for k in range(1001):
        rows.append(session.get(plant, "energy", *names))
        plant.doStep(k * 0.01, 0.01)
    assert session.log.lines("free") == []  # no limit was left
    energy, *x = np.array(rows).T
    stiffness = 12.0 * 2.0 * np.pi / 0.01 * 0.9
    total = energy + 0.5 * stiffness * x[2] ** 2
    assert np.ptp(total) <= 1e-9 * np.ptp(energy)
    # and the machine moves
    assert np.all(np.ptp(x, axis=1) > 0.1)
    assert np.ptp(energy) > 1e3


# ---- what leaves the machine --------------------------------------------------------------------


def test_step_beyond_the_triangle_is_discarded() -> None:
    plant = started(HdrmPlant, {"tau_m": [2000.0, 8.0, -6.0]})
    time = 0.0
    with pytest.raises(StepDiscardedError, match=r"x_L\[\d\] became nan"):
        for k in range(200):
            time = k * 0.01
            plant.do_step(time, 0.01)
    assert plant["x_L"][0] + 0.85 < 1.15 + 0.42
    assert plant.left_limits()[0].startswith("HdrmPlant: x_L[1] = ")
