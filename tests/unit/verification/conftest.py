"""Examiners that all tests of a process share: each takes a second to start."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import pytest

from emla_cosim.sandbox.server import Server
from emla_cosim.verification import runner
from emla_cosim.verification.examiner import ExaminerJob
from emla_cosim.verification.findings import Examined

OF_THEIR_OWN = ("test_verify_command.py",)
"""Files that test how examiners start and end."""


class Sharing(runner._ExaminerPool):
    """Examiners that wait for the next report when one is done."""

    folder: Path
    waiting: list[Server] = []  # noqa: RUF012 - of all reports

    def examined(self, jobs: Sequence[ExaminerJob]) -> tuple[Examined, ...]:
        self._folder = self.folder
        with ThreadPoolExecutor(min(2, len(jobs))) as pool:
            found = tuple(pool.map(self._examined, jobs))
        self.waiting.extend(server for server in self._servers if server._process.poll() is None)
        return found

    def _server(self) -> Server:
        if not hasattr(self._own, "server"):
            with suppress(IndexError):
                self._own.server = self.waiting.pop()
                self._servers.append(self._own.server)
        return super()._server()


@pytest.fixture(scope="session")
def sharing(tmp_path_factory: pytest.TempPathFactory) -> Iterator[type[Sharing]]:
    Sharing.folder = tmp_path_factory.mktemp("examiners")
    yield Sharing
    for server in Sharing.waiting:
        server.close()
    Sharing.waiting.clear()


@pytest.fixture(scope="module", autouse=True)
def examiners_are_shared(request: pytest.FixtureRequest, sharing: type[Sharing]) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        if request.path.name not in OF_THEIR_OWN:
            patch.setattr(runner, "_ExaminerPool", sharing)
        yield
