"""Parameters of an SSP: which value a variable gets, and in which unit."""

from pathlib import Path
from typing import Any

import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.fmu.interface import read_interface
from emla_cosim.fmu.variables import convert_start_values
from fmublock.archive import write_archive
from tests.support.ssp_documents import (
    Understood,
    binding,
    component,
    connection,
    description,
    entry,
    fake_fmu,
    folder,
    linear,
    rooted,
    ssm,
    ssv,
    system,
    table,
    understood,
)


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU with parameters of all types."""
    variables = (
        "u:input:m y:output x:output:m:exact k:parameter:m t:parameter:degC b:parameter n:parameter:Integer "
        "on:parameter:Boolean mode:parameter:Enumeration label:parameter:String"
    )
    return fake_fmu(tmp_path_factory.mktemp("fmu") / "a.fmu", *variables.split())


def read(tmp_path: Path, fmu: Path, *parts: str, files: dict | None = None, **more: str) -> Understood:
    """A root system of these parts, with files beside it."""
    return understood(rooted(tmp_path, *parts, files={"a__fmu": fmu, **(files or {})}, **more))


def values(tmp_path: Path, fmu: Path, bindings: str, **more: Any) -> dict[str, Any]:
    """Start values of one component with these bindings."""
    return read(tmp_path, fmu, component("a", "a.fmu", bindings=bindings), **more).values("a")


def mapped(parameter: Any, target: str, inside: str = "", **more: Any) -> str:
    """A binding of one value that a mapping passes to a variable."""
    return binding(ssv(p=parameter), ssm(entry("p", target, inside, **more)))


MM = {"suppress_unit_conversion": True}
ALL = {"k": 2.5, "n": -3, "on": True, "mode": "fast", "label": "a b", "x": 0.5, "u": 1.5}
SLOW = ("slow", "Enumeration")
SPACED = ssv(k=1.0, n=7, on=True).replace('"true"', '" 1 "').replace('"7"', '" +7 "')
TWO_TARGETS = ssm(entry("p", "k"), entry("p", "b"), entry("nothing", "x"))
EXCHANGED = ssm(entry("k", "b"), entry("b", "k", linear(2.0)))
SAME = ssm(entry("p", "k"), entry("q", "x"))
SECOND = binding(ssv(q=2.0), ssm(entry("q", "k", linear(3.0))))


@pytest.mark.parametrize(
    ("bindings", "expected"),
    [
        (binding(ssv(**ALL | {"mode": ("fast", "Enumeration")})), ALL),
        (binding(SPACED), {"k": 1.0, "n": 7, "on": True}),
        (binding(ssv(k=(250.0, "mm"), t=(212.0, "degF"))), {"k": 0.25, "t": 100.0}),
        # later sets override earlier ones at the same level
        (binding(ssv(k=1.0, b=1.0)) + binding(ssv(k=2.0)), {"k": 2.0, "b": 1.0}),
        # a mapping passes on only what it names
        (binding(ssv(p=2.0, x=3.0), TWO_TARGETS), {"k": 2.0, "b": 2.0}),
        (binding(ssv(k=5.0, b=7.0), EXCHANGED), {"k": 14.0, "b": 5.0}),
        # its transformation comes after the conversion: 3 (250 mm in m) + 1
        (mapped((250.0, "mm"), "k", linear(3.0, 1.0)), {"k": 1.75}),
        (mapped((250.0, "mm"), "k", linear(3.0, 1.0), **MM), {"k": 751.0}),
        # two mappings
        (mapped(1.0, "k") + mapped(2.0, "b") + SECOND, {"k": 6.0, "b": 2.0}),
        (binding(ssv(p=(1.0, "mm"), q=(5.0, "mm")), SAME) + binding(ssv(p=3.0), SAME), {"k": 3.0, "x": 5e-3}),
        # tables
        (mapped(True, "on", table("Boolean", true=False, false=True)), {"on": False}),
        (mapped(False, "on", table("Boolean", _1=False, _0=True)), {"on": True}),
        (mapped(3, "n", table("Integer", _2=20, _3=30)), {"n": 30}),
        (mapped(4, "n", table("Integer", _2=20, _03=30)), {"n": 4}),
        (mapped(3, "n", table("Integer", _03=30)), {"n": 30}),
        (mapped(SLOW, "mode", table("Enumeration", slow="fast", fast="off")), {"mode": "fast"}),
        (mapped(3, "n", linear(4.0, 1.0)), {"n": 13}),
        (mapped(True, "on", table("Integer", _1=0)), {"on": True}),
    ],
)
def test_values_of_a_component(bindings: str, expected: dict, tmp_path: Path, fmu: Path) -> None:
    read_ = read(tmp_path, fmu, component("a", "a.fmu", bindings=bindings))
    actual = read_.values("a")
    assert actual == {n: pytest.approx(v, rel=1e-13) if n == "t" else v for n, v in expected.items()}
    assert all(isinstance(expected[name], bool) == isinstance(actual[name], bool) for name in expected)
    assert read_.system.component("a").aliases == {}


@pytest.mark.parametrize("value", [2, 2.0, ("2", "Enumeration")])
def test_number_sets_an_enumeration(value: Any, tmp_path: Path, fmu: Path) -> None:
    actual = values(tmp_path, fmu, binding(ssv(mode=value)))
    ((variable, number),) = convert_start_values("a", read_interface(fmu), actual)
    assert (variable.name, number, type(number)) == ("mode", 2, int)


@pytest.mark.parametrize("number", [7, 1.5, True, ("7", "Enumeration")])
def test_value_that_is_not_an_item_of_an_enumeration(number: Any, tmp_path: Path, fmu: Path) -> None:
    actual = values(tmp_path, fmu, binding(ssv(mode=number)))
    with pytest.raises(CommandError, match=r"^a\.mode = \S+ is not one of \w+ \(1\), \w+ \(2\)") as raised:
        convert_start_values("a", read_interface(fmu), actual)
    assert f"= {actual['mode']} is" in str(raised.value)


def test_names_without_a_variable_are_noted(tmp_path: Path, fmu: Path) -> None:
    actual = read(tmp_path, fmu, component("a", "a.fmu", bindings=binding(ssv(k=1.0, nothing=2.0, y=3.0))))
    assert actual.values("a") == {"k": 1.0}
    missing, fixed = actual.notes
    assert missing.endswith(": nothing matches no variable")
    assert fixed.endswith(": y does not set a.y: it is computed by the FMU")


def test_names_that_a_mapping_leaves_out_are_noted(tmp_path: Path, fmu: Path) -> None:
    mapped_only = binding(ssv(k=1.0, b=2.0), ssm(entry("k", "k")))
    actual = read(tmp_path, fmu, component("a", "a.fmu", bindings=mapped_only))
    assert actual.values("a") == {"k": 1.0}
    (note,) = actual.notes
    assert note.endswith(": b matches no variable: the mapping leaves it out")


# ---- levels ------------------------------------------------------------------------------------

PREFIXED = binding(ssv(k=1.0), prefix="c.") + binding(
    ssv(p=2.0), ssm(entry("a.p", "a.k"), entry("p", "a.b")), prefix="a."
)
LATER = binding(ssv(k=1.0)) + mapped(2.0, "k", linear(10.0))


TO_ANOTHER = binding(ssv(k=5.0), ssm(entry("k", "b")))
TO_ITSELF = binding(ssv(k=5.0), ssm(entry("k", "k", linear(1e-3))))


@pytest.mark.parametrize(
    ("inner", "outer", "expected"),
    [
        (LATER, (500.0, "mm"), {"k": 0.5}),
        (TO_ANOTHER, 7.0, {"k": 7.0, "b": 5.0}),  # `k` inside the component is not what it is called outside
        (TO_ITSELF, 7.0, {"k": 7.0}),
    ],
    ids=["later sets", "mapping to another", "mapping to itself"],
)
def test_system_overrides_its_component(
    inner: str, outer: Any, expected: dict, tmp_path: Path, fmu: Path
) -> None:
    part = component("a", "a.fmu", bindings=inner)
    assert read(tmp_path, fmu, part, bindings=binding(ssv(**{"a.k": outer}))).values("a") == expected


def test_prefix_of_a_binding(tmp_path: Path, fmu: Path) -> None:
    actual = read(tmp_path, fmu, component("a", "a.fmu"), component("c", "a.fmu"), bindings=PREFIXED)
    assert (actual.values("a"), actual.values("c")) == ({"k": 2.0}, {"k": 1.0})


def test_each_level_overrides_the_ones_below(tmp_path: Path, fmu: Path) -> None:
    inner = component("a", "a.fmu", bindings=binding(ssv(k=1.0, b=1.0, x=1.0)))
    middle = system("s", inner, bindings=binding(ssv(**{"a.k": 2.0, "a.b": 2.0})))
    actual = read(tmp_path, fmu, middle, bindings=binding(ssv(**{"s.a.k": 3.0})))
    assert actual.values("s.a") == {"k": 3.0, "b": 2.0, "x": 1.0}


def test_mapping_that_keeps_the_name_leaves_connections_alone(tmp_path: Path, fmu: Path) -> None:
    mapping = ssm(entry("u", "u", linear(2.0)), entry("x", "x", linear(1e-3)))
    actual = read(
        tmp_path,
        fmu,
        component("a", "a.fmu", "x:output", bindings=binding(ssv(x=4.0), mapping)),
        component("b", "a.fmu", "u:input:m", bindings=binding(ssv(u=4.0), mapping)),
        connection("a.x -> b.u", linear(7.0, 3.0)),
    )
    assert actual.wires() == {"a.x -> b.u": pytest.approx((7.0, 3.0))}
    assert (actual.values("a"), actual.values("b")) == ({"x": 4e-3}, {})


def test_only_the_mapping_of_a_replaced_component_renames_signals(tmp_path: Path, fmu: Path) -> None:
    """Its binding has an annotation; a mapping of parameters must not rename outputs of other packages."""
    bound = binding(ssv(p=(250.0, "mm")), ssm(entry("p", "k", linear(-1.0)), entry("y_ours", "y")))
    annotation = '<ssd:Annotations><ssc:Annotation type="emla-cosim.renames"/></ssd:Annotations>'
    renaming = bound.replace("</ssd:ParameterBinding>", f"{annotation}</ssd:ParameterBinding>")
    (plain_mapping,) = read(tmp_path, fmu, component("a", "a.fmu", bindings=bound)).system.components
    assert (plain_mapping.parameters, plain_mapping.aliases) == ({"k": -0.25}, {})
    actual = read(tmp_path, fmu, component("a", "a.fmu", bindings=renaming))
    (ours,) = actual.system.components
    assert ours.parameters == {"p": 250.0} and ours.aliases["y_ours"].variable == "y"
    assert actual.values("a") == {"k": -0.25}


# ---- files of sets and mappings ----------------------------------------------------------------


def test_files_beside_the_structure_and_inside_the_fmu(tmp_path: Path, fmu: Path) -> None:
    bound = binding(ssv(k=1.0)) + binding("b.ssv")
    assert values(tmp_path, fmu, bound, files={"b__ssv": ssv(k=2.0)}) == {"k": 2.0}
    content = {
        "modelDescription.xml": description("a", "k:parameter:m").encode(),
        "extra/sets/k.ssv": ssv(p=2.0).encode(),
        "extra/k.ssm": ssm(entry("p", "k", linear(3.0))).encode(),
    }
    path = tmp_path / "a.fmu"
    write_archive(path, content)
    bound = binding("extra/sets/../sets/k.ssv", "extra/k.ssm", source_base="component")
    assert values(tmp_path, path, bound) == {"k": 6.0}


def test_files_in_folders_with_blanks(tmp_path: Path, fmu: Path) -> None:
    part = component("a", "my%20files/a%23.fmu", bindings=binding("my%20files/k.ssv"))
    path = rooted(tmp_path, part)
    folder(path / "my files", **{"a#__fmu": fmu, "k__ssv": ssv(k=2.0)})
    assert understood(path).values("a") == {"k": 2.0}


# ---- connectors of systems ---------------------------------------------------------------------


def test_connectors_of_systems_pass_values_on(tmp_path: Path, fmu: Path) -> None:
    inside = system(
        "s",
        component("a", "a.fmu", "k:parameter u:input"),
        component("b", "a.fmu", "k:parameter"),
        connection("length -> a.k"),
        connection("length -> b.k", linear(2.0)),
        connection("in -> a.u"),
        ports="length:parameter:mm in:input",
    )
    bound_values = {"total": (3000.0, "mm"), "s.in": (40.0, "mm")}
    total = connection("total -> s.length", linear(offset=100.0))
    actual = read(
        tmp_path, fmu, inside, total, ports="total:parameter:m", bindings=binding(ssv(**bound_values))
    )
    # 3 m are 3000 mm, and 100 more; 2 (3.1 m); `in` has the unit of the input that it leads to
    assert actual.values("s.a") == {"k": pytest.approx(3.1), "u": pytest.approx(0.04)}
    assert actual.values("s.b") == {"k": pytest.approx(6.2)}


@pytest.mark.parametrize(("outer", "expected"), [("", 2.0), (binding(ssv(**{"s.a.k": 4.0})), 4.0)])
def test_connector_overrides_the_component_and_a_higher_level_both(
    outer: str, expected: float, tmp_path: Path, fmu: Path
) -> None:
    parts = component("a", "a.fmu", "k:parameter", binding(ssv(k=1.0))), connection("p -> a.k")
    inside = system("s", *parts, ports="p:parameter", bindings=binding(ssv(p=2.0)))
    assert read(tmp_path, fmu, inside, bindings=outer).values("s.a") == {"k": expected}


INNER = system("s", component("a", "a.fmu", "k:parameter"), connection("p -> a.k"), ports="p:parameter")


SOURCE, DRIVEN = {"s.p": 3.0}, {"s.a.k": 4.0}


@pytest.mark.parametrize("sets", [[SOURCE | DRIVEN], [DRIVEN | SOURCE], [SOURCE, DRIVEN], [DRIVEN, SOURCE]])
def test_connected_variable_has_the_value_of_its_first_source(
    sets: list[dict], tmp_path: Path, fmu: Path
) -> None:
    """OMSimulator 3.0.0 computes the same in its example import_export_parameters1."""
    bindings = [binding(ssv(**values)) for values in sets]
    actual = read(tmp_path, fmu, INNER, bindings="".join(bindings))
    assert actual.values("s.a") == {"k": 3.0}
    assert [note for note in actual.notes if "s.a.k = 4.0 has no effect: it is connected to s.p" in note]
    bindings.insert(0, binding(ssv(q=2.0)))
    outer = connection("q -> s.p")
    actual = read(tmp_path, fmu, INNER, outer, ports="q:parameter", bindings="".join(bindings))
    assert actual.values("s.a") == {"k": 2.0}
    assert sum("has no effect" in note for note in actual.notes) == 2


def test_value_in_a_unit_reaches_inputs_of_other_units(tmp_path: Path, fmu: Path) -> None:
    parts = component("a", "a.fmu", "u:input"), component("b", "b.fmu", "u:input")
    wires = connection("in -> a.u"), connection("in -> b.u")
    files = {"b__fmu": fake_fmu(tmp_path / "b.fmu", "u:input:mm")}
    bindings = binding(ssv(**{"in": (5.0, "mm")}))
    actual = read(tmp_path, fmu, *parts, *wires, ports="in:input", bindings=bindings, files=files)
    assert (actual.values("a"), actual.values("b")) == ({"u": pytest.approx(5e-3)}, {"u": 5.0})


def test_driven_input_gets_no_value(tmp_path: Path, fmu: Path) -> None:
    parts = (
        component("a", "a.fmu", "y:output"),
        component("b", "a.fmu", "u:input", binding(ssv(u=3.0, k=1.0))),
        connection("a.y -> b.u"),
    )
    assert read(tmp_path, fmu, *parts).values("b") == {"k": 1.0}
