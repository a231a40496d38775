"""The faulty FMU does what it is told, so that other tests can rely on it."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.fmi2 import FMU2Slave, fmi2DoStepStatus, fmi2LastSuccessfulTime, fmi2Pending, fmi2Terminated
from fmpy.validation import validate_fmu

from tests.support.hand_written_fmus import Counts, Fault, build_faulty_fmu
from tests.support.sessions import DISCARD, ERROR, FATAL, OK, WARNING, Session, opened, refused, status

AT = 0.3
STEP = 0.1


@pytest.fixture
def faulty(faulty_fmu: Path, tmp_path: Path) -> Iterator[Session]:
    """The FMU, open for instances."""
    with opened(faulty_fmu, tmp_path) as session:
        yield session


@pytest.fixture
def counts(faulty: Session) -> Counts:
    return Counts(faulty.folder)


def told(session: Session, fault: Fault, at: float = AT) -> FMU2Slave:
    """An instance that is stepped up to 0.3 s with u = 2."""
    slave = session.instance("test", b=0.5, u=2.0, fault=fault, at=at)
    for k in range(3):
        slave.doStep(k * STEP, STEP)
    return slave


def values(session: Session, slave: FMU2Slave) -> list[float]:
    return session.get(slave, "y", "z")


def last_message(session: Session) -> tuple[int, str, str]:
    return session.log.all[-1][1:]


# ---- without a fault ---------------------------------------------------------------------------


@pytest.mark.parametrize("options", [{}, {"rollback": False, "interpolate": False, "name": "Plain"}])
def test_description_is_valid(options: dict[str, Any], tmp_path: Path) -> None:
    path = build_faulty_fmu(tmp_path, **options)
    assert path == tmp_path / f"{options.get('name', 'Faulty')}.fmu"
    assert validate_fmu(str(path)) == []


def test_held_input_is_integrated_exactly(faulty_fmu: Path) -> None:
    start_values = {"a": 3.0, "b": 0.5, "u": 2.0}
    result = simulate_fmu(str(faulty_fmu), stop_time=1.0, output_interval=0.125, start_values=start_values)
    assert len(result) == 9
    np.testing.assert_allclose(result["y"], 6.0 * result["time"] + 1.0, rtol=1e-14)
    np.testing.assert_allclose(result["z"], 6.0 * result["time"], rtol=1e-14)


def test_ramp_is_integrated_exactly_with_input_derivatives(faulty: Session) -> None:
    slave = faulty.instance("test", b=0.5, u=1.0)
    for k in range(8):
        t = (k + 1) * 0.125
        slave.setRealInputDerivatives(faulty.references(["u"]), [1], [2.0])
        slave.doStep(t - 0.125, 0.125)
        assert values(faulty, slave) == pytest.approx([t + t**2 + 0.5 * (1.0 + 2.0 * t), t + t**2])
    slave.doStep(1.0, 1.0)  # a derivative holds for one step, and the input stays where it came
    assert faulty.get(slave, "u", "z") == pytest.approx([3.0, 5.0])


def test_output_follows_inputs_in_initialization_and_at_steps_only(faulty: Session) -> None:
    slave = faulty.instance("test", running=False, b=0.5)
    faulty.set(slave, u=2.0)
    assert values(faulty, slave) == [1.0, 0.0]
    slave.exitInitializationMode()
    faulty.set(slave, u=4.0)
    assert values(faulty, slave) == [1.0, 0.0]
    slave.doStep(0.0, STEP)
    assert values(faulty, slave) == pytest.approx([2.4, 0.4])


def test_long_step_is_discarded_and_a_shorter_one_done(faulty: Session) -> None:
    slave = faulty.instance("test", u=2.0, longest=STEP)
    with refused(DISCARD):
        slave.doStep(0.0, 0.2)
    assert last_message(faulty)[:2] == (DISCARD, "logStatusDiscard")
    assert slave.getRealStatus(fmi2LastSuccessfulTime) == 0.0
    assert not slave.getBooleanStatus(fmi2Terminated)
    slave.doStep(0.0, STEP)
    assert faulty.get(slave, "z") == [0.2]


def test_what_is_not_declared_is_refused(tmp_path: Path) -> None:
    path = build_faulty_fmu(tmp_path, rollback=False, interpolate=False)
    with opened(path, tmp_path / "unpacked") as session:
        with refused():
            session.instance("test").getFMUstate()
        with refused():
            session.instance("test").setRealInputDerivatives(session.references(["u"]), [1], [1.0])


@pytest.mark.parametrize(
    "call",
    [
        lambda session, slave: slave.doStep(2.0 * STEP, STEP),
        lambda session, slave: slave.doStep(3.0 * STEP, 0.0),
        lambda session, slave: slave.enterInitializationMode(),
        lambda session, slave: session.set(slave, a=2.0),
        lambda session, slave: session.set(slave, y=2.0),
        lambda session, slave: session.set(slave, fault=Fault.ERROR),
        lambda session, slave: slave.cancelStep(),
    ],
)
def test_wrong_call_ends_the_run(faulty: Session, call: Callable[[Session, FMU2Slave], object]) -> None:
    slave = told(faulty, Fault.NONE)
    with refused():
        call(faulty, slave)
    assert last_message(faulty)[:2] == (ERROR, "logStatusError")
    with refused():
        slave.terminate()
    assert last_message(faulty)[2] == "cannot terminate in phase failed."


# ---- states ------------------------------------------------------------------------------------


def test_state_brings_everything_back(faulty: Session, counts: Counts) -> None:
    slave = told(faulty, Fault.NONE)
    slave.setRealInputDerivatives(faulty.references(["u"]), [1], [3.0])
    before = slave.getFMUstate()
    saved = slave.serializeFMUstate(before)
    slave.doStep(AT, STEP)
    after = values(faulty, slave)
    other = faulty.instance("other")
    for target, state in ((slave, before), (other, other.deSerializeFMUstate(saved))):
        target.setFMUstate(state)
        assert values(faulty, target) == pytest.approx([1.6, 0.6])
        assert target.getRealStatus(fmi2LastSuccessfulTime) == pytest.approx(AT)
        target.doStep(AT, STEP)
        assert values(faulty, target) == after
        target.setFMUstate(state)
        again = target.getFMUstate()
        assert target.serializeFMUstate(again) == saved
        target.freeFMUstate(state)
        target.freeFMUstate(again)
    assert (counts.states, counts.rollbacks) == (0, 4)


def test_state_is_used_again(faulty: Session, counts: Counts) -> None:
    slave = told(faulty, Fault.NONE)
    state = slave.getFMUstate()
    slave.fmi2GetFMUstate(slave.component, state)
    assert counts.states == 1
    slave.freeFMUstate(state)
    assert counts.states == 0


def test_leaks_are_counted(faulty: Session, counts: Counts) -> None:
    slave = faulty.instance("test")
    slave.getFMUstate()
    assert (counts.states, counts.instances) == (1, 1)
    faulty.close()
    faulty.slaves.clear()
    assert (counts.states, counts.instances) == (1, 0)


def test_going_back_against_a_promise_is_an_error(faulty: Session) -> None:
    slave = faulty.instance("test")
    state = slave.getFMUstate()
    slave.doStep(0.0, STEP, 0)
    slave.setFMUstate(state)
    slave.doStep(0.0, STEP, 1)
    slave.setFMUstate(state)
    slave.doStep(0.0, STEP, 0)
    slave.doStep(STEP, STEP, 1)
    with refused():
        slave.setFMUstate(state)


# ---- faults ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fault", "answer", "category", "message"),
    [
        (Fault.DISCARD, DISCARD, "logStatusDiscard", "to discard the step to t = 0.4 s"),
        (Fault.ERROR, ERROR, "logStatusError", "to fail in the step to t = 0.4 s"),
        (Fault.FATAL, FATAL, "logStatusFatal", "to die in the step to t = 0.4 s"),
        (Fault.NAN_Y, OK, "logEvents", "to make y NaN in the step to t = 0.4 s"),
        (Fault.TERMINATE, DISCARD, "logStatusDiscard", "to end the run at t = 0.3 s"),
        (Fault.NAN_Z, OK, "logEvents", "to make z NaN in the step to t = 0.4 s"),
        (Fault.PENDING, fmi2Pending, "logStatusPending", "not to finish the step to t = 0.4 s"),
        (Fault.WARNING, WARNING, "logStatusWarning", "to warn of the step to t = 0.4 s"),
    ],
)
def test_step_that_passes_the_time_is_faulty(
    faulty: Session, fault: Fault, answer: int, category: str, message: str
) -> None:
    slave = told(faulty, fault)
    assert values(faulty, slave) == pytest.approx([1.6, 0.6])
    assert faulty.log.all == []
    assert status(slave.doStep, AT, STEP) == answer or answer == WARNING
    assert len(faulty.log.all) == 1
    assert last_message(faulty) == (answer, category, f"the faulty model was told {message}.")


@pytest.mark.parametrize("fault", [Fault.DISCARD, Fault.ERROR, Fault.PENDING])
def test_step_that_is_not_done_changes_nothing(faulty: Session, fault: Fault) -> None:
    slave = told(faulty, fault)
    before = values(faulty, slave)
    with refused(DISCARD, ERROR, fmi2Pending):
        slave.doStep(AT, STEP)
    assert values(faulty, slave) == before
    assert slave.getRealStatus(fmi2LastSuccessfulTime) == pytest.approx(AT)
    assert not slave.getBooleanStatus(fmi2Terminated)


def test_discard_and_warning_go_on(faulty: Session) -> None:
    slave = told(faulty, Fault.DISCARD, at=0.35)
    with refused(DISCARD):
        slave.doStep(AT, STEP)
    slave.doStep(AT, 0.05)
    slave = told(faulty, Fault.WARNING)
    for k in (3, 4):
        assert slave.fmi2DoStep(slave.component, k * STEP, STEP, 1) == WARNING
    assert values(faulty, slave) == pytest.approx([2.0, 1.0])


@pytest.mark.parametrize(("fault", "is_nan"), [(Fault.NAN_Y, [True, False]), (Fault.NAN_Z, [False, True])])
def test_output_stays_nan_until_the_model_is_set_back(
    faulty: Session, fault: Fault, is_nan: list[bool]
) -> None:
    slave = told(faulty, fault)
    state = slave.getFMUstate()
    for k in (3, 4):
        slave.doStep(k * STEP, STEP, 0)
        assert [math.isnan(v) for v in values(faulty, slave)] == is_nan
    assert len(faulty.log.all) == 1
    slave.setFMUstate(state)
    assert values(faulty, slave) == pytest.approx([1.6, 0.6])
    slave.freeFMUstate(state)


@pytest.mark.parametrize("at", [AT, 0.35])
def test_end_of_the_run_is_reached_within_the_step(faulty: Session, at: float) -> None:
    slave = told(faulty, Fault.TERMINATE, at)
    assert not slave.getBooleanStatus(fmi2Terminated)
    with refused(DISCARD):
        slave.doStep(AT, STEP)
    assert slave.getBooleanStatus(fmi2Terminated)
    assert slave.getRealStatus(fmi2LastSuccessfulTime) == pytest.approx(at)
    assert faulty.get(slave, "z") == pytest.approx([2.0 * at])
    slave.terminate()


def test_fmpy_ends_the_run_where_it_is_told(faulty_fmu: Path) -> None:
    start_values = {"u": 2.0, "fault": Fault.TERMINATE, "at": 0.35}
    result = simulate_fmu(str(faulty_fmu), stop_time=1.0, output_interval=STEP, start_values=start_values)
    assert result["time"][-1] == 0.35
    assert result["z"][-1] == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("fault", "call"),
    [
        (Fault.GET_REAL, lambda session, slave: session.get(slave, "y")),
        (Fault.SET_REAL, lambda session, slave: session.set(slave, u=1.0)),
        (Fault.GET_STATE, lambda session, slave: slave.freeFMUstate(slave.getFMUstate())),
    ],
)
def test_call_is_refused_after_the_time(
    faulty: Session, counts: Counts, fault: Fault, call: Callable[[Session, FMU2Slave], object]
) -> None:
    slave = told(faulty, fault)
    call(faulty, slave)
    slave.doStep(AT, STEP)
    with refused():
        call(faulty, slave)
    assert counts.states == 0
    code, category, message = last_message(faulty)
    assert (code, category) == (ERROR, "logStatusError")
    assert message.startswith("the faulty model was told to refuse") and message.endswith(" at t = 0.4 s.")


def test_initialization_is_refused(faulty: Session) -> None:
    for fault, verb in ((Fault.ENTER_INITIALIZATION, "enter"), (Fault.EXIT_INITIALIZATION, "exit")):
        slave = faulty.new("test")
        faulty.set(slave, fault=fault)
        if fault == Fault.EXIT_INITIALIZATION:
            slave.enterInitializationMode()
        with refused():
            getattr(slave, f"{verb}InitializationMode")()
        message = f"the faulty model was told not to {verb} initialization mode."
        assert last_message(faulty) == (ERROR, "logStatusError", message)


def test_pending_step_stays_so_until_cancelled(faulty: Session) -> None:
    slave = told(faulty, Fault.PENDING)
    with refused(fmi2Pending):
        slave.doStep(AT, STEP)
    assert slave.getStatus(fmi2DoStepStatus) == fmi2Pending
    slave.cancelStep()
    assert slave.getStatus(fmi2DoStepStatus) == DISCARD


def test_calls_after_fatal_are_told_and_counted(
    faulty: Session, counts: Counts, capfd: pytest.CaptureFixture[str]
) -> None:
    bystander = faulty.instance("bystander")
    slave = told(faulty, Fault.FATAL)
    with refused(FATAL):
        slave.doStep(AT, STEP)
    assert counts.calls_after_fatal == 0
    for call in (slave.terminate, slave.reset, slave.getFMUstate, bystander.terminate):
        with refused(FATAL):
            call()
    assert counts.calls_after_fatal == 4
    assert "fmi2Terminate called after fmi2Fatal\n" in capfd.readouterr().err
    told(faulty, Fault.NONE).terminate()
    faulty.close()
    faulty.slaves.clear()
    assert (counts.instances, counts.calls_after_fatal) == (0, 4)


def test_reset_makes_it_new(faulty: Session) -> None:
    slave = told(faulty, Fault.ERROR)
    with refused():
        slave.doStep(AT, STEP)
    slave.reset()
    faulty.initialize(slave, u=1.0)
    slave.doStep(0.0, 1.0)
    assert values(faulty, slave) == [1.0, 1.0]
