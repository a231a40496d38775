"""Checks that run nothing: a good FMU passes, and each wrong one fails the check meant for it."""

from pathlib import Path

import lief  # noqa: F401  # once here, and not in each process that examines
import pytest

from emla_cosim.verify.catalogue import STATIC as CHECKS
from emla_cosim.verify.examination import examined
from emla_cosim.verify.report import Examined
from emla_cosim.verify.settings import Settings
from emla_cosim.verify.subject import Subject
from emla_cosim.verify.verdict import Verdict
from tests.support.broken.broken import Broken
from tests.support.broken.editing import good_bytes
from tests.support.broken.static import STATIC

ONLY = Settings(only=tuple(c.name for c in CHECKS))


def found(path: Path, folder: Path) -> Examined:
    return examined(Subject(path, folder / "unpacked" / "fmu", ONLY))


def test_good_fmu_passes_every_check(tmp_path: Path) -> None:
    path = tmp_path / "Toy.fmu"
    path.write_bytes(good_bytes())
    assert {f.check: f.sentence for f in found(path, tmp_path).findings if f.verdict != Verdict.PASSED} == {}


@pytest.mark.parametrize("broken", STATIC, ids=lambda b: b.name)
def test_broken_fmu_fails_its_check_alone(broken: Broken, tmp_path: Path) -> None:
    report = found(broken.build(tmp_path), tmp_path)
    wrong = {f.check: f.sentence for f in report.findings if f.verdict in (Verdict.FAILED, Verdict.WARNING)}
    assert list(wrong) == [broken.check], wrong
    assert report[broken.check].verdict == Verdict.FAILED
    assert "went wrong" not in wrong[broken.check]
    for finding in report.findings:
        assert finding.sentence.endswith("."), finding


def test_every_name_is_broken_once() -> None:
    names = [b.name for b in STATIC]
    assert len(set(names)) == len(names)
