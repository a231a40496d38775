"""The faulty FMU refuses wrong calls and counts what is left over: other tests expect none of either."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from fmpy.fmi2 import FMU2Slave

from tests.support.hand_written_fmus import Counts, Fault, build_faulty_fmu
from tests.support.sessions import FATAL, Session, opened, refused

CALLS: dict[str, Callable[[Session, FMU2Slave], object]] = {
    "a step from another time": lambda session, slave: slave.doStep(0.2, 0.1),
    "a step of size 0": lambda session, slave: slave.doStep(0.1, 0.0),
    "initialization after steps": lambda session, slave: slave.enterInitializationMode(),
    "a parameter after steps": lambda session, slave: session.set(slave, a=2.0),
    "an output": lambda session, slave: session.set(slave, y=2.0),
    "no pending step to cancel": lambda session, slave: slave.cancelStep(),
}


@pytest.fixture
def faulty(faulty_fmu: Path, tmp_path: Path) -> Iterator[Session]:
    with opened(faulty_fmu, tmp_path) as session:
        yield session


@pytest.mark.parametrize("name", CALLS)
def test_wrong_call_ends_the_run_until_a_reset(faulty: Session, name: str) -> None:
    slave = faulty.instance("test", b=0.5, u=2.0)
    slave.doStep(0.0, 0.1)
    with refused():
        CALLS[name](faulty, slave)
    with refused():
        slave.terminate()
    slave.reset()
    faulty.initialize(slave, u=1.0)
    slave.doStep(0.0, 1.0)
    assert faulty.get(slave, "y", "z") == [1.0, 1.0]


def test_going_back_despite_a_promise_is_an_error(faulty: Session) -> None:
    slave = faulty.instance("test")
    state = slave.getFMUstate()
    slave.doStep(0.0, 0.1, True)
    slave.setFMUstate(state)
    slave.doStep(0.0, 0.1, False)
    slave.doStep(0.1, 0.1, True)
    with refused():
        slave.setFMUstate(state)


def test_undeclared_capabilities_are_refused(tmp_path: Path) -> None:
    path = build_faulty_fmu(tmp_path, rollback=False, interpolate=False)
    with opened(path, tmp_path / "unpacked") as session:
        with refused():
            session.instance("test").getFMUstate()
        with refused():
            session.instance("test").setRealInputDerivatives(session.references(["u"]), [1], [1.0])


def test_calls_after_fatal_and_states_not_freed_are_counted(faulty: Session) -> None:
    counts = Counts(faulty.folder)
    slave, other = faulty.instance("test", fault=Fault.FATAL, at=0.05), faulty.instance("other")
    slave.getFMUstate()
    with refused(FATAL):
        slave.doStep(0.0, 0.1)
    assert counts.calls_after_fatal == 0
    for call in (slave.terminate, slave.reset, slave.getFMUstate, other.terminate):
        with refused(FATAL):
            call()
    faulty.instance("later").terminate()  # instances made later are not affected
    faulty.close()
    faulty.slaves.clear()
    assert (counts.calls_after_fatal, counts.states, counts.instances) == (4, 1, 0)
