"""The report as JSON."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from emla_cosim.verification.report import Report
from emla_cosim.verification.verdict import failed, passed
from tests.support.reports import CLAUSE, STARTED, examined, finding, hostile, ordinary, report


def saved(given: Report, folder: Path) -> Any:
    path = folder / "r.json"
    given.save_json(path)

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is not JSON")

    return json.loads(path.read_bytes().decode("ascii"), parse_constant=refuse)


def test_keys_of_a_report(tmp_path: Path) -> None:
    given = ordinary()
    found = saved(given, tmp_path)
    assert found == given.as_dict()
    assert (found["format"], found["version"], found["started"]) == ("emla-verify", 1, STARTED)
    assert found["passed"] is False
    assert found["complete"] is True
    assert found["counts"] == {"passed": 3, "warning": 1, "failed": 2, "skipped": 1}
    one, other = found["examined"]
    assert (one["path"], one["verdict"], one["passed"], one["seconds"]) == (
        "build/Plant.fmu", "failed", False, 1.5,
    )  # fmt: skip
    assert (other["verdict"], other["passed"]) == ("passed", True)
    assert one["facts"]["model"] == "Plant"
    assert [f["check"] for f in one["findings"]] == [
        "archive.safe", "description.units", "state.restored", "state.serialized", "reference.tube",
    ]  # fmt: skip
    units = one["findings"][1]
    assert {**units, "title": ""} == {
        "check": "description.units", "title": "", "verdict": "warning", "sentence": "motor.v has no unit.",
        "details": ["Line 7.", "Line 9."], "hint": "Do it right.", "seconds": 0.1234, "done": "Look at it.",
        "repeat": "emla verify build/Plant.fmu --only description.units --explain",
        "figures": {}, "comparisons": [],
        "clause": {"document": "FMI 2.0.4", "section": CLAUSE.section, "sentence": CLAUSE.sentence},
    }  # fmt: skip


def test_signals_have_numbers_instead_of_arrays(tmp_path: Path) -> None:
    inside, outside, _ = saved(ordinary(), tmp_path)["examined"][0]["findings"][-1]["comparisons"]
    assert set(inside) == {"signal", "unit", "inside", "worst", "worst_at", "left_at", "tube"}
    assert (inside["signal"], inside["unit"], inside["inside"], inside["left_at"]) == ("x", "m", True, None)
    assert inside["tube"] == {"value": 0.01, "time": 0.005}
    assert 0.004 < inside["worst"] < 0.006
    assert not outside["inside"] and 2 < outside["left_at"] < 3 < outside["worst_at"]


def test_values_that_json_lacks(tmp_path: Path) -> None:
    figures = {"nan": np.float64("nan"), "inf": -np.inf, "int": np.int64(3), "array": np.arange(2.0),
               "nested": ({"a": np.float32(0.5)}, Path("/x"), None, np.bool_(True))}  # fmt: skip
    given = report(examined("a.fmu", [finding("a.b", passed("It is.", figures=figures))]))
    assert saved(given, tmp_path)["examined"][0]["findings"][0]["figures"] == {
        "nan": None, "inf": None, "int": 3, "array": [0.0, 1.0], "nested": [{"a": 0.5}, "/x", None, True],
    }  # fmt: skip


def test_hostile_texts_are_unchanged(tmp_path: Path) -> None:
    given = hostile()
    found = saved(given, tmp_path)["examined"]
    for one, finds in zip(given.examined, found, strict=True):
        for mine, its in zip(one.findings, finds["findings"], strict=True):
            assert its["sentence"] == mine.sentence.replace("\udc80", "\ufffd")
    assert found[0]["seconds"] is None


def test_empty_report(tmp_path: Path) -> None:
    assert saved(report(), tmp_path)["counts"] == {"passed": 0, "warning": 0, "failed": 0, "skipped": 0}
    only_failed = report(examined("a.fmu", [finding("a.b", failed("No."))]))
    assert saved(only_failed, tmp_path)["examined"][0]["passed"] is False
