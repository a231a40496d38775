"""What a block demands of several values together is checked when initialization ends."""

import math
from collections.abc import Iterator
from typing import Any

import pytest

from fmublock import Block, BlockError, BuildError, Instance, Parameter, State, build
from fmublock.symbolic import evaluate_symbolically
from tests.support.seesaw import DEMAND, Seesaw
from tests.support.sessions import ERROR, FATAL, WARNING, Session, opened, refused

TOUCHING = {"track.high[1]": -0.6}
DESCENDING = {"start.x[1]": 0.3, "start.x[2]": 0.2}


@pytest.fixture(scope="module", params=["native", "python"])
def session(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    folder = tmp_path_factory.mktemp(f"seesaw-{request.param}")
    fmu = build(Seesaw, folder / "Seesaw.fmu", flavour=request.param)
    with opened(fmu, folder / "unpacked") as session:
        yield session


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        (TOUCHING, DEMAND),
        ({"track.gap": 2.0}, DEMAND),
        (DESCENDING, "start.x[1] must not be above start.x[2]"),
    ],
)
def test_an_fmu_refuses_what_does_not_hold(session: Session, values: Any, sentence: str) -> None:
    session.log.all.clear()
    slave = session.instance("seesaw", running=False, **values)
    with refused(ERROR, FATAL):
        slave.exitInitializationMode()
    shown = f"seesaw: {sentence}."
    assert any(shown.replace("%", "#") in line.replace("%", "#") for line in session.log.lines("seesaw"))
    session.set(slave, **{"track.high[1]": 1.0, "track.gap": 0.5, "start.x[1]": 0.1, "start.x[2]": 0.2})
    slave.exitInitializationMode()


def test_an_instance_refuses_it_and_ranges_come_first() -> None:
    instance = Instance(Seesaw(), "seesaw")
    instance["track.high[1]"] = -0.6
    instance["track.gap"] = math.nan
    instance.enter_initialization()
    with pytest.raises(BlockError, match=r"^seesaw: track\.gap = nan is outside its range"):
        instance.exit_initialization()
    instance["track.gap"] = 0.5
    with pytest.raises(BlockError, match=r'^seesaw: the ends "touch": .* of track\.gap\.$'):
        instance.exit_initialization()
    instance["track.high[1]"] = -0.4
    instance.exit_initialization()


class Divided(Block):
    x = State(0.0)
    y = Parameter(0.0)

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": 0.0}

    def conditions(self, v: Any) -> dict[str, Any]:
        return {"1 / y must be above x": 1.0 / v.y > v.x}


def test_conditions_that_cannot_be_computed_are_told_in_a_sentence() -> None:
    instance = Instance(Divided(), "divided")
    instance.enter_initialization()
    with pytest.raises(
        BlockError, match=r"^divided: its conditions cannot be computed: float division by zero"
    ):
        instance.exit_initialization()


class Branching(Divided):
    def conditions(self, v: Any) -> dict[str, Any]:
        return {"x must be small": v.x < 1.0 and v.y < 1.0}


class Listing(Divided):
    def conditions(self, v: Any) -> Any:
        return [v.x < 1.0]


class Saying(Divided):
    def conditions(self, v: Any) -> dict[str, Any]:
        return {"x must be small": "yes"}


@pytest.mark.parametrize(
    ("block", "said"),
    [
        (Branching, r"Branching\.conditions.*: `v\.x < 1\.0 and .*` in line \d+ .* use where, logical_and"),
        (Listing, r"Listing\.conditions returns \[.*\] instead of a dict of conditions"),
        (Saying, r"Saying\.conditions: 'x must be small' is 'yes', which is not a number"),
    ],
)
def test_conditions_that_make_no_sense_end_the_export(block: type[Block], said: str) -> None:
    with pytest.raises(BuildError, match=said):
        evaluate_symbolically(block())


def test_every_element_has_its_own_limits(session: Session) -> None:
    session.instance("edges", **{"start.x[1]": -1.5, "start.x[2]": 1.5})
    expected = "edges: x[1] = -1.5 left its limits, -1 to 1, at t = 0 s."
    assert [x.text for x in session.log.all if x.instance == "edges" and x.status == WARNING] == [expected]
