"""The faulty FMU fails as its parameters say, so that other tests can rely on it."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.fmi2 import FMU2Slave, fmi2DoStepStatus, fmi2LastSuccessfulTime, fmi2Pending, fmi2Terminated
from fmpy.validation import validate_fmu

from tests.support.hand_written_fmus import Counts, Fault, build_faulty_fmu
from tests.support.sessions import DISCARD, ERROR, FATAL, OK, WARNING, Session, opened, refused, status

AT, STEP = 0.3, 0.1


@pytest.fixture
def faulty(faulty_fmu: Path, tmp_path: Path) -> Iterator[Session]:
    with opened(faulty_fmu, tmp_path) as session:
        yield session


@pytest.fixture
def counts(faulty: Session) -> Counts:
    return Counts(faulty.folder)


def stepped(session: Session, fault: Fault, at: float = AT) -> FMU2Slave:
    """Return an instance at t = 0.3 s, with u = 2."""
    slave = session.instance("test", b=0.5, u=2.0, fault=fault, at=at)
    for k in range(3):
        slave.doStep(k * STEP, STEP)
    return slave


def values(session: Session, slave: FMU2Slave) -> list[float]:
    return session.get(slave, "y", "z")


def test_fmpy_accepts_it_and_integrates_a_held_input(faulty_fmu: Path) -> None:
    assert validate_fmu(str(faulty_fmu)) == []
    start_values = {"a": 3.0, "b": 0.5, "u": 2.0, "fault": Fault.TERMINATE, "at": 0.35}
    result = simulate_fmu(str(faulty_fmu), stop_time=1.0, output_interval=STEP, start_values=start_values)
    assert result["time"][-1] == 0.35
    np.testing.assert_allclose(result["y"], 6.0 * result["time"] + 1.0, rtol=1e-14)


def test_ramp_is_integrated_exactly_with_input_derivatives(faulty: Session) -> None:
    slave = faulty.instance("test", b=0.5, u=1.0)
    for t in (0.125, 0.25):
        slave.setRealInputDerivatives(faulty.references(["u"]), [1], [2.0])
        slave.doStep(t - 0.125, 0.125)
        assert values(faulty, slave) == pytest.approx([t + t**2 + 0.5 * (1.0 + 2.0 * t), t + t**2])
    slave.doStep(0.25, 0.25)  # a derivative holds for one step; the input stays where it ended
    assert faulty.get(slave, "u", "z") == pytest.approx([1.5, 0.3125 + 0.25 * 1.5])


def test_undeclared_capabilities_are_refused(tmp_path: Path) -> None:
    path = build_faulty_fmu(tmp_path, rollback=False, interpolate=False)
    with opened(path, tmp_path / "unpacked") as session:
        with refused():
            session.instance("test").getFMUstate()
        with refused():
            session.instance("test").setRealInputDerivatives(session.references(["u"]), [1], [1.0])


CALLS: dict[str, Callable[[Session, FMU2Slave], object]] = {
    "a step from another time": lambda session, slave: slave.doStep(2.0 * STEP, STEP),
    "a step of size 0": lambda session, slave: slave.doStep(3.0 * STEP, 0.0),
    "initialization after steps": lambda session, slave: slave.enterInitializationMode(),
    "a parameter after steps": lambda session, slave: session.set(slave, a=2.0),
    "an output": lambda session, slave: session.set(slave, y=2.0),
    "no pending step to cancel": lambda session, slave: slave.cancelStep(),
}


@pytest.mark.parametrize("name", CALLS)
def test_wrong_call_ends_the_run(faulty: Session, name: str) -> None:
    slave = stepped(faulty, Fault.NONE)
    with refused():
        CALLS[name](faulty, slave)
    assert faulty.log.all[-1][1:3] == (ERROR, "logStatusError")
    with refused():
        slave.terminate()
    slave.reset()
    faulty.initialize(slave, u=1.0)
    slave.doStep(0.0, 1.0)
    assert values(faulty, slave) == [1.0, 1.0]


def test_state_restores_everything(faulty: Session, counts: Counts) -> None:
    slave = stepped(faulty, Fault.NONE)
    slave.setRealInputDerivatives(faulty.references(["u"]), [1], [3.0])
    before = slave.getFMUstate()
    saved = slave.serializeFMUstate(before)
    slave.doStep(AT, STEP)
    after = values(faulty, slave)
    other = faulty.instance("other")
    for target, state in ((slave, before), (other, other.deSerializeFMUstate(saved))):
        target.setFMUstate(state)
        assert values(faulty, target) == pytest.approx([1.6, 0.6])
        target.doStep(AT, STEP)
        assert values(faulty, target) == after
        target.freeFMUstate(state)
    assert (counts.instances, counts.states, counts.rollbacks) == (2, 0, 2)
    slave.getFMUstate()
    faulty.close()
    faulty.slaves.clear()
    assert (counts.instances, counts.states) == (0, 1)  # the leak is counted


def test_rollback_against_a_promise_is_an_error(faulty: Session) -> None:
    slave = faulty.instance("test")
    state = slave.getFMUstate()
    slave.doStep(0.0, STEP, 1)
    slave.setFMUstate(state)
    slave.doStep(0.0, STEP, 0)
    slave.doStep(STEP, STEP, 1)
    with refused():
        slave.setFMUstate(state)


STEPS = {
    Fault.DISCARD: (DISCARD, "logStatusDiscard", "to discard the step to t = 0.4 s"),
    Fault.ERROR: (ERROR, "logStatusError", "to fail in the step to t = 0.4 s"),
    Fault.FATAL: (FATAL, "logStatusFatal", "to die in the step to t = 0.4 s"),
    Fault.NAN_Y: (OK, "logEvents", "to make y NaN in the step to t = 0.4 s"),
    Fault.TERMINATE: (DISCARD, "logStatusDiscard", "to end the run at t = 0.3 s"),
    Fault.NAN_Z: (OK, "logEvents", "to make z NaN in the step to t = 0.4 s"),
    Fault.PENDING: (fmi2Pending, "logStatusPending", "not to finish the step to t = 0.4 s"),
    Fault.WARNING: (WARNING, "logStatusWarning", "to warn of the step to t = 0.4 s"),
}


@pytest.mark.parametrize("fault", STEPS)
def test_step_that_passes_the_time_is_faulty(faulty: Session, fault: Fault) -> None:
    answer, category, message = STEPS[fault]
    slave = stepped(faulty, fault)
    before = values(faulty, slave)
    assert before == pytest.approx([1.6, 0.6]) and faulty.log.all == []
    assert status(slave.doStep, AT, STEP) == answer or answer == WARNING
    assert [line[1:] for line in faulty.log.all] == [
        (answer, category, f"the faulty model was told {message}.")
    ]
    if fault == Fault.FATAL:
        return
    found = values(faulty, slave)
    if answer in (DISCARD, ERROR, fmi2Pending):
        assert found == before
        assert slave.getRealStatus(fmi2LastSuccessfulTime) == pytest.approx(AT)
        assert slave.getBooleanStatus(fmi2Terminated) == (fault == Fault.TERMINATE)
    else:
        assert [math.isnan(v) for v in found] == [fault == Fault.NAN_Y, fault == Fault.NAN_Z]
    if fault == Fault.PENDING:
        assert slave.getStatus(fmi2DoStepStatus) == fmi2Pending
        slave.cancelStep()
        assert slave.getStatus(fmi2DoStepStatus) == DISCARD


def test_long_step_is_discarded_and_a_shorter_one_done(faulty: Session) -> None:
    slave = faulty.instance("test", u=2.0, longest=STEP)
    with refused(DISCARD):
        slave.doStep(0.0, 0.2)
    slave.doStep(0.0, STEP)
    assert faulty.get(slave, "z") == [0.2]


@pytest.mark.parametrize(
    ("fault", "call"),
    [
        (Fault.GET_REAL, lambda session, slave: session.get(slave, "y")),
        (Fault.SET_REAL, lambda session, slave: session.set(slave, u=1.0)),
        (Fault.GET_STATE, lambda session, slave: slave.freeFMUstate(slave.getFMUstate())),
    ],
)
def test_call_is_refused_after_the_time(
    faulty: Session, fault: Fault, call: Callable[[Session, FMU2Slave], object]
) -> None:
    slave = stepped(faulty, fault)
    call(faulty, slave)
    slave.doStep(AT, STEP)
    with refused():
        call(faulty, slave)
    message = faulty.log.all[-1].text
    assert message.startswith("the faulty model was told to refuse") and message.endswith(" at t = 0.4 s.")


def test_initialization_is_refused(faulty: Session) -> None:
    for fault, verb in ((Fault.ENTER_INITIALIZATION, "enter"), (Fault.EXIT_INITIALIZATION, "exit")):
        slave = faulty.new("test")
        faulty.set(slave, fault=fault)
        if fault == Fault.EXIT_INITIALIZATION:
            slave.enterInitializationMode()
        with refused():
            getattr(slave, f"{verb}InitializationMode")()
        assert faulty.log.all[-1].text == f"the faulty model was told not to {verb} initialization mode."


def test_calls_after_fatal_are_counted(
    faulty: Session, counts: Counts, capfd: pytest.CaptureFixture[str]
) -> None:
    other = faulty.instance("other")
    slave = stepped(faulty, Fault.FATAL)
    with refused(FATAL):
        slave.doStep(AT, STEP)
    assert counts.calls_after_fatal == 0
    for call in (slave.terminate, slave.reset, slave.getFMUstate, other.terminate):
        with refused(FATAL):
            call()
    assert counts.calls_after_fatal == 4
    assert "fmi2Terminate called after fmi2Fatal\n" in capfd.readouterr().err
    stepped(faulty, Fault.NONE).terminate()  # instances made later are not affected
    faulty.close()
    faulty.slaves.clear()
    assert (counts.instances, counts.calls_after_fatal) == (0, 4)
