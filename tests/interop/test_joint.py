"""The joint is such that running it shows what the other tests of this folder claim."""

from dataclasses import replace

import numpy as np

from emla_cosim.master.algorithms.jacobi import Jacobi
from emla_cosim.master.assembly import Assembly
from tests.support.joint_run import STEP, Case, differences, our_run, study_joint


def test_it_sets_no_enumeration(case: Case) -> None:
    """libcosim and ecos cannot: they warn, and the FMU keeps its default."""
    variables = case.variables()
    types = {f"{c.name}.{n}": variables[c.name][n].type for c in case.system.components for n in c.parameters}
    assert set(types.values()) == {"Real", "Integer", "Boolean"}


def test_every_signal_moves_in_one_joint_but_the_constant_load(case: Case) -> None:
    """What rests would agree with anything."""
    still = np.ptp(our_run(case, "jacobi"), axis=0) == 0.0
    resting = {".".join(s) for s, at_rest in zip(case.signals, still, strict=True) if at_rest}
    off = {"lift.disturbance.supply.sag", "lift.plant.inverter.u_available", "lift.observer.d_hat"}
    assert resting == {"lift.disturbance.F_L", *(off if case.system == study_joint() else ())}


def test_the_order_of_exchange_shows(case: Case) -> None:
    found = differences(case, our_run(case, "gauss-seidel"), our_run(case, "jacobi"))
    assert max(found.values()) > 0.1


def test_the_moving_joint_begins_within_the_limits_and_the_study_at_them(case: Case) -> None:
    with Assembly(case.system, case.fmus) as assembly:
        master = Jacobi()
        master.setup(assembly.network)
        master.initialize(0.0, STEP)
        saturated = assembly.network.signals[assembly.network.names.index("lift.controller.saturated")]
    assert saturated == (1.0 if case.system == study_joint() else 0.0)


def test_the_length_of_steps_shows(case: Case) -> None:
    other = replace(case, step=2.0**-13)
    found = differences(case, our_run(other, "jacobi"), our_run(case, "jacobi"))
    assert max(found.values()) > 1e-3
