"""The report as JSON and as JUnit XML, against the structure of Jenkins' schema junit-10."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import etree

from emla_cosim.base.errors import CommandError
from fmu_verify.check import passed
from fmu_verify.findings import shorten_names
from fmu_verify.report import Report
from tests.support.reports import CLAUSE, STARTED, examined, finding, hostile, ordinary, report

SAVE: dict[str, Callable[..., None]] = {
    "JSON": Report.save_json,
    "JUnit": Report.save_junit,
    "HTML": Report.save_html,
    "SARIF": Report.save_sarif,
    "badge": Report.save_badge,
}
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
"""Elements of JUnit XML: their children, their attributes, and those that are required."""


def as_json(report_: Report, folder: Path) -> Any:
    report_.save_json(folder / "r.json")

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is not JSON")

    return json.loads((folder / "r.json").read_bytes().decode("ascii"), parse_constant=refuse)


def as_junit(report_: Report, folder: Path) -> Any:
    report_.save_junit(folder / "r.xml")
    return etree.fromstring((folder / "r.xml").read_bytes())


def test_report_replaces_reports_of_its_kind_only(tmp_path: Path) -> None:
    report_ = ordinary()
    for kind, save in SAVE.items():
        save(report_, tmp_path / kind)
    for kind, save in SAVE.items():
        save(report_, tmp_path / kind)
        for other_kind in SAVE.keys() - {kind}:
            with pytest.raises(CommandError, match="was not written by emla"):
                save(report_, tmp_path / other_kind)


# ---- JSON ------------------------------------------------------------------------------------------


def test_keys_of_the_json_report(tmp_path: Path) -> None:
    report_ = ordinary()
    content = as_json(report_, tmp_path)
    assert content == report_.as_dict()
    assert (content["format"], content["version"], content["started"]) == ("emla-verify", 1, STARTED)
    assert (content["passed"], content["complete"]) == (False, True)
    assert content["counts"] == {"passed": 3, "warning": 1, "failed": 2, "skipped": 1}
    first, second = content["examined"]
    assert (first["path"], first["verdict"], first["passed"], first["seconds"]) == (
        "build/Plant.fmu", "failed", False, 1.5,
    )  # fmt: skip
    assert (second["verdict"], second["passed"]) == ("passed", True)
    assert first["facts"]["model"] == "Plant"
    units = first["findings"][1]
    assert {**units, "title": ""} == {
        "check": "description.units", "title": "", "verdict": "warning", "sentence": "motor.v has no unit.",
        "details": ["Line 7.", "Line 9."], "hint": "Do it right.", "seconds": 0.1234, "done": "Look at it.",
        "repeat": "emla verify build/Plant.fmu --only description.units --explain",
        "figures": {}, "comparisons": [],
        "clause": {"document": "FMI 2.0.4", "section": CLAUSE.section, "sentence": CLAUSE.sentence},
    }  # fmt: skip


def test_signals_have_numbers_instead_of_arrays(tmp_path: Path) -> None:
    inside, outside, _ = as_json(ordinary(), tmp_path)["examined"][0]["findings"][-1]["comparisons"]
    assert set(inside) == {"signal", "unit", "inside", "worst", "worst_at", "left_at", "tube"}
    assert (inside["signal"], inside["unit"], inside["inside"], inside["left_at"]) == ("x", "m", True, None)
    assert inside["tube"] == {"value": 0.01, "time": 0.005}
    assert 0.004 < inside["worst"] < 0.006
    assert not outside["inside"] and 2 < outside["left_at"] < 3 < outside["worst_at"]


def test_values_that_json_lacks(tmp_path: Path) -> None:
    figures = {"nan": np.float64("nan"), "inf": -np.inf, "int": np.int64(3), "array": np.arange(2.0),
               "nested": ({"a": np.float32(0.5)}, Path("/x"), None, np.bool_(True))}  # fmt: skip
    report_ = report(examined("a.fmu", [finding("a.b", passed("It is.", figures=figures))]))
    assert as_json(report_, tmp_path)["examined"][0]["findings"][0]["figures"] == {
        "nan": None, "inf": None, "int": 3, "array": [0.0, 1.0], "nested": [{"a": 0.5}, "/x", None, True],
    }  # fmt: skip


def test_hostile_texts_are_unchanged_in_json(tmp_path: Path) -> None:
    report_ = hostile()
    content = as_json(report_, tmp_path)["examined"]
    for first, examined_ in zip(report_.examined, content, strict=True):
        expected = [f.sentence.replace("\udc80", "\ufffd") for f in first.findings]
        assert [f["sentence"] for f in examined_["findings"]] == expected
    assert content[0]["seconds"] is None


# ---- JUnit XML -------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [ordinary, hostile, report])
def test_junit_report_follows_the_schema(make: Any, tmp_path: Path) -> None:
    root = as_junit(make(), tmp_path)
    assert root.tag == "testsuites"
    for element in root.iter():
        children, attributes, required = ALLOWED[element.tag]
        assert {child.tag for child in element} <= children
        assert required <= set(element.attrib) <= attributes
        if "time" in element.attrib:
            assert re.fullmatch(r"(([0-9]{0,3},)*[0-9]{3}|[0-9]{0,3})*(\.[0-9]*)?", element.get("time"))


def test_suite_per_fmu_and_case_per_check(tmp_path: Path) -> None:
    root = as_junit(ordinary(), tmp_path)
    assert [root.get(n) for n in ("tests", "failures", "errors", "time")] == ["7", "2", "0", "3.000"]
    first, second = root
    assert {**first.attrib, "time": ""} == {
        "name": "build/Plant.fmu", "tests": "5", "failures": "2", "errors": "0", "skipped": "1", "time": "",
        "timestamp": STARTED,
    }  # fmt: skip
    assert {p.get("name"): p.get("value") for p in first.iter("property")}["model"] == "Plant"
    good, warning, bad, skipped, _ = first.findall("testcase")
    assert dict(good.attrib) == {"classname": "build.Plant", "name": "archive.safe", "time": "0.123"}
    assert [[child.tag for child in case] for case in (good, warning, bad)] == [
        [], ["system-out"], ["failure"],
    ]  # fmt: skip
    assert "motor.v has no unit.\n\nLine 7.\nLine 9." in warning[0].text
    assert bad[0].get("message") == "x is 2 where it was 1."
    assert bad[0].text == (
        "x is 2 where it was 1.\n\nv is 3, was 4.\n\n"
        "FMI 2.0.4, 2.1.5: “The function returns a new instance of an FMU.”\n\n"
        "What was done: Look at it.\n\nDo it right.\n\n"
        "Repeat it: emla verify build/Plant.fmu --only state.restored --explain"
    )
    assert dict(skipped[0].attrib) == {"message": "It needs state.restored, which failed."}
    assert {case.get("classname") for case in second.iter("testcase")} == {"other.Plant"}


def test_control_characters_are_escaped_in_junit(tmp_path: Path) -> None:
    hostile().save_junit(tmp_path / "r.xml")
    text = (tmp_path / "r.xml").read_text(encoding="utf-8")
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202e]", text)
    assert r"bell\x07 nul\x00 escape\x1b[31m" in text
    assert r"half\udc80" in text


def test_short_names_keep_what_distinguishes_paths() -> None:
    paths = ["a/x/P.fmu", "a/y/P.fmu", "b/y/P.fmu", "Q.fmu"]
    assert shorten_names(paths) == ["x/P.fmu", "a/y/P.fmu", "b/y/P.fmu", "Q.fmu"]
    assert shorten_names(["P.fmu", "P.fmu"]) == ["P.fmu", "P.fmu"]
