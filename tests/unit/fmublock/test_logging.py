"""What native FMUs log, and when."""

from typing import Any

import pytest

from fmublock.description import LOG_CATEGORIES
from tests.support.sessions import DISCARD, ERROR, OK, WARNING, Line, Session, refused

EVENT, WARN = "logEvents", "logStatusWarning"
DISCARDED, WRONG = "logStatusDiscard", "logStatusError"
STATUSES = {EVENT: OK, WARN: WARNING, DISCARDED: DISCARD, WRONG: ERROR}


def read_messages(session: Session, slave: Any) -> list[str]:
    """Categories of the messages when one thing of every kind happens; the instance continues."""
    session.log.all.clear()
    slave.reset()
    session.initialize(slave)  # an event
    early_state = slave.getFMUstate()
    slave.doStep(0.0, 0.5)
    slave.doStep(0.5, 0.5)
    slave.setFMUstate(early_state)  # a warning
    slave.freeFMUstate(early_state)
    session.set(slave, force=float("nan"))
    with refused(DISCARD):
        slave.doStep(0.0, 0.5)
    with refused(ERROR):
        slave.doStep(77.0, 0.5)
    for line in session.log.all:
        assert line.status == STATUSES[line.category]
    return [line.category for line in session.log.all]


ALL = [EVENT, WARN, DISCARDED, WRONG]


@pytest.mark.parametrize(
    ("logging", "calls", "expected"),
    [
        (True, [], ALL),
        (False, [], [WARN, DISCARDED, WRONG]),
        (True, [(False, [])], []),
        (False, [(True, [])], ALL),
        *((True, [(True, [c])], [c]) for c in ALL),  # what was on before is off
        *((True, [(False, [c])], [x for x in ALL if x != c]) for c in ALL),
        (True, [(True, [EVENT, DISCARDED])], [EVENT, DISCARDED]),
        (True, [(False, [EVENT, DISCARDED])], [WARN, WRONG]),
        (False, [(True, ["logAll"])], ALL),
        (True, [(False, ["logAll"])], []),
        (True, [(True, [c]) for c in LOG_CATEGORIES], [list(LOG_CATEGORIES)[-1]]),
    ],
)
def test_categories_that_are_on_are_logged(
    session: Session, logging: bool, calls: list[tuple[bool, list[str]]], expected: list[str]
) -> None:
    slave = session.new(logging=logging)
    for is_on, categories in calls:
        slave.setDebugLogging(is_on, categories)
    assert read_messages(session, slave) == (ALL if expected == ["logAll"] else expected)
    assert [c.name for c in session.description.logCategories] == list(LOG_CATEGORIES)


@pytest.mark.parametrize("name", ["", "logEvents ", "c" * 10_000])
def test_unknown_category_is_refused_and_nothing_is_changed(session: Session, name: str) -> None:
    slave = session.instance()
    slave.setDebugLogging(True, [WARN, WRONG])
    for on in (True, False):
        session.log.all.clear()
        with refused():
            slave.setDebugLogging(on, [DISCARDED, name])
        assert session.log.all == [Line("toy", ERROR, WRONG, f"toy: there is no log category {name[:100]}.")]
    assert read_messages(session, slave) == [WARN, WRONG]


@pytest.mark.parametrize("has_callbacks", [True, False])
def test_instance_without_a_logger_is_silent(session: Session, has_callbacks: bool) -> None:
    session.log.callbacks.logger = type(session.log.callbacks.logger)()
    second, callbacks = session.new(), session.log.callbacks if has_callbacks else None
    guid = session.description.guid.encode()
    component = second.fmi2Instantiate(b"bare", 1, guid, b"file:///", callbacks, False, True)
    with refused():
        second.fmi2DoStep(component, 0.0, 0.5, True)
    second.fmi2FreeInstance(component)
    assert session.log.all == []


NASTY = "50%s%n %d"


def test_no_message_contains_a_percent_sign(session: Session) -> None:
    """Hosts take a message as a printf format."""
    slave = session.instance(NASTY)
    with refused():
        slave.terminate() or slave.terminate()
    with refused():
        slave.setDebugLogging(True, [NASTY])
    assert [line.instance for line in session.log.all] == [NASTY] * 4
    assert [line.text for line in session.log.all] == [
        "50#s#n #d: initialized at t = 0 s.",
        "50#s#n #d: terminated at t = 0 s.",
        "50#s#n #d: cannot terminate in phase terminated.",
        "50#s#n #d: there is no log category 50#s#n #d.",
    ]


@pytest.mark.parametrize(("name", "logged_name"), [("ä" * 200, "ä" * 200), ("a" + "ä" * 10_000, "Toy")])
def test_names_are_not_cut_within_a_character(session: Session, name: str, logged_name: str) -> None:
    """No character of several bytes is cut."""
    session.instance(name)
    assert session.log.all == [Line(name, OK, EVENT, f"{logged_name}: initialized at t = 0 s.")]
