"""Intermediate update and early return of FMUs for FMI 3.0, against steps as long as an internal one."""

import math
from collections.abc import Callable
from ctypes import c_double, c_int32, c_uint32
from pathlib import Path
from typing import Any

import pytest

from tests.support.fmi3_host import Host, root_of
from tests.support.toy import Toy

REFERENCE = Toy.layout().reference
FORCE, X, V, POWER, INVERSE = (REFERENCE(n) for n in ("force", "x", "v[1]", "power", "inverse"))
INTERNAL, STEP, DISCARD = 2.0**-9, 2.0**-7, 2
INTERNAL_STEP = REFERENCE("solver.internal_step")
READ = [X, V, POWER, INVERSE]


class Updates:
    """A host's callback: it reads variables, and can do more."""

    def __init__(self, more: Callable[[Any, float], Any] = lambda slave, time: None) -> None:
        self.slave: Any = None
        self.more = more
        self.received_values: list[tuple[float, list[float]]] = []
        self.flags = set[tuple[bool, ...]]()
        self.can_return: list[bool] = []
        self.return_time: float | None = None

    def __call__(self, environment: Any, time: float, *arguments: Any) -> None:
        *flags, can_return, requested, return_time = arguments
        self.flags.add(tuple(map(bool, flags)))
        self.can_return.append(bool(can_return))
        self.received_values.append((time, self.slave.getFloat64(READ, nValues=5)))
        self.more(self.slave, time)
        if self.return_time is not None:
            requested[0], return_time[0] = True, self.return_time


def start(host: Host, updates: Updates | None = None, required: Any = READ, is_early: bool = True) -> Any:
    options: dict[str, Any] = {}
    if updates is not None:
        options = {"intermediateUpdate": updates, "requiredIntermediateVariables": required}
    slave = host.new(**options, earlyReturnAllowed=is_early)
    if updates is not None:
        updates.slave = slave
    slave.setFloat64([INTERNAL_STEP], [INTERNAL])
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    return slave


def test_model_description(fmi3_toy_fmu: Path) -> None:
    root = root_of(fmi3_toy_fmu, "modelDescription.xml")
    names = root.xpath("ModelVariables/*[@intermediateUpdate='true']/@name")
    assert names == ["x", "v", "power", "inverse"]
    (element,) = root.xpath("CoSimulation")
    assert element.get("providesIntermediateUpdate") == "true"
    assert element.get("canReturnEarlyAfterIntermediateUpdate") == "true"
    assert element.get("mightReturnEarlyFromDoStep") is None


def test_values_after_each_internal_step(host: Host) -> None:
    """States are those of steps of the internal length, the last values those of the communication point."""
    updates = Updates()
    slave, fine = start(host, updates), start(host)
    seen_before, force = 0, [3.0, -2.0]
    random = slave.getFloat64([POWER])[0] - 0.5 * slave.getFloat64([V], nValues=2)[0]
    for n in range(2):
        for each in (slave, fine):
            each.setFloat64([FORCE], [force[n]])
        assert slave.doStep(n * STEP, STEP) == (False, False, False, (n + 1) * STEP)
        received = updates.received_values[seen_before:]
        assert [time for time, _ in received] == [n * STEP + k * INTERNAL for k in range(1, 5)]
        for time, values in received:
            fine.doStep(time - INTERNAL, INTERNAL)
            assert values[:3] == fine.getFloat64(READ, nValues=5)[:3]
            assert values[4] == 1.0 / (1.0 - values[0])
        for _, values in received[:-1]:  # the noise changes at communication points
            assert values[3] - force[n] * values[1] == pytest.approx(random, abs=1e-12)
        after = slave.getFloat64(READ, nValues=5)
        assert received[-1][1] == after
        random, before = after[3] - force[n] * after[1], random
        assert random != before
        seen_before = len(updates.received_values)
    assert updates.flags == {(False, True, True)}  # set requested, get allowed, step finished
    assert updates.can_return == [True, True, True, False] * 2


def test_callback_changes_no_bit(host: Host) -> None:
    slaves = [start(host, Updates()), start(host)]
    for slave in slaves:
        for n in range(20):
            slave.setFloat64([FORCE], [0.1 * n])
            slave.doStep(n * 0.0123, 0.0123)
    assert slaves[0].getFloat64(READ, nValues=5) == slaves[1].getFloat64(READ, nValues=5)
    bits = [slave.serializeFMUState(slave.getFMUState()) for slave in slaves]
    assert bits[0] == bits[1]


@pytest.mark.parametrize(
    ("return_time", "reached"), [(0.0, 1), (INTERNAL, 1), (2.7 * INTERNAL, 2), (STEP, 4)]
)
def test_step_that_the_host_ends(host: Host, return_time: float, reached: int) -> None:
    """The step ends at the last internal step that is not after the time that the host asks for."""
    updates = Updates()
    slave, second = start(host, updates), start(host)
    updates.return_time = return_time
    time = reached * INTERNAL
    assert slave.doStep(0.0, STEP) == (False, False, reached < 4, time)
    assert len(updates.received_values) == reached
    second.doStep(0.0, time)
    assert slave.getFloat64(READ, nValues=5) == second.getFloat64(READ, nValues=5)
    updates.return_time = None
    for each in (slave, second):  # another step of the same length, and the rest of a step
        each.setFloat64([FORCE], [7.0])
        assert each.doStep(time, STEP) == (False, False, False, time + STEP)
        assert each.doStep(time + STEP, INTERNAL)[3] == time + STEP + INTERNAL
    assert slave.getFloat64(READ, nValues=5) == second.getFloat64(READ, nValues=5)


def test_early_return_that_is_not_allowed(host: Host) -> None:
    updates = Updates()
    slave = start(host, updates, is_early=False)
    updates.return_time = 0.0
    assert slave.doStep(0.0, STEP) == (False, False, False, STEP)
    assert updates.can_return == [False] * 4


def test_derivatives_of_outputs_at_internal_steps(host: Host) -> None:
    """They are those after a step to that time, with the inputs of the step."""
    actual: list[list[float]] = []
    slave = start(host, Updates(lambda slave, time: actual.append(output_derivatives(slave))))
    fine = start(host)
    for each in (slave, fine):
        each.setFloat64([FORCE], [3.0])
    slave.doStep(0.0, STEP)
    for k in range(4):
        fine.doStep(k * INTERNAL, INTERNAL)
        assert actual[k] == output_derivatives(fine)
    force = 3.0 - 3.0 * 0.126 - 0.05  # of the input, the spring and the damper
    assert actual[0][1] == pytest.approx(force / 2.0, abs=1e-3)


def output_derivatives(slave: Any) -> list[float]:
    """Return the time derivatives of x and v."""
    references, orders, values = (c_uint32 * 2)(X, V), (c_int32 * 2)(1, 1), (c_double * 3)()
    slave.fmi3GetOutputDerivatives(slave.component, references, 2, orders, values, 3)
    return list(values)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda s: s.setFloat64([FORCE], [1.0]), "cannot set values in phase intermediate-update"),
        (lambda s: s.getFMUState(), "cannot get the state in phase intermediate-update"),
        (lambda s: s.doStep(0.0, STEP), "cannot do a step in phase intermediate-update"),
        (lambda s: s.terminate(), "cannot terminate in phase intermediate-update"),
        (lambda s: s.reset(), "cannot reset in phase intermediate-update"),
        (lambda s: s.getDirectionalDerivative([X], [FORCE], [1.0]), "cannot get directional derivatives"),
        (lambda s: s.getFloat64([FORCE]), "force is not among requiredIntermediateVariables"),
    ],
)
def test_other_calls_in_the_callback_are_refused(host: Host, call: Callable[[Any], Any], words: str) -> None:
    answers: list[str] = []
    slave = start(host, Updates(lambda slave, time: answers.append(host.refused(call, slave))))
    second = start(host)
    for each in (slave, second):
        each.doStep(0.0, STEP)
    assert len(answers) == 4 and all(words in answer for answer in answers)
    assert slave.getFloat64(READ, nValues=5) == second.getFloat64(READ, nValues=5)


@pytest.mark.parametrize("name", ["force", "body.mass", "step_count"])
def test_variables_without_intermediate_update_are_refused(host: Host, name: str) -> None:
    with pytest.raises(Exception, match="instantiate"):
        host.new(intermediateUpdate=Updates(), requiredIntermediateVariables=[REFERENCE(name)])
    assert host.lines[-1][1].endswith(f"{name} has no intermediate update.")


def test_discarded_step_shows_no_infinite_values(host: Host) -> None:
    updates = Updates()
    slave = start(host, updates)
    slave.setFloat64([FORCE], [3e154])  # the power overflows within the step
    before = slave.getFloat64(READ, nValues=5)
    assert "discarded" in host.refused(slave.doStep, 0.0, 1.0, status=DISCARD)
    assert slave.getFloat64(READ, nValues=5) == before
    assert 10 < len(updates.received_values) < 500
    assert all(math.isfinite(value) for _, values in updates.received_values for value in values)
    slave.setFloat64([FORCE], [0.0])
    updates.received_values.clear()
    assert slave.doStep(0.0, STEP)[3] == STEP
    assert len(updates.received_values) == 4
