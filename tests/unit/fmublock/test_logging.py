"""What native FMUs say through the logger, and when."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fmublock.description import LOG_CATEGORIES
from tests.support.sessions import DISCARD, ERROR, OK, WARNING, Line, Session, opened, refused

EVENT, WARN = "logEvents", "logStatusWarning"
DISCARDED, WRONG = "logStatusDiscard", "logStatusError"
STATUSES = {EVENT: OK, WARN: WARNING, DISCARDED: DISCARD, WRONG: ERROR}


@pytest.fixture
def session(native_toy_fmu: Path, tmp_path: Path) -> Iterator[Session]:
    with opened(native_toy_fmu, tmp_path / "fmu") as session:
        yield session


def heard(session: Session, slave: Any) -> list[str]:
    """Categories of the messages when one thing of every kind happens; the instance goes on."""
    session.log.all.clear()
    slave.reset()
    session.initialize(slave)  # an event
    early = slave.getFMUstate()
    slave.doStep(0.0, 0.5)
    slave.doStep(0.5, 0.5)
    slave.setFMUstate(early)  # a warning
    slave.freeFMUstate(early)
    session.set(slave, force=float("nan"))
    with refused(DISCARD):
        slave.doStep(0.0, 0.5)
    with refused(ERROR):
        slave.doStep(77.0, 0.5)
    for line in session.log.all:
        assert line.status == STATUSES[line.category]
    return [line.category for line in session.log.all]


ALL = [EVENT, WARN, DISCARDED, WRONG]


def test_with_logging_everything_is_said(session: Session) -> None:
    assert heard(session, session.new(logging=True)) == ALL


def test_without_logging_problems_are_said(session: Session) -> None:
    assert heard(session, session.new(logging=False)) == [WARN, DISCARDED, WRONG]


def test_switched_off_nothing_is_said(session: Session) -> None:
    slave = session.new()
    slave.setDebugLogging(False, [])
    assert heard(session, slave) == []


def test_switched_on_everything_is_said(session: Session) -> None:
    slave = session.new(logging=False)
    slave.setDebugLogging(True, [])
    assert heard(session, slave) == ALL


@pytest.mark.parametrize("category", ALL)
def test_one_category_is_said_alone(session: Session, category: str) -> None:
    """Switching on names all that is wanted: what was on before is off."""
    slave = session.new()
    slave.setDebugLogging(True, [category])
    assert heard(session, slave) == [category]


@pytest.mark.parametrize("category", ALL)
def test_one_category_is_left_out(session: Session, category: str) -> None:
    slave = session.new()
    slave.setDebugLogging(False, [category])
    assert heard(session, slave) == [c for c in ALL if c != category]


@pytest.mark.parametrize("on", [True, False])
def test_several_categories_can_be_named(session: Session, on: bool) -> None:
    slave = session.new()
    slave.setDebugLogging(on, [EVENT, DISCARDED])
    assert heard(session, slave) == ([EVENT, DISCARDED] if on else [WARN, WRONG])


@pytest.mark.parametrize("on", [True, False])
def test_log_all_is_all(session: Session, on: bool) -> None:
    slave = session.new(logging=not on)
    slave.setDebugLogging(on, ["logAll"])
    assert heard(session, slave) == (ALL if on else [])


def test_categories_can_be_changed_at_any_time(session: Session) -> None:
    slave = session.instance()
    slave.setDebugLogging(False, [])
    slave.terminate()
    slave.setDebugLogging(True, [WRONG])
    with refused():
        slave.terminate()
    assert [line.text for line in session.log.all] == [
        "toy: initialized at t = 0 s.",
        "toy: cannot terminate in phase terminated.",
    ]


def test_the_categories_of_the_model_description_are_those_of_the_binary(session: Session) -> None:
    described = [c.name for c in session.description.logCategories]
    assert described == list(LOG_CATEGORIES)
    slave = session.new()
    for name in described:
        slave.setDebugLogging(True, [name])
    slave.setDebugLogging(True, described)
    assert set(heard(session, slave)) <= set(described)


@pytest.mark.parametrize("name", ["logNothing", "", "logall", "logEvents "])
def test_an_unknown_category_is_refused_and_nothing_is_changed(session: Session, name: str) -> None:
    slave = session.new()
    slave.setDebugLogging(True, [WARN, WRONG])
    for on in (True, False):
        session.log.all.clear()
        with refused():
            slave.setDebugLogging(on, [DISCARDED, name])
        assert session.log.all == [Line("toy", ERROR, WRONG, f"toy: there is no log category {name}.")]
    assert heard(session, slave) == [WARN, WRONG]


def test_categories_that_are_announced_but_missing_are_refused(session: Session) -> None:
    slave = session.new()
    with refused():
        slave.fmi2SetDebugLogging(slave.component, True, 2, None)
    assert session.log.lines("toy") == ["toy: 2 values were announced, but the array is NULL."]


def test_an_instance_without_a_logger_is_silent(session: Session) -> None:
    session.log.callbacks.logger = type(session.log.callbacks.logger)()
    slave = session.instance()
    with refused():
        slave.doStep(77.0, 0.5)
    slave.doStep(0.0, 0.5)
    assert session.log.all == []


def test_an_instance_without_callbacks_works(session: Session) -> None:
    other = session.new()
    component = other.fmi2Instantiate(
        b"bare", 1, session.description.guid.encode(), b"file:///", None, False, True
    )
    assert component is not None
    with refused():
        other.fmi2DoStep(component, 0.0, 0.5, True)
    other.fmi2FreeInstance(component)


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


def test_a_long_category_is_cut(session: Session) -> None:
    slave = session.new()
    with refused():
        slave.setDebugLogging(True, ["c" * 10_000])
    assert session.log.lines("toy") == [f"toy: there is no log category {'c' * 100}."]


@pytest.mark.parametrize(("name", "shown"), [("ä" * 200, "ä" * 200), ("a" + "ä" * 10_000, "Toy")])
def test_a_name_is_in_the_message_whole_or_not_at_all(session: Session, name: str, shown: str) -> None:
    """No character of several bytes is cut."""
    session.instance(name)
    assert session.log.all == [Line(name, OK, EVENT, f"{shown}: initialized at t = 0 s.")]


def test_every_message_begins_with_the_instances_name(session: Session) -> None:
    for name in ("a", "b"):
        heard(session, session.new(name))
        assert {line.instance for line in session.log.all} == {name}
        assert all(line.text.startswith(f"{name}: ") for line in session.log.all)
