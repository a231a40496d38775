"""SSP 2.0 with FMUs of FMI 3.0: arrays and types, read and written."""

import zipfile
from pathlib import Path
from typing import Any

import polars
import pytest
from pyssp_standard.ssd import SSD
from pyssp_standard.ssv import SSV

import emla_cosim as ec
import fmublock
from emla_cosim.base.errors import CommandError
from emla_cosim.base.faults import accept_faults
from emla_cosim.base.units import LinearTransformation
from emla_cosim.ssp.reader.flat_document import read_ssp
from emla_cosim.ssp.writer.package_writer import SystemTimes, write_ssp
from emla_cosim.system.model import Alias, Component, Connection, System
from fmublock import Block, Input, Output
from tests.support.hand_written_fmus import build_all_types_3_fmu
from tests.support.ssp_documents import (
    binding,
    component,
    connection,
    entry,
    linear,
    rooted,
    ssm,
    ssv,
    system,
)

TYPES = ("Float32", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Boolean")
STEP, STOP = 0.125, 0.5
MATRIX = '<ssc:Dimension size="2"/><ssc:Dimension sizeConnector="n"/>'


class Pair(Block):
    """Adds one to each of two numbers."""

    u = Input(shape=2)
    y = Output(shape=2)

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"y": [v.u[0] + 1.0, v.u[1] + 1.0]}


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    path = tmp_path_factory.mktemp("fmus")
    third = build_all_types_3_fmu(path / "Third.fmu")
    return {
        "Third": third,
        "Pair": fmublock.build(Pair, path / "Pair.fmu"),
        "Pair3": fmublock.build(Pair, path / "Pair3.fmu", fmi=3),
    }


def connector(name: str, kind: str, type_: str = "Float64", inside: str = "") -> str:
    return f'<ssd:Connector name="{name}" kind="{kind}"><ssc:{type_}/>{inside}</ssd:Connector>'


def third(name: str, bindings: str = "", *more: str, matrix: str = MATRIX) -> str:
    """A component with the FMU of all types."""
    ports = [
        connector("u", "input", inside=matrix),
        connector("y", "output", inside=matrix),
        connector("n", "structuralParameter", "UInt64"),
        connector("x", "output"),
        *(connector(f"{t}_{d}", k, t) for t in TYPES for d, k in (("in", "input"), ("out", "output"))),
        *more,
    ]
    return with_connectors(component(name, "Third.fmu", bindings=bindings), *ports)


def with_connectors(text: str, *ports: str) -> str:
    """The element with these connectors in front of what it has."""
    head, rest = text.split(">", 1)
    return f"{head}><ssd:Connectors>{''.join(ports)}</ssd:Connectors>{rest}"


def values(name: str, texts: str, dimensions: str, type_: str = "Float64") -> str:
    inside = f'<ssv:{type_} value="{texts}"/>{dimensions}'
    parameter = f'<ssv:Parameter name="{name}">{inside}</ssv:Parameter></ssv:Parameters>'
    return ssv(version="2.0").replace("</ssv:Parameters>", parameter)


TWO_BY_TWO = '<ssc:Dimension size="2"/><ssc:Dimension size="2"/>'


def written(path: Path, fmus: dict[str, Path], *parts: str, **more: Any) -> Path:
    """A folder with a system of these parts, and all FMUs."""
    files = {f"{name}__fmu": file for name, file in fmus.items()}
    return rooted(path, *parts, files=files, version="2.0", **more)


def run(source: Path | System, **options: Any) -> ec.Result:
    with ec.load(source, step_size=STEP, stop_time=STOP, **options).prepare() as simulation:
        return simulation.run()


def test_whole_arrays_elements_and_values(fmus: dict[str, Path], tmp_path: Path) -> None:
    """b.y = gain_b * gain_a * u, by hand; c gets one element of it in an element, and d a scalar of c."""
    a = third("a", binding(values("u", "1 2 3 4", TWO_BY_TWO)))
    b = third("b", binding(values("gain", "5 6 7 8", TWO_BY_TWO)))
    wires = (
        connection("a.y -> b.u"),
        connection("b.y -> c.u", start_indices="1 2", end_indices="2 1"),
        connection("d.u -> c.x", start_indices="2 2"),
        *(connection(f"a.{t}_out -> b.{t}_in") for t in TYPES),
    )
    result = run(written(tmp_path, fmus, a, b, third("c"), third("d"), *wires))
    for position, index in enumerate(("1,1", "1,2", "2,1", "2,2")):
        assert result[f"b.y[{index}]"][-1] == (position + 5) * (position + 1) * (position + 1)
    assert result["c.y[2,1]"][-1] == 3 * 24.0
    assert result["c.y[1,2]"][-1] == 2 * 0.5
    assert result["d.y[2,2]"][-1] == 4 * result["c.x"][-1]


def test_versions_mix_and_units_apply_to_each_element(fmus: dict[str, Path], tmp_path: Path) -> None:
    """An inner system passes arrays of a known size and of the size inside; those of FMI 2.0 are scalars."""
    vector = '<ssc:Dimension size="2"/>'

    def pair(name: str, source: str) -> str:
        ports = connector("u", "input", inside=vector), connector("y", "output", inside=vector)
        return with_connectors(component(name, source), *ports)

    inner = system("s", pair("three", "Pair3.fmu"), connection("in -> three.u"), connection("three.y -> out"))
    ports = connector("in", "input", inside="<ssc:Dimension/>"), connector("out", "output", inside=vector)
    inner = with_connectors(inner, *ports)
    path = written(
        tmp_path,
        fmus,
        pair("two", "Pair.fmu"),
        inner,
        third("t"),
        connection("two.y -> s.in", linear(10.0, 1.0)),
        connection("s.out -> t.u", start_indices="2", end_indices="1 1"),
        bindings=binding(values("two.u", "1 2", vector)),
    )
    result = run(path)
    assert [result[f"s.three.y[{i}]"][-1] for i in (1, 2)] == [22.0, 32.0]
    assert result["t.y[1,1]"][-1] == 32.0


def test_elements_pass_systems_and_signal_dictionaries(fmus: dict[str, Path], tmp_path: Path) -> None:
    """Each connector of a system that is declared with sizes can be connected by element on both sides."""
    matrix = TWO_BY_TWO
    inner = system(
        "s",
        third("t"),
        connection("in -> t.u", start_indices="1 2", end_indices="2 2"),
        connection("t.y -> out", start_indices="2 2", end_indices="2 1"),
    )
    inner = with_connectors(
        inner, connector("in", "input", inside=matrix), connector("out", "output", inside=matrix)
    )
    reference = with_connectors(
        '<ssd:SignalDictionaryReference name="NAME" dictionary="bus"></ssd:SignalDictionaryReference>',
        connector("signal", "inout", inside=matrix),
    )
    path = written(
        tmp_path,
        fmus,
        third("a"),
        third("b"),
        inner,
        reference.replace("NAME", "first"),
        reference.replace("NAME", "second"),
        connection("a.x -> s.in", end_indices="1 2"),
        connection("a.y -> first.signal"),
        connection("second.signal -> b.u", start_indices="2 1", end_indices="1 1"),
        connection("s.out -> b.u", start_indices="2 1", end_indices="2 2"),
        '<ssd:SignalDictionary name="bus" source="bus.ssb"/>',
    )
    (path / "bus.ssb").write_text("")
    result = run(path)
    assert result["s.t.y[2,2]"][-1] == 4 * result["a.x"][-1] != 0.0
    assert result["b.y[1,1]"][-1] == result["a.y[2,1]"][-1]
    assert result["b.y[2,2]"][-1] == 4 * result["s.t.y[2,2]"][-1]


def test_replaced_components_keep_the_names_of_elements(fmus: dict[str, Path], tmp_path: Path) -> None:
    aliases = {"k": Alias("gain[2,1]", LinearTransformation(10.0)), "own": Alias("u[1,1]")}
    replaced = Component("a", parameters={"k": 0.5, "own": 3.0}, fmu=fmus["Third"], aliases=aliases)
    other_component = Component("b", fmu=fmus["Third"])
    array_connections = tuple(
        Connection("a", f"y{index}", "b", f"u{index}") for index in ("[1,1]", "[1,2]", "[2,1]", "[2,2]")
    )
    times = SystemTimes(0.0, STOP, STEP)
    system = System((replaced, other_component), array_connections)
    write_ssp(tmp_path / "x.ssp", "x", "", system, dict.fromkeys("ab", fmus["Third"]), times)
    with read_ssp(tmp_path / "x.ssp") as document:
        actual = document.system.component("a")
        assert (actual.parameters, actual.aliases) == ({"k": 0.5, "own": 3.0}, aliases)
        assert [str(x) for x in document.system.connections] == [str(x) for x in array_connections]


def test_documents_of_version_1_name_elements_or_whole_arrays(fmus: dict[str, Path], tmp_path: Path) -> None:
    ports = "u:input u[1,1]:input:Real y:output y[2,2]:output:Real UInt64_in:input:Integer x:output:Real"
    bindings = binding(ssv(**{"gain[2,2]": 7.0, "UInt64_in": 5}))
    parts = (
        component("a", "Third.fmu", ports, bindings),
        component("b", "Third.fmu", ports),
        component("c", "Third.fmu", ports),
        connection("a.y -> b.u"),
        connection("a.y[2,2] -> c.u[1,1]"),
    )
    result = run(rooted(tmp_path, *parts, files={"Third__fmu": fmus["Third"]}))
    assert result["b.y[2,2]"][-1] == 4 * 7.0 * 0.5
    assert result["c.y[1,1]"][-1] == 7.0 * 0.5
    assert result["a.UInt64_out"][-1] == 5


def test_mappings_apply_to_arrays(fmus: dict[str, Path], tmp_path: Path) -> None:
    mapping = ssm(entry("p", "gain", linear(2.0)), version="2.0")
    path = written(tmp_path, fmus, third("a", binding(values("p", "1 2 3 4", TWO_BY_TWO), mapping)))
    with read_ssp(path) as document:
        assert dict(document.system.component("a").parameters) == {
            "gain[1,1]": 2.0, "gain[1,2]": 4.0, "gain[2,1]": 6.0, "gain[2,2]": 8.0
        }  # fmt: skip


BYTES = connector("Binary_source", "output", "Binary") + connector("Binary_in", "input", "Binary")


def test_binary_values_pass_through_packages(fmus: dict[str, Path], tmp_path: Path) -> None:
    parts = third("a", "", BYTES), third("b", "", BYTES), connection("a.Binary_source -> b.Binary_in")
    path = written(tmp_path, fmus, *parts)
    with read_ssp(path) as document:
        files = dict.fromkeys("ab", fmus["Third"])
        write_ssp(tmp_path / "x.ssp", "x", "", document.system, files, SystemTimes(0.0, STOP, STEP))
    actual = [
        list(run(source, signals=["b.checksum"])["b.checksum"]) for source in (path, tmp_path / "x.ssp")
    ]
    assert actual[0] == actual[1] and len(set(actual[0])) > 1


A_B = third("a"), third("b")
UNSIZED = system("s", ports="in:input:Float64").replace("<ssc:Float64/>", "<ssc:Float64/><ssc:Dimension/>")


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ((third("a", matrix='<ssc:Dimension size="3"/><ssc:Dimension/>'),),
         "dimension 1 of a.u .* size 3, .* 2 x 2"),
        ((third("a", binding(values("n", "3", "", "UInt64")), matrix=TWO_BY_TWO),),
         "dimension 2 of a.u .* size 2, .* 2 x 3"),
        ((third("a", matrix='<ssc:Dimension size="2"/>'),), "a.u is declared with 1 dimension"),
        ((third("a", matrix='<ssc:Dimension sizeConnector="m"/><ssc:Dimension/>'),),
         "'m', which does not exist"),
        ((third("a", matrix='<ssc:Dimension sizeConnector="n" size="2"/>'),), "both size and sizeConnector"),
        ((third("a", "", connector("end", "parameter", inside=MATRIX)),), "a.end .* is a scalar"),
        ((*A_B, connection("a.y -> b.u", start_indices="1 1")), r"a.y\[1,1\] -> b.u joins 1 .* and 4 "),
        ((*A_B, connection("a.x -> b.u")), "a.x -> b.u joins 1 element and 4 elements, an array with"),
        ((*A_B, connection("a.y -> b.u", start_indices="1", end_indices="1 1")), "'y' has 2 dimensions"),
        ((*A_B, connection("a.y -> b.u", start_indices="3 1", end_indices="1 1")), r"\[1,1\] to \[2,2\]"),
        ((*A_B, connection("a.y -> b.u", start_indices="0 1", end_indices="1 1")), "at least 1"),
        ((*A_B, connection("a.x -> b.u", start_indices="1", end_indices="1 1")), "'x' is not an array"),
        ((*A_B, connection("a.y -> b.u"), connection("a.x -> b.u", end_indices="1 1")), r"b.u\[1,1\] .* two"),
        ((third("a"), UNSIZED, connection("a.y -> s.in")), "array 'in' of unknown size"),
        ((third("a", "", connector("Choice", "input", "Int8")),), "no variable"),
        ((third("a", "", connector("stride", "parameter", "Int8")),),
         "type Int8, but the variable is of type Int64"),
        ((third("a", binding(values("gain", "1 2 3", TWO_BY_TWO))),), "gives 'gain' 3 values; it needs 4"),
        ((third("a", binding(values("gain", "1 2", '<ssc:Dimension size="0"/>'))),), "has the size 0"),
        ((third("a", binding(values("gain", "1 2 3", ""))),), 'add <ssc:Dimension size="3"/>'),
        ((third("a", binding(values("gain", "1 2", '<ssc:Dimension size="2"/>'))),),
         "dimensions 2, but a.gain .* 2 x 2"),
        ((third("a", binding(values("gain", "1", ""))),),
         "one value and no dimensions, but a.gain has .* 2 x 2"),
        ((third("a", binding(values("end", "1 1", '<ssc:Dimension size="2"/>'))),),
         "a.end has no dimensions"),
        ((third("a", binding(values("gain", "1", '<ssc:Dimension sizeConnector="n"/>'))),),
         "must have a size"),
        ((third("a", binding(values("gain", "1", "<ssc:Dimension/>"))),), "must have a size"),
        ((third("a", binding(values("blob", "00", "", "Binary"))),), "a.blob of the type Binary"),
        ((third("a", binding(values("text", "x", "", "String").replace(
            '<ssv:String value="x"/>', '<ssv:String value="x"><ssv:Value value="y"/></ssv:String>'))),),
         "only one of the two is allowed"),
        ((third("a", binding(values("stride", "1", '<ssc:Dimension size="18446744073709551615"/>'))),),
         "it needs"),
    ],
)  # fmt: skip
def test_invalid_arrays(parts: tuple[str, ...], words: str, fmus: dict[str, Path], tmp_path: Path) -> None:
    with pytest.raises(CommandError, match=rf"SystemStructure.ssd' line \d+.*{words}"):
        run(written(tmp_path, fmus, *parts))


def test_several_values_without_dimensions_are_a_vector_with_lenient(
    fmus: dict[str, Path], tmp_path: Path
) -> None:
    vector = component("a", "Pair3.fmu", bindings=binding(values("u", "3 4", "")))
    with accept_faults(lenient=True) as faults, read_ssp(written(tmp_path, fmus, vector)) as document:
        assert document.system.component("a").parameters == {"u[1]": 3.0, "u[2]": 4.0}
    assert any("2 values, but no dimension" in remark for remark in faults.remarks())


def test_files_of_parameters_have_arrays(fmus: dict[str, Path], tmp_path: Path) -> None:
    file = tmp_path / "x.ssv"
    file.write_text(values("a.gain", "1 2 3 9", TWO_BY_TWO))
    result = run(System.of({"a": fmus["Third"], "b": fmus["Pair"]}), parameters=[file])
    assert result["a.y[2,2]"][-1] == 4.5
    file.write_text(values("a.gain", "1 2", '<ssc:Dimension size="2"/>'))
    with pytest.raises(CommandError, match=r"line .*dimensions 2, but a.gain has the dimensions 2 x 2"):
        run(System.of({"a": fmus["Third"], "b": fmus["Pair"]}), parameters=[file])


# ---- written -----------------------------------------------------------------------------------

SYSTEM = [
    "a.y -> b.u",
    "a.y[1,2] -> c.u[2,1]",
    "a.x -> c.u[1,1]",
    "two.y -> three.u",
    "three.y[1] -> d.u[1,1]",
    "three.y[2] -> d.u[2,2]",
    "b.y[2,2] -> two.u[1]",
    *(f"a.{t}_out -> b.{t}_in" for t in TYPES),
]
VALUES = {
    "a.gain[2,1]": 7.5, "a.u[2,2]": -1.25, "a.UInt64_in": 2**63 + 2048, "a.Float32_in": 0.1,
    "a.Int8_in": -128, "c.u[1,2]": 3.0, "a.Boolean_in": True, "two.u[2]": 0.3,
}  # fmt: skip


@pytest.fixture(scope="module")
def exported(fmus: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A package of all types, arrays and both versions, and the results of what it was written of."""
    path = tmp_path_factory.mktemp("exported")
    parts = dict.fromkeys("abcd", fmus["Third"]) | {"two": fmus["Pair"], "three": fmus["Pair3"]}
    scenario = ec.load(System.of(parts, SYSTEM, VALUES), step_size=STEP, stop_time=STOP)
    scenario.export(path / "x.ssp")
    with scenario.prepare() as simulation:
        simulation.run().save(path / "before", plots=False)
    return path / "x.ssp", path / "before" / "results.csv"


def test_results_of_a_package_have_the_same_bytes(exported: tuple[Path, Path], tmp_path: Path) -> None:
    package, before = exported
    scenario = ec.load(package)
    with scenario.prepare() as simulation:
        simulation.run().save(tmp_path / "after", plots=False)
    after = (tmp_path / "after" / "results.csv").read_bytes()
    assert after == before.read_bytes()
    row = polars.read_csv(before).row(-1, named=True)
    assert (row["b.UInt64_out"], row["b.Float32_out"]) == (float(2**63 + 2048), 0.10000000149011612)
    scenario.export(tmp_path / "again.ssp")
    first, second = (
        zipfile.ZipFile(p).read("SystemStructure.ssd") for p in (package, tmp_path / "again.ssp")
    )
    assert first == second


def test_pyssp_standard_reads_the_package(exported: tuple[Path, Path], tmp_path: Path) -> None:
    """Its schemas of SSP 2.0, for the structure with XSD 1.1. Its values lack the types of SSP 2.0."""
    with zipfile.ZipFile(exported[0]) as archive:
        archive.extractall(tmp_path)
    files = list(tmp_path.rglob("*.ssv"))
    assert len(files) == 3
    names: dict[str, list[tuple[str, str]]] = {}
    for file in files:
        with SSV(file) as document:
            assert (document.version, document.identifier) == ("2.0", "ssv2")
            document.__check_compliance__()
            names[file.stem] = [(p["type_name"], p["name"]) for p in document.parameters]
    assert names == {
        "a": [
            ("Float64", "u"), ("Float64", "gain"), ("Float32", "Float32_in"), ("Int8", "Int8_in"),
            ("UInt64", "UInt64_in"), ("Boolean", "Boolean_in"),
        ],
        "c": [("Float64", "u")],
        "two": [("Real", "u[2]")],
    }  # fmt: skip
    with SSD(tmp_path / "SystemStructure.ssd") as document:
        assert document.identifier == "ssd2_11"
        document.__check_compliance__()
        assert document.system is not None
        connectors = {e.name: {c.name for c in e.connectors} for e in document.system.elements}
    assert connectors["three"] == {"u", "y"} and connectors["two"] == {"u[1]", "y[1]", "y[2]"}
    text = (tmp_path / "SystemStructure.ssd").read_text()
    assert text.count('startElement="a" startConnector="y" endElement="b" endConnector="u"') == 1
    assert 'startConnector="y" startIndices="1 2" endElement="c" endConnector="u" endIndices="2 1"' in text


@pytest.mark.parametrize(
    ("connections", "start_values", "version"),
    [
        (["a.x -> b.u[1]"], {"a.end": 1.0, "a.Int32_in": 7, "a.Boolean_in": True}, "1.0"),
        (["a.x -> b.u[1]"], {"a.Int8_in": 7}, "2.0"),
        (["a.x -> b.u[1]", "a.Int64_out -> a.Int64_in"], {}, "2.0"),
        (["a.y[1,1] -> b.u[1]"], {}, "2.0"),
    ],
)
def test_oldest_sufficient_version_is_written(
    connections: list[str], start_values: dict[str, Any], version: str, fmus: dict[str, Path], tmp_path: Path
) -> None:
    system = System.of({"a": fmus["Third"], "b": fmus["Pair"]}, connections, start_values)
    ec.load(system, step_size=STEP, stop_time=STOP).export(tmp_path / "x.ssp")
    with zipfile.ZipFile(tmp_path / "x.ssp") as archive:
        texts = [archive.read(n).decode() for n in archive.namelist() if n.endswith((".ssd", ".ssv"))]
    assert all(f'version="{version}"' in text for text in texts)
