"""FMUs for FMI 3.0 with a periodic input clock, against the same block in steps of the interval."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fmpy.validation import validate_fmu

import emla_cosim as ec
from emla_cosim.fmu.models import MODELS
from fmublock import BuildError, build
from tests.support.c_programs import needs_cc
from tests.support.fmi3_host import Host, call_at_random, root_of
from tests.support.sessions import ERROR
from tests.support.toy import Toy
from tests.support.toy_fmu import copy_toy

REFERENCE = Toy.layout().reference
FORCE, MASS, X, V, POWER = (REFERENCE(n) for n in ("force", "body.mass", "x", "v[1]", "power"))
TIME = len(Toy.layout().scalars) + 3
CLOCK = TIME + 1
READ = [X, V, POWER]
INTERVAL = 0.01


@pytest.fixture(scope="module")
def paths(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("clock")
    return [
        copy_toy(folder / f"{name}.fmu", 3, clock) for name, clock in (("clocked", INTERVAL), ("plain", None))
    ]


@pytest.fixture
def hosts(paths: list[Path], tmp_path: Path) -> Iterator[list[Host]]:
    hosts = [Host(path, tmp_path / path.stem) for path in paths]
    yield hosts
    for host in hosts:
        host.close()


def values(slave: Any) -> list[float]:
    return slave.getFloat64(READ, nValues=4)


def start(host: Host, start_time: float = 0.0) -> Any:
    """Start a clocked instance in step mode, and look at its first values."""
    slave = host.new(eventModeUsed=True)
    slave.enterInitializationMode(startTime=start_time)
    slave.first = values(slave)
    slave.exitInitializationMode()
    assert slave.updateDiscreteStates() == (False,) * 5 + (0.0,)
    slave.enterStepMode()
    return slave


def tick(slave: Any, force: float) -> list[float]:
    """Enter event mode, tick with this input, and return the outputs."""
    slave.enterEventMode()
    slave.setClock([CLOCK], [True])
    slave.setFloat64([FORCE], [force])
    actual = values(slave)
    slave.updateDiscreteStates()
    slave.enterStepMode()
    return actual


def test_model_description(paths: list[Path]) -> None:
    assert validate_fmu(str(paths[0])) == []
    root = root_of(paths[0], "modelDescription.xml")
    (clock,) = root.xpath("ModelVariables/Clock")
    attributes = ("causality", "intervalVariability", "intervalDecimal", "shiftDecimal", "valueReference")
    assert [clock.get(n) for n in attributes] == ["input", "constant", "0.01", "0.01", str(CLOCK)]
    clocked = root.xpath("ModelVariables/*[@clocks]")
    assert {v.get("name") for v in clocked} == {"force", "x", "v", "random", "step_count", "power", "inverse"}
    assert {(v.get("clocks"), v.get("variability")) for v in clocked} == {(str(CLOCK), "discrete")}
    assert root.find("ModelExchange") is None and root.find("CoSimulation").get("hasEventMode") == "true"


@pytest.mark.parametrize(("parts", "start_time"), [(1, 0.0), (3, 2.5)])
def test_tick_is_a_step_of_the_interval(hosts: list[Host], parts: int, start_time: float) -> None:
    """The same bits, however many steps are between two ticks."""
    clocked, plain = start(hosts[0], start_time), hosts[1].started(time=start_time)
    assert clocked.first == values(plain)
    time = start_time
    for n in range(1, 200):
        force = 0.1 * n
        for part in range(1, parts + 1):
            end = start_time + (n - 1 + part / parts) * INTERVAL
            assert clocked.doStep(time, end - time)[:3] == (False, False, False)
            time = end
        plain.setFloat64([FORCE], [force])
        plain.doStep(start_time + (n - 1) * INTERVAL, INTERVAL)
        assert tick(clocked, force) == values(plain), n
        assert clocked.getFloat64([TIME]) == plain.getFloat64([TIME])


def test_inputs_can_change_until_the_update(hosts: list[Host]) -> None:
    """Each read computes the tick anew, as a host needs to solve a loop; noise is drawn once."""
    first, second = start(hosts[0]), start(hosts[0])
    for slave in (first, second):
        slave.doStep(0.0, INTERVAL)
    first.enterEventMode()
    first.setClock([CLOCK], [True])
    for force in (100.0, -7.0, 3.0):
        first.setFloat64([FORCE], [force])
        actual_values = values(first)
    first.updateDiscreteStates()
    first.enterStepMode()
    assert actual_values == tick(second, 3.0)
    states = [s.serializeFMUState(s.getFMUState()) for s in (first, second)]
    assert states[0] == states[1]


def test_states_are_restored_also_within_a_tick(hosts: list[Host]) -> None:
    slave = start(hosts[0])
    slave.doStep(0.0, INTERVAL)
    slave.enterEventMode()
    slave.setClock([CLOCK], [True])
    state = slave.getFMUState()
    content = slave.serializeFMUState(state)
    actual_values = []
    for restore in (lambda: None, lambda: slave.setFMUState(state), lambda: None):
        restore()
        slave.setFloat64([FORCE], [3.0])
        actual_values.append(values(slave))
    slave.updateDiscreteStates()
    slave.enterStepMode()
    second = start(hosts[0])
    second.setFMUState(second.deserializeFMUState(content))
    second.setFloat64([FORCE], [3.0])
    actual_values.append(values(second))
    assert actual_values[1:] == actual_values[:-1]
    slave.freeFMUState(state)


def test_calls_at_the_invalid_time_are_refused(hosts: list[Host]) -> None:
    host = hosts[0]
    slave = start(host)
    only = "can be set and read only while the clock ticks"
    assert f"power {only}" in host.refused(slave.getFloat64, [POWER])
    assert f"force {only}" in host.refused(slave.setFloat64, [FORCE], [1.0])
    assert slave.getFloat64([MASS]) == [2.0]
    assert "in phase step" in host.refused(slave.setClock, [CLOCK], [True])
    words = "the step to t = 0.015 s goes past the tick of the clock at t = 0.01 s"
    assert words in host.refused(slave.doStep, 0.0, 0.015)
    slave.doStep(0.0, 0.005)
    slave.enterEventMode()
    words = "the clock ticks at t = 0.01 s, but the instance is at t = 0.005 s"
    assert words in host.refused(slave.setClock, [CLOCK], [True])
    assert "no clock with value reference 3" in host.refused(slave.setClock, [3], [True])
    slave.updateDiscreteStates()
    slave.enterStepMode()
    slave.doStep(0.005, 0.005)
    slave.enterEventMode()
    assert f"power {only}" in host.refused(slave.getFloat64, [POWER])
    slave.setClock([CLOCK], [True])
    assert "cannot be deactivated" in host.refused(slave.setClock, [CLOCK], [False])
    assert "needs fmi3UpdateDiscreteStates first" in host.refused(slave.enterStepMode)
    assert "in phase co-simulation-event" in host.refused(slave.doStep, 0.01, 0.01)
    slave.updateDiscreteStates()
    words = "the clock ticks at t = 0.02 s, but the instance is at t = 0.01 s"
    assert words in host.refused(slave.setClock, [CLOCK], [True])
    slave.enterStepMode()
    slave.terminate()


def test_impossible_ticks_are_refused(hosts: list[Host], tmp_path: Path) -> None:
    slave, second = start(hosts[0]), start(hosts[0])
    for each in (slave, second):
        each.doStep(0.0, INTERVAL)
    slave.enterEventMode()
    slave.setClock([CLOCK], [True])
    slave.setFloat64([FORCE], [1e308])
    for call, *arguments in ((slave.updateDiscreteStates,), (slave.getFloat64, [POWER])):
        assert "the tick at t = 0.01 s is impossible" in hosts[0].refused(call, *arguments)
    slave.setFloat64([FORCE], [3.0])
    assert values(slave) == tick(second, 3.0)
    host = Host(build(Toy, tmp_path / "slow.fmu", fmi=3, clock=10.0), tmp_path / "slow")
    slow = host.new(eventModeUsed=True)
    slow.enterInitializationMode()
    slow.setFloat64([REFERENCE("solver.internal_step")], [1e-9])
    words = "the step of 10 s needs more than 1e+09 internal steps"
    assert words in host.refused(slow.exitInitializationMode)
    host.close()


def test_host_without_event_mode_is_refused(hosts: list[Host]) -> None:
    with pytest.raises(Exception, match="instantiate"):
        hosts[0].new()
    status, text = hosts[0].lines[-1]
    assert status == ERROR and "needs a host with event mode" in text


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"clock": 1e-3}, "a clock needs FMI 3.0"),
        ({"clock": 0.0, "fmi": 3}, "must be positive and finite, not 0 s"),
        ({"clock": float("inf"), "fmi": 3}, "must be positive and finite, not inf s"),
    ],
)
def test_invalid_intervals_are_refused(tmp_path: Path, options: dict[str, Any], words: str) -> None:
    with pytest.raises(BuildError, match=words):
        build(Toy, tmp_path / "Toy.fmu", **options)


CHECKED = ("DoStep", "GetFloat64", "SetFloat64", "SetClock", "UpdateDiscreteStates", "EnterStepMode")


@needs_cc
@pytest.mark.slow
def test_random_calls_do_not_crash_the_fmu(hosts: list[Host], tmp_path: Path) -> None:
    counts = call_at_random(hosts[0], tmp_path, 20_000, CLOCK, 1)
    for function in CHECKED:
        assert counts[function][0] > 0 and counts[function][ERROR] > 0, function


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["jacobi", "strong"])
def test_clocks_of_ten_steps_are_step_multiples(algorithm: str, fmu_folder: Path, tmp_path: Path) -> None:
    names = {"lift.controller": "RsbaController", "lift.observer": "EmlaObserver"}
    clocked = {c: build(MODELS[n], tmp_path / f"{n}.fmu", fmi=3, clock=1e-3) for c, n in names.items()}
    assert [validate_fmu(str(fmu)) for fmu in clocked.values()] == [[], []]
    options = {"algorithm": algorithm, "step_size": 1e-4, "stop_time": 0.02, "output_interval": 1e-4}
    sampled = {"step_multiples": dict.fromkeys(names, 1)} if algorithm == "strong" else {}
    plain, second = (
        ec.load("lift", fmus=fmu_folder, **options, **changes).prepare().run().to_polars()
        for changes in ({"step_multiples": dict.fromkeys(names, 10)}, {"replace": clocked, **sampled})
    )
    assert second.select(plain.columns).equals(plain)
