"""Connections of an SSP: who drives whom, and what becomes of the values on the way."""

from pathlib import Path

import pytest

from tests.support.ssp_documents import (
    component,
    connection,
    fake_fmu,
    folder,
    linear,
    ssd,
    system,
    understood,
)

SUPPRESSED = {"suppress_unit_conversion": True}


@pytest.fixture
def fmus(tmp_path: Path) -> dict[str, Path]:
    """FMUs with an output y and inputs u and w, of which u has the unit that the FMU is called after."""
    units = {
        "m": "m",
        "mm": "mm",
        "km": "km",
        "K": "K",
        "degC": "degC",
        "degF": "degF",
        "rpm": "rpm",
        "rad_s": "rad/s",
    }
    made = {
        f"{name}__fmu": fake_fmu(tmp_path / f"{name}.fmu", f"y:output:{unit}", f"u:input:{unit}", "w:input")
        for name, unit in units.items()
    }
    return made | {
        "none__fmu": fake_fmu(tmp_path / "none.fmu", "y:output", "u:input", "w:input"),
    }


def wires(tmp_path: Path, fmus: dict[str, Path], *parts: str, ports: str = "") -> dict:
    """Factors and offsets of all connections in a root system of these parts."""
    return understood(folder(tmp_path / "ssp", root=ssd(system("root", *parts, ports=ports)), **fmus)).wires()


@pytest.mark.parametrize(
    ("source", "target", "more", "inside", "expected"),
    [
        ("m", "mm", {}, "", (1e3, 0.0)),
        ("mm", "m", {}, "", (1e-3, 0.0)),
        ("degC", "K", {}, "", (1.0, 273.15)),
        ("K", "degC", {}, "", (1.0, -273.15)),
        ("degF", "degC", {}, "", (5 / 9, -160 / 9)),
        ("degC", "degF", {}, "", (1.8, 32.0)),
        ("degF", "K", {}, "", (5 / 9, 273.15 - 160 / 9)),
        ("K", "degF", {}, "", (1.8, 32.0 - 1.8 * 273.15)),
        ("degF", "degF", {}, "", (1.0, 0.0)),
        ("degC", "degF", {}, linear(2.0, 5.0), (3.6, 69.0)),
        ("rpm", "rad_s", {}, "", (0.10471975511965977, 0.0)),
        ("m", "m", {}, "", (1.0, 0.0)),
        ("m", "none", {}, "", (1.0, 0.0)),
        ("none", "mm", {}, "", (1.0, 0.0)),
        ("m", "mm", SUPPRESSED, "", (1.0, 0.0)),
        ("m", "K", SUPPRESSED, "", (1.0, 0.0)),
        # the transformation comes after the conversion: 2 (1000 x) + 5, and 2 (x - 273.15) + 5
        ("m", "mm", {}, linear(2.0, 5.0), (2e3, 5.0)),
        ("K", "degC", {}, linear(2.0, 5.0), (2.0, -541.3)),
        ("m", "mm", SUPPRESSED, linear(2.0, 5.0), (2.0, 5.0)),
        ("none", "none", {}, linear(offset=-4.0), (1.0, -4.0)),
        ("none", "none", {}, linear(factor=-4.0), (-4.0, 0.0)),
    ],
)
def test_units_of_variables(
    source: str, target: str, more: dict, inside: str, expected: tuple, tmp_path: Path, fmus: dict
) -> None:
    found = wires(
        tmp_path,
        fmus,
        component("a", f"{source}.fmu", "y:output"),
        component("b", f"{target}.fmu", "u:input"),
        connection("a.y -> b.u", inside, **more),
    )
    assert found == {"a.y -> b.u": pytest.approx(expected, rel=1e-14)}


@pytest.mark.parametrize(
    ("output", "input_", "fmu", "inside", "more", "expected"),
    [
        ("y:output:mm", "u:input:m", "none", "", {}, (1e-3, 0.0)),
        # the FMU's m to the connector's mm and back again, with 3 mm more on the way
        ("y:output:mm", "u:input:mm", "m", linear(offset=3.0), {}, (1.0, 3e-3)),
        ("y:output:mm", "u:input", "m", "", {}, (1.0, 0.0)),
        # 1 m is 1000 mm, taken as 1000 m
        ("y:output:mm", "u:input", "m", "", SUPPRESSED, (1e3, 0.0)),
        ("y:output:Real", "u:input:mm", "m", "", SUPPRESSED, (1e-3, 0.0)),
    ],
)
def test_units_of_connectors(
    output: str, input_: str, fmu: str, inside: str, more: dict, expected: tuple, tmp_path: Path, fmus: dict
) -> None:
    found = wires(
        tmp_path,
        fmus,
        component("a", f"{fmu}.fmu", output),
        component("b", f"{fmu}.fmu", input_),
        connection("a.y -> b.u", inside, **more),
    )
    assert found == {"a.y -> b.u": pytest.approx(expected, rel=1e-15)}


@pytest.mark.parametrize(
    ("target", "inside", "expected"),
    [
        ("u:input:m", "", (1.0, 0.0)),
        ("u:input:m", linear(2.0, 3.0), (2.0, 3.0)),
        ("u:input:Integer", "", (1.0, 0.0)),
    ],
)
def test_integers(target: str, inside: str, expected: tuple, tmp_path: Path) -> None:
    files = {
        "a__fmu": fake_fmu(tmp_path / "a.fmu", "y:output:Integer"),
        "b__fmu": fake_fmu(tmp_path / "b.fmu", target),
    }
    found = wires(
        tmp_path,
        files,
        component("a", "a.fmu", "y:output:Integer"),
        component("b", "b.fmu", target),
        connection("a.y -> b.u", inside),
    )
    assert found == {"a.y -> b.u": expected}


def test_differences_have_no_zero(tmp_path: Path) -> None:
    files = {
        "a__fmu": fake_fmu(tmp_path / "a.fmu", "y:output:degC:relative"),
        "b__fmu": fake_fmu(tmp_path / "b.fmu", "u:input:K"),
    }
    parts = component("a", "a.fmu", "y:output"), component("b", "b.fmu", "u:input"), connection("a.y -> b.u")
    assert wires(tmp_path, files, *parts) == {"a.y -> b.u": (1.0, 0.0)}


def turned(wire: str) -> str:
    start, end = wire.split(" -> ")
    return f"{end} -> {start}"


@pytest.mark.parametrize("turn", [False, True], ids=["straight", "turned"])
def test_two_levels_in_both_directions(turn: bool, tmp_path: Path, fmus: dict) -> None:
    def wire(text: str, inside: str = "") -> str:
        return connection(turned(text) if turn else text, inside)

    def level(name: str, inner: str, x: str, v: str) -> str:
        """A system that passes its input on to an element, and that element's output on."""
        return system(name, inner, wire(f"in -> {x}"), wire(f"{v} -> out"), ports="in:input out:output")

    b = component("b", "mm.fmu", "u:input y:output")
    inside = system(
        "inside",
        b,
        wire("in -> b.u", linear(2.0, 1.0)),
        wire("b.y -> out", linear(-1.0)),
        ports="in:input:mm out:output:mm",
    )
    found = wires(
        tmp_path,
        fmus,
        component("a", "m.fmu", "y:output u:input"),
        level("outside", inside, "inside.in", "inside.out"),
        wire("a.y -> outside.in", linear(offset=7.0)),
        wire("outside.out -> a.u", linear(10.0)),
    )
    # `outside.in` has the unit of what it leads to: 2 (1000 x + 7) + 1; back: 10 (-x / 1000)
    assert found == {
        "a.y -> outside.inside.b.u": pytest.approx((2e3, 15.0)),
        "outside.inside.b.y -> a.u": pytest.approx((-1e-2, 0.0)),
    }


def test_a_system_without_units_between(tmp_path: Path, fmus: dict) -> None:
    """It passes on what arrives to inputs of different units."""
    inside = system(
        "s",
        component("b", "mm.fmu", "u:input"),
        component("c", "km.fmu", "u:input"),
        connection("in -> b.u"),
        connection("in -> c.u"),
        ports="in:input",
    )
    found = wires(
        tmp_path,
        fmus,
        component("a", "m.fmu", "y:output"),
        inside,
        connection("a.y -> s.in", linear(offset=2.0)),
    )
    # 2 m more
    assert found == {"a.y -> s.b.u": (1e3, 2e3), "a.y -> s.c.u": (1e-3, 2e-3)}


def test_an_input_straight_through_a_system(tmp_path: Path, fmus: dict) -> None:
    found = wires(
        tmp_path,
        fmus,
        component("a", "m.fmu", "y:output"),
        component("b", "m.fmu", "u:input"),
        system("s", connection("in -> out", linear(3.0)), ports="in:input:mm out:output:m"),
        connection("a.y -> s.in"),
        connection("s.out -> b.u"),
    )
    assert found == {"a.y -> b.u": pytest.approx((3.0, 0.0))}


def test_inputs_of_the_root_drive_nothing(tmp_path: Path, fmus: dict) -> None:
    found = wires(
        tmp_path,
        fmus,
        component("a", "m.fmu", "u:input w:input"),
        connection("in -> a.u"),
        connection("in -> a.w"),
        ports="in:input",
    )
    assert found == {}


DICTIONARY = '<ssd:SignalDictionary name="bus"/>'


def reference(name: str, connectors: str) -> str:
    return component(name, None, connectors, dictionary="bus").replace(
        "ssd:Component", "ssd:SignalDictionaryReference"
    )


def test_a_signal_dictionary_reaches_into_systems(tmp_path: Path, fmus: dict) -> None:
    inside = system(
        "s",
        component("b", "m.fmu", "u:input"),
        reference("there", "x:input:mm"),
        connection("there.x -> b.u"),
    )
    found = wires(
        tmp_path,
        fmus,
        component("a", "m.fmu", "y:output"),
        reference("here", "x:inout:mm"),
        inside,
        connection("here.x -> a.y", linear(offset=2.0)),
        DICTIONARY,
    )
    # 2 mm more
    assert found == {"a.y -> s.b.u": pytest.approx((1.0, 2e-3))}


def test_the_nearest_dictionary_of_a_name_counts(tmp_path: Path, fmus: dict) -> None:
    def inside(name: str, *more: str) -> str:
        parts = (component("b", "m.fmu", "u:input"), reference("r", "x:inout"), connection("r.x -> b.u"))
        return system(name, *parts, *more)

    found = wires(
        tmp_path,
        fmus,
        component("a", "m.fmu", "y:output"),
        reference("r", "x:inout"),
        connection("a.y -> r.x"),
        inside("near", DICTIONARY),
        inside("far"),
        DICTIONARY,
    )
    assert found == {"a.y -> far.b.u": (1.0, 0.0)}


def test_what_is_usual_is_left_to_the_units(tmp_path: Path, fmus: dict) -> None:
    """So that it follows when the FMU is replaced."""
    parts = (
        component("a", "m.fmu", "y:output"),
        component("b", "mm.fmu", "u:input w:input"),
        connection("a.y -> b.u"),
        connection("a.y -> b.w", linear(2.0)),
    )
    path = folder(tmp_path / "ssp", root=ssd(system("root", *parts)), **fmus)
    found = {x.input: x.transformation for x in understood(path).system.connections}
    assert found["u"] is None
    assert found["w"] is not None
