"""Examiners that all tests of a process share: each takes a second to start."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from emla_cosim.verification import runner
from emla_cosim.verification.examiner import ExaminerJob
from emla_cosim.verification.findings import Examined

OF_THEIR_OWN = ("test_verify_command.py",)
"""Files that test how examiners start and end."""


class Sharing(runner._ExaminerPool):
    """Examiners that wait for the next report when one is done."""

    folder: Path
    waiting: list[Any] = []  # noqa: RUF012 - of all reports

    def examined(self, jobs: Sequence[ExaminerJob]) -> tuple[Examined, ...]:
        self._folder = self.folder
        self._taken: list[Any] = []
        with ThreadPoolExecutor(min(2, len(jobs))) as pool:
            found = tuple(pool.map(self._examined, jobs))
        self.waiting.extend(one for one in self._taken if one[0].poll() is None)
        return found

    def _process(self) -> Any:
        if not hasattr(self._own, "process"):
            with suppress(IndexError):
                self._own.process = self.waiting.pop()
            self._taken.append(super()._process())
        return self._own.process


@pytest.fixture(scope="session")
def sharing(tmp_path_factory: pytest.TempPathFactory) -> Iterator[type[Sharing]]:
    Sharing.folder = tmp_path_factory.mktemp("examiners")
    yield Sharing
    for process, channel in Sharing.waiting:
        channel.close()
        process.kill()
        process.wait()
    Sharing.waiting.clear()


@pytest.fixture(scope="module", autouse=True)
def examiners_are_shared(request: pytest.FixtureRequest, sharing: type[Sharing]) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        if request.path.name not in OF_THEIR_OWN:
            patch.setattr(runner, "_ExaminerPool", sharing)
        yield
