"""Clocks of FMI 3.0 FMUs: an FMU that refuses ticks at other times, and clocked variables without a tick."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.base.errors import CommandError, RunError
from emla_cosim.system.model import System
from tests.support.hand_written_fmus import edit_description
from tests.unit.master.conftest import run

STEP, STOP, THRESHOLD = 0.125, 2.0, 0.35
TICKS = {
    "periodic": 0.25 + 0.1 * np.arange(18),
    "fixed": 0.25 + 0.1 * np.arange(18),
    "changing": 0.1 * np.cumsum([1, 2, 3, 4, 5]),
    "countdown": THRESHOLD * np.arange(1, 6) + 0.05,
}
"""The times of the ticks until STOP, in s."""


def sums(times: Any, ticks: Any, values: Any) -> Any:
    """Return the sum of the values at ticks until each time."""
    return np.array([np.sum(values[ticks <= t + 1e-9]) for t in np.asarray(times)])


@pytest.mark.parametrize(
    ("start", "options"),
    [(0.0, {}), (0.0, {"algorithm": "strong"}), (3.0, {}), (3.0, {"step": 2.0})],
    ids=str,
)
@pytest.mark.parametrize("clock", TICKS)
def test_clocks_tick_at_their_times(build: Any, clock: str, start: float, options: dict[str, Any]) -> None:
    system = System.of({"a": build(clock=clock)}, [], {"a.threshold": THRESHOLD, "a.w": 2.0})
    result = run(system, start_time=start, stop=start + STOP, **options)
    ticks = start + TICKS[clock]
    assert np.array_equal(result["a.sum"], sums(result["time"], ticks, np.full(len(ticks), 2.0)))
    assert result["a.sum"][-1] == 2.0 * len(ticks)


def test_tick_samples_the_inputs_of_its_step(build: Any) -> None:
    system = System.of({"a": build(), "b": build(clock="periodic")}, ["a.x -> b.w"])
    result = run(system, algorithm="jacobi")
    ticks = TICKS["periodic"]
    starts = STEP * (np.ceil(ticks / STEP - 1e-9) - 1.0)  # of the steps with the ticks; a.x is the time
    assert np.allclose(result["b.sum"], sums(result["time"], ticks, starts), rtol=0.0, atol=1e-12)


def test_input_that_is_set_by_hand_waits_for_the_tick(build: Any) -> None:
    with ec.load(
        System.of({"a": build(clock="periodic")}, []), step_size=STEP, stop_time=STOP
    ).prepare() as simulation:
        simulation.start()
        simulation["a.w"] = 5.0
        values_at_ticks = []
        for time in (0.125, 0.25, 0.5):
            simulation.advance(time)
            values_at_ticks.append(simulation["a.sum"])
    assert values_at_ticks == [0.0, 5.0, 15.0]


def test_fmu_that_cannot_vary_its_step_needs_ticks_at_its_points(build: Any) -> None:
    path = build(clock="periodic", varies=False, early=False)
    result = run(System.of({"a": path}, [], {"a.w": 1.0}), step=0.05)
    assert result["a.sum"][-1] == len(TICKS["periodic"])
    with pytest.raises(
        RunError, match=r"a clock of a ticks at t = 0\.35 s, within a step, and the FMU cannot vary"
    ):
        run(System.of({"a": path}))


def test_clock_without_event_mode_is_refused(build: Any) -> None:
    with pytest.raises(CommandError, match="has the clock 'tick' but no event mode"):
        run(System.of({"a": build(clock="periodic", events=False)}))


@pytest.mark.parametrize(
    ("old", "new", "error", "words"),
    [
        ('intervalDecimal="0.1"', 'intervalDecimal="0"', RunError, "with the interval 0 s of its clock tick"),
        ('intervalDecimal="0.1"', 'intervalDecimal="x"', CommandError, "of its clock 'tick' is 'x'"),
        ('shiftDecimal="0.25"', 'shiftDecimal="-1"', RunError, "with the shift -1 s of its clock tick"),
    ],
)  # fmt: skip
def test_invalid_descriptions_are_refused(
    build: Any, tmp_path: Path, old: str, new: str, error: type[Exception], words: str
) -> None:
    changed = edit_description(build(clock="periodic"), tmp_path / build(clock="periodic").name, old, new)
    with pytest.raises(error, match=words):
        run(System.of({"a": changed}), lenient=True)
