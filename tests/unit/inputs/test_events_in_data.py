"""Data with jumps, for discrete variables, and beside the run."""

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from tests.support.hand_written_fmus import build_all_types_fmu, edit_description

STEP = 0.1
TIMES = np.arange(11) * STEP


@pytest.fixture(scope="module")
def integrator(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU with the continuous input u and the output x, its integral."""
    return build_all_types_fmu(tmp_path_factory.mktemp("integrator") / "M.fmu")


def driven(fmu: Path, data: dict[str, list[float]], **settings: str) -> ec.Result:
    """Return a run in which data drive u."""
    source = ec.Input(data=data, signals={"M.u": "u"}, **settings)
    options = {"step_size": STEP, "stop_time": 1.0, "algorithm": "jacobi", "signals": ["input.M.u", "M.x"]}
    with ec.load(str(fmu), input=[source], **options).prepare() as simulation:
        return simulation.run()


@pytest.mark.parametrize("interpolation", ["held", "linear", "cubic"])
def test_two_rows_at_one_time_are_a_jump(integrator: Path, interpolation: str) -> None:
    data = {"time": [0.0, 0.5, 0.5, 1.0], "u": [0.0, 1.0, 3.0, 5.0]}
    result = driven(integrator, data, interpolation=interpolation)
    before, after = {
        "held": (np.zeros(5), np.full(6, 3.0)),
        "linear": (2.0 * TIMES[:5], 3.0 + 4.0 * (TIMES[5:] - 0.5)),
        "cubic": (2.0 * TIMES[:5], 3.0 + 4.0 * (TIMES[5:] - 0.5)),  # two rows: a straight line
    }[interpolation]
    after[-1] = 5.0
    assert result["input.M.u"] == pytest.approx(np.concatenate((before, after)), abs=1e-12)


def test_a_cubic_column_has_a_spline_on_each_side_of_a_jump(integrator: Path) -> None:
    left, right = [0.0, 0.1, 0.2, 0.3, 0.5], [0.5, 0.6, 0.8, 0.9, 1.0]
    values = [0.0, 0.3, 0.1, 0.4, 0.2, 5.0, 5.5, 5.1, 5.3, 5.2]
    result = driven(integrator, {"time": [*left, *right], "u": values}, interpolation="cubic")
    expected = [
        float(CubicSpline(*((left, values[:5]) if t < 0.5 - 1e-9 else (right, values[5:])))(t)) for t in TIMES
    ]
    assert result["input.M.u"] == pytest.approx(expected, abs=1e-12)


def test_equal_rows_change_nothing(integrator: Path) -> None:
    once = driven(integrator, {"time": [0.0, 0.4, 1.0], "u": [0.0, 2.0, 1.0]})
    twice = driven(integrator, {"time": [0.0, 0.4, 0.4, 1.0, 1.0], "u": [0.0, 2.0, 2.0, 1.0, 1.0]})
    assert np.array_equal(once["M.x"], twice["M.x"])


def test_steps_end_at_jumps_under_error_control(integrator: Path) -> None:
    source = ec.Input(
        data={"time": [0.0, 0.437, 0.437, 1.0], "u": [0.0, 0.0, 1.0, 1.0]}, signals={"M.u": "u"}
    )
    options = {"step_size": STEP, "stop_time": 1.0, "error_tolerance": 1e-3}
    with ec.load(str(integrator), input=[source], **options).prepare() as simulation:
        times = simulation.run().time
    assert np.abs(times - 0.437).min() < 1e-12


def test_data_of_discrete_variables_hold(integrator: Path, tmp_path: Path) -> None:
    held = edit_description(
        integrator, tmp_path / "M.fmu", 'causality="input" variability="continuous"',
        'causality="input" variability="discrete"',
    )  # fmt: skip
    data = {"time": [0.0, 0.25, 0.75], "u": [1.0, 2.0, 5.0]}
    result = driven(held, data)
    expected = np.where(TIMES < 0.25 - 1e-9, 1.0, np.where(TIMES < 0.75 - 1e-9, 2.0, 5.0))
    assert np.array_equal(result["input.M.u"], expected)
    assert np.array_equal(result["M.x"], driven(integrator, data, interpolation="held")["M.x"])


@pytest.mark.parametrize(
    ("times", "words"),
    [
        ([125.0, 127.0], "has data from 125 to 127 s, after the run, from 0 to 1 s"),
        ([1.0, 2.0], "after the run"),
        ([-3.0, -1.0], "has data from -3 to -1 s, before the run, from 0 to 1 s"),
    ],
)
def test_data_beside_the_run_are_refused(integrator: Path, times: list[float], words: str) -> None:
    with pytest.raises(CommandError, match=words):
        driven(integrator, {"time": times, "u": [1.0, 2.0]})


def test_data_before_the_run_may_repeat(integrator: Path) -> None:
    result = driven(integrator, {"time": [-3.0, -1.0], "u": [1.0, 3.0]}, end="repeat")
    assert result["input.M.u"][:3] == pytest.approx([2.0, 2.1, 2.2])


def test_data_are_compared_with_the_times_of_each_run(integrator: Path) -> None:
    source = ec.Input(data={"time": [1.0, 2.0], "u": [1.0, 2.0]}, signals={"M.u": "u"})
    with ec.load(str(integrator), input=[source], step_size=STEP, stop_time=1.0).prepare() as simulation:
        with pytest.raises(CommandError, match="after the run"):
            simulation.run()
        assert simulation.run(stop_time=2.0).steps == 20
