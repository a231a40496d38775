"""Limits of states and outputs: an instance that leaves them says so once, and goes on."""

import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from fmublock import Input, Parameter, State, build
from fmublock.instance import BlockError, Instance
from fmublock.recipe import Recipe
from tests.support.cart import Cart
from tests.support.paths import ROOT
from tests.support.sessions import OK, WARNING, Line, Session, opened, status


@pytest.fixture(scope="module", params=["native", "python"])
def session(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    folder = tmp_path_factory.mktemp(f"cart-{request.param}")
    fmu = build(Cart, folder / "Cart.fmu", flavour=request.param)
    with opened(fmu, folder / "unpacked") as session:
        yield session


def steps(session: Session, slave: Any, count: int, start: int = 0) -> list[int]:
    return [status(slave.doStep, 0.5 * (start + i), 0.5) for i in range(count)]


def warned(session: Session, name: str) -> list[Line]:
    return [line for line in session.log.all if line.instance == name and line.status == WARNING]


@pytest.mark.parametrize("logging", [True, False])
def test_every_limit_that_is_left_is_reported_once_and_stops_nothing(session: Session, logging: bool) -> None:
    name = f"cart_{logging}"
    slave = session.new(name, logging=logging)
    session.initialize(slave, a=-2.0)
    assert steps(session, slave, 6) == [OK] * 6  # x = -t^2, v = -2 t
    if not logging and session.description.modelExchange is None:
        return  # PythonFMU's library passes warnings on with debug logging only
    assert [line.text for line in warned(session, name)] == [
        f"{name}: x = -2.25 left its limits, -1 to 2, at t = 1.5 s.",
        f"{name}: v_seen = -4 left its limits, -3.5 to 3.5, at t = 2 s.",
    ]
    assert {line.category for line in warned(session, name)} == {"logStatusWarning"}
    assert session.get(slave, "x") == pytest.approx([-9.0])


def test_a_limit_itself_is_not_beyond_it(session: Session) -> None:
    slave = session.instance("edge", **{"start.x": -1.0})
    steps(session, slave, 2)
    assert session.get(slave, "x") == [-1.0]
    assert not warned(session, "edge")


def test_a_value_and_its_limit_never_read_alike(session: Session) -> None:
    slave = session.instance("close", **{"start.x": 2.0000000001})
    steps(session, slave, 1)
    expected = "close: x = 2.0000000001 left its limits, -1 to 2, at t = 0 s."
    assert [line.text for line in warned(session, "close")] == [expected]


def test_a_start_beyond_the_limits_is_reported_and_a_reset_begins_anew(session: Session) -> None:
    slave = session.instance("outside", **{"start.x": 2.5})
    expected = "outside: x = 2.5 left its limits, -1 to 2, at t = 0 s."
    assert [line.text for line in warned(session, "outside")] == [expected]
    slave.reset()
    session.initialize(slave, **{"start.x": 2.5})
    assert [line.text for line in warned(session, "outside")] == [expected] * 2


def test_limits_are_what_is_set(session: Session) -> None:
    slave = session.instance("set", a=-2.0, **{"track.low": -100.0, "v_max": 1.5})
    steps(session, slave, 6)
    expected = "set: v_seen = -2 left its limits, -1.5 to 1.5, at t = 1 s."
    assert [line.text for line in warned(session, "set")] == [expected]


def test_in_process_the_sentences_are_the_same() -> None:
    cart = Instance(Cart(), "cart")
    cart["a"] = -2.0
    cart.enter_initialization()
    cart.exit_initialization()
    assert cart.left_limits() == []
    for i in range(3):
        cart.do_step(0.5 * i, 0.5)
    assert cart.left_limits() == ["cart: x = -2.25 left its limits, -1 to 2, at t = 1.5 s."]
    assert cart.left_limits() == []
    with pytest.raises(BlockError):  # which does not depend on it
        cart.do_step(9.0, 0.5)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda p: Input(limits=p), "an input or a parameter has no limits"),
        (lambda p: Parameter(limits=p), "an input or a parameter has no limits"),
        (lambda _: State(limits=(0.0, 1.0)), "neither one nor two scalar parameters"),  # type: ignore[arg-type]
        (lambda p: State(limits=(p, Parameter(shape=2))), "neither one nor two scalar parameters"),
    ],
)
def test_limits_that_make_no_sense_are_refused(make: Any, said: str) -> None:
    with pytest.raises(TypeError, match=said):
        make(Parameter(1.0))


def test_the_key_of_a_block_with_limits_is_the_same_in_every_process() -> None:
    """Otherwise an FMU that is up to date would be built again each time, with another hash."""
    text = (
        "from fmublock.recipe import Recipe; from tests.support.cart import Cart; "
        "print(Recipe.of(Cart, 'native').key())"
    )
    there = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True, cwd=ROOT)
    assert there.stdout.strip() == Recipe.of(Cart, "native").key()
