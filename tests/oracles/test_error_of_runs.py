"""Error control keeps the error over 10 s within ten times the tolerance, or says that it does not."""

from collections.abc import Callable
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.master.algorithms.registry import ALGORITHMS
from emla_cosim.recorders.recorder import ProgressRecorder
from tests.support import crane, oscillator
from tests.support.rigid_load import rigid_load
from tests.support.tiers import mostly_slow

INTERVAL, STOP = 0.01, 10.0
"""s."""

Exact = Callable[[np.ndarray], dict[str, np.ndarray]]
"""Returns the exact signals by name at times in s."""


def _swing(times: np.ndarray) -> dict[str, np.ndarray]:
    names = ("left.x", "right.x", "left.v", "right.v")
    return {f"oscillator.{n}": x for n, x in zip(names, oscillator.solution(times).T, strict=True)}


def _lift(times: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip(("crane.mechanics.s", "crane.mechanics.v"), crane.solution()[:, 1:3].T, strict=True))


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[ec.Simulation, Exact]]:
    @cache
    def prepare(name: str) -> tuple[ec.Simulation, Exact]:
        folder = tmp_path_factory.mktemp(name)
        system, exact = {
            "oscillator": lambda: (oscillator.system(folder), _swing),
            "crane": lambda: (crane.system(folder), _lift),
        }[name]()
        return ec.load(system, stop_time=STOP, fmus=folder).prepare(), exact

    return prepare


def error_of(result: ec.Result, exact: Exact) -> float:
    """Return the largest error of a signal, relative to its largest value."""
    signals = exact(np.asarray(result.time))
    return max(
        float(np.abs(np.asarray(result[name]) - x).max() / np.abs(x).max()) for name, x in signals.items()
    )


def run(simulation: ec.Simulation, *case: Any) -> ec.Result:
    algorithm, extrapolation, first, tolerance = case
    return simulation.run(
        algorithm=algorithm,
        extrapolation=extrapolation,
        step_size=first,
        error_tolerance=tolerance,
        output_interval=INTERVAL,
    )


def has_remark(result: ec.Result) -> bool:
    return any("the errors of all steps add up to" in remark for remark in result.remarks)


FOLLOWED = [*product(["oscillator", "crane"], ALGORITHMS, [1e-2, 1e-3, 1e-4], [1e-3, 1e-4, 1e-5, 1e-6])]
QUICK = [
    ("oscillator", "jacobi", 1e-2, 1e-3),
    ("oscillator", "gauss-seidel", 1e-2, 1e-5),
    ("oscillator", "strong", 1e-2, 1e-3),
    ("crane", "gauss-seidel", 1e-2, 1e-4),
]


@pytest.mark.parametrize(("system", "algorithm", "first", "tolerance"), mostly_slow(FOLLOWED, QUICK))
def test_followed_inputs_keep_the_tolerance(
    system: str, algorithm: str, first: float, tolerance: float, simulated: Any
) -> None:
    simulation, exact = simulated(system)
    result = run(simulation, algorithm, "fmu", first, tolerance)
    assert error_of(result, exact) < 10.0 * tolerance
    assert not has_remark(result)


WITH_HELD_INPUTS = [
    *product(["oscillator", "crane"], ALGORITHMS, ["none", "master"], [1e-2, 1e-3, 1e-4, 1e-5])
]


@pytest.mark.parametrize(
    ("system", "algorithm", "extrapolation", "tolerance"),
    mostly_slow(WITH_HELD_INPUTS, [("oscillator", "gauss-seidel", "none", 1e-2)]),
)
def test_held_inputs_keep_the_tolerance_or_get_a_remark(
    system: str, algorithm: str, extrapolation: str, tolerance: float, simulated: Any
) -> None:
    """With a million steps at most; at rest, errors of the crane are damped, and their sum is larger."""
    simulation, exact = simulated(system)
    result = run(simulation, algorithm, extrapolation, 1e-2, tolerance)
    error, estimated = error_of(result, exact), result.stepping["estimated_error"]
    assert result.steps < 1.1e6
    assert has_remark(result) == (estimated > 10.0 * tolerance)
    assert error < 3.0 * estimated
    assert error < 10.0 * tolerance or has_remark(result)
    assert system == "crane" or estimated < 3.0 * error


@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("extrapolation", ["none", "fmu"])
def test_coupling_that_diverges_advises_strong(algorithm: str, extrapolation: str) -> None:
    with (
        ec.load(rigid_load(), stop_time=STOP).prepare() as simulation,
        pytest.raises(ec.RunError, match=r"even with a step of .* s\..*Use the algorithm strong"),
    ):
        run(simulation, algorithm, extrapolation, 1e-2, 1e-3)


def test_sampled_components_get_a_note_and_a_remark(fmu_folder: Any) -> None:
    notes = list[str]()
    progress = ec.Progress()
    progress.note = notes.append  # type: ignore[method-assign]
    with ec.load("lift", stop_time=0.05, fmus=fmu_folder).prepare() as simulation:
        result = simulation.run(error_tolerance=1e-3, recorders=[ec.TimeSeries(), ProgressRecorder(progress)])
    assert any("a component samples" in note for note in notes)
    assert any("bounds the error of one step only" in remark for remark in result.remarks)
