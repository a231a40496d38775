"""What is odd is told as a warning, and what the standard allows passes."""

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
from tests.support.broken.examining import examined_here
from tests.support.broken.static import LIBRARY

NAMES = tuple(c.name for c in STATIC if c.name != "sources.compile")
Build = Callable[[Path], Path]


def with_unit(name: str, **base: object) -> Build:
    """The good FMU with one more unit."""

    def edit(root: etree._Element) -> None:
        unit = etree.SubElement(root.find("UnitDefinitions"), "Unit", name=name)
        etree.SubElement(unit, "BaseUnit", {key: str(value) for key, value in base.items()})

    return with_tree(edit)


def with_variable(element: str) -> Build:
    """The good FMU with one more variable."""
    return with_tree(lambda root: root.find("ModelVariables").append(etree.fromstring(element)))


ODD = {
    "stops before it starts": ("description.experiment", setting("//DefaultExperiment", stopTime="-1")),
    "never stops": ("description.experiment", setting("//DefaultExperiment", stopTime="INF")),
    "derivative in other units": (
        "units.derivatives",
        with_tree(
            lambda root: [
                root.find("UnitDefinitions").append(
                    etree.fromstring('<Unit name="mm/s"><BaseUnit m="1" s="-1" factor="0.001"/></Unit>')
                ),
                [
                    (e.set("unit", "mm/s"), e.attrib.pop("displayUnit"), e.attrib.pop("declaredType"))
                    for e in root.xpath("//ScalarVariable[@name='der(x)']/Real")
                ],
            ]
        ),
    ),
    "endless range": ("variables.range", setting("//ScalarVariable[@name='x_0']/Real", max="INF")),
    "no step": ("description.experiment", setting("//DefaultExperiment", stepSize="0")),
    "offset": ("units.consistent", with_unit("degC", K=1)),
    "folder": ("archive.layout", with_files(lambda files: files.update({"Toy/readme.txt": b"!"}))),
    "another page": (
        "documents.present",
        with_files(
            lambda files: files.update({"documentation/a.pdf": files.pop("documentation/index.html")})
        ),
    ),
    "depends on a parameter": (
        "structure.dependencies",
        setting("//Outputs/Unknown[@index='16']", dependencies="1 2 12"),
    ),
    "encoding": ("description.encoding", with_text(' encoding="UTF-8"', "")),
}


@pytest.mark.parametrize("name", ODD)
def test_odd_fmu_is_warned_of_once(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    check, build = ODD[name]
    report = examined_here(build(tmp_path), NAMES, monkeypatch)
    assert {f.check: f.sentence for f in report.of(Verdict.FAILED)} == {}
    assert [f.check for f in report.of(Verdict.WARNING)] == [check]


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
    "flat names": with_tree(
        lambda root: (
            root.attrib.pop("variableNamingConvention"),
            root.xpath("//ScalarVariable[@name='step_count']")[0].set("name", "steps so far"),
        )
    ),
    "time": with_variable(
        '<ScalarVariable name="time" valueReference="99" causality="independent" variability="continuous">'
        '<Real unit="s"/></ScalarVariable>'
    ),
    "alias": with_variable(
        '<ScalarVariable name="again" valueReference="10" variability="continuous" initial="calculated">'
        '<Real unit="m"/></ScalarVariable>'
    ),
    "defaults": with_variable('<ScalarVariable name="plain" valueReference="98"><Real/></ScalarVariable>'),
    "constant": with_variable(
        '<ScalarVariable name="c" valueReference="98" variability="constant"><String start=""/>'
        "</ScalarVariable>"
    ),
    "comments": with_tree(
        lambda root: [e.insert(0, etree.Comment("!")) for e in list(root.iter(etree.Element)) if len(e)]
    ),
    "no default experiment": without("//DefaultExperiment"),
    "outputs in another order": with_tree(
        lambda root: root.find("ModelStructure/Outputs").append(root.find("ModelStructure/Outputs")[0])
    ),
    "kinds": setting("//Outputs/Unknown[@index='16']", dependenciesKind="dependent tunable"),
    "byte order mark": with_files(
        lambda files: files.update({DESCRIPTION: b"\xef\xbb\xbf" + files[DESCRIPTION]})
    ),
    "no documentation": with_files(
        lambda files: [files.pop(name) for name in list(files) if name.startswith("documentation/")]
    ),
}


@pytest.mark.parametrize("name", ALLOWED)
def test_what_the_standard_allows_passes(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    report = examined_here(ALLOWED[name](tmp_path), NAMES, monkeypatch)
    wrong = [*report.of(Verdict.FAILED), *report.of(Verdict.WARNING)]
    assert {f.check: f.sentence for f in wrong} == {}


ODD_UNITS = {
    "mm with factor 1": with_unit("mm", m=1),
    "torque as force": with_unit("N.m", kg=1, m=1, s=-2),
    "kN without factor": with_unit("kN", kg=1, m=1, s=-2),
    "rpm as rad/s": with_unit("rpm", s=-1, rad=1),
}

WRONG_UNITS = {
    "no factor": with_unit("widget", m=1, factor=0),
    "infinite": with_unit("widget", m=1, factor="INF"),
}


@pytest.mark.parametrize("name", ODD_UNITS)
def test_units_that_their_names_contradict_only_warn(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report = examined_here(ODD_UNITS[name](tmp_path), NAMES, monkeypatch)
    assert not report.of(Verdict.FAILED)
    (found,) = report.of(Verdict.WARNING)
    assert (found.check, found.clause.section) == ("units.consistent", "2.2.2")


@pytest.mark.parametrize("name", WRONG_UNITS)
def test_wrong_units_fail(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    report = examined_here(WRONG_UNITS[name](tmp_path), NAMES, monkeypatch)
    assert [f.check for f in report.of(Verdict.FAILED)] == ["units.consistent"]


def with_header(*lines: str) -> Build:
    """The good FMU with more lines in one of its headers."""

    def edit(files: Files) -> None:
        files["sources/equations.h"] += "\n".join(("", *lines, "")).encode()

    return with_files(edit)


SOURCES = {
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


@pytest.mark.parametrize("name", SOURCES)
def test_sources(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    build, verdict, words = SOURCES[name]
    finding = examined_here(build(tmp_path), ("sources.compile",), monkeypatch)["sources.compile"]
    assert finding.verdict == verdict, finding.sentence
    assert words in finding.sentence


@pytest.mark.parametrize("documented", [False, True])
def test_library_that_needs_another(
    documented: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It fails, unless the FMU tells what it needs: then nothing can be said here."""

    def edit(files: Files) -> None:
        content = files[LIBRARY]
        assert b"libm.so.6\0" in content
        files[LIBRARY] = content.replace(b"libm.so.6\0", b"libq.so.6\0")
        if documented:
            files["documentation/externalDependencies.txt"] = b"libq"

    report = examined_here(with_files(edit)(tmp_path), ("binaries",), monkeypatch)
    assert report["binaries.loads"].verdict == (Verdict.SKIPPED if documented else Verdict.FAILED)
    assert "libq.so.6" in report["binaries.loads"].sentence
    assert report["binaries.imports"].verdict == (Verdict.PASSED if documented else Verdict.WARNING)
    assert "libq.so.6" in report["binaries.imports"].sentence


def test_headers_in_another_folder_are_warned_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The sources compile with an include path, for which FMI 2.0 has no place."""
    build = with_files(
        lambda files: files.update({"sources/lib/equations.h": files.pop("sources/equations.h")})
    )
    found = examined_here(build(tmp_path), ("sources.compile",), monkeypatch)["sources.compile"]
    assert found.verdict == Verdict.WARNING
    assert found.sentence.endswith("which SourceFiles cannot list: lib.")
