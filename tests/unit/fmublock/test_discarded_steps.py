"""After a discarded step the clock is where it was, so that a run goes on as if nobody had tried."""

from collections.abc import Callable, Iterator, Sequence
from itertools import accumulate, repeat
from pathlib import Path
from typing import Any

import pytest

from fmublock.instance import Instance, StepDiscardedError
from tests.support.sessions import DISCARD, OK, Session, opened, status
from tests.support.toy import Toy

NAMES = ("x", "v[1]", "v[2]", "power", "random", "step_count")
STEP = 1e-4
TIMES = list(accumulate(repeat(STEP, 600), initial=0.0))  # as a tool that adds its steps up
AT = 300

Try = tuple[float, float]
TRIES: dict[str, Sequence[Try]] = {
    "same length": [(TIMES[AT], STEP)],
    "same length, twice": [(TIMES[AT], STEP)] * 2,
    "longer, then halves": [(TIMES[AT], 3.0 * STEP), (TIMES[AT], 0.5 * STEP)],
    "a little later": [(TIMES[AT] + 5e-5 * STEP, STEP)],
}


@pytest.fixture(scope="module", params=["native", "python"])
def session(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    path: Path = request.getfixturevalue(f"{request.param}_toy_fmu")
    with opened(path, tmp_path_factory.mktemp("discarded")) as session:
        yield session


def go_on(do_step: Callable[[float, float], Any], first: int, last: int) -> None:
    for k in range(first, last):
        do_step(TIMES[k], STEP)


def running() -> Instance:
    instance = Instance(Toy(), "toy")
    instance.enter_initialization()
    instance.exit_initialization()
    return instance


@pytest.mark.parametrize("tries", TRIES)
def test_an_instance_goes_on_as_if_nobody_had_tried(tries: str) -> None:
    tried, straight = running(), running()
    for instance in (tried, straight):
        go_on(instance.do_step, 0, AT)
    tried["force"] = float("nan")
    for time, step in TRIES[tries]:
        with pytest.raises(StepDiscardedError):
            tried.do_step(time, step)
        assert tried.time == straight.time
    tried["force"] = straight["force"]
    assert tried.get_state() == straight.get_state()
    for first, last in ((AT, AT + 1), (AT + 1, AT + 2), (AT + 2, len(TIMES))):
        for instance in (tried, straight):
            go_on(instance.do_step, first, last)
        assert tried.get_state() == straight.get_state()
    assert tried.time == len(TIMES) * STEP


@pytest.mark.parametrize("tries", TRIES)
def test_an_fmu_goes_on_as_if_nobody_had_tried(session: Session, tries: str) -> None:
    """Its own time is compared through the saved state, which holds it to the bit."""
    tried, straight = session.instance("tried"), session.instance("straight")
    for slave in (tried, straight):
        go_on(slave.doStep, 0, AT)
    (force,) = session.get(straight, "force")
    session.set(tried, force=float("nan"))
    for time, step in TRIES[tries]:
        assert status(tried.doStep, time, step) == DISCARD
    session.set(tried, force=force)
    assert saved(tried) == saved(straight)
    for first, last in ((AT, AT + 1), (AT + 1, AT + 2), (AT + 2, len(TIMES))):
        for slave in (tried, straight):
            go_on(slave.doStep, first, last)
        assert session.get(tried, *NAMES) == session.get(straight, *NAMES)
        assert saved(tried) == saved(straight)
    assert status(tried.doStep, len(TIMES) * STEP, STEP) == OK


def saved(slave: Any) -> bytes:
    state = slave.getFMUstate()
    text = slave.serializeFMUstate(state)
    slave.freeFMUstate(state)
    return text
