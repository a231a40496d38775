"""The frame of a run: start, stop, what may be called when, and going back. Both flavours."""

import math
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.support.sessions import DISCARD, ERROR, FATAL, OK, WARNING, Session, opened, refused

NATIVE_OUTPUTS = ("x", "v[1]", "v[2]", "power", "inverse", "random", "step_count", "force")


@pytest.fixture
def session(toy_fmu: Path, tmp_path: Path) -> Iterator[Session]:
    with opened(toy_fmu, tmp_path / "fmu") as session:
        yield session


@pytest.fixture
def native(native_toy_fmu: Path, tmp_path: Path) -> Iterator[Session]:
    with opened(native_toy_fmu, tmp_path / "fmu") as session:
        yield session


def running(
    session: Session, start: float = 0.0, stop: float | None = None, tolerance: float | None = None
) -> Any:
    slave = session.new()
    slave.setupExperiment(tolerance, start, stop)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    return slave


def bits(session: Session, slave: Any) -> bytes:
    values = session.get(slave, *NATIVE_OUTPUTS)
    return struct.pack(f"{len(values)}d", *values)


# ---- stop time ---------------------------------------------------------------------------------


def test_a_step_past_the_stop_time_is_refused(session: Session) -> None:
    slave = running(session, stop=1.0)
    slave.doStep(0.0, 0.75)
    before = bits(session, slave)
    with refused(ERROR, DISCARD):
        slave.doStep(0.75, 0.5)
    (line,) = session.log.lines("toy")
    assert "the step to t = 1.25 s goes past the stop time 1" in line
    assert bits(session, slave) == before
    slave.doStep(0.75, 0.25)


def test_nothing_comes_after_the_stop_time(session: Session) -> None:
    slave = running(session, stop=1.0)
    slave.doStep(0.0, 1.0)
    for step in (1e-9, 1e-3, 1.0):
        with refused(ERROR, DISCARD):
            slave.doStep(1.0, step)


@pytest.mark.parametrize(
    ("step", "count", "start"), [(0.1, 10, 0.0), (0.01, 100, 0.0), (1e-3, 1000, 5.0), (1.0 / 3.0, 3, -1.0)]
)
def test_steps_that_reach_the_stop_time_but_for_rounding_are_done(
    session: Session, step: float, count: int, start: float
) -> None:
    """Ten times 0.1 added up is not 1."""
    slave = running(session, start=start, stop=start + count * step)
    now = start
    for _ in range(count):
        slave.doStep(now, step)
        now += step
    assert session.get(slave, "step_count") == [count]


def test_without_a_stop_time_a_run_has_no_end(session: Session) -> None:
    slave = running(session, start=1e6)
    slave.doStep(1e6, 0.5)
    slave.doStep(1e6 + 0.5, 0.5)


def test_a_reset_forgets_the_stop_time(session: Session) -> None:
    slave = running(session, stop=1.0)
    slave.reset()
    session.initialize(slave)
    slave.doStep(0.0, 0.75)
    slave.doStep(0.75, 0.75)


def test_a_saved_state_carries_the_stop_time(session: Session) -> None:
    slave, other = running(session, stop=1.0), running(session)
    saved = slave.getFMUstate()
    other.setFMUstate(saved)
    slave.freeFMUstate(saved)
    with refused(ERROR, DISCARD):
        other.doStep(0.0, 1.5)
    other.doStep(0.0, 1.0)


@pytest.mark.parametrize(("start", "stop"), [(1.0, 0.5), (0.0, math.nan), (0.0, -math.inf)])
def test_a_stop_before_the_start_is_refused(session: Session, start: float, stop: float) -> None:
    slave = session.new()
    with refused(ERROR, FATAL):
        slave.setupExperiment(None, start, stop)
    assert "is not after the start time" in session.log.lines("toy")[0]


@pytest.mark.parametrize("start", [math.nan, math.inf])
def test_a_start_that_is_no_number_is_refused(session: Session, start: float) -> None:
    slave = session.new()
    with refused(ERROR, FATAL):
        slave.setupExperiment(None, start)
    assert f"the start time {start} is not a finite number of seconds." in session.log.lines("toy")[0]


def test_the_last_setup_counts(session: Session) -> None:
    slave = session.new()
    slave.setupExperiment(None, 2.0, 3.0)
    slave.setupExperiment(None, 4.0, 6.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    slave.doStep(4.0, 2.0)


def test_a_run_may_stop_where_it_starts(session: Session) -> None:
    slave = running(session, start=1.0, stop=1.0)
    assert session.get(slave, "x") == [0.125]
    with refused(ERROR, DISCARD):
        slave.doStep(1.0, 0.1)


# ---- tolerance ---------------------------------------------------------------------------------


@pytest.mark.parametrize("tolerance", [math.nan, math.inf, -1e-6, 0.0])
def test_a_tolerance_that_is_no_positive_number_is_refused(native: Session, tolerance: float) -> None:
    slave = native.new()
    with refused():
        slave.setupExperiment(tolerance)
    assert native.log.lines("toy") == [f"toy: the tolerance {tolerance:g} is not a positive number."]
    slave.setupExperiment(1e-6)
    slave.enterInitializationMode()


def test_a_refused_setup_sets_nothing(native: Session) -> None:
    slave = native.new()
    slave.setupExperiment(None, 2.0, 3.0)
    for arguments in ((-1.0, 5.0, 6.0), (None, 5.0, 4.0), (None, math.nan, 9.0)):
        with refused():
            slave.setupExperiment(*arguments)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    with refused():
        slave.doStep(2.0, 1.5)
    slave.doStep(2.0, 1.0)


def test_a_tolerance_changes_no_result(session: Session) -> None:
    results = []
    for tolerance in (None, 1e-2, 1e-9):
        slave = running(session, tolerance=tolerance)
        slave.doStep(0.0, 0.5)
        results.append(bits(session, slave))
    assert results[0] == results[1] == results[2]


# ---- internal steps ----------------------------------------------------------------------------


def test_a_step_of_too_many_internal_steps_is_refused_at_once(session: Session) -> None:
    """1.5e9 of them would take minutes; the instance can go on with fewer."""
    slave = session.instance(**{"solver.internal_step": 1e-9})
    before, begin = bits(session, slave), time.process_time()
    with refused(ERROR, DISCARD):
        slave.doStep(0.0, 1.5)
    assert time.process_time() - begin < 0.5
    assert "needs more than 1e+09 internal steps." in session.log.lines("toy")[0]
    assert bits(session, slave) == before
    slave.doStep(0.0, 1e-6)


@pytest.mark.parametrize("step", [0.0, -0.1, math.nan, math.inf])
def test_a_step_that_is_no_positive_number_is_refused(session: Session, step: float) -> None:
    slave = session.instance()
    before = bits(session, slave)
    with refused(ERROR, DISCARD):
        slave.doStep(0.0, step)
    assert bits(session, slave) == before
    slave.doStep(0.0, 0.1)


# ---- going back --------------------------------------------------------------------------------


def test_going_back_behind_a_promised_point_is_a_warning_and_exact(native: Session) -> None:
    """noSetFMUStatePriorToCurrentPoint at t = 0.5 s promises not to go back before 0.5 s."""
    slave = native.instance()
    slave.doStep(0.0, 0.25, False)
    early, bits_then = slave.getFMUstate(), bits(native, slave)
    slave.doStep(0.25, 0.25, False)
    late = slave.getFMUstate()
    slave.doStep(0.5, 0.25, True)
    bits_once = bits(native, slave)
    assert slave.fmi2SetFMUstate(slave.component, late) == OK
    assert native.log.lines("toy") == []
    assert slave.fmi2SetFMUstate(slave.component, early) == WARNING
    assert native.log.lines("toy") == [
        "toy: set back to t = 0.25 s, though noSetFMUStatePriorToCurrentPoint was given at t = 0.5 s."
    ]
    assert bits(native, slave) == bits_then
    slave.doStep(0.25, 0.25, False)
    slave.doStep(0.5, 0.25, False)
    assert bits(native, slave) == bits_once


def test_a_promise_is_for_good(native: Session) -> None:
    """Going back does not end it, a step without one neither."""
    slave = native.instance()
    early = slave.getFMUstate()
    slave.doStep(0.0, 0.25, False)
    slave.doStep(0.25, 0.25, True)
    for _ in range(2):
        assert slave.fmi2SetFMUstate(slave.component, early) == WARNING
        slave.doStep(0.0, 0.25, False)


def test_without_a_promise_going_back_is_fine(native: Session) -> None:
    slave = native.instance()
    early = slave.getFMUstate()
    slave.doStep(0.0, 0.25, False)
    assert slave.fmi2SetFMUstate(slave.component, early) == OK
    assert native.log.lines("toy") == []


def test_a_discarded_step_promises_nothing(native: Session) -> None:
    slave = native.instance()
    early = slave.getFMUstate()
    slave.doStep(0.0, 0.25, False)
    native.set(slave, force=math.inf)
    with refused(DISCARD):
        slave.doStep(0.25, 0.25, True)
    assert slave.fmi2SetFMUstate(slave.component, early) == OK


def test_a_reset_forgets_a_promise(native: Session) -> None:
    slave = native.instance()
    early = slave.getFMUstate()
    slave.doStep(0.0, 0.25, True)
    slave.doStep(0.25, 0.25, True)
    slave.reset()
    assert slave.fmi2SetFMUstate(slave.component, early) == OK


# ---- what may be called when -------------------------------------------------------------------


def test_nothing_can_be_read_before_initialization(native: Session) -> None:
    """Values are not computed yet; PythonFMU's are, so that it has no reason to refuse."""
    slave = native.new()
    for call in (
        lambda: native.get(slave, "x"),
        lambda: slave.getInteger(native.references(["count"])),
        lambda: slave.getBoolean(native.references(["damped"])),
    ):
        with refused():
            call()
    assert native.log.lines("toy") == ["toy: cannot get values in phase instantiated."] * 3
    native.initialize(slave)
    assert native.get(slave, "x") == [0.125]


@pytest.mark.parametrize("name", ["force", "body.mass", "count", "damped", "x"])
def test_nothing_can_be_set_after_termination(session: Session, name: str) -> None:
    slave = session.instance()
    slave.doStep(0.0, 0.1)
    slave.terminate()
    before = bits(session, slave)
    with refused(ERROR, FATAL):
        session.set(slave, **{name: 1})
    assert "cannot set values in phase terminated." in session.log.lines("toy")[0]
    assert bits(session, slave) == before


def test_no_step_comes_after_termination(session: Session) -> None:
    slave = session.instance()
    slave.doStep(0.0, 0.1)
    slave.terminate()
    before = bits(session, slave)
    with refused(ERROR, DISCARD):
        slave.doStep(0.1, 0.1)
    assert bits(session, slave) == before


@pytest.mark.parametrize("kind", [2, 3])
def test_time_and_end_can_be_asked(native: Session, kind: int) -> None:
    """fmi2LastSuccessfulTime and fmi2Terminated; after a discarded step it is the time before."""
    slave = native.instance()
    slave.doStep(0.0, 0.25)
    native.set(slave, force=math.nan)
    with refused(DISCARD):
        slave.doStep(0.25, 0.25)
    if kind == 2:
        assert slave.getRealStatus(kind) == 0.25
    else:
        assert slave.getBooleanStatus(kind) is False
