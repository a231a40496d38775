"""What a run says of connections that are one step late: those that delay a value, not each sampled one."""

from collections.abc import Iterator
from pathlib import Path

import pytest

import emla_cosim as ec
from emla_cosim.run.result import Result
from emla_cosim.views.formatting import describe_stepping
from tests.support.axis import axis
from tests.support.coupled_systems import drive


@pytest.fixture(scope="module")
def lift(fmu_folder: Path) -> Iterator[ec.Simulation]:
    with ec.load("lift", stop_time=0.02, fmus=fmu_folder).prepare() as simulation:
        yield simulation


@pytest.fixture(scope="module")
def slide(fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ec.Simulation]:
    with ec.load(axis(tmp_path_factory.mktemp("axis"), fmu_folder)).prepare() as simulation:
        yield simulation


def late(result: Result) -> list[str]:
    """The lines of the terminal on late connections."""
    return [line for line in describe_stepping(result) if "late" in line]


def test_held_values_of_a_sampled_controller_are_not_reported(lift: ec.Simulation) -> None:
    result = lift.run()
    assert len(result.stepping["late_connections"]) > 5 and late(result) == []


def test_delays_that_another_order_avoids_are_reported(lift: ec.Simulation) -> None:
    """Jacobi delays measurement and reference, too; what the controller holds is not counted."""
    result = lift.run(algorithm="jacobi")
    feedback = set(lift.run().stepping["late_connections"])
    avoided = [name for name in result.stepping["late_connections"] if name not in feedback]
    (line,) = late(result)
    assert line == f"One step (0.0001 s) late: {avoided[0]} and {len(avoided) - 1} more, in run.json"


def test_systems_without_delays_have_no_line(slide: ec.Simulation) -> None:
    assert late(slide.run()) == late(slide.run(estimate_coupling=False)) == []


def test_delay_between_continuous_components_is_reported(slide: ec.Simulation) -> None:
    """The estimate is that of exchanged signals, and shows no error of a component that only reads."""
    result = slide.run(algorithm="jacobi")
    assert late(result) == ["One step (0.001 s) late: gantry.motion.x_d -> gantry.slide.command"]
    summary = result.record["coupling"]["summary"]
    assert summary.startswith("Estimated coupling error: less than 0.001 % of the range of")


def test_steps_of_error_control_have_no_size(slide: ec.Simulation) -> None:
    result = slide.run(algorithm="jacobi", error_tolerance=1e-3)
    assert late(result) == ["One step late: gantry.motion.x_d -> gantry.slide.command"]


def test_loops_have_an_estimate_instead() -> None:
    with ec.load(drive().system, stop_time=0.05, step_size=1e-3).prepare() as simulation:
        result = simulation.run(algorithm="jacobi")
        assert late(result) == [] and result.record["coupling"]["estimated_error"] > 0.0
        (line,) = late(simulation.run(estimate_coupling=False))
    assert line == "Coupling error not estimated: it is switched off; one step late: motor.tau -> rotor.tau"
