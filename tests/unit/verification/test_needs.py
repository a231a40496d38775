"""What is said of a check that was asked for, where one that it needs failed and was not asked for."""

from pathlib import Path

import pytest

from emla_cosim.verification.runner import verify
from emla_cosim.verification.verdict import Verdict


@pytest.fixture
def no_archive(tmp_path: Path) -> Path:
    path = tmp_path / "Odd.fmu"
    path.write_bytes(b"no zip")
    return path


def test_a_failed_need_fails_the_report(no_archive: Path) -> None:
    (examined,) = verify(no_archive, only=["run"]).examined
    assert {f.check for f in examined.of(Verdict.FAILED)} == {"archive.safe"}
    assert {f.check.split(".")[0] for f in examined.of(Verdict.SKIPPED)} == {"run"}
    assert not examined.passed


def test_what_was_to_be_left_out_is_left_out(no_archive: Path) -> None:
    report = verify(no_archive, only=["run"], skip=["archive.safe"])
    assert set(report.counts) == {Verdict.SKIPPED}
