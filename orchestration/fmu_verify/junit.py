"""Write the report as JUnit XML for CI systems: a suite for each FMU, a case for each check."""

import math
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from emla_cosim.pages.text import make_visible

from .check import Verdict
from .findings import Examined, Finding, Findings, explain_finding, shorten_names


def render(report: Findings) -> str:
    """Return the report as JUnit XML."""
    names = shorten_names([examined.label for examined in report.examined])
    objections = sum(len(examined.objections) for examined in report.examined)
    root = _make_element(
        "testsuites",
        name="emla verify",
        tests=sum(report.counts.values()) + objections,
        failures=report.counts[Verdict.FAILED] + objections,
        errors=0,
        time=_format_seconds(sum(examined.seconds for examined in report.examined)),
    )
    pairs = zip(report.examined, names, strict=True)
    root.extend(_build_suite(examined, name, report) for examined, name in pairs)
    etree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{etree.tostring(root, encoding="unicode")}\n'


def _build_suite(examined: Examined, name: str, report: Findings) -> Any:
    suite = _make_element(
        "testsuite",
        name=examined.label,
        tests=len(examined.findings) + len(examined.objections),
        failures=len(examined.of(Verdict.FAILED)) + len(examined.objections),
        errors=0,
        skipped=len(examined.of(Verdict.SKIPPED)),
        time=_format_seconds(examined.seconds),
        timestamp=report.started,
    )
    properties = _make_element("properties")
    facts = {"emla-cosim": report.version, **examined.facts}
    properties.extend(_make_element("property", name=fact, value=value) for fact, value in facts.items())
    suite.append(properties)
    suite.extend(_build_case(examined, finding, _make_class_name(name)) for finding in examined.findings)
    class_name = _make_class_name(name)
    for sentence in examined.objections:  # why an FMU does not pass although no check failed
        case = _make_element("testcase", classname=class_name, name="fully verified", time="0.000")
        case.append(_make_element("failure", sentence, type="not passed", message=sentence))
        suite.append(case)
    if examined.not_examined:
        suite.append(_make_element("system-out", "\n".join(["Not examined:", *examined.not_examined])))
    return suite


def _make_class_name(label: str) -> str:
    """Return the class name by which CI systems group cases: folders as packages, no other dots."""
    return label.removesuffix(".fmu").replace(".", "_").replace("/", ".")


def _build_case(examined: Examined, finding: Finding, class_name: str) -> Any:
    seconds, text = _format_seconds(finding.seconds), explain_finding(examined, finding)
    case = _make_element("testcase", classname=class_name, name=finding.check, time=seconds)
    if finding.verdict == Verdict.FAILED:
        case.append(_make_element("failure", text, type=finding.check, message=finding.sentence))
    elif finding.verdict == Verdict.SKIPPED:
        case.append(_make_element("skipped", message=finding.sentence))
    elif finding.verdict == Verdict.WARNING:
        case.append(_make_element("system-out", f"Warning: {text}"))
    return case


def _format_seconds(seconds: float) -> str:
    return f"{seconds if math.isfinite(seconds) else 0.0:.3f}"


def _make_element(tag: str, text: str | None = None, **attributes: Any) -> Any:
    element = etree.Element(tag, {name: make_visible(value) for name, value in attributes.items()})
    if text is not None:
        element.text = make_visible(text)
    return element
