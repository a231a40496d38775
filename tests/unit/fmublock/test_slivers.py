"""Tools add their steps up, so that the last one before the end may be a sliver: all of them are served."""

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from fmublock.instance import BlockError, Instance
from tests.support.sessions import DISCARD, ERROR, OK, Session, opened, refused, status
from tests.support.toy import Toy

NAMES = ("x", "v[1]", "v[2]", "power", "random", "step_count")
STEP = 1e-4

Loop = Callable[[float, float, Callable[[float, float], Any]], None]


def textbook(end: float, step: float, do_step: Callable[[float, float], Any]) -> None:
    """The loop of every textbook."""
    time = 0.0
    while time < end:
        h = min(step, end - time)
        do_step(time, h)
        time += h


def lenient(end: float, step: float, do_step: Callable[[float, float], Any]) -> None:
    """Adds full steps up and does not mind passing the end by rounding."""
    time = 0.0
    while time < end - 0.5 * step:
        do_step(time, step)
        time += step


def strict(end: float, step: float, do_step: Callable[[float, float], Any]) -> None:
    """Passes the doubles nearest to its points, and their differences."""
    points = [k * step for k in range(round(end / step))]
    for time, following in zip(points, [*points[1:], end], strict=True):
        do_step(time, following - time)


def careless(end: float, step: float, do_step: Callable[[float, float], Any]) -> None:
    """Does not notice that it has arrived, nor that it goes no further."""
    last = (0.0, step)

    def noted(time: float, h: float) -> None:
        nonlocal last
        do_step(time, h)
        last = (time, h)

    textbook(end, step, noted)
    for again in (last, last, (end, math.ulp(end)), (end, 1e-300)):
        do_step(*again)


LOOPS: list[Loop] = [textbook, lenient, strict, careless]


@pytest.fixture(scope="module", params=["native", "python"])
def session(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    path: Path = request.getfixturevalue(f"{request.param}_toy_fmu")
    with opened(path, tmp_path_factory.mktemp("slivers")) as session:
        yield session


def straight(count: int, step: float) -> Instance:
    """The toy after steps that begin at the products of count and step."""
    instance = Instance(Toy(), "toy")
    instance.enter_initialization()
    instance.exit_initialization()
    for k in range(count):
        instance.do_step(k * step, step)
    return instance


def values(instance: Instance) -> list[float]:
    return [instance[name] for name in NAMES]


def bounded(session: Session, end: float) -> Any:
    """An FMU instance that is told when the run ends."""
    slave = session.new()
    slave.setupExperiment(startTime=0.0, stopTime=end)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    return slave


def test_the_textbook_loop_ends_in_a_sliver() -> None:
    """The loops of the tests below: else they would prove nothing."""
    for end in (0.2, 0.3, 1.0, 10.0):
        steps: list[float] = []
        textbook(end, STEP, lambda _, h, steps=steps: steps.append(h))
        assert 0.0 < steps[-1] < 1e-6 * STEP
        assert len(steps) == round(end / STEP) + 1


@pytest.mark.parametrize("loop", LOOPS)
@pytest.mark.parametrize(("end", "step"), [(0.2, 1e-4), (0.3, 1e-4), (1.0, 1e-4)])
def test_every_loop_arrives_with_the_same_bits(session: Session, end: float, step: float, loop: Loop) -> None:
    """States, noise and the number of steps are those of a run without the sliver."""
    expected = values(straight(round(end / step), step))
    slave = bounded(session, end)
    loop(end, step, slave.doStep)
    assert session.get(slave, *NAMES) == expected
    instance = Instance(Toy())
    instance.setup_experiment(0.0, end)
    instance.enter_initialization()
    instance.exit_initialization()
    loop(end, step, instance.do_step)
    assert values(instance) == expected
    assert instance.time == round(end / step) * step


def test_a_long_loop_arrives(native_toy_fmu: Path, tmp_path: Path) -> None:
    """10 s in steps of 0.1 ms: the sum is 1e-11 s away."""
    with opened(native_toy_fmu, tmp_path / "fmu") as session:
        slave = bounded(session, 10.0)
        textbook(10.0, STEP, slave.doStep)
        assert session.get(slave, "step_count") == [100_000.0]


def test_a_run_goes_on_after_a_sliver_as_if_there_had_been_none(session: Session) -> None:
    """What is set before it acts in the next step; input derivatives were for the sliver alone."""
    slave, other = session.instance("sliver"), session.instance("straight")
    for instance in (slave, other):
        strict(0.3, STEP, instance.doStep)
        session.set(instance, force=3.0)
    before = session.get(slave, *NAMES)
    if session.description.coSimulation.canInterpolateInputs:
        slave.setRealInputDerivatives(session.references(["force"]), [1], [1e9])
    slave.doStep(0.3 - 2e-14, 1.7e-14)
    assert session.get(slave, *NAMES) == before
    for instance in (slave, other):
        instance.doStep(0.3, STEP)
    assert session.get(slave, *NAMES) == session.get(other, *NAMES) != before


def test_slivers_add_up_to_nothing(session: Session) -> None:
    """Nor does the time creep on with them: the FMU goes no further than 1e-6 of a step."""
    slave = session.instance()
    strict(0.3, STEP, slave.doStep)
    before = session.get(slave, *NAMES)
    time = 0.3
    for _ in range(9):
        slave.doStep(time, 1e-7 * STEP)
        time += 1e-7 * STEP
    assert session.get(slave, *NAMES) == before
    slave.doStep(time, STEP)
    assert session.get(slave, "step_count") == [3001.0]


def test_a_restored_state_knows_how_long_the_last_step_was(session: Session) -> None:
    slave = session.instance()
    strict(0.3, STEP, slave.doStep)
    saved = slave.getFMUstate()
    other = session.instance("other")
    other.setFMUstate(other.deSerializeFMUstate(slave.serializeFMUstate(saved)))
    before = session.get(other, *NAMES)
    other.doStep(0.3 - 2e-14, 1.7e-14)
    assert session.get(other, *NAMES) == before == session.get(slave, *NAMES)
    slave.freeFMUstate(saved)


@pytest.mark.parametrize("part", [1e-5, 1e-3, 0.1])
def test_a_short_step_is_no_sliver(session: Session, part: float) -> None:
    slave, instance = session.instance(), straight(10, 0.01)
    strict(0.1, 0.01, slave.doStep)
    for do_step in (slave.doStep, instance.do_step):
        do_step(0.1, part * 0.01)
    assert instance["step_count"] == 11.0
    assert session.get(slave, *NAMES) == values(instance)


def test_a_first_step_is_no_sliver(session: Session) -> None:
    """However short: there is nothing yet that it could make up for."""
    slave = session.instance(time=1.0)
    slave.doStep(1.0, 1e-18)
    assert session.get(slave, "step_count") == [1.0]


@pytest.mark.parametrize(
    ("time", "step"),
    [(0.3 - 1e-9, 1.7e-14), (0.3 + 1e-9, 1.7e-14), (0.3 - 1e-6, STEP), (0.3 + 1e-6, STEP), (0.29, 0.01)],
)
def test_a_step_that_starts_elsewhere_is_refused(session: Session, time: float, step: float) -> None:
    slave = session.instance()
    strict(0.3, STEP, slave.doStep)
    before = session.get(slave, *NAMES)
    with refused(ERROR, DISCARD):
        slave.doStep(time, step)
    assert session.get(slave, *NAMES) == before
    with pytest.raises(BlockError, match="the step starts at"):
        straight(3000, STEP).do_step(time, step)
    assert status(slave.doStep, 0.3, STEP) == OK


@pytest.mark.parametrize(
    ("time", "asked"),
    [
        (0.5, "0.5"),
        (0.123456789, "0.123456789"),
        (0.25 + 1e-10, "0.2500000001"),
        (0.25 + 1e-13, "0.2500000000001"),
    ],
)
def test_the_message_shows_where_two_times_differ(session: Session, time: float, asked: str) -> None:
    """The steps before are so short that these are no rounding."""
    session.log.all.clear()
    slave = session.instance()
    points = [0.0, 0.25 - 1e-5, 0.25 - 1e-9, 0.25]
    for start, end in pairwise(points):
        slave.doStep(start, end - start)
    with refused(ERROR, DISCARD):
        slave.doStep(time, 1e-12)
    (line,) = session.log.lines("toy")
    assert line == f"toy: the step starts at t = {asked} s, but the instance is at t = 0.25 s."


def test_the_message_shows_by_how_much_the_stop_time_is_passed(session: Session) -> None:
    session.log.all.clear()
    slave = bounded(session, 1e9)
    with refused(ERROR, DISCARD):
        slave.doStep(0.0, 1e9 * (1.0 + 2e-3))
    assert session.log.lines("toy") == ["toy: the step to t = 1.002e+09 s goes past the stop time 1e+09 s."]


def test_times_may_be_rounded_to_their_last_place_far_from_zero(session: Session) -> None:
    """At 1e9 s a double resolves 0.12 us, a part in a thousand of this step."""
    start = 1e9
    slave = session.instance(time=start)
    time = start
    for _ in range(100):
        slave.doStep(time, STEP)
        time = math.nextafter(time + STEP, math.inf)
    assert session.get(slave, "step_count") == [100.0]


@pytest.mark.parametrize(("units", "answer"), [(-4, OK), (4, OK), (5, ERROR)])
def test_four_units_in_the_last_place_are_rounding(session: Session, units: int, answer: int) -> None:
    start = 2.0**30
    slave, instance = session.instance(time=start), Instance(Toy())
    instance.setup_experiment(start)
    instance.enter_initialization()
    instance.exit_initialization()
    time = start + units * math.ulp(start)
    if answer == OK:
        instance.do_step(time, STEP)
        assert status(slave.doStep, time, STEP) == OK
    else:
        with pytest.raises(BlockError, match="the step starts at"):
            instance.do_step(time, STEP)
        with refused(ERROR, DISCARD):
            slave.doStep(time, STEP)


def test_what_differs_by_just_the_rounding_is_a_sliver_in_both_flavours(session: Session) -> None:
    """At t = 0 a part in a million of the last step, 1 s, is the double 1e-6."""
    slave = session.instance(time=-1.0)
    slave.doStep(-1.0, 1.0)
    slave.doStep(0.0, 1e-6)
    assert session.get(slave, "step_count") == [1.0]
    slave.doStep(0.0, math.nextafter(1e-6, 1.0))
    assert session.get(slave, "step_count") == [2.0]
