"""Integers, Enumerations and Booleans on connections, as in systems of other tools."""

from enum import IntEnum
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.base.units import LinearTransformation
from emla_cosim.master.algorithms.registry import Jacobi
from emla_cosim.master.assembly import Assembly
from emla_cosim.master.instances.described_instance import _read_nominal
from emla_cosim.master.stepping.timing import make_communication_points
from emla_cosim.study.loading import load
from emla_cosim.system.model import Component, Connection, System
from fmublock import Block, DiscreteState, Input, Output, Parameter, build, where
from tests.support.simulated import begun, step_by_step


class Gear(IntEnum):
    NEUTRAL = 1
    FIRST = 2
    SECOND = 3


class Half(IntEnum):
    NEUTRAL = 1
    FIRST = 2


class Lever(Block):
    """Knows fewer gears."""

    gear = Input(Half.FIRST)
    engaged = Output(0.0)

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"engaged": v.gear}


class Counter(Block):
    """Counts while it is on, in steps of an input."""

    by = Input(1)
    on = Input(True)
    gear = Input(Gear.FIRST)
    level = Input(0.5)
    first = Parameter(0)
    most = Parameter(4)

    n = DiscreteState(0.0)

    count = Output(0)
    wants = Output(True)
    shifted = Output(Gear.FIRST)
    half = Output(0.0)

    def update(self, v: Any) -> dict[str, Any]:
        return {"n": where(v.on > 0.5, v.n + v.by, v.n)}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {
            "count": v.first + v.n,
            "wants": where(v.n < v.most, 1.0, 0.0),
            "shifted": where(v.gear > 2.5, 1.0, v.gear + 1.0),
            "half": 0.5 * v.level,
        }


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(Counter, tmp_path_factory.mktemp("counter") / "Counter.fmu")


@pytest.fixture(scope="module")
def lever(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(Lever, tmp_path_factory.mktemp("lever") / "Lever.fmu")


def pair(*wires: tuple[str, str], **connection: Any) -> System:
    """Two counters a and b; wires such as ("a.count", "b.by")."""
    ends = ([end.split(".") for end in wire] for wire in wires)
    connections = (Connection(*source, *target, **connection) for source, target in ends)
    return System((Component("a"), Component("b")), tuple(connections))


def rows(system: System, fmu: Path, steps: int) -> dict[str, np.ndarray]:
    """Signals by name, a value per communication point, with jacobi."""
    with Assembly(system, {"a": fmu, "b": fmu}) as assembly:
        network, times = assembly.network, make_communication_points(0.1 * steps, 0.1)
        master = begun(network, Jacobi(), times)
        signals = [network.signals.copy()]
        for _ in step_by_step(master, times):
            signals.append(network.signals.copy())
        return dict(zip(network.names, np.array(signals).T, strict=True))


def refused(system: System, fmus: dict[str, Path], message: str) -> None:
    with pytest.raises(CommandError, match=message), Assembly(system, fmus):
        pass


def test_values_arrive_unchanged(fmu: Path) -> None:
    wires = [("a.count", "b.by"), ("a.wants", "b.on"), ("a.shifted", "b.gear"), ("a.count", "b.level")]
    values = rows(pair(*wires, ("b.count", "a.level")), fmu, 6)
    # a counts from 0 and wants until 4; b adds what a had counted, while a wanted, one step later
    assert values["a.count"].tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert values["a.wants"].tolist() == [1, 1, 1, 1, 0, 0, 0]
    assert values["a.shifted"].tolist() == [3] * 7
    assert values["b.count"].tolist() == [0, 0, 1, 3, 6, 6, 6]
    assert values["b.half"].tolist() == [0.0, 0.0, 0.5, 1.0, 1.5, 2.0, 2.5]


def test_conversions_that_keep_every_value(fmu: Path) -> None:
    values = rows(pair(("a.shifted", "b.by"), ("b.count", "a.level"), ("a.shifted", "b.level")), fmu, 3)
    assert values["b.count"].tolist() == [0, 3, 6, 9]  # an enumeration is the number of its value
    assert values["b.half"].tolist() == [1.5] * 4
    values = rows(pair(("a.wants", "b.by"), ("b.count", "a.level"), ("a.wants", "b.level")), fmu, 6)
    assert values["b.count"].tolist() == [0, 1, 2, 3, 4, 4, 4]  # a Boolean is 0 or 1
    assert values["b.half"].tolist() == [0.5, 0.5, 0.5, 0.5, 0.5, 0.0, 0.0]


@pytest.mark.parametrize(
    ("wire", "reason"),
    [
        (("a.half", "b.by"), "Real and Integer: a Real can have values that no Integer has"),
        (("a.half", "b.on"), "Real and Boolean: a Real can have values that no Boolean has"),
        (("a.count", "b.on"), "Integer and Boolean: not every Integer is a value of a Boolean"),
        (("a.wants", "b.gear"), "Boolean and Enumeration: not every Boolean is a value of an Enumeration"),
    ],
)
def test_conversions_that_lose_values_are_refused(fmu: Path, wire: tuple[str, str], reason: str) -> None:
    message = f"{wire[0]} -> {wire[1]} joins the types {reason}"
    refused(pair(wire), {"a": fmu, "b": fmu}, message)


def test_lenient_sets_an_enumeration_by_an_integer(fmu: Path, lever: Path) -> None:
    components = Component("a", fmu=fmu), Component("lever", fmu=lever)
    system = System(components, (Connection("a", "count", "lever", "gear"),))
    times = {"stop_time": 0.1, "step_size": 0.05}
    with pytest.raises(CommandError, match="`--lenient` accepts this"):
        load(system, **times).prepare()
    with load(system, **times, lenient=True).prepare() as simulation:
        result = simulation.run()
    assert "a.count -> lever.gear" in str(result.record["accepted_faults"])
    assert "nothing checks that it has this value" in str(result.record["accepted_faults"])
    assert result["a.count"].tolist() == result["lever.engaged"].tolist() == [0, 1, 2]


def test_enumeration_without_the_value_of_the_source(fmu: Path, lever: Path) -> None:
    system = System((Component("a"), Component("lever")), (Connection("a", "shifted", "lever", "gear"),))
    refused(system, {"a": fmu, "lever": lever}, r"the input has no value 3 \(second\)")


def test_only_reals_are_transformed_and_integers_are_whole_numbers(fmu: Path) -> None:
    fmus = {"a": fmu, "b": fmu}
    system = pair(("a.count", "b.by"), transformation=LinearTransformation(2.0))
    refused(system, fmus, "transforms values of the type Integer")
    for value, reason in ((2.5, "2.5 is not a whole number"), ("two", "two is not a")):
        refused(pair().with_parameters({"a.first": value}), fmus, reason)
    integer_pair = pair(("a.count", "b.by")).with_parameters({"a.first": 3.0})
    assert rows(integer_pair, fmu, 1)["a.count"].tolist() == [3, 4]


NOMINALS = [("0", 1.0), ("nan", 1.0), ("inf", 1.0), ("-3", 3.0), ("2.5", 2.5), (None, 1.0)]


@pytest.mark.parametrize(("declared", "nominal"), NOMINALS)
def test_invalid_nominal_is_ignored(declared: str | None, nominal: float) -> None:
    assert _read_nominal(SimpleNamespace(nominal=declared)) == nominal  # type: ignore[arg-type]
