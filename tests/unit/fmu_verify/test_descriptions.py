"""Model descriptions and sources: errors fail, oddities warn, and what the standard allows passes."""

import math
import sys
from pathlib import Path

import pytest
from lxml import etree

from fmu_verify.catalogue import STATIC
from fmu_verify.check import Verdict
from tests.support.broken.editing import (
    DESCRIPTION,
    Build,
    Edit,
    Files,
    append,
    remove,
    set_attributes,
    setting,
    with_files,
    with_text,
    with_tree,
    without,
)
from tests.support.broken.examining import CALLING, examine, list_problems
from tests.support.broken.static import LIBRARY
from tests.support.tiers import mostly_slow

NAMES = tuple(c.name for c in STATIC if c.name not in {*CALLING, "sources.compile"})
"""Checks of files that are only read."""

FAILED, WARNING = Verdict.FAILED, Verdict.WARNING


def variable(name: str) -> str:
    return f"//ScalarVariable[@name='{name}']"


def scalar(name: str, reference: int, element: str = "<Real/>", **attributes: str) -> str:
    """Return the element of a variable."""
    written = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return f'<ScalarVariable name="{name}" valueReference="{reference}"{written}>{element}</ScalarVariable>'


def with_variable(name: str, reference: int, element: str = "<Real/>", **attributes: str) -> Build:
    """Builds the good FMU with one more variable."""
    return with_tree(append("ModelVariables", scalar(name, reference, element, **attributes)))


def unit(name: str, **base: object) -> Edit:
    """Append a unit."""
    written = "".join(f' {key}="{value}"' for key, value in base.items())
    return append("UnitDefinitions", f'<Unit name="{name}"><BaseUnit{written}/></Unit>')


def with_unit(name: str, **base: object) -> Build:
    """Builds the good FMU with one more unit."""
    return with_tree(unit(name, **base))


# fmt: off
REPORTED: dict[str, tuple[Verdict, str, str, Build]] = {
    "reinit": (FAILED, "variables.attributes", "x has reinit",
        with_tree(remove("//ModelExchange"), set_attributes(f"{variable('x')}/Real", reinit="true"))),
    "multiple sets": (FAILED, "variables.attributes", "force has canHandleMultipleSetPerTimeInstant",
        with_tree(remove("//ModelExchange"),
            set_attributes(variable("force"), canHandleMultipleSetPerTimeInstant="true"))),
    "input with initial": (FAILED, "variables.attributes",
        "force is continuous and an input; its initial cannot be exact",
        setting(variable("force"), initial="exact")),
    "two times": (FAILED, "variables.attributes", "Both t and s are independent",
        with_tree(*(append("ModelVariables", scalar(name, reference, causality="independent"))
            for name, reference in (("t", 97), ("s", 98))))),
    "start of time": (FAILED, "variables.start", "t is independent, but has a start value",
        with_variable("t", 97, '<Real start="0"/>', causality="independent")),
    "constant without value": (FAILED, "variables.start", "c has no start value",
        with_variable("c", 97, variability="constant")),
    "min above max": (FAILED, "variables.range", "count has the min 10, which is above its max 9",
        setting(f"{variable('count')}/Integer", min="10")),
    "nominal": (FAILED, "variables.range", "x has the nominal 0",
        setting(f"{variable('x')}/Real", nominal="0")),
    "range of type": (FAILED, "variables.range", "The start value 0.125 of x_0 is below its min 1",
        setting("//SimpleType[@name='Length']/Real", min="1")),
    "endless range": (WARNING, "variables.range", "", setting(f"{variable('x_0')}/Real", max="INF")),
    "no item": (FAILED, "variables.range", "The start value 2 of shape is not an item of Shape",
        with_tree(set_attributes(f"{variable('shape')}/Enumeration", start="2"),
            set_attributes("//Item[@name='cubic']", value="3"))),
    "item twice": (FAILED, "description.types",
        "More than one item of the enumeration Shape has the value 1",
        setting("//Item[@name='cubic']", value="1")),
    "type of another type": (FAILED, "description.types",
        "count is of type Integer, but declared as Length, which is Real",
        setting(f"{variable('count')}/Integer", declaredType="Length")),
    "name of a variable": (FAILED, "description.types", "The SimpleType force has the name of a variable",
        with_tree(set_attributes("//SimpleType[@name='Force']", name="force"),
            set_attributes("//*[@declaredType='Force']", declaredType="force"))),
    "stops before it starts": (WARNING, "description.experiment", "",
        setting("//DefaultExperiment", stopTime="-1")),
    "never stops": (WARNING, "description.experiment", "", setting("//DefaultExperiment", stopTime="INF")),
    "no step": (WARNING, "description.experiment", "", setting("//DefaultExperiment", stepSize="0")),
    "encoding": (WARNING, "description.encoding", "", with_text(' encoding="UTF-8"', "")),
    "unit twice": (FAILED, "units.defined", "The unit N is defined more than once",
        with_unit("N", kg=1, m=1, s=-2)),
    "display unit without unit": (FAILED, "units.defined", "random has a display unit, but no unit",
        setting(f"{variable('random')}/Real", displayUnit="mm")),
    "derivative in other units": (WARNING, "units.derivatives", "", with_tree(
        unit("mm/s", m=1, s=-1, factor=0.001),
        lambda root: [(e.set("unit", "mm/s"), e.attrib.pop("displayUnit"), e.attrib.pop("declaredType"))
            for e in root.xpath(f"{variable('der(x)')}/Real")])),
    "mm with factor 1": (WARNING, "units.consistent", "mm", with_unit("mm", m=1)),
    "rpm as rad/s": (WARNING, "units.consistent", "rpm", with_unit("rpm", s=-1, rad=1)),
    "no offset": (WARNING, "units.consistent", "degC", with_unit("degC", K=1)),
    "no factor": (FAILED, "units.consistent", "widget", with_unit("widget", m=1, factor=0)),
    "constant alias of a variable": (FAILED, "variables.aliases",
        "x and c have the same value reference, but only some of them are constant",
        with_variable("c", 10, '<Real unit="m" start="1"/>', variability="constant")),
    "unit of alias": (FAILED, "variables.aliases",
        "x and c have the same value reference, but different units",
        with_variable("c", 10, '<Real unit="N"/>')),
    "one state twice": (FAILED, "structure.derivatives",
        "More than one of Derivatives is the derivative of v[1]",
        setting(f"{variable('der(v[2])')}/Real", derivative="12")),
    "its own derivative": (FAILED, "structure.derivatives", "der(x) is its own derivative",
        setting(f"{variable('der(x)')}/Real", derivative="18")),
    "derivative of a Boolean": (FAILED, "structure.derivatives",
        "inverse is the derivative of damped, which is of type Boolean",
        setting(f"{variable('inverse')}/Real", derivative="6")),
    "output twice": (FAILED, "structure.outputs", "Outputs lists x more than once",
        with_tree(append("ModelStructure/Outputs", '<Unknown index="11"/>'))),
    "no output": (FAILED, "structure.outputs", "Outputs lists body.mass, which does not belong there",
        with_tree(append("ModelStructure/Outputs", '<Unknown index="2"/>'))),
    "output beyond": (FAILED, "structure.outputs",
        "Outputs lists variable 4294967295; there are only 20",
        with_tree(append("ModelStructure/Outputs", '<Unknown index="4294967295"/>'))),
    "unknown that is known": (FAILED, "structure.initial_unknowns",
        "InitialUnknowns lists random, which does not belong there",
        with_tree(append("ModelStructure/InitialUnknowns", '<Unknown index="14"/>'))),
    "descending": (FAILED, "structure.dependencies",
        "The dependencies of power in Outputs are not in ascending order",
        setting("//Outputs/Unknown[@index='16']", dependencies="12 1")),
    "kinds alone": (FAILED, "structure.dependencies", "has 1 kinds for 0 dependencies",
        with_tree(lambda root: [(e.attrib.pop("dependencies"), e.set("dependenciesKind", "fixed"))
            for e in root.xpath("//Outputs/Unknown[@index='16']")])),
    "linear Boolean": (FAILED, "structure.dependencies",
        "b in Outputs is of type Boolean, but has a dependency of the kind constant",
        with_tree(append("ModelVariables",
                scalar("b", 97, "<Boolean/>", causality="output", variability="discrete")),
            append("ModelStructure/Outputs",
                '<Unknown index="21" dependencies="1" dependenciesKind="constant"/>'),
            append("ModelStructure/InitialUnknowns", '<Unknown index="21"/>'))),
    "depends on a parameter": (WARNING, "structure.dependencies", "",
        setting("//Outputs/Unknown[@index='16']", dependencies="1 2 12")),
    "folder": (WARNING, "archive.layout", "",
        with_files(lambda files: files.update({"Toy/readme.txt": b"!"}))),
    "another page": (WARNING, "documents.present", "", with_files(
        lambda files: files.update({"documentation/a.pdf": files.pop("documentation/index.html")}))),
}
# fmt: on


@pytest.mark.parametrize("name", REPORTED)
def test_fault_is_reported_by_one_check(name: str, tmp_path: Path) -> None:
    verdict, check, words, build = REPORTED[name]
    report = examine(build(tmp_path), *NAMES)
    assert list(list_problems(report)) == [check]
    assert report[check].verdict == verdict
    assert words in report[check].sentence


# fmt: off
ALLOWED = {
    "tonne as T": with_unit("T", kg=1, factor=1000),
    "no base unit": without("//Unit[@name='W']/BaseUnit"),
    "unknown display unit": setting(f"{variable('x')}/Real", displayUnit="yd"),
    "Hz as turns": with_unit("Hz", s=-1),
    "Hz as 2 pi": with_unit("Hz", s=-1, factor=2 * math.pi),
    "rpm as in the standard": with_unit("rpm", s=-1, rad=1, factor=0.1047197551196598),
    "rpm as turns": with_unit("rpm", s=-1, factor=1 / 60),
    "torque per radian": with_unit("N.m/rad", kg=1, m=2, s=-2),
    "torque with rad": with_unit("N.m", kg=1, m=2, s=-2, rad=-1),
    "bar": with_unit("bar", kg=1, m=-1, s=-2, factor="1.0e5"),
    "absurd exponent": with_unit("N.mm", kg=1, m=2, s=-2, rad=2147483647, factor=1e-3),
    "few digits": with_unit("deg", rad=1, factor="0.0174533"),
    "celsius": with_unit("degC", K=1, offset="273.15"),
    "unit of one's own": with_unit("widget", kg=7, factor=-3),
    "quoted name": setting(variable("step_count"), name="robot[3,4].'motor #234'.n"),
    "flat names": with_tree(lambda root: root.attrib.pop("variableNamingConvention"),
        set_attributes(variable("step_count"), name="steps so far")),
    "time": with_variable("time", 99, '<Real unit="s"/>', causality="independent"),
    "alias": with_variable("again", 10, '<Real unit="m"/>', initial="calculated"),
    "defaults": with_variable("plain", 98),
    "constant": with_variable("c", 98, '<String start=""/>', variability="constant"),
    "comments": with_tree(
        lambda root: [e.insert(0, etree.Comment("!")) for e in [*root.iter(etree.Element)] if len(e)]),
    "no default experiment": without("//DefaultExperiment"),
    "outputs in another order": with_tree(lambda root: [
        outputs.append(outputs[0]) for outputs in root.iter("Outputs")]),
    "kinds": setting("//Outputs/Unknown[@index='16']", dependenciesKind="dependent tunable"),
    "byte order mark":
        with_files(lambda files: files.update({DESCRIPTION: b"\xef\xbb\xbf" + files[DESCRIPTION]})),
    "no documentation": with_files(
        lambda files: [files.pop(name) for name in [*files] if name.startswith("documentation/")]),
}
# fmt: on


@pytest.mark.parametrize("name", ALLOWED)
def test_allowed_declarations_pass(name: str, tmp_path: Path) -> None:
    assert list_problems(examine(ALLOWED[name](tmp_path), *NAMES)) == {}


def with_header(line: str) -> Build:
    """Builds the good FMU with one more line in a header."""
    header = "sources/equations.h"
    return with_files(lambda files: files.update({header: files[header] + f"\n{line}\n".encode()}))


# fmt: off
SOURCES = {
    "headers in another folder": (WARNING, "which SourceFiles cannot list: lib.", with_files(
        lambda files: files.update({"sources/lib/equations.h": files.pop("sources/equations.h")}))),
    "syntax": (WARNING, "does not compile", with_header("int nonsense(")),
    "header of a system": (WARNING, "nowhere.h", with_header("#include <nowhere.h>")),
    "header of its own": (FAILED, "nowhere.h", with_header('#include "nowhere.h"')),
    "linking": (WARNING, "gone", with_header("void gone(void); void (*f)(void) = gone;")),
    "not listed": (WARNING, "SourceFiles", with_tree(remove("//SourceFiles"))),
}
# fmt: on


@pytest.mark.parametrize("name", mostly_slow(SOURCES, ["syntax", "header of its own", "not listed"]))
def test_sources(name: str, tmp_path: Path) -> None:
    verdict, words, build = SOURCES[name]
    finding = examine(build(tmp_path), "sources.compile")["sources.compile"]
    assert finding.verdict == verdict, finding.sentence
    assert words in finding.sentence


@pytest.mark.parametrize("documented", [False, True])
def test_library_that_needs_another(documented: bool, tmp_path: Path) -> None:
    """It fails, unless the FMU says what it needs: then nothing can be checked here."""

    def edit(files: Files) -> None:
        content = files[LIBRARY]
        assert b"libm.so.6\0" in content
        files[LIBRARY] = content.replace(b"libm.so.6\0", b"libq.so.6\0")
        if documented:
            files["documentation/externalDependencies.txt"] = b"libq"

    report = examine(with_files(edit)(tmp_path), "binaries")
    assert report["binaries.loads"].verdict == (Verdict.SKIPPED if documented else Verdict.FAILED)
    assert report["binaries.imports"].verdict == (Verdict.PASSED if documented else Verdict.WARNING)
    assert all("libq.so.6" in report[f"binaries.{name}"].sentence for name in ("loads", "imports"))


@pytest.mark.skipif(sys.platform != "linux", reason="a path in ELF files")
@pytest.mark.parametrize(
    ("paths", "verdict"),
    [("/home/builder/lib", Verdict.WARNING), ("$ORIGIN:/usr/lib/x86_64-linux-gnu", Verdict.PASSED)],
)
def test_path_of_the_exporters_machine(paths: str, verdict: Verdict, tmp_path: Path) -> None:
    import lief

    def edit(files: Files) -> None:
        library = lief.ELF.parse(files[LIBRARY])
        assert library is not None
        library.add(lief.ELF.DynamicEntryRunPath(paths))
        files[LIBRARY] = library.write_to_bytes()

    finding = examine(with_files(edit)(tmp_path), "binaries")["binaries.imports"]
    assert finding.verdict == verdict, finding.sentence
    assert verdict == Verdict.PASSED or "/home/builder/lib (RUNPATH)" in finding.sentence
