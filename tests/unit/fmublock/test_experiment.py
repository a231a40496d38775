"""The frame of a run: start and stop, going back, and what may be called after the end."""

import math

import pytest
from fmpy.fmi2 import fmi2LastSuccessfulTime, fmi2Terminated

from tests.support.sessions import DISCARD, ERROR, FATAL, OK, WARNING, Session, refused

NAMES = ("x", "v[1]", "v[2]", "power", "inverse", "random", "step_count", "force")


@pytest.mark.parametrize("forget", ["reset", "set up again"])
def test_last_setup_counts(either: Session, forget: str) -> None:
    slave = either.new()
    either.set(slave, **{"solver.internal_step": 0.125})
    slave.setupExperiment(None, 2.0, 3.0)
    if forget == "reset":
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        slave.doStep(2.0, 0.5)
        slave.reset()
        either.set(slave, **{"solver.internal_step": 0.125})
    slave.setupExperiment(None, 4.0, 6.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    assert either.get(slave, "x", "step_count") == [0.125, 0.0]
    slave.doStep(4.0, 2.0)


def test_refused_setup_sets_nothing(session: Session) -> None:
    slave = session.new()
    slave.setupExperiment(1e-6, 2.0, 3.0)
    tolerances = (math.nan, math.inf, -1e-6, 0.0)
    for arguments in (*((x, 5.0, 6.0) for x in tolerances), (None, 5.0, 4.0), (None, math.nan, 9.0)):
        with refused():
            slave.setupExperiment(*arguments)
    expected = [f"toy: the tolerance {x:g} is not a positive number." for x in tolerances]
    assert session.log.lines("toy")[: len(tolerances)] == expected
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    with refused():
        slave.doStep(2.0, 1.5)
    slave.doStep(2.0, 1.0)


def test_duration_of_a_promise_about_states(session: Session) -> None:
    """Going back does not end it, nor does a step without one; a discarded step promises nothing."""
    slave = session.instance()
    early_state = slave.getFMUstate()

    def go_back() -> int:
        return slave.fmi2SetFMUstate(slave.component, early_state)

    slave.doStep(0.0, 0.25, False)
    assert go_back() == OK
    slave.doStep(0.0, 0.25, False)
    session.set(slave, force=math.inf)
    with refused(DISCARD):
        slave.doStep(0.25, 0.25, True)
    assert go_back() == OK
    session.set(slave, force=0.5)
    slave.doStep(0.0, 0.25, False)
    slave.doStep(0.25, 0.25, True)
    session.log.all.clear()
    for _ in range(2):
        assert go_back() == WARNING
        slave.doStep(0.0, 0.25, False)
    promise = "though noSetFMUStatePriorToCurrentPoint was given at t = 0.25 s."
    assert session.log.lines("toy") == [f"toy: set back to t = 0 s, {promise}"] * 2
    slave.reset()
    assert go_back() == OK


def test_nothing_can_be_changed_after_termination(either: Session) -> None:
    slave = either.instance()
    slave.doStep(0.0, 0.1)
    slave.terminate()
    before = either.get(slave, *NAMES)
    for name in ("force", "count", "damped"):
        with refused(ERROR, FATAL):
            either.set(slave, **{name: 1})
        assert "cannot set values in phase terminated." in either.log.lines("toy")[-1]
    with refused(ERROR, DISCARD):
        slave.doStep(0.1, 0.1)
    assert either.get(slave, *NAMES) == before


def test_status_functions(session: Session) -> None:
    """fmi2LastSuccessfulTime and fmi2Terminated; after a discarded step it is the time before."""
    slave = session.instance()
    slave.doStep(0.0, 0.25)
    session.set(slave, force=math.nan)
    with refused(DISCARD):
        slave.doStep(0.25, 0.25)
    assert slave.getRealStatus(fmi2LastSuccessfulTime) == 0.25
    assert slave.getBooleanStatus(fmi2Terminated) is False
