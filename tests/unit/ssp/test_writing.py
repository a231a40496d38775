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
    folder.mkdir(exist_ok=True)
    write_ssp(folder / "x.ssp", "x", "", system, fmus, SystemTimes(0.0, 1.0, 0.1))
    return understood(folder / "x.ssp")


def files(folder: Path) -> set[str]:
    with zipfile.ZipFile(folder / "x.ssp") as archive:
        return set(archive.namelist())


@pytest.fixture
def fmu(tmp_path: Path) -> Path:
    return fake_fmu(tmp_path / "a.fmu", "k:parameter", "y:output:m", "u:input:mm")


def of_all(names: list[str], fmu: Path, *connections: Connection) -> tuple[System, dict[str, Path]]:
    """A system of components with one FMU."""
    return System(tuple(map(Component, names)), connections), dict.fromkeys(names, fmu)


@pytest.mark.parametrize(
    "first",
    [
        Component("j.a", parameters={"b": 1.0}),
        Component("j.a"),
        # the mapping must not find a value of another component
        Component("j.a", aliases={"k": Alias("b", LinearTransformation(2.0))}),
    ],
)
def test_value_belongs_to_its_component(first: Component, tmp_path: Path) -> None:
    variables = ("b:parameter",) if first.aliases else ("k:parameter", "b:parameter")
    fmus = {"j.a": fake_fmu(tmp_path / "a.fmu", *variables)}
    fmus["j.b"] = fake_fmu(tmp_path / "b.fmu", "k:parameter")
    actual = exported(tmp_path, System((first, Component("j.b", parameters={"k": 3.0})), ()), fmus)
    assert (actual.values("j.a"), actual.values("j.b")) == (first.parameters, {"k": 3.0})
    assert [c.aliases for c in actual.system.components] == [first.aliases, {}]


def test_component_without_values_has_no_parameter_file(tmp_path: Path, fmu: Path) -> None:
    system, fmus = of_all(["j.a", "j.b"], fmu)
    exported(tmp_path, system.with_parameters({"j.b.k": 3.0}), fmus)
    assert {name for name in files(tmp_path) if name.endswith(".ssv")} == {"resources/j_b.ssv"}


def test_connections_of_all_types(tmp_path: Path) -> None:
    types = ("Real", "Integer", "Boolean", "Enumeration")
    variables = (f"{k}{t}:{c}:{t}" for t in types for k, c in (("y", "output"), ("u", "input")))
    fmu = fake_fmu(tmp_path / "a.fmu", *variables)
    wires = [Connection("a.x", f"y{t}", "b.x", f"u{t}") for t in types]
    wires.append(Connection("a.x", "yInteger", "a.x", "uReal", LinearTransformation(2.0, 1.0)))
    assert exported(tmp_path, *of_all(["a.x", "b.x"], fmu, *wires)).wires() == {
        **{f"a.x.y{t} -> b.x.u{t}": (1.0, 0.0) for t in types},
        "a.x.yInteger -> a.x.uReal": (2.0, 1.0),
    }


@pytest.mark.parametrize(
    "names",
    [
        *(["a.b"], ["a-1.b"], ["Größe.b"], ["_.b"], ["a.1"], ["1.b"], ["a b.c"], ["²x.b"], ["a..b"]),
        # those that differ only in characters that identifiers cannot have
        ["a.b", "a_b", "a-b", "a b", "a_b_2", "/a.b", "1", "c_1", "_x0020_"],
        ["a.b", "a.b.c"],
    ],
)
def test_component_names_are_the_same_after_reading(names: list[str], tmp_path: Path, fmu: Path) -> None:
    """Also where the files of components would have the same name."""
    components = [Component(name, parameters={"k": float(i)}) for i, name in enumerate(names, 1)]
    actual = exported(tmp_path, System(tuple(components), ()), dict.fromkeys(names, fmu)).system.components
    assert [(c.name, c.parameters) for c in actual] == [(c.name, c.parameters) for c in components]


@pytest.mark.parametrize(("type_", "value", "expected"), [("Boolean", "true", True), ("Integer", "7", 7)])
def test_values_given_as_text(type_: str, value: Any, expected: Any, tmp_path: Path) -> None:
    fmu = fake_fmu(tmp_path / "a.fmu", f"k:parameter:{type_}")
    system = System((Component("j.a", parameters={"k": value}),), ())
    assert exported(tmp_path, system, {"j.a": fmu}).values("j.a") == {"k": expected}


@pytest.mark.parametrize(
    ("type_", "start", "changed_value", "read"),
    [("Enumeration", "off", "fast", 5), ("String", "", "text", "text")],
)
def test_types_that_not_all_tools_read(
    type_: str, start: str, changed_value: str, read: Any, tmp_path: Path
) -> None:
    """Only the FMU's own start value is possible, and is left out; `lenient` accepts others."""
    fmus = {"j.a": fake_fmu(tmp_path / "a.fmu", f"k:parameter:{type_}", "r:parameter")}
    system = System((Component("j.a", parameters={"k": start, "r": 2.0}),), ())
    assert exported(tmp_path, system, fmus).values("j.a") == {"r": 2.0}
    changed = System((Component("j.a", parameters={"k": changed_value}),), ())
    words = f"not all tools read {type_}s"
    with pytest.raises(CommandError, match=rf"j\.a\.k = {changed_value} cannot be exported: {words}"):
        exported(tmp_path / "new", changed, fmus)
    assert not any((tmp_path / "new").iterdir())
    with accept_faults(lenient=True) as faults:
        assert exported(tmp_path / "new", changed, fmus).values("j.a") == {"k": read}
    assert any(f"'j.a.k' has a fault, which was accepted: {words}" in r for r in faults.remarks())


def test_file_must_end_in_ssp(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match=r"ends in \.ssp"):
        write_ssp(tmp_path / "x.zip", "x", "", System((), ()), {}, SystemTimes(0.0, 1.0, 0.1))


def test_messages_have_the_path_in_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fmu: Path
) -> None:
    """Even where the temporary folder is a link."""
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "link"))
    exported(tmp_path, *of_all(["j.a"], fmu))
    with pytest.raises(CommandError) as caught, read_ssp(tmp_path / "x.ssp") as document:
        (component,) = document.system.components
        raise CommandError(f"'{component.fmu}' is wrong.")
    assert str(caught.value) == "'x.ssp/resources/a.fmu' is wrong."
