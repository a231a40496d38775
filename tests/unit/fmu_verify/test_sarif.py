"""The report as SARIF, against the schema of SARIF 2.1.0 as far as it is used, and what GitHub requires."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from fmu_verify import sarif
from fmu_verify.check import failed, noted, passed, skipped, warned
from fmu_verify.checks import archive, derivatives
from fmu_verify.findings import Examined
from fmu_verify.report import Report
from tests.support.reports import STARTED, examined, finding, hostile, ordinary, report, ten


def _object(required: dict[str, Any], optional: dict[str, Any] | None = None) -> dict[str, Any]:
    content = {"properties": required | (optional or {}), "required": list(required)}
    return {"type": "object", "additionalProperties": False, **content}


def _list(items: dict[str, Any], least: int = 0) -> dict[str, Any]:
    return {"type": "array", "items": items, "minItems": least}


def _text(most: int) -> dict[str, Any]:
    return _object({"text": {"type": "string", "minLength": 1, "maxLength": most}})


_NAME, _LEVEL = {"type": "string", "minLength": 1}, {"enum": list(sarif.LEVELS)}
_FROM_ONE, _FROM_ZERO = {"type": "integer", "minimum": 1}, {"type": "integer", "minimum": 0}
_RULE = _object(
    {
        "id": _NAME,
        "shortDescription": _text(1024),
        "fullDescription": _text(1024),
        "help": _text(5000),
        "properties": _object({"tags": {**_list(_NAME), "maxItems": 20, "uniqueItems": True}}),
    },
    {"helpUri": {"type": "string", "pattern": "^https://"}},
)
_REGION = _object(dict.fromkeys(("startLine", "startColumn", "endLine", "endColumn"), _FROM_ONE))
_PHYSICAL_LOCATION = _object(
    {"artifactLocation": _object({"uri": {"type": "string", "pattern": r"^[!-~]+$"}}), "region": _REGION}
)
_LOGICAL = {
    **_object({"kind": {"enum": ["variable", "resource"]}}, {"name": _NAME, "fullyQualifiedName": _NAME}),
    "minProperties": 2,
}
_LOCATION = _object({"physicalLocation": _PHYSICAL_LOCATION}, {"logicalLocations": _list(_LOGICAL)})
_HASH = {"type": "string", "pattern": "^[0-9a-f]{32}$"}
_RESULT = _object(
    {
        "ruleId": _NAME,
        "ruleIndex": _FROM_ZERO,
        "level": _LEVEL,
        "message": _text(5000),
        "locations": {**_list(_LOCATION, 1), "maxItems": 1},
        "partialFingerprints": _object({"primaryLocationLineHash": _HASH}),
    }
)
_INVOCATION = _object(
    {
        "executionSuccessful": {"type": "boolean"},
        "exitCode": {"type": "integer"},
        "toolExecutionNotifications": _list(_object({"level": _LEVEL, "message": _text(5000)})),
    },
    {"startTimeUtc": {"type": "string", "pattern": r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ$"}},
)
_RUN = _object(
    {
        "tool": _object({"driver": _object({"name": _NAME, "version": _NAME, "rules": _list(_RULE)})}),
        "invocations": _list(_INVOCATION, 1),
        "columnKind": {"const": "unicodeCodePoints"},
        "results": {**_list(_RESULT), "maxItems": 25_000},
    }
)
SCHEMA = _object(
    {
        "$schema": {"const": sarif.SCHEMA},
        "version": {"const": "2.1.0"},
        "runs": {**_list(_RUN, 1), "maxItems": 1},
    }
)


def run_of(report_: Report) -> dict[str, Any]:
    """The run of a report, which fits the schema and whose results name their rules."""
    content = json.loads(sarif.render(report_).encode("ascii"))
    Draft202012Validator(SCHEMA).validate(content)
    (run,) = content["runs"]
    rules = run["tool"]["driver"]["rules"]
    assert len({rule["id"] for rule in rules}) == len(rules)
    assert all(rules[result["ruleIndex"]]["id"] == result["ruleId"] for result in run["results"])
    return run


def one_of(*outcomes: Any, path: str = "build/x.fmu") -> Report:
    return report(examined(path, [finding(f"group.check_{k}", o) for k, o in enumerate(outcomes)]))


@pytest.mark.parametrize("make", [ordinary, hostile, report, ten])
def test_report_fits_the_schema(make: Any) -> None:
    run_of(make())


def test_results_have_level_message_and_location() -> None:
    run = run_of(ordinary())
    assert [(r["ruleId"], r["level"]) for r in run["results"]] == [
        ("state.restored", "error"), ("reference.tube", "error"), ("description.units", "warning"),
    ]  # fmt: skip
    first, second, _ = run["results"]
    assert first["message"]["text"].startswith(
        "x is 2 where it was 1.\n\nv is 3, was 4.\n\nFMI 2.0.4, 2.1.5: “"
    )
    assert first["locations"][0]["physicalLocation"]["artifactLocation"] == {"uri": "build/Plant.fmu"}
    assert [location["fullyQualifiedName"] for location in second["locations"][0]["logicalLocations"]] == [
        "motor.v", "motor.i",
    ]  # fmt: skip
    (invocation,) = run["invocations"]
    assert (invocation["executionSuccessful"], invocation["exitCode"]) == (True, 1)
    assert invocation["startTimeUtc"] == STARTED.replace("+00:00", "Z")


def test_notes_are_results_and_passed_or_skipped_checks_are_not() -> None:
    outcomes = noted("It is odd."), passed("It is.", gaps=("Only 3 of 9.",)), skipped("It has none.")
    run = run_of(one_of(*outcomes))
    (note,) = run["results"]
    assert (note["level"], note["message"]["text"].split("\n")[0]) == ("note", "It is odd.")
    assert len(run["tool"]["driver"]["rules"]) == 3
    assert run["invocations"][0]["exitCode"] == 0


def test_rules_quote_the_standard_in_both_versions() -> None:
    checks = (archive.safe, derivatives.adjoint)
    procedures = [finding(check.name, passed("It is."), check.title) for check in checks]
    safe, adjoint = run_of(report(examined("x.fmu", procedures)))["tool"]["driver"]["rules"]
    for clause in (archive.safe.clause, archive.safe.clause.of(3)):
        assert f"{clause}: “{clause.sentence}”" in safe["help"]["text"]
    assert archive.safe.hint in safe["help"]["text"]
    assert safe["helpUri"].endswith("2.0.4") and adjoint["helpUri"].endswith("3.0.2/")
    assert "FMI 2.0.4" not in adjoint["help"]["text"]


def test_fingerprints_do_not_depend_on_what_was_found(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def prints(report_: Report) -> list[str]:
        return [r["partialFingerprints"]["primaryLocationLineHash"] for r in run_of(report_)["results"]]

    before = prints(one_of(failed("x is 1."), warned("y.")))
    assert len(set(before)) == 2
    assert prints(one_of(failed("x is 2."), failed("z."))) == before
    assert not set(before) & set(prints(one_of(failed("x is 1."), path="build/y.fmu")))
    monkeypatch.chdir(tmp_path)  # another checkout
    assert prints(one_of(failed("x is 1."), warned("y."), path=f"{tmp_path}/build/x.fmu")) == before


@pytest.mark.parametrize(
    ("path", "uri"),
    [
        ("./a b/ä%.fmu", "a%20b/%C3%A4%25.fmu"),
        ("a/../x.fmu", "x.fmu"),
        ("/elsewhere/x.fmu", Path("/elsewhere/x.fmu").absolute().as_uri()),
        ("study.ssp/resources/x.fmu", "study.ssp"),
    ],
)
def test_addresses(path: str, uri: str) -> None:
    (result,) = run_of(one_of(failed("It is wrong."), path=path))["results"]
    (location,) = result["locations"]
    assert location["physicalLocation"]["artifactLocation"]["uri"] == uri
    inner = [{"name": "x.fmu", "kind": "resource"}] if ".ssp" in path else None
    assert location.get("logicalLocations") == inner


def test_other_reasons_not_to_pass_are_one_result() -> None:
    objections, gaps = ("First.", "Second."), ("A gap.",)
    fmu_report = Examined(Path("x.fmu"), {}, (), 1.0, objections=objections, not_examined=gaps)
    run = run_of(replace(report(fmu_report), complete=False))
    (result,) = run["results"]
    assert (result["ruleId"], result["message"]["text"]) == ("not-passed", "First.\nSecond.")
    (invocation,) = run["invocations"]
    assert not invocation["executionSuccessful"]
    assert [n["message"]["text"] for n in invocation["toolExecutionNotifications"]] == [
        "x.fmu: A gap.", "Interrupted before all checks were done.",
    ]  # fmt: skip


def test_text_of_an_fmu_makes_no_link() -> None:
    (result,) = run_of(one_of(failed("See [this](1) and u[2].")))["results"]
    assert result["message"]["text"].startswith("See [this] (1) and u[2].")


def test_results_beyond_the_limit_of_github_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sarif, "_MOST_RESULTS", 2)
    run = run_of(one_of(warned("w"), failed("f"), noted("n"), failed("g")))
    assert [r["level"] for r in run["results"]] == ["error", "error"]
    (note,) = run["invocations"][0]["toolExecutionNotifications"]
    assert note["message"]["text"] == "2 more results were left out."
