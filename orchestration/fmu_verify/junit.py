"""Write the report as JUnit XML for CI systems: a suite for each FMU, a case for each check."""

import math
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from emla_cosim.pages.text import make_visible

from .explanation import explain_finding, shorten_names
from .findings import Examined, Finding, Findings
from .verdict import Verdict


def render(report: Findings) -> str:
    """Return the report as JUnit XML."""
    names = shorten_names([one.label for one in report.examined])
    objections = sum(len(one.objections) for one in report.examined)
    root = _element(
        "testsuites",
        name="emla verify",
        tests=sum(report.counts.values()) + objections,
        failures=report.counts[Verdict.FAILED] + objections,
        errors=0,
        time=_time(sum(one.seconds for one in report.examined)),
    )
    root.extend(_suite(one, name, report) for one, name in zip(report.examined, names, strict=True))
    etree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{etree.tostring(root, encoding="unicode")}\n'


def _suite(one: Examined, name: str, report: Findings) -> Any:
    suite = _element(
        "testsuite",
        name=one.label,
        tests=len(one.findings) + len(one.objections),
        failures=len(one.of(Verdict.FAILED)) + len(one.objections),
        errors=0,
        skipped=len(one.of(Verdict.SKIPPED)),
        time=_time(one.seconds),
        timestamp=report.started,
    )
    properties = _element("properties")
    facts = {"emla-cosim": report.version, **one.facts}
    properties.extend(_element("property", name=fact, value=value) for fact, value in facts.items())
    suite.append(properties)
    suite.extend(_case(one, finding, _class_name(name)) for finding in one.findings)
    for sentence in one.objections:  # why an FMU does not pass although no check failed
        case = _element("testcase", classname=_class_name(name), name="fully verified", time=_time(0.0))
        case.append(_element("failure", sentence, type="not passed", message=sentence))
        suite.append(case)
    if one.not_examined:
        suite.append(_element("system-out", "\n".join(["Not examined:", *one.not_examined])))
    return suite


def _class_name(label: str) -> str:
    """Return the class name by which CI systems group cases: folders as packages, no other dots."""
    return label.removesuffix(".fmu").replace(".", "_").replace("/", ".")


def _case(one: Examined, finding: Finding, class_name: str) -> Any:
    case = _element("testcase", classname=class_name, name=finding.check, time=_time(finding.seconds))
    if finding.verdict == Verdict.FAILED:
        case.append(
            _element("failure", explain_finding(one, finding), type=finding.check, message=finding.sentence)
        )
    elif finding.verdict == Verdict.SKIPPED:
        case.append(_element("skipped", message=finding.sentence))
    elif finding.verdict == Verdict.WARNING:
        case.append(_element("system-out", f"Warning: {explain_finding(one, finding)}"))
    return case


def _time(seconds: float) -> str:
    return f"{seconds if math.isfinite(seconds) else 0.0:.3f}"


def _element(tag: str, text: str | None = None, **attributes: Any) -> Any:
    element = etree.Element(tag, {name: make_visible(value) for name, value in attributes.items()})
    if text is not None:
        element.text = make_visible(text)
    return element
