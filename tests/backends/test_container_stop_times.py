"""The FMU of a system does no step past the stop time, also if this is k h but for rounding."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

import emla_cosim as ec
from tests.support.container_host import Host
from tests.support.hand_written_fmus import build_strict_fmu
from tests.support.tiers import mostly_slow

WIRES = ["a.x -> b.u", "b.x -> a.u"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("strict")


@pytest.fixture(scope="module")
def system(folder: Path) -> ec.System:
    """Two components in a loop, one of each version of FMI."""
    fmus = {name: build_strict_fmu(folder / f"Strict{v}.fmu", v) for name, v in (("a", 2), ("b", 3))}
    return ec.System.of(fmus, WIRES)


@pytest.fixture(scope="module")
def export(system: ec.System, folder: Path) -> Callable[..., Path]:
    """Return what exports the system, once for the same options, because compiling takes a second."""
    exported = dict[str, Path]()

    def make(fmi: int, step: float, stop: float, **options: Any) -> Path:
        key = repr((fmi, step, stop, options))
        if key not in exported:
            scenario = ec.load(system, step_size=step, stop_time=stop, **options)
            exported[key] = scenario.export(folder / f"{len(exported)}.fmu", outputs=["*"], fmi=fmi)
        return exported[key]

    return make


def simulate(fmu: Path, start: float, stop: float, step: float, host_step: float) -> Any:
    return fmpy.simulate_fmu(
        str(fmu),
        start_time=start,
        stop_time=stop,
        step_size=host_step,
        output_interval=host_step,
        start_values={"a.last": stop, "b.last": stop},
    )


CASES = [
    # start, step, steps, of the host's step, options
    (0.0, 1e-7, 100, 1, {}),
    (0.0, 1e-7, 100, 10, {}),
    (0.5, 0.1, 3, 1, {}),
    (0.0, 1 / 3, 6, 1, {}),
    (0.0, 1e-3, 40, 1, {"algorithm": "jacobi"}),
    (0.0, 1e-3, 40, 4, {"algorithm": "strong"}),
    (0.0, 1e-3, 40, 1, {"step_multiples": {"b": 4}}),
]


@pytest.mark.parametrize(
    ("fmi", "case"),
    mostly_slow([(fmi, case) for fmi in (2, 3) for case in CASES], [(2, CASES[-1]), (3, CASES[0])]),
    ids=str,
)
def test_no_component_steps_past_the_stop_time(
    export: Callable[..., Path], fmi: int, case: tuple[float, float, int, int, dict[str, Any]]
) -> None:
    start, step, steps, multiple, options = case
    end = start + steps * step
    fmu = export(fmi, step, end, start_time=start, **options)
    expected = simulate(fmu, start, end, step, multiple * step)
    for stop in (math.nextafter(end, 0.0), end, math.nextafter(end, 2.0 * end)):
        rows = simulate(fmu, start, stop, step, multiple * step)
        assert rows["a.reached"][-1] <= stop and rows["b.reached"][-1] <= stop
        assert rows["a.reached"][-1] == pytest.approx(end, rel=1e-15, abs=0.0)
        assert np.array_equal(rows["a.x"][:-1], expected["a.x"][: len(rows) - 1])
        assert rows["b.x"][-1] == pytest.approx(expected["b.x"][-1], rel=1e-14)


@pytest.mark.parametrize("fmi", mostly_slow([2, 3], [3]))
def test_steps_of_a_host_that_end_at_the_stop_time(
    export: Callable[..., Path], tmp_path: Path, fmi: int
) -> None:
    """The FMU tells the time that it reached, and refuses the next step."""
    step, stop = 0.1, math.nextafter(0.3, 0.0)
    with Host(export(fmi, step, 0.3), tmp_path) as host:
        host.start({"a.last": stop, "b.last": stop}, stop=stop)
        host.step(0.0, 0.2)
        answer = host.step(0.2, stop - 0.2)
        assert fmi == 2 or answer[1:] == (False, False, stop)
        assert host.read(["a.reached", "b.reached"]) == [stop, stop]
        with pytest.raises(FMICallException):
            host.step(stop, 0.1)
        assert "goes past the stop time" in host.messages[-1]


def test_without_a_stop_time_steps_end_at_communication_points(
    export: Callable[..., Path], tmp_path: Path
) -> None:
    with Host(export(3, 0.1, 0.3), tmp_path) as host:
        host.start()
        host.step(0.0, math.nextafter(0.3, 0.0))
        assert host["a.reached"] == 0.3
