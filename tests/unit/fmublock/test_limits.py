"""Limits of states and outputs: an instance that leaves them reports it once, and continues."""

import subprocess
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from fmublock import Block, Input, Instance, Output, Parameter, State
from fmublock.errors import BuildError
from fmublock.recipe import Recipe
from tests.support.cart import Cart
from tests.support.paths import ROOT
from tests.support.sessions import WARNING, Session
from tests.support.units import KINDS, Unit, Units, start

COARSE = {"solver.internal_step": 0.125}


@pytest.fixture(params=KINDS)
def make(request: pytest.FixtureRequest, units: Units) -> Callable[[], Unit]:
    return partial(units.make, Cart, request.param, "cart")


def go_on(unit: Unit, count: int) -> None:
    for i in range(count):
        assert unit.step(0.5 * i, 0.5)


def test_each_limit_is_reported_once_and_does_not_end_the_run(make: Callable[[], Unit]) -> None:
    unit = start(make(), a=-2.0, **COARSE)
    go_on(unit, 6)  # x = -t^2, v = -2 t
    assert unit.messages == [
        "cart: x = -2.25 left its limits, -1 to 2, at t = 1.5 s.",
        "cart: v_seen = -4 left its limits, -3.5 to 3.5, at t = 2 s.",
    ]
    assert unit.get("x") == pytest.approx([-9.0])


@pytest.mark.parametrize(
    ("values", "steps", "message"),
    [
        ({"start.x": -1.0}, 2, None),  # a limit itself is not beyond it
        ({"start.x": 2.0000000001}, 1, "x = 2.0000000001 left its limits, -1 to 2, at t = 0 s."),
        (
            {"a": -2.0, "track.low": -9.0, "v_max": 1.5},
            6,
            "v_seen = -2 left its limits, -1.5 to 1.5, at t = 1 s.",
        ),
    ],
)
def test_limits_are_start_values(
    make: Callable[[], Unit], values: dict[str, float], steps: int, message: str | None
) -> None:
    unit = start(make(), **values, **COARSE)
    go_on(unit, steps)
    assert unit.messages == ([f"cart: {message}"] if message else [])


@pytest.mark.parametrize("kind", ["native", "python"])
def test_reset_reports_anew_and_warnings_have_their_category(units: Units, kind: str) -> None:
    session = units.opened(Cart, kind)
    assert isinstance(session, Session)
    session.log.all.clear()
    slave = session.instance("outside", **{"start.x": 2.5})
    slave.reset()
    session.initialize(slave, **{"start.x": 2.5})
    lines = [line for line in session.log.all if line.status == WARNING]
    text = "outside: x = 2.5 left its limits, -1 to 2, at t = 0 s."
    assert [(line.category, line.text) for line in lines] == [("logStatusWarning", text)] * 2
    session.log.all.clear()
    session.initialize(session.new("quiet", logging=False), **{"start.x": 2.5})
    # PythonFMU's library passes warnings on with debug logging only
    assert len([line for line in session.log.all if line.status == WARNING]) == (kind == "native")


@pytest.mark.parametrize(
    ("kind", "limits", "words"),
    [
        (Input, Parameter(1.0), "an input or a parameter has no limits"),
        (Parameter, Parameter(1.0), "an input or a parameter has no limits"),
        (State, (0.0, 1.0), "neither one nor two scalar parameters"),
        (State, (Parameter(1.0), Parameter(shape=2)), "neither one nor two scalar parameters"),
    ],
)
def test_invalid_limits_are_refused(kind: Any, limits: Any, words: str) -> None:
    with pytest.raises(TypeError, match=words):
        kind(limits=limits)


@pytest.mark.parametrize(
    ("declared", "fault"),
    [
        (Parameter(5.0, unit="m", maximum=3.0), "starts at 5 m, above its maximum of 3 m"),
        (Input(minimum=1.0, name="motor.u"), "starts at 0, below its minimum of 1"),
        (Parameter([1.0, 2.0], shape=2, maximum=1.5), "starts at 2, above its maximum of 1.5"),
        (Parameter(3, minimum=4), "starts at 3, below its minimum of 4"),
        (State(Parameter(5.0), maximum=2.0), "starts at 5, above its maximum of 2"),
        (Parameter(1.0, minimum=2.0, maximum=1.0), "has the minimum 2, above its maximum of 1"),
        (Output(nominal=-1.0, unit="m"), "has the nominal value -1 m; it must be positive and finite"),
    ],
    ids=lambda x: "" if isinstance(x, str) else type(x).__name__,
)
def test_start_values_outside_of_their_range_are_refused(declared: Any, fault: str) -> None:
    block = type("Wrong", (Block,), {"x": declared})
    with pytest.raises(BuildError) as caught:
        Recipe.of(block, "native")
    assert str(caught.value).startswith("Wrong.") and str(caught.value).endswith(f" {fault}.")
    with pytest.raises(TypeError, match=r"^Wrong\."):
        Instance(block())


def test_computed_outputs_have_no_start_value_to_refuse() -> None:
    block = type("Right", (Block,), {"y": Output(minimum=1.0), "k": Parameter(2.0, minimum=2.0, maximum=2.0)})
    assert Recipe.of(block, "native").model == "Right"


def test_key_of_a_block_with_limits_is_the_same_in_every_process() -> None:
    """Otherwise an FMU that is up to date would be built again each time, with another hash."""
    text = (
        "from fmublock.recipe import Recipe; from tests.support.cart import Cart; "
        "print(Recipe.of(Cart, 'native').key())"
    )
    there = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True, cwd=ROOT)
    assert there.stdout.strip() == Recipe.of(Cart, "native").key()
