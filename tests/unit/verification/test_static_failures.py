"""More ways to be wrong: each is failed by the check meant for it, in words that name the place."""

from collections.abc import Callable
from pathlib import Path

import pytest
from lxml import etree

from emla_cosim.verification.catalogue import STATIC
from emla_cosim.verification.verdict import Verdict
from tests.support.broken.editing import setting, with_tree
from tests.support.broken.examining import examined_here

NAMES = tuple(c.name for c in STATIC if c.name != "sources.compile")
Edit = Callable[[etree._Element], object]


def variable(name: str) -> str:
    return f"//ScalarVariable[@name='{name}']"


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


WRONG: dict[str, tuple[str, str, Callable[[Path], Path]]] = {
    "reinit": (
        "variables.attributes",
        "x has reinit",
        both(remover("//ModelExchange"), setter(f"{variable('x')}/Real", reinit="true")),
    ),
    "multiple sets": (
        "variables.attributes",
        "force has canHandleMultipleSetPerTimeInstant",
        both(
            remover("//ModelExchange"), setter(variable("force"), canHandleMultipleSetPerTimeInstant="true")
        ),
    ),
    "input with initial": (
        "variables.attributes",
        "force is continuous and an input; its initial cannot be exact",
        setting(variable("force"), initial="exact"),
    ),
    "two times": (
        "variables.attributes",
        "Both t and s are independent",
        appended(
            "ModelVariables",
            '<ScalarVariable name="t" valueReference="97" causality="independent"><Real/></ScalarVariable>',
            "ModelVariables",
            '<ScalarVariable name="s" valueReference="98" causality="independent"><Real/></ScalarVariable>',
        ),
    ),
    "start of time": (
        "variables.start",
        "t is independent, but has a start value",
        appended(
            "ModelVariables",
            '<ScalarVariable name="t" valueReference="97" causality="independent"><Real start="0"/>'
            "</ScalarVariable>",
        ),
    ),
    "constant without value": (
        "variables.start",
        "c has no start value",
        appended(
            "ModelVariables",
            '<ScalarVariable name="c" valueReference="97" variability="constant"><Real/></ScalarVariable>',
        ),
    ),
    "min above max": (
        "variables.range",
        "count has the min 10, which is above its max 9",
        setting(f"{variable('count')}/Integer", min="10"),
    ),
    "nominal": (
        "variables.range",
        "x has the nominal 0",
        setting(f"{variable('x')}/Real", nominal="0"),
    ),
    "range of type": (
        "variables.range",
        "The start value 0.125 of x_0 is below its min 1",
        setting("//SimpleType[@name='Length']/Real", min="1"),
    ),
    "no item": (
        "variables.range",
        "The start value 2 of shape is not an item of Shape",
        both(
            setter(f"{variable('shape')}/Enumeration", start="2"),
            setter("//Item[@name='cubic']", value="3"),
        ),
    ),
    "item twice": (
        "description.types",
        "More than one item of the enumeration Shape has the value 1",
        setting("//Item[@name='cubic']", value="1"),
    ),
    "type of another type": (
        "description.types",
        "count is of type Integer, but declared as Length, which is Real",
        setting(f"{variable('count')}/Integer", declaredType="Length"),
    ),
    "name of a variable": (
        "description.types",
        "The SimpleType force has the name of a variable",
        both(
            setter("//SimpleType[@name='Force']", name="force"),
            setter("//*[@declaredType='Force']", declaredType="force"),
        ),
    ),
    "unit twice": (
        "units.defined",
        "The unit N is defined more than once",
        appended("UnitDefinitions", '<Unit name="N"><BaseUnit kg="1" m="1" s="-2"/></Unit>'),
    ),
    "display unit without unit": (
        "units.defined",
        "random has a display unit, but no unit",
        setting(f"{variable('random')}/Real", displayUnit="mm"),
    ),
    "constant alias of a variable": (
        "variables.aliases",
        "x and c have the same value reference, but only some of them are constant",
        appended(
            "ModelVariables",
            '<ScalarVariable name="c" valueReference="10" variability="constant"><Real unit="m" start="1"/>'
            "</ScalarVariable>",
        ),
    ),
    "unit of alias": (
        "variables.aliases",
        "x and c have the same value reference, but different units",
        appended(
            "ModelVariables", '<ScalarVariable name="c" valueReference="10"><Real unit="N"/></ScalarVariable>'
        ),
    ),
    "one state twice": (
        "structure.derivatives",
        "More than one of Derivatives is the derivative of v[1]",
        setting(f"{variable('der(v[2])')}/Real", derivative="12"),
    ),
    "its own derivative": (
        "structure.derivatives",
        "der(x) is its own derivative",
        setting(f"{variable('der(x)')}/Real", derivative="18"),
    ),
    "derivative of a Boolean": (
        "structure.derivatives",
        "inverse is the derivative of damped, which is of type Boolean",
        setting(f"{variable('inverse')}/Real", derivative="6"),
    ),
    "output twice": (
        "structure.outputs",
        "Outputs lists x more than once",
        appended("ModelStructure/Outputs", '<Unknown index="11"/>'),
    ),
    "no output": (
        "structure.outputs",
        "Outputs lists body.mass, which does not belong there",
        appended("ModelStructure/Outputs", '<Unknown index="2"/>'),
    ),
    "output beyond": (
        "structure.outputs",
        "Outputs lists variable 4294967295; there are only 20",
        appended("ModelStructure/Outputs", '<Unknown index="4294967295"/>'),
    ),
    "unknown that is known": (
        "structure.initial_unknowns",
        "InitialUnknowns lists random, which does not belong there",
        appended("ModelStructure/InitialUnknowns", '<Unknown index="14"/>'),
    ),
    "descending": (
        "structure.dependencies",
        "The dependencies of power in Outputs are not in ascending order",
        setting("//Outputs/Unknown[@index='16']", dependencies="12 1"),
    ),
    "kinds alone": (
        "structure.dependencies",
        "has 1 kinds for 0 dependencies",
        with_tree(
            lambda root: [
                (e.attrib.pop("dependencies"), e.set("dependenciesKind", "fixed"))
                for e in root.xpath("//Outputs/Unknown[@index='16']")
            ]
        ),
    ),
    "linear Boolean": (
        "structure.dependencies",
        "b in Outputs is of type Boolean, but has a dependency of the kind constant",
        appended(
            "ModelVariables",
            '<ScalarVariable name="b" valueReference="97" causality="output" variability="discrete">'
            "<Boolean/></ScalarVariable>",
            "ModelStructure/Outputs",
            '<Unknown index="21" dependencies="1" dependenciesKind="constant"/>',
            "ModelStructure/InitialUnknowns",
            '<Unknown index="21"/>',
        ),
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_fmu_fails_in_words_that_name_the_place(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    check, words, build = WRONG[name]
    report = examined_here(build(tmp_path), NAMES, monkeypatch)
    failures = {f.check: f.sentence for f in report.of(Verdict.FAILED)}
    assert list(failures) == [check], failures
    assert words in failures[check]
    assert report.of(Verdict.WARNING) == []
