"""What a block demands of several values together is checked when initialization ends."""

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import pytest

import emla_cosim as ec
from fmublock import Block, BlockError, BuildError, Instance, Output, Parameter, State
from fmublock.symbolic import evaluate_symbolically
from tests.support.generated_c import Code
from tests.support.seesaw import DEMAND, ODD, Odd, Seesaw
from tests.support.tiers import mostly_slow
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


@pytest.mark.parametrize("kind", mostly_slow(KINDS, ["block", "native"]))
def test_condition_can_have_any_text(kind: str, units: Units) -> None:
    unit = units.make(Odd, kind, "odd")
    assert unit.set(k=-1.0) and unit.enter() and not unit.exit()
    assert f"odd: {ODD}" in unit.messages[-1]


def test_plain_c_has_the_text_of_a_condition(tmp_path: Path) -> None:
    scenario = ec.load(ec.System.of({"odd": Odd}), step_size=0.1, stop_time=1.0)
    code = Code(scenario.export(tmp_path / "code.c", components=["*"]))
    setattr(code.parameters, code.field("odd.k"), -1.0)
    assert code.start() == f"odd: {ODD}"


class Divided(Block):
    """Neither its conditions nor its output have a value where y = 0, which is within its range."""

    checks: ClassVar[Any] = staticmethod(lambda v: {"1 / y must be above x": 1.0 / v.y > v.x})
    x = State(0.0)
    y = Parameter(0.0)
    quotient = Output()

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": 0.0}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"quotient": 1.0 / v.y}

    def conditions(self, v: Any) -> Any:
        return self.checks(v)


def test_equations_that_fail_at_the_start_give_one_message() -> None:
    instance = Instance(Divided(), "divided")
    instance.enter_initialization()
    with pytest.raises(
        BlockError, match=r"^divided: its conditions cannot be computed: float division by zero"
    ):
        instance.exit_initialization()
    instance.block.checks = lambda v: {}
    sentence = r"^divided: the first outputs cannot be computed: float division by zero\.$"
    for call in (lambda: instance["quotient"], instance.exit_initialization):
        with pytest.raises(BlockError, match=sentence):
            call()
    instance["y"] = 2.0
    instance.exit_initialization()
    assert instance["quotient"] == 0.5


@pytest.mark.parametrize(
    ("checks", "message"),
    [
        (
            lambda v: {"small": v.x < 1.0 and v.y < 1.0},
            r": `v\.x < 1\.0 and .*` in line \d+ .* use where, logical_and",
        ),
        (lambda v: [v.x < 1.0], r" returns \[.*\] instead of a dict of conditions"),
        (lambda v: {"x must be small": "yes"}, r": 'x must be small' is 'yes', which is not a number"),
    ],
)
def test_invalid_conditions_end_the_export(checks: Any, message: str) -> None:
    block = type("Wrong", (Divided,), {"checks": staticmethod(checks)})
    with pytest.raises(BuildError, match=rf"^Wrong\.conditions.*{message}"):
        evaluate_symbolically(block())
