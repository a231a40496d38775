"""Model descriptions and sources: errors fail, oddities warn, and what the standard allows passes."""

import math
from collections.abc import Callable
from pathlib import Path

import pytest
from lxml import etree

from emla_cosim.verification.catalogue import STATIC
from emla_cosim.verification.verdict import Verdict
from tests.support.broken.editing import (
    DESCRIPTION,
    Files,
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

Edit = Callable[[etree._Element], object]
Build = Callable[[Path], Path]


def variable(name: str) -> str:
    return f"//ScalarVariable[@name='{name}']"


def scalar(name: str, reference: int, element: str = "<Real/>", **attributes: str) -> str:
    """Return the element of a variable."""
    given = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return f'<ScalarVariable name="{name}" valueReference="{reference}"{given}>{element}</ScalarVariable>'


def with_variable(element: str) -> Build:
    """The good FMU with one more variable."""
    return with_tree(lambda root: root.find("ModelVariables").append(etree.fromstring(element)))


def appended(parent: str, element: str, *more: str) -> Callable[[Path], Path]:
    """The good FMU with one more element, and the elements of `more` at the places before them."""

    def edit(root: etree._Element) -> None:
        root.find(parent).append(etree.fromstring(element))
        for place, other in zip(more[::2], more[1::2], strict=True):
            root.find(place).append(etree.fromstring(other))

    return with_tree(edit)


def both(*edits: Edit) -> Callable[[Path], Path]:
    return with_tree(lambda root: [edit(root) for edit in edits])


def setter(path: str, **attributes: str) -> Edit:
    return lambda root: [e.set(k, v) for e in root.xpath(path) for k, v in attributes.items()]


def remover(path: str) -> Edit:
    return lambda root: [e.getparent().remove(e) for e in root.xpath(path)]


# fmt: off
WRONG: dict[str, tuple[str, str, Callable[[Path], Path]]] = {
    "reinit": ("variables.attributes", "x has reinit",
        both(remover("//ModelExchange"), setter(f"{variable('x')}/Real", reinit="true"))),
    "multiple sets": ("variables.attributes", "force has canHandleMultipleSetPerTimeInstant",
        both(remover("//ModelExchange"),
            setter(variable("force"), canHandleMultipleSetPerTimeInstant="true"))),
    "input with initial": ("variables.attributes",
        "force is continuous and an input; its initial cannot be exact",
        setting(variable("force"), initial="exact")),
    "two times": ("variables.attributes", "Both t and s are independent",
        appended("ModelVariables", scalar("t", 97, causality="independent"),
            "ModelVariables", scalar("s", 98, causality="independent"))),
    "start of time": ("variables.start", "t is independent, but has a start value",
        with_variable(scalar("t", 97, '<Real start="0"/>', causality="independent"))),
    "constant without value": ("variables.start", "c has no start value",
        with_variable(scalar("c", 97, variability="constant"))),
    "min above max": ("variables.range", "count has the min 10, which is above its max 9",
        setting(f"{variable('count')}/Integer", min="10")),
    "nominal": ("variables.range", "x has the nominal 0", setting(f"{variable('x')}/Real", nominal="0")),
    "range of type": ("variables.range", "The start value 0.125 of x_0 is below its min 1",
        setting("//SimpleType[@name='Length']/Real", min="1")),
    "no item": ("variables.range", "The start value 2 of shape is not an item of Shape",
        both(setter(f"{variable('shape')}/Enumeration", start="2"),
            setter("//Item[@name='cubic']", value="3"))),
    "item twice": ("description.types", "More than one item of the enumeration Shape has the value 1",
        setting("//Item[@name='cubic']", value="1")),
    "type of another type": ("description.types",
        "count is of type Integer, but declared as Length, which is Real",
        setting(f"{variable('count')}/Integer", declaredType="Length")),
    "name of a variable": ("description.types", "The SimpleType force has the name of a variable",
        both(setter("//SimpleType[@name='Force']", name="force"),
            setter("//*[@declaredType='Force']", declaredType="force"))),
    "unit twice": ("units.defined", "The unit N is defined more than once",
        appended("UnitDefinitions", '<Unit name="N"><BaseUnit kg="1" m="1" s="-2"/></Unit>')),
    "display unit without unit": ("units.defined", "random has a display unit, but no unit",
        setting(f"{variable('random')}/Real", displayUnit="mm")),
    "constant alias of a variable": ("variables.aliases",
        "x and c have the same value reference, but only some of them are constant",
        with_variable(scalar("c", 10, '<Real unit="m" start="1"/>', variability="constant"))),
    "unit of alias": ("variables.aliases", "x and c have the same value reference, but different units",
        with_variable(scalar("c", 10, '<Real unit="N"/>'))),
    "one state twice": ("structure.derivatives", "More than one of Derivatives is the derivative of v[1]",
        setting(f"{variable('der(v[2])')}/Real", derivative="12")),
    "its own derivative": ("structure.derivatives", "der(x) is its own derivative",
        setting(f"{variable('der(x)')}/Real", derivative="18")),
    "derivative of a Boolean": ("structure.derivatives",
        "inverse is the derivative of damped, which is of type Boolean",
        setting(f"{variable('inverse')}/Real", derivative="6")),
    "output twice": ("structure.outputs", "Outputs lists x more than once",
        appended("ModelStructure/Outputs", '<Unknown index="11"/>')),
    "no output": ("structure.outputs", "Outputs lists body.mass, which does not belong there",
        appended("ModelStructure/Outputs", '<Unknown index="2"/>')),
    "output beyond": ("structure.outputs", "Outputs lists variable 4294967295; there are only 20",
        appended("ModelStructure/Outputs", '<Unknown index="4294967295"/>')),
    "unknown that is known": ("structure.initial_unknowns",
        "InitialUnknowns lists random, which does not belong there",
        appended("ModelStructure/InitialUnknowns", '<Unknown index="14"/>')),
    "descending": ("structure.dependencies",
        "The dependencies of power in Outputs are not in ascending order",
        setting("//Outputs/Unknown[@index='16']", dependencies="12 1")),
    "kinds alone": ("structure.dependencies", "has 1 kinds for 0 dependencies",
        with_tree(lambda root: [(e.attrib.pop("dependencies"), e.set("dependenciesKind", "fixed"))
            for e in root.xpath("//Outputs/Unknown[@index='16']")])),
    "linear Boolean": ("structure.dependencies",
        "b in Outputs is of type Boolean, but has a dependency of the kind constant",
        appended("ModelVariables",
            scalar("b", 97, "<Boolean/>", causality="output", variability="discrete"),
            "ModelStructure/Outputs", '<Unknown index="21" dependencies="1" dependenciesKind="constant"/>',
            "ModelStructure/InitialUnknowns", '<Unknown index="21"/>')),
}
# fmt: on


@pytest.mark.parametrize("name", WRONG)
def test_wrong_description_fails_with_the_name_of_the_place(name: str, tmp_path: Path) -> None:
    check, words, build = WRONG[name]
    report = examine(build(tmp_path), *NAMES)
    assert list(list_problems(report)) == [check]
    assert report[check].verdict == Verdict.FAILED
    assert words in report[check].sentence


def with_unit(name: str, **base: object) -> Build:
    """The good FMU with one more unit."""

    def edit(root: etree._Element) -> None:
        unit = etree.SubElement(root.find("UnitDefinitions"), "Unit", name=name)
        etree.SubElement(unit, "BaseUnit", {key: str(value) for key, value in base.items()})

    return with_tree(edit)


# fmt: off
ODD = {
    "stops before it starts": ("description.experiment", setting("//DefaultExperiment", stopTime="-1")),
    "never stops": ("description.experiment", setting("//DefaultExperiment", stopTime="INF")),
    "derivative in other units": ("units.derivatives", both(
        lambda root: root.find("UnitDefinitions").append(
            etree.fromstring('<Unit name="mm/s"><BaseUnit m="1" s="-1" factor="0.001"/></Unit>')),
        lambda root: [(e.set("unit", "mm/s"), e.attrib.pop("displayUnit"), e.attrib.pop("declaredType"))
            for e in root.xpath("//ScalarVariable[@name='der(x)']/Real")])),
    "endless range": ("variables.range", setting("//ScalarVariable[@name='x_0']/Real", max="INF")),
    "no step": ("description.experiment", setting("//DefaultExperiment", stepSize="0")),
    "offset": ("units.consistent", with_unit("degC", K=1)),
    "folder": ("archive.layout", with_files(lambda files: files.update({"Toy/readme.txt": b"!"}))),
    "another page": ("documents.present", with_files(
        lambda files: files.update({"documentation/a.pdf": files.pop("documentation/index.html")}))),
    "depends on a parameter": ("structure.dependencies",
        setting("//Outputs/Unknown[@index='16']", dependencies="1 2 12")),
    "encoding": ("description.encoding", with_text(' encoding="UTF-8"', "")),
}
# fmt: on


@pytest.mark.parametrize("name", ODD)
def test_odd_description_gets_one_warning(name: str, tmp_path: Path) -> None:
    check, build = ODD[name]
    report = examine(build(tmp_path), *NAMES)
    assert list(list_problems(report)) == [check]
    assert report[check].verdict == Verdict.WARNING


# fmt: off
ALLOWED = {
    "tonne as T": with_unit("T", kg=1, factor=1000),
    "no base unit": without("//Unit[@name='W']/BaseUnit"),
    "unknown display unit": setting("//ScalarVariable[@name='x']/Real", displayUnit="yd"),
    "Hz as turns": with_unit("Hz", s=-1),
    "Hz as rad": with_unit("Hz", s=-1, rad=1, factor=2 * math.pi),
    "Hz as 2 pi": with_unit("Hz", s=-1, factor=2 * math.pi),
    "rpm as in the standard": with_unit("rpm", s=-1, rad=1, factor=0.1047197551196598),
    "rpm as turns": with_unit("rpm", s=-1, factor=1 / 60),
    "1/min as rad": with_unit("1/min", s=-1, rad=1, factor=0.10471975511965977),
    "torque per radian": with_unit("N.m/rad", kg=1, m=2, s=-2),
    "torque with rad": with_unit("N.m", kg=1, m=2, s=-2, rad=-1),
    "bar": with_unit("bar", kg=1, m=-1, s=-2, factor="1.0e5"),
    "absurd exponent": with_unit("N.mm", kg=1, m=2, s=-2, rad=2147483647, factor=1e-3),
    "few digits": with_unit("deg", rad=1, factor="0.0174533"),
    "celsius": with_unit("degC", K=1, offset="273.15"),
    "unit of one's own": with_unit("widget", kg=7, factor=-3),
    "quoted name": setting("//ScalarVariable[@name='step_count']", name="robot[3,4].'motor #234'.n"),
    "flat names": both(lambda root: root.attrib.pop("variableNamingConvention"),
        setter(variable("step_count"), name="steps so far")),
    "time": with_variable(scalar("time", 99, '<Real unit="s"/>', causality="independent")),
    "alias": with_variable(scalar("again", 10, '<Real unit="m"/>', initial="calculated")),
    "defaults": with_variable(scalar("plain", 98)),
    "constant": with_variable(scalar("c", 98, '<String start=""/>', variability="constant")),
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
def test_what_the_standard_allows_passes(name: str, tmp_path: Path) -> None:
    assert list_problems(examine(ALLOWED[name](tmp_path), *NAMES)) == {}


UNITS = {
    "mm with factor 1": (with_unit("mm", m=1), Verdict.WARNING),
    "torque as force": (with_unit("N.m", kg=1, m=1, s=-2), Verdict.WARNING),
    "kN without factor": (with_unit("kN", kg=1, m=1, s=-2), Verdict.WARNING),
    "rpm as rad/s": (with_unit("rpm", s=-1, rad=1), Verdict.WARNING),
    "no factor": (with_unit("widget", m=1, factor=0), Verdict.FAILED),
    "infinite": (with_unit("widget", m=1, factor="INF"), Verdict.FAILED),
}


@pytest.mark.parametrize("name", UNITS)
def test_units_with_other_factors_or_exponents(name: str, tmp_path: Path) -> None:
    build, verdict = UNITS[name]
    report = examine(build(tmp_path), *NAMES)
    assert list(list_problems(report)) == ["units.consistent"]
    finding = report["units.consistent"]
    assert finding.verdict == verdict
    assert verdict == Verdict.FAILED or finding.clause.section == "2.2.2"


def with_header(*lines: str) -> Build:
    """The good FMU with more lines in one of its headers."""

    def edit(files: Files) -> None:
        files["sources/equations.h"] += "\n".join(("", *lines, "")).encode()

    return with_files(edit)


SOURCES = {
    "headers in another folder": (
        with_files(lambda files: files.update({"sources/lib/equations.h": files.pop("sources/equations.h")})),
        Verdict.WARNING,
        "which SourceFiles cannot list: lib.",
    ),
    "syntax": (with_header("int nonsense("), Verdict.WARNING, "does not compile"),
    "header of a system": (with_header("#include <nowhere.h>"), Verdict.WARNING, "nowhere.h"),
    "header of its own": (with_header('#include "nowhere.h"'), Verdict.FAILED, "nowhere.h"),
    "linking": (with_header("void gone(void); void (*f)(void) = gone;"), Verdict.WARNING, "gone"),
    "not listed": (
        with_tree(lambda root: [e.getparent().remove(e) for e in root.xpath("//SourceFiles")]),
        Verdict.WARNING,
        "SourceFiles",
    ),
    "more": (with_header("static int unused;"), Verdict.PASSED, "fmi2_block.c"),
}


@pytest.mark.parametrize("name", mostly_slow(SOURCES, ["syntax", "header of its own", "not listed"]))
def test_sources(name: str, tmp_path: Path) -> None:
    build, verdict, words = SOURCES[name]
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
