"""What a block demands of several values together is checked when initialization ends."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from fmublock import Block, BlockError, BuildError, Instance, Output, Parameter, State
from fmublock.symbolic import evaluate_symbolically
from tests.support.seesaw import DEMAND, Seesaw
from tests.support.units import KINDS, Unit, Units, start

TOUCHING = {"track.high[1]": -0.6}
DESCENDING = {"start.x[1]": 0.3, "start.x[2]": 0.2, "mass": 0.0}


@pytest.fixture(params=KINDS)
def make(request: pytest.FixtureRequest, units: Units) -> Callable[[], Unit]:
    return partial(units.make, Seesaw, request.param, "seesaw")


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        (TOUCHING, DEMAND),
        ({"track.gap": 2.0}, DEMAND),
        (DESCENDING, "start.x[1] must not be above start.x[2]"),
        ({**TOUCHING, "track.gap": math.nan}, "track.gap = nan is outside its range"),  # ranges come first
        *(({"mass": value}, "mass = ") for value in (-5.0, -5e-324, math.nan, math.inf)),  # of states, too
    ],
)
def test_conditions_are_checked_when_initialization_ends(
    make: Callable[[], Unit], values: dict[str, float], sentence: str
) -> None:
    unit = make()
    assert unit.set(**values) and unit.enter() and not unit.exit()
    # a logger may take the percent sign for a format
    assert f"seesaw: {sentence}".replace("%", "#") in unit.messages[-1].replace("%", "#")
    good = {"track.high[1]": 1.0, "track.gap": 0.5, "start.x[1]": 0.1, "start.x[2]": 0.2, "mass": 0.0}
    assert unit.set(**good) and unit.exit()


def test_each_element_has_its_own_limits(make: Callable[[], Unit]) -> None:
    unit = start(make(), **{"start.x[1]": -1.5, "start.x[2]": 1.5})
    assert unit.messages == ["seesaw: x[1] = -1.5 left its limits, -1 to 1, at t = 0 s."]


class Divided(Block):
    x = State(0.0)
    y = Parameter(0.0)

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": 0.0}

    def conditions(self, v: Any) -> dict[str, Any]:
        return {"1 / y must be above x": 1.0 / v.y > v.x}


def test_conditions_that_cannot_be_computed_give_one_message() -> None:
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
def test_wrong_conditions_end_the_export(block: type[Block], said: str) -> None:
    with pytest.raises(BuildError, match=said):
        evaluate_symbolically(block())


class Quotient(Block):
    """A block whose output has no value for a parameter within its range."""

    a = Parameter(0.0)
    y = Output()

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"y": 1.0 / v.a}


def test_outputs_that_cannot_be_computed_give_one_message() -> None:
    instance = Instance(Quotient(), "quotient")
    instance.enter_initialization()
    sentence = r"^quotient: the first outputs cannot be computed: float division by zero\.$"
    for call in (lambda: instance["y"], instance.exit_initialization):
        with pytest.raises(BlockError, match=sentence):
            call()
    instance["a"] = 2.0
    instance.exit_initialization()
    assert instance["y"] == 0.5
