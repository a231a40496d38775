"""The report as JSON, for programs.

    {
      "format": "emla-verify", "version": 1,           increases if a field changes or is removed
      "made_by": "emla-cosim 0.1.0", "started": "2026-01-31T12:00:00+00:00",
      "passed": true,                                  all FMUs passed
      "complete": true,                                false after an interruption
      "counts": {"passed": 8, "warning": 1, "failed": 0, "skipped": 2},
      "examined": [
        {
          "name": "build/Plant.fmu",                   name in reports
          "path": "build/Plant.fmu",                   as the user wrote it
          "passed": true, "verdict": "warning",        the worst verdict
          "objections": [],                            why it does not pass, besides failed checks
          "not_examined": ["..."],                     what could not be judged
          "seconds": 1.5,
          "facts": {"FMI": "2.0", ...},                texts by name
          "findings": [
            {
              "check": "reference.tube", "title": "...", "verdict": "passed",
              "sentence": "...", "details": ["..."], "hint": "...", "seconds": 0.2,
              "done": "...",                           what was done
              "repeat": "emla verify ...",             the command that repeats the check
              "clause": {"document": "FMI 2.0.4", "section": "4.2.2", "sentence": "..."},
              "figures": {"steps": 1000, ...},         numbers that the check measures
              "comparisons": [
                {
                  "signal": "x", "unit": "m",
                  "inside": false, "left_at": 0.7,     null if it stays in its tube
                  "worst": 0.01, "worst_at": 0.9,      in the unit of the signal, and in s
                  "tube": {"value": 0.001, "time": 0.005}
                }
              ]
            }
          ]
        }
      ]
    }

Infinite numbers and NaN are null. Verdicts are passed, warning, failed and skipped.
"""

import json
from typing import Any

from emla_cosim.base.tolerances import Comparison
from emla_cosim.pages.text import to_plain

from .check import Verdict
from .findings import Examined, Finding, Findings, find_worst, format_command
from .report_files import JSON_FORMAT

VERSION = 1
"""Version of the format."""


def as_dict(report: Findings) -> dict[str, Any]:
    """Return the report as dictionaries, lists, strings, finite numbers, booleans and None."""
    return to_plain(
        {
            "format": JSON_FORMAT,
            "version": VERSION,
            "made_by": f"emla-cosim {report.version}",
            "started": report.started,
            "passed": report.passed,
            "complete": report.complete,
            "counts": {verdict.value: report.counts[verdict] for verdict in Verdict},
            "examined": [_describe_examined(examined) for examined in report.examined],
        }
    )


def render(report: Findings) -> str:
    """Return the report as JSON."""
    # NaN is not JSON
    return json.dumps(as_dict(report), indent=2, allow_nan=False) + "\n"


def _describe_examined(examined: Examined) -> dict[str, Any]:
    return {
        "name": examined.label,
        "path": str(examined.path),
        "passed": examined.passed,
        "verdict": find_worst(examined.findings).value,
        "objections": examined.objections,
        "not_examined": examined.not_examined,
        "seconds": examined.seconds,
        "facts": examined.facts,
        "findings": [_describe_finding(examined, finding) for finding in examined.findings],
    }


def _describe_finding(examined: Examined, finding: Finding) -> dict[str, Any]:
    clause, outcome = finding.clause, finding.outcome
    return {
        "check": finding.check,
        "title": finding.title,
        "verdict": finding.verdict.value,
        "sentence": finding.sentence,
        "done": finding.done,
        "details": outcome.details,
        "clause": {"document": clause.document, "section": clause.section, "sentence": clause.sentence},
        "hint": finding.hint,
        "repeat": format_command(examined, finding),
        "seconds": finding.seconds,
        "figures": outcome.figures,
        "comparisons": [_describe_comparison(comparison) for comparison in outcome.comparisons],
    }


def _describe_comparison(comparison: Comparison) -> dict[str, Any]:
    names = ("signal", "unit", "inside", "worst", "worst_at", "left_at")
    tube = {"value": comparison.tube.value, "time": comparison.tube.time}
    return {**{name: getattr(comparison, name) for name in names}, "tube": tube}
