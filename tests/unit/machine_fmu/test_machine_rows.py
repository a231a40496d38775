"""Equations of machines give the same on arrays of poses, on symbols, and on floats."""

import casadi
import numpy as np
import pytest

from emla_cosim.study.machines.schema import load_machine
from machine_fmu.model import MachineModel

ROWS = 20


@pytest.mark.parametrize("name", ["excavator", "hdrm", "lift_table", "stewart"])
def test_arrays_and_symbols_have_the_same_forces_and_energies(name: str) -> None:
    model = MachineModel(load_machine(name))
    n, draw = len(model.names), np.random.default_rng(5)
    low, start, high = (np.array(x) for x in (model.q_LB, model.start, model.q_UB))
    q = np.clip(start + 0.05 * (high - low) * draw.uniform(-1.0, 1.0, (ROWS, n)), low, high)
    v, a = draw.uniform(-0.2, 0.2, (ROWS, n)), draw.uniform(-1.0, 1.0, (ROWS, n))
    masses = draw.uniform(10.0, 500.0, ROWS)
    x = model.find_unknowns(q, masses)
    symbols = [casadi.SX.sym(f"s{i}", count) for i, count in enumerate((n, x.shape[1], n, n))]
    (q_i, x_i, v_i, a_i), m = map(casadi.vertsplit, symbols), casadi.SX.sym("m")
    forces = casadi.Function("f", [*symbols, m], [casadi.vertcat(*model.inverse(q_i, x_i, v_i, a_i, m))])
    energy = casadi.Function("e", [*symbols[:3], m], [model.energy_of(q_i, x_i, v_i, m)])
    columns = [values.T for values in (q, x, v, a)]
    for actual, function, arguments in (
        (model.forces(q, v, a, masses), forces, columns),
        (model.energy(q, v, masses)[:, None], energy, columns[:3]),
    ):
        expected = np.array(function.map(ROWS)(*arguments, masses[None])).T
        assert actual == pytest.approx(expected, rel=1e-13, abs=1e-13 * np.abs(expected).max())


def test_poses_that_do_not_close_are_nan_without_a_warning(recwarn: pytest.WarningsRecorder) -> None:
    model = MachineModel(load_machine("hdrm"), {"screw.q_UB[1]": 0.9})
    forces = model.holding_forces(np.array([[0.9, 0.1, 0.1], [0.1, 0.1, 0.1]]))
    assert np.isnan(forces[0]).any() and np.isfinite(forces[1]).all()
    assert not recwarn.list
