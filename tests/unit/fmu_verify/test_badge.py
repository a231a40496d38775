"""The badge: its message for each state, as an image that a browser draws."""

from dataclasses import replace
from pathlib import Path

import pytest
from lxml import etree

from fmu_verify.check import failed, passed, skipped, warned
from fmu_verify.findings import Examined
from fmu_verify.report import Report
from tests.support.reports import examined, finding, ordinary, report

GOOD = examined(
    "x.fmu", [finding("a.b", passed("p")), finding("a.c", warned("w")), finding("a.d", skipped("s"))]
)


@pytest.mark.parametrize(
    ("report_", "text"),
    [
        (report(GOOD), "FMU: 2 checks passed"),
        (report(examined("x.fmu", [finding("a.b", passed("p"))])), "FMU: 1 check passed"),
        (report(GOOD, GOOD), "2 FMUs: 4 checks passed"),
        (report(examined("x.fmu", [finding("a.b", failed("f"))]), GOOD), "2 FMUs: 1 check failed"),
        (report(Examined(Path("x.fmu"), {}, (), 1.0, objections=("No binary.",))), "FMU: not passed"),
        (replace(report(GOOD), complete=False), "FMU: incomplete"),
        (replace(ordinary(), complete=False), "2 FMUs: incomplete"),
    ],
)
def test_badge_shows_its_message(report_: Report, text: str, tmp_path: Path) -> None:
    report_.save_badge(tmp_path / "badge.svg")
    image = etree.fromstring((tmp_path / "badge.svg").read_bytes())
    assert image.get("aria-label") == text == image.findtext("{*}title")
    texts = list(image.iter("{*}text"))
    assert ": ".join(element.text for element in texts) == text
    assert all(
        float(element.get("x")) + float(element.get("textLength")) < float(image.get("width"))
        for element in texts
    )
