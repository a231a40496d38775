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
    ssd,
    ssm,
    ssv,
    system,
    table,
    understood,
)

PORTS = "u:input:m"


@pytest.fixture
def fmu(tmp_path: Path) -> Path:
    """An FMU with parameters of all types."""
    return fake_fmu(
        tmp_path / "a.fmu",
        "u:input:m",
        "y:output",
        "x:output:m:exact",
        "k:parameter:m",
        "t:parameter:degC",
        "b:parameter",
        "n:parameter:Integer",
        "on:parameter:Boolean",
        "mode:parameter:Enumeration",
        "label:parameter:String",
    )


def read(tmp_path: Path, fmu: Path, *parts: str, files: dict | None = None, **more: str) -> Understood:
    """A root system of these parts, with files beside it."""
    return understood(
        folder(tmp_path / "ssp", root=ssd(system("root", *parts, **more)), a__fmu=fmu, **(files or {}))
    )


def values(tmp_path: Path, fmu: Path, bindings: str, **more: Any) -> dict[str, Any]:
    """Start values of one component with these bindings."""
    return read(tmp_path, fmu, component("a", "a.fmu", bindings=bindings), **more).values("a")


def test_values_of_all_types(tmp_path: Path, fmu: Path) -> None:
    given = ssv(k=2.5, n=-3, on=True, mode=("fast", "Enumeration"), label="a b", x=0.5, u=1.5)
    found = values(tmp_path, fmu, binding(given))
    assert found == {"k": 2.5, "n": -3, "on": True, "mode": "fast", "label": "a b", "x": 0.5, "u": 1.5}
    assert isinstance(found["on"], bool)


@pytest.mark.parametrize("given", [2, 2.0, ("2", "Enumeration")])
def test_a_number_sets_an_enumeration(given: Any, tmp_path: Path, fmu: Path) -> None:
    found = values(tmp_path, fmu, binding(ssv(mode=given)))
    ((variable, number),) = convert_start_values("a", read_interface(fmu), found)
    assert (variable.name, number, type(number)) == ("mode", 2, int)


@pytest.mark.parametrize("given", [7, 1.5, True, ("7", "Enumeration")])
def test_a_value_that_is_no_item_of_an_enumeration(given: Any, tmp_path: Path, fmu: Path) -> None:
    found = values(tmp_path, fmu, binding(ssv(mode=given)))
    with pytest.raises(CommandError, match=r"^a\.mode = \S+ is not one of \w+ \(1\), \w+ \(2\)") as raised:
        convert_start_values("a", read_interface(fmu), found)
    assert f"= {found['mode']} is" in str(raised.value)


def test_white_space_that_the_schema_allows(tmp_path: Path, fmu: Path) -> None:
    given = ssv(k=1.0, n=7, on=True).replace('"true"', '" 1 "').replace('"7"', '" +7 "')
    assert values(tmp_path, fmu, binding(given)) == {"k": 1.0, "n": 7, "on": True}


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ((250.0, "mm"), 0.25),
        ((2.0, "m"), 2.0),
        (2.0, 2.0),
    ],
)
def test_units_are_converted(given: Any, expected: float, tmp_path: Path, fmu: Path) -> None:
    assert values(tmp_path, fmu, binding(ssv(k=given))) == {"k": expected}


@pytest.mark.parametrize(
    ("given", "expected"),
    [((300.0, "K"), 26.85), ((212.0, "degF"), 100.0), ((-40.0, "degF"), -40.0), ((50.0, "degC"), 50.0)],
)
def test_units_with_offset(given: Any, expected: float, tmp_path: Path, fmu: Path) -> None:
    found = values(tmp_path, fmu, binding(ssv(t=given)))
    assert found == {"t": pytest.approx(expected, rel=1e-13)}


def test_what_no_variable_is_called_is_told(tmp_path: Path, fmu: Path) -> None:
    found = read(tmp_path, fmu, component("a", "a.fmu", bindings=binding(ssv(k=1.0, nothing=2.0, y=3.0))))
    assert found.values("a") == {"k": 1.0}
    assert [note.removesuffix(" matches no variable").rpartition(" ")[2] for note in found.notes] == [
        "nothing",
        "y",
    ]


# ---- levels and order --------------------------------------------------------------------------


def test_later_sets_win_at_the_same_level(tmp_path: Path, fmu: Path) -> None:
    both = binding(ssv(k=1.0, b=1.0)) + binding("b.ssv")
    assert values(tmp_path, fmu, both, files={"b__ssv": ssv(k=2.0)}) == {"k": 2.0, "b": 1.0}


def test_higher_levels_win(tmp_path: Path, fmu: Path) -> None:
    lowest = component("a", "a.fmu", bindings=binding(ssv(k=1.0, b=1.0, x=1.0)))
    middle = system("s", lowest, bindings=binding(ssv(**{"a.k": 2.0, "a.b": 2.0})))
    found = read(tmp_path, fmu, middle, bindings=binding(ssv(**{"s.a.k": 3.0})))
    assert found.values("s.a") == {"k": 3.0, "b": 2.0, "x": 1.0}


def test_higher_levels_win_over_later_sets_and_mappings(tmp_path: Path, fmu: Path) -> None:
    lower = binding(ssv(k=1.0)) + binding(ssv(p=2.0), ssm(entry("p", "k", linear(10.0))))
    found = read(
        tmp_path,
        fmu,
        component("a", "a.fmu", bindings=lower),
        bindings=binding(ssv(**{"a.k": (500.0, "mm")})),
    )
    assert found.values("a") == {"k": 0.5}


@pytest.mark.parametrize("mapping", [entry("k", "b"), entry("k", "k", linear(1e-3))])
def test_higher_levels_win_over_mappings_of_the_same_name(mapping: str, tmp_path: Path, fmu: Path) -> None:
    """What `k` means inside the component is not what it is called outside."""
    inside = component("a", "a.fmu", bindings=binding(ssv(k=5.0), ssm(mapping)))
    found = read(tmp_path, fmu, inside, bindings=binding(ssv(**{"a.k": 7.0})))
    assert {"b": 5.0, **found.values("a")} == {"k": 7.0, "b": 5.0}


def test_a_prefix_comes_before_names_and_mappings(tmp_path: Path, fmu: Path) -> None:
    own = ssm(entry("a.p", "a.k"), entry("p", "a.b"))
    found = read(
        tmp_path,
        fmu,
        component("a", "a.fmu"),
        component("c", "a.fmu"),
        bindings=binding(ssv(k=1.0), prefix="c.") + binding(ssv(p=2.0), own, prefix="a."),
    )
    assert (found.values("a"), found.values("c")) == ({"k": 2.0}, {"k": 1.0})


# ---- mappings ----------------------------------------------------------------------------------


def test_a_mapping_passes_what_it_names_alone(tmp_path: Path, fmu: Path) -> None:
    mapping = ssm(entry("p", "k"), entry("p", "b"), entry("nothing", "x"))
    assert values(tmp_path, fmu, binding(ssv(p=2.0, x=3.0), mapping)) == {"k": 2.0, "b": 2.0}


def test_a_mapping_may_exchange_names(tmp_path: Path, fmu: Path) -> None:
    mapping = ssm(entry("k", "b"), entry("b", "k", linear(2.0)))
    assert values(tmp_path, fmu, binding(ssv(k=5.0, b=7.0), mapping)) == {"k": 14.0, "b": 5.0}


@pytest.mark.parametrize(
    ("inside", "more", "expected"),
    [
        (linear(3.0, 1.0), {}, 1.75),  # 3 (250 mm in m) + 1
        (linear(3.0, 1.0), {"suppress_unit_conversion": True}, 751.0),
        (linear(offset=-1.0), {}, -0.75),
        ("", {"suppress_unit_conversion": True}, 250.0),
    ],
)
def test_transformations_come_after_the_conversion(
    inside: str, more: dict, expected: float, tmp_path: Path, fmu: Path
) -> None:
    mapping = ssm(entry("p", "k", inside, **more))
    assert values(tmp_path, fmu, binding(ssv(p=(250.0, "mm")), mapping)) == {"k": expected}


def test_a_mapping_that_keeps_the_name_leaves_connections_alone(tmp_path: Path, fmu: Path) -> None:
    """The mapping is of parameters: what arrives through a connection does not pass it."""
    mapping = ssm(entry("u", "u", linear(2.0)), entry("x", "x", linear(1e-3)))
    found = read(
        tmp_path,
        fmu,
        component("a", "a.fmu", "x:output", bindings=binding(ssv(x=4.0), mapping)),
        component("b", "a.fmu", PORTS, bindings=binding(ssv(u=4.0), mapping)),
        connection("a.x -> b.u", linear(7.0, 3.0)),
    )
    assert found.wires() == {"a.x -> b.u": pytest.approx((7.0, 3.0))}
    assert (found.values("a"), found.values("b")) == ({"x": 4e-3}, {})


@pytest.mark.parametrize(
    ("second", "expected"),
    [
        (binding(ssv(p=2.0), ssm(entry("p", "b"))), {"k": 1.0, "b": 2.0}),
        (binding(ssv(q=2.0), ssm(entry("q", "k", linear(3.0)))), {"k": 6.0}),
    ],
    ids=["of one name", "to one name"],
)
def test_two_mappings(second: str, expected: dict, tmp_path: Path, fmu: Path) -> None:
    """Then the system has the FMU's names, and no other ones."""
    bound = binding(ssv(p=1.0), ssm(entry("p", "k"))) + second
    found = read(tmp_path, fmu, component("a", "a.fmu", bindings=bound))
    assert found.values("a") == expected
    assert found.system.component("a").aliases == {}


def test_the_same_mapping_for_sets_in_different_units(tmp_path: Path, fmu: Path) -> None:
    mapping = ssm(entry("p", "k"), entry("q", "x"))
    both = binding(ssv(p=(1.0, "mm"), q=(5.0, "mm")), mapping) + binding(ssv(p=3.0), mapping)
    assert values(tmp_path, fmu, both) == {"k": 3.0, "x": 5e-3}


def test_only_a_replaced_component_has_the_names_of_its_mapping_in_results(tmp_path: Path, fmu: Path) -> None:
    """Which its binding says; a mapping of parameters must not rename the outputs of other people."""
    bound = binding(ssv(p=(250.0, "mm")), ssm(entry("p", "k", linear(-1.0)), entry("y_ours", "y")))
    annotation = '<ssc:Annotation type="emla-cosim.renames"/>'
    end = "</ssd:ParameterBinding>"
    renaming = bound.replace(end, f"<ssd:Annotations>{annotation}</ssd:Annotations>{end}")
    found = read(tmp_path, fmu, component("a", "a.fmu", bindings=bound))
    (theirs,) = found.system.components
    assert (dict(theirs.parameters), dict(theirs.aliases)) == ({"k": -0.25}, {})
    found = read(tmp_path, fmu, component("a", "a.fmu", bindings=renaming))
    (ours,) = found.system.components
    assert dict(ours.parameters) == {"p": 250.0}
    assert ours.aliases["y_ours"].variable == "y"
    assert found.values("a") == {"k": -0.25}


@pytest.mark.parametrize(
    ("name", "given", "mapping", "expected"),
    [
        ("on", True, table("Boolean", true=False, false=True), False),
        ("on", False, table("Boolean", _1=False, _0=True), True),
        ("n", 3, table("Integer", _2=20, _3=30), 30),
        ("n", 4, table("Integer", _2=20, _3=30), 4),
        ("n", 3, table("Integer", _03=30), 30),
        ("mode", ("slow", "Enumeration"), table("Enumeration", slow="fast", fast="off"), "fast"),
        ("n", 3, linear(4.0, 1.0), 13),
        ("on", True, table("Integer", _1=0), True),
    ],
)
def test_tables(name: str, given: Any, mapping: str, expected: Any, tmp_path: Path, fmu: Path) -> None:
    found = values(tmp_path, fmu, binding(ssv(p=given), ssm(entry("p", name, mapping))))
    assert found == {name: expected}
    assert isinstance(expected, bool) == isinstance(found[name], bool)


# ---- where sets and mappings are ---------------------------------------------------------------


def test_files_inside_the_fmu(tmp_path: Path) -> None:
    content = {
        "modelDescription.xml": description("a", "k:parameter:m"),
        "extra/sets/k.ssv": ssv(p=2.0),
        "extra/k.ssm": ssm(entry("p", "k", linear(3.0))),
    }
    path = tmp_path / "a.fmu"
    write_archive(path, {name: text.encode() for name, text in content.items()})
    bound = binding("extra/sets/../sets/k.ssv", "extra/k.ssm", source_base="component")
    assert values(tmp_path, path, bound) == {"k": 6.0}


def test_files_in_folders_with_blanks(tmp_path: Path, fmu: Path) -> None:
    path = folder(
        tmp_path / "ssp",
        root=ssd(system("root", component("a", "my%20files/a%23.fmu", bindings=binding("my%20files/k.ssv")))),
    )
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
    found = read(
        tmp_path,
        fmu,
        inside,
        connection("total -> s.length", linear(offset=100.0)),
        ports="total:parameter:m",
        bindings=binding(ssv(total=(3000.0, "mm"), **{"s.in": (40.0, "mm")})),
    )
    # 3 m are 3000 mm, and 100 more; 2 (3.1 m); `in` has the unit of the input that it leads to
    assert found.values("s.a") == {"k": pytest.approx(3.1), "u": pytest.approx(0.04)}
    assert found.values("s.b") == {"k": pytest.approx(6.2)}


def test_values_of_connectors_and_variables_override_each_other(tmp_path: Path, fmu: Path) -> None:
    def inside(own: str) -> str:
        parts = (component("a", "a.fmu", "k:parameter", binding(ssv(k=1.0))), connection("p -> a.k"))
        return system("s", *parts, ports="p:parameter", bindings=own)

    lower = read(tmp_path / "1", fmu, inside(binding(ssv(p=2.0))))
    assert lower.values("s.a") == {"k": 2.0}
    outer = binding(ssv(**{"s.a.k": 4.0}))
    assert read(tmp_path / "2", fmu, inside(binding(ssv(p=2.0))), bindings=outer).values("s.a") == {"k": 4.0}


@pytest.mark.parametrize("order", [("s.p", "s.a.k"), ("s.a.k", "s.p")])
@pytest.mark.parametrize("together", [True, False], ids=["one set", "a set each"])
def test_a_connected_variable_has_the_value_of_its_source(
    order: tuple[str, ...], together: bool, tmp_path: Path, fmu: Path
) -> None:
    """OMSimulator 3.0.0 computes the same in its example import_export_parameters1."""
    given = {"s.p": 3.0, "s.a.k": 4.0}
    if together:
        bindings = binding(ssv(**{name: given[name] for name in order}))
    else:
        bindings = "".join(binding(ssv(**{name: given[name]})) for name in order)
    inside = system("s", component("a", "a.fmu", "k:parameter"), connection("p -> a.k"), ports="p:parameter")
    found = read(tmp_path, fmu, inside, bindings=bindings)
    assert found.values("s.a") == {"k": 3.0}
    assert [note for note in found.notes if "s.a.k = 4.0 has no effect: it is connected to s.p" in note]


def test_of_several_connected_parameters_the_source_applies(tmp_path: Path, fmu: Path) -> None:
    inner = system("s", component("a", "a.fmu", "k:parameter"), connection("p -> a.k"), ports="p:parameter")
    found = read(
        tmp_path,
        fmu,
        inner,
        connection("q -> s.p"),
        ports="q:parameter",
        bindings=binding(ssv(**{"q": 2.0, "s.p": 3.0, "s.a.k": 4.0})),
    )
    assert found.values("s.a") == {"k": 2.0}
    assert sum("has no effect" in note for note in found.notes) == 2


def test_values_in_units_reach_inputs_of_different_ones(tmp_path: Path, fmu: Path) -> None:
    other = fake_fmu(tmp_path / "b.fmu", "u:input:mm")
    found = read(
        tmp_path,
        fmu,
        component("a", "a.fmu", "u:input"),
        component("b", "b.fmu", "u:input"),
        connection("in -> a.u"),
        connection("in -> b.u"),
        ports="in:input",
        bindings=binding(ssv(**{"in": (5.0, "mm")})),
        files={"b__fmu": other},
    )
    assert (found.values("a"), found.values("b")) == ({"u": pytest.approx(5e-3)}, {"u": 5.0})


def test_what_an_output_drives_gets_no_value(tmp_path: Path, fmu: Path) -> None:
    found = read(
        tmp_path,
        fmu,
        component("a", "a.fmu", "y:output"),
        component("b", "a.fmu", "u:input", binding(ssv(u=3.0, k=1.0))),
        connection("a.y -> b.u"),
    )
    assert found.values("b") == {"k": 1.0}
