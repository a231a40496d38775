"""Checks that run nothing: a good FMU passes, and each wrong one fails the check meant for it."""

from pathlib import Path

import pytest

from emla_cosim.verify.catalogue import STATIC as CHECKS
from emla_cosim.verify.verdict import Verdict
from tests.support.broken.broken import Broken
from tests.support.broken.editing import good_bytes
from tests.support.broken.examining import examined_apart, examined_here
from tests.support.broken.static import STATIC

NAMES = tuple(c.name for c in CHECKS)


def test_good_fmu_passes_every_check(tmp_path: Path) -> None:
    path = tmp_path / "Toy.fmu"
    path.write_bytes(good_bytes())
    assert {
        f.check: f.sentence for f in examined_apart(path, NAMES).findings if f.verdict != Verdict.PASSED
    } == {}


@pytest.mark.parametrize("broken", STATIC, ids=lambda b: b.name)
def test_broken_fmu_fails_its_check_alone(
    broken: Broken, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report = examined_here(broken.build(tmp_path), NAMES, monkeypatch)
    wrong = {f.check: f.sentence for f in report.findings if f.verdict in (Verdict.FAILED, Verdict.WARNING)}
    assert list(wrong) == [broken.check], wrong
    assert report[broken.check].verdict == Verdict.FAILED
    assert "went wrong" not in wrong[broken.check]
    for finding in report.findings:
        assert finding.sentence.endswith("."), finding


def test_every_name_is_broken_once() -> None:
    names = [b.name for b in STATIC]
    assert len(set(names)) == len(names)
