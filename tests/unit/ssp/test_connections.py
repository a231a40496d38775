"""Connections of an SSP: what drives what, and the factor and offset of the value on the way."""

from pathlib import Path
from typing import Any

import pytest

from emla_cosim.study.loading import load
from tests.support.ssp_documents import (
    binding,
    component,
    connection,
    fake_fmu,
    linear,
    packed,
    rooted,
    ssv,
    system,
    understood,
)

SUPPRESSED = {"suppress_unit_conversion": True}
LENGTHS_AND_OTHERS = ("m", "mm", "km", "K", "degC", "degF", "rpm", "rad/s")


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """FMUs with an output y and inputs u and w, of which y and u have the unit that names the FMU."""
    folder = tmp_path_factory.mktemp("fmus")
    variables = {
        unit.replace("/", "_"): (f"y:output:{unit}", f"u:input:{unit}", "w:input")
        for unit in LENGTHS_AND_OTHERS
    }
    variables |= {
        "none": ("y:output", "u:input", "w:input"),
        "difference": ("y:output:degC:relative", "u:input:K:relative"),
    }
    return {f"{name}__fmu": fake_fmu(folder / f"{name}.fmu", *v) for name, v in variables.items()}


def wires(tmp_path: Path, fmus: dict[str, Path], *parts: str, ports: str = "") -> dict:
    """Factors and offsets of all connections in a root system of these parts."""
    return understood(rooted(tmp_path, *parts, files=fmus, ports=ports)).wires()


@pytest.mark.parametrize(
    ("source", "target", "more", "inside", "expected"),
    [
        ("m", "mm", {}, "", (1e3, 0.0)),
        ("degF", "degC", {}, "", (5 / 9, -160 / 9)),
        ("K", "degF", {}, "", (1.8, 32.0 - 1.8 * 273.15)),
        ("rpm", "rad_s", {}, "", (0.10471975511965977, 0.0)),
        ("m", "none", {}, "", (1.0, 0.0)),
        ("none", "mm", {}, "", (1.0, 0.0)),
        ("m", "K", SUPPRESSED, "", (1.0, 0.0)),
        # the transformation comes after the conversion: 2 (1000 x) + 5, and 2 (x - 273.15) + 5
        ("m", "mm", {}, linear(2.0, 5.0), (2e3, 5.0)),
        ("K", "degC", {}, linear(2.0, 5.0), (2.0, -541.3)),
        ("m", "mm", SUPPRESSED, linear(2.0, 5.0), (2.0, 5.0)),
        ("none", "none", {}, linear(offset=-4.0), (1.0, -4.0)),
        ("none", "none", {}, linear(factor=-4.0), (-4.0, 0.0)),
        ("difference", "difference", {}, "", (1.0, 0.0)),
        ("K", "difference", {}, linear(offset=-293.15), (1.0, -293.15)),
    ],
)
def test_units_of_variables(
    source: str, target: str, more: dict, inside: str, expected: tuple, tmp_path: Path, fmus: dict
) -> None:
    parts = component("a", f"{source}.fmu", "y:output"), component("b", f"{target}.fmu", "u:input")
    actual = wires(tmp_path, fmus, *parts, connection("a.y -> b.u", inside, **more))
    assert actual == {"a.y -> b.u": pytest.approx(expected, rel=1e-14)}


@pytest.mark.parametrize(
    ("output", "input_", "fmu", "inside", "more", "expected"),
    [
        ("y:output:mm", "u:input:m", "none", "", {}, (1e-3, 0.0)),
        # the FMU's m to the connector's mm and back again, with 3 mm more on the way
        ("y:output:mm", "u:input:mm", "m", linear(offset=3.0), {}, (1.0, 3e-3)),
        ("y:output:mm", "u:input", "m", "", {}, (1.0, 0.0)),
        ("y:output:degC", "u:input:K", "difference", "", {}, (1.0, 0.0)),
        # 1 m is 1000 mm, taken as 1000 m
        ("y:output:mm", "u:input", "m", "", SUPPRESSED, (1e3, 0.0)),
        ("y:output:Real", "u:input:mm", "m", "", SUPPRESSED, (1e-3, 0.0)),
    ],
)
def test_units_of_connectors(
    output: str, input_: str, fmu: str, inside: str, more: dict, expected: tuple, tmp_path: Path, fmus: dict
) -> None:
    parts = component("a", f"{fmu}.fmu", output), component("b", f"{fmu}.fmu", input_)
    actual = wires(tmp_path, fmus, *parts, connection("a.y -> b.u", inside, **more))
    assert actual == {"a.y -> b.u": pytest.approx(expected, rel=1e-15)}


@pytest.mark.parametrize("is_reversed", [False, True], ids=["straight", "turned"])
def test_two_levels_in_both_directions(is_reversed: bool, tmp_path: Path, fmus: dict) -> None:
    def wire(text: str, inside: str = "") -> str:
        return connection(" -> ".join(reversed(text.split(" -> "))) if is_reversed else text, inside)

    inside = system(
        "inside",
        component("b", "mm.fmu", "u:input y:output"),
        wire("in -> b.u", linear(2.0, 1.0)),
        wire("b.y -> out", linear(-1.0)),
        ports="in:input:mm out:output:mm",
    )
    passing = wire("in -> inside.in"), wire("inside.out -> out")
    actual = wires(
        tmp_path,
        fmus,
        component("a", "m.fmu", "y:output u:input"),
        system("outside", inside, *passing, ports="in:input out:output"),
        wire("a.y -> outside.in", linear(offset=7.0)),
        wire("outside.out -> a.u", linear(10.0)),
    )
    # `outside.in` has the unit of what it leads to: 2 (1000 x + 7) + 1; back: 10 (-x / 1000)
    assert actual == {
        "a.y -> outside.inside.b.u": pytest.approx((2e3, 15.0)),
        "outside.inside.b.y -> a.u": pytest.approx((-1e-2, 0.0)),
    }


A_Y, B_U = component("a", "m.fmu", "y:output"), component("b", "m.fmu", "u:input")
DICTIONARY = '<ssd:SignalDictionary name="bus"/>'


def reference(name: str, connectors: str) -> str:
    text = component(name, None, connectors, dictionary="bus")
    return text.replace("ssd:Component", "ssd:SignalDictionaryReference")


def reader(name: str, *more: str) -> str:
    """A system whose component reads the signal x of the dictionary."""
    return system(name, B_U, reference("r", "x:inout"), connection("r.x -> b.u"), *more)


TWO_UNITS = system(
    "s",
    component("b", "mm.fmu", "u:input"),
    component("c", "km.fmu", "u:input"),
    connection("in -> b.u"),
    connection("in -> c.u"),
    ports="in:input",
)
STRAIGHT = system("s", connection("in -> out", linear(3.0)), ports="in:input:mm out:output:m")
IN_DICTIONARY = system(
    "s",
    B_U,
    reference("there", "x:input:mm"),
    connection("there.x -> b.u"),
)


REFERENCE = reference("here", "x:inout:mm"), connection("here.x -> a.y", linear(offset=2.0))
NEAR_AND_FAR = reader("near", DICTIONARY), reader("far"), reference("r", "x:inout"), connection("a.y -> r.x")
WAYS = {
    "two units, 2 m more": (
        (TWO_UNITS, connection("a.y -> s.in", linear(offset=2.0))),
        {"a.y -> s.b.u": (1e3, 2e3), "a.y -> s.c.u": (1e-3, 2e-3)},
    ),
    "straight through": (
        (B_U, STRAIGHT, connection("a.y -> s.in"), connection("s.out -> b.u")),
        {"a.y -> b.u": (3.0, 0.0)},
    ),
    "input of the root": ((B_U, connection("in -> b.u")), {}),
    "dictionary, 2 mm more": ((IN_DICTIONARY, *REFERENCE, DICTIONARY), {"a.y -> s.b.u": (1.0, 2e-3)}),
    "nearest dictionary": ((*NEAR_AND_FAR, DICTIONARY), {"a.y -> far.b.u": (1.0, 0.0)}),
}


@pytest.mark.parametrize(("parts", "expected"), WAYS.values(), ids=WAYS)
def test_ways_through_systems(parts: tuple, expected: dict, tmp_path: Path, fmus: dict) -> None:
    actual = wires(tmp_path, fmus, A_Y, *parts, ports="in:input")
    assert actual == {name: pytest.approx(values) for name, values in expected.items()}


def test_conversion_of_units_is_not_stored_in_the_connection(tmp_path: Path, fmus: dict) -> None:
    """It follows from the units, so that it is right when an FMU is replaced."""
    parts = (
        A_Y,
        component("b", "mm.fmu", "u:input w:input"),
        connection("a.y -> b.u"),
        connection("a.y -> b.w", linear(2.0)),
    )
    read = understood(rooted(tmp_path, *parts, files=fmus))
    actual = {x.input: x.transformation for x in read.system.connections}
    assert actual["u"] is None
    assert actual["w"] is not None


def gain(name: str, ports: str, b: float = 1.0, **values: Any) -> str:
    """The faulty FMU as y = b u, which has no units."""
    return component(name, "Faulty.fmu", ports, binding(ssv(a=0.0, b=b, **values)))


def test_run_applies_conversions_and_transformations(tmp_path: Path, faulty_fmu: Path) -> None:
    inside = gain("gain", "u:input:K y:output:m", b=0.01), connection("in -> gain.u")
    parts = (
        gain("source", "y:output:degC", b=10.0, u=2.0),
        system("s", *inside, connection("gain.y -> out"), ports="in:input:K out:output:m"),
        gain("length", "u:input:mm"),
        gain("plain", "u:input:mm"),
        connection("s.in -> source.y"),
        connection("s.out -> length.u", linear(-2.0, 1.0)),
        connection("s.out -> plain.u", suppress_unit_conversion=True),
    )
    path = packed(tmp_path / "test.ssp", rooted(tmp_path, *parts, files={"Faulty__fmu": faulty_fmu}))
    with load(path, stop_time=0.3, step_size=0.1).prepare() as simulation:
        result = simulation.run()
    actual = [result[name][-1] for name in ("source.y", "s.gain.y", "length.y", "plain.y")]
    metres = 0.01 * (20.0 + 273.15)
    assert actual == pytest.approx((20.0, metres, -2.0 * 1000.0 * metres + 1.0, metres), rel=1e-12)
