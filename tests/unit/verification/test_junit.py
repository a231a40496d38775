"""The report as JUnit XML, against the structure of Jenkins' schema junit-10."""

import re
from pathlib import Path
from typing import Any

import pytest
from lxml import etree

from emla_cosim.verification.report import Report
from emla_cosim.verification.short_names import shorten_names
from tests.support.reports import STARTED, hostile, ordinary, report

ALLOWED = {
    "testsuites": ({"testsuite"}, {"name", "time", "tests", "failures", "errors"}, set()),
    "testsuite": (
        {"properties", "testcase", "system-out"},
        {"name", "tests", "failures", "errors", "time", "skipped", "timestamp"},
        {"name", "tests", "failures", "errors"},
    ),
    "properties": ({"property"}, set(), set()),
    "property": (set(), {"name", "value"}, {"name", "value"}),
    "testcase": ({"skipped", "failure", "system-out"}, {"name", "time", "classname"}, {"name"}),
    "failure": (set(), {"type", "message"}, set()),
    "skipped": (set(), {"type", "message"}, set()),
    "system-out": (set(), set(), set()),
}
"""By element: its children, its attributes, and those of them that are required."""


def saved(given: Report, folder: Path) -> Any:
    path = folder / "r.xml"
    given.save_junit(path)
    return etree.fromstring(path.read_bytes())


@pytest.mark.parametrize("make", [ordinary, hostile, report])
def test_report_follows_the_schema(make: Any, tmp_path: Path) -> None:
    root = saved(make(), tmp_path)
    assert root.tag == "testsuites"
    for element in root.iter():
        children, attributes, required = ALLOWED[element.tag]
        assert {child.tag for child in element} <= children
        assert required <= set(element.attrib) <= attributes
        if "time" in element.attrib:
            assert re.fullmatch(r"(([0-9]{0,3},)*[0-9]{3}|[0-9]{0,3})*(\.[0-9]*)?", element.get("time"))


def test_suite_per_fmu_and_case_per_check(tmp_path: Path) -> None:
    root = saved(ordinary(), tmp_path)
    assert dict(root.attrib) == {
        "name": "emla verify",
        "tests": "7",
        "failures": "2",
        "errors": "0",
        "time": "3.000",
    }
    one, other = root
    assert {**one.attrib, "time": ""} == {
        "name": "build/Plant.fmu", "tests": "5", "failures": "2", "errors": "0", "skipped": "1", "time": "",
        "timestamp": STARTED,
    }  # fmt: skip
    assert {p.get("name"): p.get("value") for p in one.iter("property")}["model"] == "Plant"
    good, warning, bad, skipped, _ = one.findall("testcase")
    assert dict(good.attrib) == {"classname": "build.Plant", "name": "archive.safe", "time": "0.123"}
    assert len(good) == 0
    assert [child.tag for child in warning] == ["system-out"]
    assert "motor.v has no unit.\n\nLine 7.\nLine 9." in warning[0].text
    assert [child.tag for child in bad] == ["failure"]
    assert bad[0].get("message") == "x is 2 where it was 1."
    assert bad[0].text == (
        "x is 2 where it was 1.\n\nv is 3, was 4.\n\n"
        "FMI 2.0.4, 2.1.5: “The function returns a new instance of an FMU.”\n\n"
        "What was done: Look at it.\n\nDo it right.\n\n"
        "Repeat it: emla verify build/Plant.fmu --only state.restored --explain"
    )
    assert dict(skipped[0].attrib) == {"message": "It needs state.restored, which failed."}
    assert {case.get("classname") for case in other.iter("testcase")} == {"other.Plant"}


def test_control_characters_are_escaped(tmp_path: Path) -> None:
    text = (tmp_path / "r.xml", saved(hostile(), tmp_path))[0].read_text(encoding="utf-8")
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202e]", text)
    assert r"bell\x07 nul\x00 escape\x1b[31m" in text
    assert r"half\udc80" in text


def test_short_names_are_unique() -> None:
    paths = ["a/x/P.fmu", "a/y/P.fmu", "b/y/P.fmu", "Q.fmu"]
    assert shorten_names(paths) == ["x/P.fmu", "a/y/P.fmu", "b/y/P.fmu", "Q.fmu"]
    assert shorten_names(["P.fmu", "P.fmu"]) == ["P.fmu", "P.fmu"]
    assert shorten_names([]) == []
