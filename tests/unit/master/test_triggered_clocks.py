"""Output clocks and triggered input clocks, with an FMU that refuses ticks and reads at wrong times."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.base.errors import CommandError, RunError
from emla_cosim.system.model import System
from tests.support.hand_written_fmus import build_trigger_fmu, edit_description
from tests.unit.master.conftest import run

STEP, STOP = 0.125, 2.0
PERIOD = 0.3
WIRES = ["a.alarm -> b.go", "a.level -> b.w"]
CLEAR_IN_GET, NEVER_CLEAR = 1, 2
ALGORITHMS = ["gauss-seidel", "strong", "jacobi"]


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_trigger_fmu(tmp_path_factory.mktemp("clocks") / "Trigger.fmu")


@pytest.fixture(scope="module")
def dependent(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_trigger_fmu(tmp_path_factory.mktemp("clocks") / "Dependent.fmu", sub=0.2)


def pair(fmu: Path, wires: Any = WIRES, names: str = "ab", **values: float) -> System:
    """A component a with an alarm, and others without one."""
    starts = {"a.period": PERIOD} | {f"a.{name}": value for name, value in values.items()}
    return System.of(dict.fromkeys(names, fmu), wires, starts)


def alarms(times: Any, period: float = PERIOD, burst: int = 1) -> Any:
    """Return how often the alarm has ticked until each time."""
    return burst * np.floor(np.asarray(times) / period + 1e-9)


def sums(levels: Any) -> Any:
    """Return the sum at each point: each new tick adds the level that the alarm has there."""
    return np.cumsum(np.diff(levels, prepend=0.0) * levels)


def delayed(values: Any) -> Any:
    return np.concatenate([[0.0], values[:-1]])


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_triggered_clock_ticks_in_the_step_that_reads_its_source(fmu: Path, algorithm: str) -> None:
    is_late = algorithm == "jacobi"
    result = run(pair(fmu), algorithm=algorithm)
    levels = alarms(result["time"])
    expected_levels = delayed(levels) if is_late else levels
    assert levels[-1] == 6
    assert np.array_equal(result["a.alarm"], levels) and np.array_equal(result["a.level"][4:], levels[4:])
    assert np.array_equal(result["b.echo"], expected_levels) and np.array_equal(
        result["b.ticks"], expected_levels
    )
    assert np.array_equal(result["b.sum"], sums(expected_levels))
    assert result["b.last"][-1] == result["time"][np.flatnonzero(np.diff(expected_levels))[-1] + 1]
    assert result["a.alarm"].dtype == np.int32
    assert result.stepping["late_connections"] == (WIRES if is_late else [])


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize(("period", "burst"), [(0.3, 3), (0.04, 2)])
def test_no_tick_within_a_step_is_lost(fmu: Path, algorithm: str, period: float, burst: int) -> None:
    result = run(pair(fmu, period=period, burst=burst), algorithm=algorithm)
    levels = alarms(result["time"], period, burst)
    expected_levels = delayed(levels) if algorithm == "jacobi" else levels
    assert np.array_equal(result["a.alarm"], levels)
    assert np.array_equal(result["b.ticks"], expected_levels) and np.array_equal(
        result["b.sum"], sums(expected_levels)
    )


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_tick_at_the_start_comes_at_the_end_of_the_first_step(fmu: Path, algorithm: str) -> None:
    result = run(pair(fmu, rings=1), algorithm=algorithm)
    levels = 1 + alarms(result["time"])
    assert np.array_equal(result["a.alarm"], levels)
    expected_levels = delayed(levels) if algorithm == "jacobi" else np.concatenate([[0], levels[1:]])
    assert np.array_equal(result["b.ticks"], expected_levels) and result["b.last"][1] == STEP


def test_large_step_ticks_as_often_as_the_small_ones(fmu: Path) -> None:
    result = run(pair(fmu), algorithm="strong", step_multiples={"b": 4})
    levels = alarms(result["time"])
    sampled = levels[np.arange(len(levels)) // 4 * 4]
    assert np.array_equal(result["b.ticks"], sampled)


def test_clock_that_the_fmu_sets_in_its_update_counts_once(fmu: Path) -> None:
    result = run(pair(fmu, manner=CLEAR_IN_GET, burst=2), algorithm="gauss-seidel")
    assert np.array_equal(result["b.ticks"], alarms(result["time"], burst=2))


def test_clock_that_never_stops_is_an_error(fmu: Path) -> None:
    with pytest.raises(
        RunError, match=r"a answered getClock at t = 0\.3 s with a tick of alarm after each of"
    ):
        run(pair(fmu, manner=NEVER_CLEAR))


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_ticks_in_a_chain_are_as_late_as_the_algorithm_makes_them(fmu: Path, algorithm: str) -> None:
    wires = ["a.alarm -> a.go", "a.echo -> b.go", "b.echo -> c.go", "a.x -> a.w", "a.x -> b.w"]
    result = run(pair(fmu, wires, "abc"), algorithm=algorithm)
    levels = alarms(result["time"])
    levels_in_a = (
        levels if algorithm == "strong" else delayed(levels)
    )  # a reads its own outputs before its step
    later = delayed if algorithm == "jacobi" else np.asarray
    assert np.array_equal(result["a.ticks"], levels_in_a)
    assert np.array_equal(result["b.ticks"], later(levels_in_a))
    assert np.array_equal(result["c.ticks"], later(later(levels_in_a)))


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "strong"])
def test_clocks_in_a_loop(fmu: Path, algorithm: str) -> None:
    result = run(pair(fmu, ["a.alarm -> b.go", "b.echo -> a.go"]), algorithm=algorithm)
    levels = alarms(result["time"])
    assert np.array_equal(result["b.ticks"], levels)
    assert np.array_equal(result["a.ticks"], levels if algorithm == "strong" else delayed(levels))


def test_package_keeps_connections_of_clocks(fmu: Path, tmp_path: Path) -> None:
    path = ec.load(pair(fmu), step_size=STEP, stop_time=STOP).export(tmp_path / "x.ssp")
    with ec.load(path, algorithm="gauss-seidel").prepare() as simulation:
        result = simulation.run()
    assert np.array_equal(result["b.ticks"], alarms(result["time"]))


def test_clock_without_a_connection_never_ticks_with_a_remark(fmu: Path) -> None:
    result = run(pair(fmu, []))
    assert not result["b.ticks"].any() and not result["b.echo"].any()
    words = "No output clock is connected to the triggered clocks a.go and b.go: they never tick."
    assert words in result.remarks and words in result.record["remarks"]
    (remark,) = [x for x in run(pair(fmu)).remarks if "clock" in x]
    assert remark == "No output clock is connected to the triggered clock a.go: it never ticks."


def test_clocks_can_be_read_and_recorded_but_not_set(fmu: Path) -> None:
    result = run(pair(fmu), signals=["b.go", "a.alarm"], algorithm="gauss-seidel")
    assert np.array_equal(result["b.go"], alarms(result["time"]))
    with ec.load(pair(fmu), step_size=STEP, stop_time=STOP).prepare() as simulation:
        simulation.start()
        assert simulation["a.alarm"] == 0
        simulation.advance(1.0)
        assert simulation["a.alarm"] == 3
        with pytest.raises(CommandError, match=r"a\.go cannot be set: it is a clock"):
            simulation["a.go"] = 1
    with pytest.raises(CommandError, match=r"a\.go cannot be set: it is a clock"):
        run(System.of({"a": fmu}, [], {"a.go": 1}))


@pytest.mark.parametrize(
    ("wire", "words"),
    [
        ("a.x -> b.go", "joins the types Real and Clock: only an output clock can drive a triggered input"),
        ("a.alarm -> b.w", "joins the types Clock and Real: only an output clock"),
        ("a.alarm -> b.beat", r"b\.beat cannot be connected: it is a constant clock, which ticks at its own"),
        ("a.go -> b.go", r"a\.go must be an output"),
    ],
)
def test_wrong_connections_are_refused(dependent: Path, wire: str, words: str) -> None:
    with pytest.raises(CommandError, match=words):
        run(pair(dependent, [wire]))


def test_too_many_ticks_in_a_step_are_an_error(fmu: Path) -> None:
    with pytest.raises(
        RunError, match=r"the clock go of b has to tick 1250 times in the step to t = 1 s; fewer"
    ):
        run(pair(fmu, period=0.004, burst=5), step=1.0, algorithm="gauss-seidel")


def test_dependent_clock_ticks_with_its_clock(dependent: Path) -> None:
    result = run(System.of({"a": dependent}), step=0.25, signals=["a.beat", "a.sub", "a.beats", "a.subs"])
    assert np.array_equal(result["a.beats"], np.floor(result["time"] / 0.1 + 1e-9) + 1)
    assert np.array_equal(result["a.subs"], np.floor(result["time"] / 0.2 + 1e-9) + 1)
    assert np.array_equal(result["a.beat"], result["a.beats"]) and np.array_equal(
        result["a.sub"], result["a.subs"]
    )


def test_triggered_clock_can_depend_on_another(dependent: Path, tmp_path: Path) -> None:
    old = '<Clock name="go" valueReference="20" causality="input"'
    path = edit_description(dependent, tmp_path / dependent.name, old, f'{old} clocks="31"')
    result = run(pair(path), step=0.1, algorithm="gauss-seidel")
    assert np.array_equal(result["b.ticks"], alarms(result["time"]))
    with pytest.raises(RunError, match=r"the clock go of b ticks at t = 0\.375 s without beat, on which it"):
        run(pair(path), algorithm="gauss-seidel")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            'intervalDecimal="0.2"',
            'intervalDecimal="0.25"',
            r"the clock sub of a ticks at t = 0\.25 s without beat, on which it depends",
        ),
        (
            'clocks="31" intervalVariability="constant"',
            'clocks="31" intervalVariability="unknown"',
            "has the clock 'sub' with intervalVariability = 'unknown', which is not one of",
        ),
    ],
)
def test_invalid_clocks_are_refused(dependent: Path, tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises((RunError, CommandError), match=words):
        run(System.of({"a": edit_description(dependent, tmp_path / dependent.name, old, new)}), lenient=True)
