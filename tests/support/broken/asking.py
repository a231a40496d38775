"""Broken FMUs that examiners look at, each asked what its settings say."""

from collections.abc import Iterable
from pathlib import Path

from fmu_verify.examiner import ExaminerJob
from fmu_verify.findings import Examined
from fmu_verify.runner import examine_all
from fmu_verify.settings import Settings
from tests.support.broken.broken import Broken


def examined_all(broken: Iterable[tuple[Broken, Settings]], folder: Path) -> dict[str, Examined]:
    """Build broken FMUs in a folder and return what is found about each, by its name."""
    jobs = []
    for fmu, settings in broken:
        (folder / fmu.name).mkdir()
        path = fmu.build(folder / fmu.name)
        jobs.append(ExaminerJob(path, settings, fmu.name, path))
    return {examined.name: examined for examined in examine_all(jobs, folder)[0]}
