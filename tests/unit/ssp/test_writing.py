"""What is written of systems in which names, units and files could be mistaken for each other."""

import tempfile
import zipfile
from pathlib import Path
from typing import Any

import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.base.faults import accept_faults
from emla_cosim.base.units import LinearTransformation
from emla_cosim.ssp.reader.flat_document import read_ssp
from emla_cosim.ssp.writer.package_writer import SystemTimes, write_ssp
from emla_cosim.system.model import Alias, Component, Connection, System
from tests.support.ssp_documents import Understood, fake_fmu, understood


def exported(folder: Path, system: System, fmus: dict[str, Path]) -> Understood:
    """The system after it was written and read."""
    path = folder / "x.ssp"
    write_ssp(path, "x", "", system, fmus, SystemTimes(0.0, 1.0, 0.1))
    return understood(path)


def files(folder: Path) -> set[str]:
    with zipfile.ZipFile(folder / "x.ssp") as archive:
        return set(archive.namelist())


def pair(folder: Path, first: list[str], second: list[str], *components: Component) -> Understood:
    """Two components with FMUs of these variables."""
    paths = [fake_fmu(folder / f"{i}.fmu", *variables) for i, variables in enumerate((first, second))]
    names = [c.name for c in components]
    return exported(folder, System(components, ()), dict(zip(names, paths, strict=True)))


def test_a_parameter_of_the_same_name_in_another_component(tmp_path: Path) -> None:
    """It stays with the component that it was set for."""
    components = Component("j.a", parameters={"b": 1.0}), Component("j.b", parameters={"k": 3.0})
    found = pair(tmp_path, ["k:parameter", "b:parameter"], ["k:parameter"], *components)
    assert (found.values("j.a"), found.values("j.b")) == ({"b": 1.0}, {"k": 3.0})


def test_a_component_without_values_has_no_set(tmp_path: Path) -> None:
    components = Component("j.a"), Component("j.b", parameters={"k": 3.0})
    pair(tmp_path, ["k:parameter"], ["k:parameter"], *components)
    assert {name for name in files(tmp_path) if name.endswith(".ssv")} == {"resources/j_b.ssv"}


def twice(folder: Path, system: System, fmus: dict[str, Path]) -> tuple[bytes, bytes]:
    """The package of a system, and that of what was read from it."""
    exported(folder, system, fmus)
    (folder / "again").mkdir()
    with read_ssp(folder / "x.ssp") as document:
        theirs = {c.name: c.fmu for c in document.system.components if c.fmu is not None}
        exported(folder / "again", document.system, theirs)
    return (folder / "x.ssp").read_bytes(), (folder / "again" / "x.ssp").read_bytes()


def test_components_of_several_systems(tmp_path: Path) -> None:
    names = {"a.b.x": "k", "a.c": "n", "a.b.z": "p"}
    fmus = {name: fake_fmu(tmp_path / f"{v}.fmu", f"{v}:parameter") for name, v in names.items()}
    system = System(tuple(Component(n, parameters={v: 1.0}) for n, v in names.items()), ())
    first, second = twice(tmp_path, system, fmus)
    assert first == second


def test_another_name_for_what_has_no_value(tmp_path: Path) -> None:
    """The mapping must not find a value that is meant for somebody else."""
    aliases = {"k": Alias("theirs", LinearTransformation(2.0))}
    components = (Component("j.a", aliases=aliases), Component("j.b", parameters={"k": 3.0}))
    found = pair(tmp_path, ["theirs:parameter"], ["k:parameter"], *components)
    assert (found.values("j.a"), found.values("j.b")) == ({}, {"k": 3.0})
    assert found.system.component("j.a").aliases == aliases


def test_files_of_components_that_would_be_called_the_same(tmp_path: Path) -> None:
    fmu = fake_fmu(tmp_path / "a.fmu", "k:parameter")
    values = {"a.b": 1.0, "a.c.x": 2.0, "a_c.x": 3.0, "/x.y": 4.0}
    system = System(tuple(Component(n, parameters={"k": v}) for n, v in values.items()), ())
    found = exported(tmp_path, system, dict.fromkeys(values, fmu))
    assert {n: found.values(n)["k"] for n in values} == values
    assert {"resources/a_c_x.ssv", "resources/a_c_x_2.ssv", "resources/_x_y.ssv"} < files(tmp_path)


def test_units_of_one_name_that_are_not_the_same(tmp_path: Path) -> None:
    one = fake_fmu(tmp_path / "one.fmu", "y:output:u", "k:parameter:u", units={"u": 'm="1" factor="2"'})
    two = fake_fmu(tmp_path / "two.fmu", "u:input:u", "p:parameter:u", units={"u": 'm="1" factor="6"'})
    components = (Component("j.a", parameters={"k": 3.0}), Component("j.b", parameters={"p": 5.0}))
    system = System(components, (Connection("j.a", "y", "j.b", "u"),))
    found = exported(tmp_path, system, {"j.a": one, "j.b": two})
    assert (found.values("j.a"), found.values("j.b")) == ({"k": 3.0}, {"p": 5.0})
    assert found.wires() == {"j.a.y -> j.b.u": (pytest.approx(1.0 / 3.0), 0.0)}


def test_an_output_that_leads_to_two_places_outside(tmp_path: Path) -> None:
    fmu = fake_fmu(tmp_path / "a.fmu", "y:output:m", "u:input:mm")
    names = ("a.x", "b.x", "b.z", "a.c.x")
    wires = [Connection("a.x", "y", name, "u") for name in names]
    system = System(tuple(map(Component, names)), tuple(wires))
    found = exported(tmp_path, system, dict.fromkeys(names, fmu))
    assert found.wires() == {f"a.x.y -> {name}.u": (1e3, 0.0) for name in names}


def test_connections_of_all_types(tmp_path: Path) -> None:
    types = ("Real", "Integer", "Boolean", "Enumeration")
    fmu = fake_fmu(
        tmp_path / "a.fmu", *(f"{k}{t}:{c}:{t}" for t in types for k, c in (("y", "output"), ("u", "input")))
    )
    wires = [Connection("a.x", f"y{t}", "b.x", f"u{t}") for t in types]
    wires.append(Connection("a.x", "yInteger", "a.x", "uReal", LinearTransformation(2.0, 1.0)))
    system = System((Component("a.x"), Component("b.x")), tuple(wires))
    found = exported(tmp_path, system, {"a.x": fmu, "b.x": fmu})
    assert found.wires() == {
        **{f"a.x.y{t} -> b.x.u{t}": (1.0, 0.0) for t in types},
        "a.x.yInteger -> a.x.uReal": (2.0, 1.0),
    }


def test_a_component_inside_a_component(tmp_path: Path) -> None:
    fmu = fake_fmu(tmp_path / "a.fmu", "k:parameter")
    system = System((Component("a.b"), Component("a.b.c")), ())
    assert exported(tmp_path, system, dict.fromkeys(("a.b", "a.b.c"), fmu)).system.branches == ["a"]


@pytest.mark.parametrize("name", ["a.b", "a-1.b", "Größe.b", "_.b", "a.1", "1.b", "a b.c", "²x.b", "a..b"])
def test_names_that_stay(name: str, tmp_path: Path) -> None:
    fmu = fake_fmu(tmp_path / "a.fmu", "k:parameter")
    (component,) = exported(tmp_path, System((Component(name),), ()), {name: fmu}).system.components
    assert component.name == name


@pytest.mark.parametrize(
    ("type_", "value", "expected"),
    [
        ("Boolean", "true", True),
        ("Integer", "7", 7),
    ],
)
def test_values_that_are_written_in_another_way(
    type_: str, value: Any, expected: Any, tmp_path: Path
) -> None:
    fmu = fake_fmu(tmp_path / "a.fmu", f"k:parameter:{type_}")
    system = System((Component("j.a", parameters={"k": value}),), ())
    assert exported(tmp_path, system, {"j.a": fmu}).values("j.a") == {"k": expected}


@pytest.mark.parametrize(
    ("type_", "start", "other"), [("Enumeration", "off", "fast"), ("String", "", "text")]
)
def test_types_that_not_all_tools_read(type_: str, start: str, other: str, tmp_path: Path) -> None:
    """Only the FMU's own start value is possible, and is left out."""
    fmu = fake_fmu(tmp_path / "a.fmu", f"k:parameter:{type_}", "r:parameter")
    system = System((Component("j.a", parameters={"k": start, "r": 2.0}),), ())
    assert exported(tmp_path, system, {"j.a": fmu}).values("j.a") == {"r": 2.0}
    changed = System((Component("j.a", parameters={"k": other}),), ())
    (tmp_path / "new").mkdir()
    with pytest.raises(
        CommandError, match=rf"j\.a\.k = {other} cannot be exported: not all tools read {type_}s"
    ):
        exported(tmp_path / "new", changed, {"j.a": fmu})
    assert not any((tmp_path / "new").iterdir())
    with accept_faults(lenient=True) as faults:
        read = exported(tmp_path / "new", changed, {"j.a": fmu}).values("j.a")
    assert read == {"k": {"fast": 5, "text": "text"}[other]}
    assert any(
        f"'j.a.k' has a fault, which was accepted: not all tools read {type_}s" in r for r in faults.remarks()
    )


def test_names_that_differ_only_in_characters_that_identifiers_lack(tmp_path: Path) -> None:
    fmu = fake_fmu(tmp_path / "a.fmu", "k:parameter")
    names = ["a.b", "a_b", "a-b", "a b", "a_b_2", "1", "c_1", "_x0020_"]
    found = exported(tmp_path, System(tuple(map(Component, names)), ()), dict.fromkeys(names, fmu))
    assert [c.name for c in found.system.components] == names


def test_files_that_end_otherwise(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match=r"ends in \.ssp"):
        write_ssp(tmp_path / "x.zip", "x", "", System((), ()), {}, SystemTimes(0.0, 1.0, 0.1))


def test_messages_name_files_as_the_user_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Even where the temporary folder is a link."""
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "link"))
    fmu = fake_fmu(tmp_path / "a.fmu", "k:parameter")
    exported(tmp_path, System((Component("j.a"),), ()), {"j.a": fmu})
    with pytest.raises(CommandError) as caught, read_ssp(tmp_path / "x.ssp") as document:
        (component,) = document.system.components
        raise CommandError(f"'{component.fmu}' is wrong.")
    assert str(caught.value) == "'x.ssp/resources/a.fmu' is wrong."
