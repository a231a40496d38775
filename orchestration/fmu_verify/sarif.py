"""Write the report as SARIF 2.1.0: a rule for each check, a result for each failure, warning and note.

It has what GitHub's code scanning accepts: each result is at the first character of its FMU, whose path is
relative to the working folder, and has a fingerprint that does not depend on what exactly was found.
"""

import hashlib
import json
import os
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from urllib.parse import quote

from emla_cosim.pages.text import make_visible, shorten_text, to_plain

from .catalogue import CHECKS
from .check import Verdict
from .findings import Examined, Finding, Findings, explain_finding
from .report_files import SARIF_TOOL

SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
LEVELS = ("error", "warning", "note")

_MOST_RESULTS = 25_000
"""GitHub rejects a run with more."""
_MOST_SIGNALS = 100
_MOST_DETAILS = 5
_MAX_TITLE_LENGTH = 1000
"""GitHub cuts a description after 1024 characters."""
_MAX_LENGTH = 4000

_START = {"startLine": 1, "startColumn": 1, "endLine": 1, "endColumn": 2}
"""An FMU has no lines, but GitHub requires this region."""

_NOT_PASSED = "not-passed"
"""Rule for an FMU that does not pass although no check failed."""

_PAGES = {
    "FMI 2.0.4": "https://github.com/modelica/fmi-standard/releases/tag/v2.0.4",
    "FMI 3.0.2": "https://fmi-standard.org/docs/3.0.2/",
}


def render(report: Findings) -> str:
    """Return the report as SARIF."""
    results = sorted(_list_results(report), key=lambda result: LEVELS.index(result["level"]))
    left_out = len(results) - _MOST_RESULTS
    rules = _list_rules(report)
    positions = {rule["id"]: k for k, rule in enumerate(rules)}
    for result in results:
        result["ruleIndex"] = positions[result["ruleId"]]
    notes = [f"{examined.label}: {gap}" for examined in report.examined for gap in examined.not_examined]
    notes += [f"{left_out} more results were left out."] if left_out > 0 else []
    notes += [] if report.complete else ["Interrupted before all checks were done."]
    invocation = {
        "executionSuccessful": report.complete,
        "exitCode": 0 if report.passed else 1,
        **_describe_start(report.started),
        "toolExecutionNotifications": [{"level": "note", "message": _make_message(note)} for note in notes],
    }
    run = {
        "tool": {"driver": {"name": SARIF_TOOL, "version": report.version, "rules": rules}},
        "invocations": [invocation],
        "columnKind": "unicodeCodePoints",
        "results": results[:_MOST_RESULTS],
    }
    content = {"$schema": SCHEMA, "version": "2.1.0", "runs": [run]}
    return json.dumps(to_plain(content), indent=2, allow_nan=False) + "\n"


def _list_results(report: Findings) -> Iterator[dict[str, Any]]:
    """Yield a result for each failure, warning and note, and one for the objections of each FMU."""
    for examined in report.examined:
        for finding in examined.findings:
            if (level := _choose_level(finding)) is not None:
                text = explain_finding(examined, finding, _MOST_DETAILS)
                yield _make_result(examined, finding.check, level, text, _list_signals(finding))
        if examined.objections:
            yield _make_result(examined, _NOT_PASSED, "error", "\n".join(examined.objections))


def _choose_level(finding: Finding) -> str | None:
    """Return the level of a result; None for a finding that is not reported as one."""
    if finding.is_noted:
        return "note"
    return {Verdict.FAILED: "error", Verdict.WARNING: "warning"}.get(finding.verdict)


def _make_result(
    examined: Examined, rule: str, level: str, text: str, signals: list[dict[str, str]] | None = None
) -> dict[str, Any]:
    address = _make_address(examined.file)
    inside = "" if examined.file == examined.path else examined.path.name
    key = "\0".join((rule, address, inside))
    inner = [{"name": make_visible(inside), "kind": "resource"}] if inside else []
    location: dict[str, Any] = {
        "physicalLocation": {"artifactLocation": {"uri": address}, "region": dict(_START)}
    }
    if logical := [*inner, *(signals or [])]:
        location["logicalLocations"] = logical
    return {
        "ruleId": rule,
        "level": level,
        "message": _make_message(text),
        "locations": [location],
        # the one that GitHub reads; without it, GitHub makes one of the first bytes of the FMU
        "partialFingerprints": {
            "primaryLocationLineHash": hashlib.sha256(key.encode("utf-8", "replace")).hexdigest()[:32]
        },
    }


def _list_signals(finding: Finding) -> list[dict[str, str]]:
    """Return the signals that left their tubes."""
    names = [c.signal for c in finding.outcome.comparisons if not c.inside]
    return [{"fullyQualifiedName": make_visible(n), "kind": "variable"} for n in names[:_MOST_SIGNALS]]


def _list_rules(report: Findings) -> list[dict[str, Any]]:
    """Return a rule for each check that ran, whatever its verdict."""
    findings = {finding.check: finding for examined in report.examined for finding in examined.findings}
    checks = {check.name: check for check in CHECKS}
    rules = []
    for name, finding in findings.items():
        check = checks.get(name)
        versions = (check.only_for,) if check and check.only_for else (2, 3)
        texts = [check.of(version) for version in versions] if check else [finding]
        clauses = list(dict.fromkeys(text.clause for text in texts))
        quotes = [f"{clause}: “{clause.sentence}”" for clause in clauses]
        page = next((_PAGES[clause.document] for clause in clauses if clause.document in _PAGES), None)
        hints = dict.fromkeys(text.hint for text in texts)
        rules.append(_make_rule(name, finding.title, finding.done, [*quotes, *hints], page))
    if any(examined.objections for examined in report.examined):
        hint = "Remove the cause, or leave checks out with `--skip`."
        procedure = "Look for reasons, besides failed checks, for which an FMU does not pass."
        rules.append(_make_rule(_NOT_PASSED, "The FMU is fully verified", procedure, [hint]))
    return rules


def _make_rule(
    name: str, title: str, procedure: str, help_: list[str], page: str | None = None
) -> dict[str, Any]:
    return {
        "id": name,
        "shortDescription": _make_message(title, _MAX_TITLE_LENGTH),
        "fullDescription": _make_message(procedure or title, _MAX_TITLE_LENGTH),
        "help": _make_message("\n\n".join(help_)),
        **({"helpUri": page} if page else {}),
        "properties": {"tags": ["FMI", name.partition(".")[0]]},
    }


def _make_message(text: str, most: int = _MAX_LENGTH) -> dict[str, str]:
    """Return a message without embedded links, such as `[x](1)`: their destination would have to exist."""
    return {"text": shorten_text(make_visible(text).replace("](", "] ("), most) or "-"}


def _make_address(path: Path) -> str:
    """Return the address of a file, relative to the working folder if it is in there."""
    absolute_path = Path(os.path.abspath(path))  # noqa: PTH100 - follows no links, as git does not
    if absolute_path.is_relative_to(Path.cwd()):
        return quote(os.fsencode(absolute_path.relative_to(Path.cwd()).as_posix()))
    return absolute_path.as_uri()


def _describe_start(text: str) -> dict[str, str]:
    try:
        return {"startTimeUtc": f"{datetime.fromisoformat(text).astimezone(UTC):%Y-%m-%dT%H:%M:%SZ}"}
    except ValueError:
        return {}
