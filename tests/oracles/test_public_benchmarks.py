"""Two public benchmarks of co-simulation against their solutions, in fixed and in controlled steps.

The published reference of the crane's length differs from the solution here by 1.65 um, which is the error
of that reference: it was integrated in steps of 50 us.
"""

from collections.abc import Iterator

import numpy as np
import pytest

import emla_cosim as ec
from tests.support import crane, oscillator


@pytest.fixture(scope="module")
def lifting(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ec.Simulation]:
    folder = tmp_path_factory.mktemp("crane")
    with ec.load(crane.system(folder), stop_time=crane.STOP, step_size=1e-3).prepare() as simulation:
        yield simulation


@pytest.fixture(scope="module")
def swinging(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ec.Simulation]:
    folder = tmp_path_factory.mktemp("oscillator")
    with ec.load(
        oscillator.system(folder), stop_time=oscillator.STOP, step_size=1e-3
    ).prepare() as simulation:
        yield simulation


def test_crane_rests_until_the_valve_moves() -> None:
    """Pressures and valve as printed in the benchmark; and it stays there until the valve moves."""
    assert crane.equilibrium() == pytest.approx((3170846.2, 4529153.8, 0.45434559), rel=2e-8)
    resting = crane.solution()[:201, 1]
    assert resting == pytest.approx(np.full(201, 0.5), abs=1e-9)


@pytest.mark.parametrize(
    ("algorithm", "extrapolation", "step", "error"),
    [
        ("gauss-seidel", "none", 0.04, 0.847),
        ("strong", "none", 0.04, 1.3e-3),
        ("strong", "fmu", 0.04, 6.4e-4),
        ("jacobi", "none", 0.01, 7.8e-4),
        ("gauss-seidel", "fmu", 0.001, 3.8e-7),
        ("strong", "fmu", 0.001, 6.2e-8),
    ],
)
def test_errors_of_the_crane(
    lifting: ec.Simulation, algorithm: str, extrapolation: str, step: float, error: float
) -> None:
    """The largest error of the cylinder's length in m; its range is 96 mm."""
    result = lifting.run(
        algorithm=algorithm, extrapolation=extrapolation, step_size=step, output_interval=max(step, 0.01)
    )
    exact = crane.solution()[:: round(max(step, 0.01) / 0.01), 1]
    actual = np.abs(np.asarray(result["crane.mechanics.s"]) - exact).max()
    assert actual == pytest.approx(error, rel=0.15)
    # Jacobi at 10 ms uses forces that are off by 6 %, although the length is right to 0.8 %
    has_remark = any("Coupling error" in remark for remark in result.remarks)
    if error > 1e-3 or algorithm == "jacobi":
        assert has_remark
    elif error < 1e-5:
        assert not has_remark


def test_jacobi_at_40_ms_does_not_reach_the_end_of_the_crane(lifting: ec.Simulation) -> None:
    with pytest.raises(
        ec.RunError,
        match=r"hydraulics answered doStep at t = 4\.\d+ s with fmi2Discard.*Parts of .* are discarded, too",
    ):
        lifting.run(algorithm="jacobi", step_size=0.04, output_interval=0.04)


@pytest.mark.parametrize(
    ("algorithm", "extrapolation", "tolerance"),
    [("gauss-seidel", "fmu", 1e-2), ("gauss-seidel", "fmu", 1e-3), ("strong", "fmu", 1e-2)],
)
def test_error_control_shortens_steps_when_the_valve_moves(
    lifting: ec.Simulation, algorithm: str, extrapolation: str, tolerance: float
) -> None:
    """After two seconds of rest, in which every step is good enough; the time of the move is not an event."""
    result = lifting.run(
        algorithm=algorithm, extrapolation=extrapolation, error_tolerance=tolerance, output_interval=0.01
    )
    exact = crane.solution()[:, 1]
    error = np.abs(np.asarray(result["crane.mechanics.s"]) - exact).max()
    assert error < 10.0 * tolerance * np.ptp(exact)


@pytest.mark.parametrize(
    ("algorithm", "extrapolation", "error", "gained"),
    [
        ("jacobi", "none", 0.557, 2.289),
        ("gauss-seidel", "none", 0.129, 0.386),
        ("strong", "none", 0.119, -0.230),
        ("strong", "fmu", 7.6e-4, 1.0e-6),
    ],
)
def test_errors_of_the_oscillator(
    swinging: ec.Simulation, algorithm: str, extrapolation: str, error: float, gained: float
) -> None:
    """In steps of 1 ms, as a part of each signal's range; energy should neither come nor go."""
    result = swinging.run(algorithm=algorithm, extrapolation=extrapolation, output_interval=0.01)
    names = [f"oscillator.{name}" for name in ("left.x", "right.x", "left.v", "right.v")]
    actual = np.column_stack([result[name] for name in names])
    exact = oscillator.solution(np.asarray(result["time"]))
    assert (np.abs(actual - exact) / np.ptp(exact, axis=0)).max() == pytest.approx(error, rel=0.05)
    energy = oscillator.energy(actual)
    assert energy[-1] / energy[0] - 1.0 == pytest.approx(gained, rel=0.05)
    estimated = result.record["coupling"]["estimated_error"]
    assert error / 3.0 < estimated < 3.0 * error
    assert any("Coupling error" in remark for remark in result.remarks) == (error > 0.01)
    assert np.ptp(oscillator.energy(exact)) < 1e-6
