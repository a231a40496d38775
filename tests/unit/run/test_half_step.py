"""Half the step of what is continuous: sampled components keep their behavior, or the reason is given."""

from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.run.half_step import HalfStep, NotHalvedError, halve_step

SAMPLERS = ("disturbance", "observer", "controller")
SAMPLED = {f"lift.{name}": 1 for name in SAMPLERS}


@pytest.fixture(scope="module")
def lift() -> ec.Simulation:
    return ec.load("lift", stop_time=0.03).prepare()


@pytest.mark.parametrize("options", [{}, {"algorithm": "strong", "step_multiples": SAMPLED}])
def test_drive_with_a_digital_controller_keeps_its_bits(options: dict[str, Any], lift: ec.Simulation) -> None:
    """All that is exchanged in its loop is sampled, so there is no error of the coupling.

    The plant does the same internal steps of 50 µs. A controller at 20 kHz gives another motion.
    """
    full_run = lift.run(**options)
    half = halve_step(lift, options)
    assert half.samplers == SAMPLED and half.step == 1e-4
    halved = lift.run(**{**options, **half.options})
    assert halved.steps == 2 * full_run.steps and np.array_equal(halved.time, full_run.time)
    assert all(np.array_equal(halved[name], full_run[name]) for name in full_run.names)
    faster = lift.run(**{**options, "step_size": 5e-5})
    assert np.abs(faster["lift.plant.i_q"] - full_run["lift.plant.i_q"]).max() > 0.1


def test_multiples_and_rows_keep_their_times() -> None:
    simulation = ec.load("prototype", stop_time=0.02).prepare()
    options = {"output_interval": 2e-3}
    half = halve_step(simulation, options)
    assert half.options["output_interval"] == 2e-3 and half.options["step_size"] == 5e-5
    multiples = {"disturbance": 2, "observer": 20, "controller": 20}
    assert half.options["step_multiples"] == {f"prototype.{name}": n for name, n in multiples.items()}
    full_run, halved = simulation.run(**options), simulation.run(**{**options, **half.options})
    assert all(np.array_equal(halved[name], full_run[name]) for name in full_run.names)


REASONS: list[tuple[dict[str, Any], str]] = [
    ({"algorithm": "jacobi"}, "lift.controller samples lift.reference.x_d one step late, and half the step"),
    ({"algorithm": "strong"}, "lift.disturbance samples, .*; set --step-multiple lift.disturbance=1"),
    ({"error_tolerance": 1e-3}, "the step size is controlled"),
    ({"set": {"lift.plant.sensor.sigma": 1e-6}}, r"lift.plant draws random numbers in each step \("),
    ({"algorithm": ec.GaussSeidel()}, "the algorithm is an object"),
]


@pytest.mark.parametrize(("options", "reason"), REASONS)
def test_run_whose_step_cannot_be_halved_has_a_reason(
    options: dict[str, Any], reason: str, lift: ec.Simulation
) -> None:
    with pytest.raises(NotHalvedError, match=reason):
        halve_step(lift, options)


@pytest.mark.parametrize(
    ("order", "change", "suggested"),
    [
        (1, 1.5, "set --step-size 0.0005 --step-multiple c=20"),
        (1, 5.1, "set --step-size 0.0001 --step-multiple c=100"),
        (2, 5.1, "set --step-size 0.0002 --step-multiple c=50"),
        (1, 1e4, "choose a --step-size far below 1e-06"),
    ],
)
def test_suggested_step_follows_from_the_order(order: int, change: float, suggested: str) -> None:
    assert HalfStep({}, 1e-3, {"c": 10}, order, is_held=True).suggest(change) == suggested
    without = HalfStep({}, 1e-3, {}, order, is_held=True).suggest(change)
    assert without.endswith(" or --extrapolation fmu")
