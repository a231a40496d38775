"""Clocks of FMI 3.0 FMUs: an FMU that refuses ticks at other times, and clocked variables without a tick."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.base.errors import CommandError, RunError
from emla_cosim.system.model import System
from tests.support.hand_written_fmus import build_event_fmu, edit_description
from tests.support.tiers import mostly_slow

STEP, STOP, THRESHOLD = 0.125, 2.0, 0.35
TICKS = {
    "periodic": 0.25 + 0.1 * np.arange(18),
    "fixed": 0.25 + 0.1 * np.arange(18),
    "changing": 0.1 * np.cumsum([1, 2, 3, 4, 5]),
    "countdown": THRESHOLD * np.arange(1, 6) + 0.05,
}
"""The times of the ticks until STOP, in s."""


@pytest.fixture(scope="module")
def build(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder, built = tmp_path_factory.mktemp("clocks"), dict[str, Path]()

    def get(clock: str | None, **options: bool) -> Path:
        name = f"Clock{clock}" + "".join(f"{k}{v}" for k, v in sorted(options.items()))
        if name not in built:
            built[name] = build_event_fmu(folder / f"{name}.fmu", clock=clock, **options)
        return built[name]

    return get


def run(system: System, step: float = STEP, stop: float = STOP, **options: Any) -> ec.Result:
    with ec.load(system, step_size=step, stop_time=stop, **options).prepare() as simulation:
        return simulation.run()


def sums(times: Any, ticks: Any, values: Any) -> Any:
    """Return the sum of the values at ticks until each time."""
    return np.array([np.sum(values[ticks <= t + 1e-9]) for t in np.asarray(times)])


@pytest.mark.parametrize("options", [{}, {"algorithm": "strong"}], ids=str)
@pytest.mark.parametrize("clock", TICKS)
def test_clocks_tick_at_their_times(build: Any, clock: str, options: dict[str, Any]) -> None:
    found = run(System.of({"a": build(clock)}, [], {"a.threshold": THRESHOLD, "a.w": 2.0}), **options)
    ticks = TICKS[clock]
    assert np.array_equal(found["a.sum"], sums(found["time"], ticks, np.full(len(ticks), 2.0)))
    assert found["a.sum"][-1] == 2.0 * len(ticks)


@pytest.mark.parametrize("step", [STEP, 2.0])
def test_start_time_shifts_the_ticks(build: Any, step: float) -> None:
    system = System.of({"a": build("periodic")}, [], {"a.w": 1.0})
    with ec.load(system, step_size=step, start_time=3.0, stop_time=5.0).prepare() as simulation:
        found = simulation.run()
    ticks = 3.0 + TICKS["periodic"]
    assert np.array_equal(found["a.sum"], sums(found["time"], ticks, np.ones(len(ticks))))


@pytest.mark.parametrize("isolate", mostly_slow([[], ["b"]], [[]]))
def test_tick_samples_the_inputs_of_its_step(build: Any, isolate: list[str]) -> None:
    system = System.of({"a": build(None), "b": build("periodic")}, ["a.x -> b.w"])
    found = run(system, algorithm="jacobi", isolate=isolate)
    ticks = TICKS["periodic"]
    starts = STEP * (np.ceil(ticks / STEP - 1e-9) - 1.0)  # of the steps with the ticks; a.x is the time
    assert np.allclose(found["b.sum"], sums(found["time"], ticks, starts), rtol=0.0, atol=1e-12)


def test_input_that_is_set_by_hand_waits_for_the_tick(build: Any) -> None:
    with ec.load(
        System.of({"a": build("periodic")}, []), step_size=STEP, stop_time=STOP
    ).prepare() as simulation:
        simulation.start()
        simulation["a.w"] = 5.0
        seen = []
        for time in (0.125, 0.25, 0.5):
            simulation.advance(time)
            seen.append(simulation["a.sum"])
    assert seen == [0.0, 5.0, 15.0]


@pytest.mark.parametrize("clock", ["periodic", "countdown"])
def test_resumed_run_has_the_same_ticks(build: Any, clock: str, tmp_path: Path) -> None:
    system = System.of({"a": build(clock)}, [], {"a.threshold": THRESHOLD, "a.w": 2.0})
    run(system, stop=0.5, checkpoint=tmp_path / "c")  # the countdown clock does not tick in the next step
    resumed = run(system, resume=tmp_path / "c")
    ticks = TICKS[clock]
    assert np.array_equal(resumed["a.sum"], sums(resumed["time"], ticks, np.full(len(ticks), 2.0)))


def test_fmu_that_cannot_vary_its_step_needs_ticks_at_its_points(build: Any) -> None:
    path = build("periodic", varies=False, early=False)
    found = run(System.of({"a": path}, [], {"a.w": 1.0}), step=0.05)
    assert found["a.sum"][-1] == len(TICKS["periodic"])
    with pytest.raises(
        RunError, match=r"a clock of a ticks at t = 0\.35 s, within a step, and the FMU cannot vary"
    ):
        run(System.of({"a": path}))


def test_clock_without_event_mode_is_refused(build: Any) -> None:
    with pytest.raises(CommandError, match="has the clock 'tick' but no event mode"):
        run(System.of({"a": build("periodic", events=False)}))


@pytest.mark.parametrize(
    ("old", "new", "error", "words"),
    [
        ('intervalDecimal="0.1"', 'intervalDecimal="0"', RunError, "clock tick has the interval 0 s"),
        ('intervalDecimal="0.1"', 'intervalDecimal="x"', CommandError, "of its clock 'tick' is 'x'"),
        ('shiftDecimal="0.25"', 'shiftDecimal="-1"', RunError, "clock tick has the shift -1 s"),
    ],
)  # fmt: skip
def test_invalid_descriptions_are_refused(
    build: Any, tmp_path: Path, old: str, new: str, error: type[Exception], words: str
) -> None:
    changed = edit_description(build("periodic"), tmp_path / build("periodic").name, old, new)
    with pytest.raises(error, match=words):
        run(System.of({"a": changed}), lenient=True)
