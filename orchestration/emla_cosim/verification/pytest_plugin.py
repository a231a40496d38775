"""`pytest --fmu 'build/*.fmu'`: every check of every FMU is a test.

    build/Plant.fmu::state.restored

pytest loads this module wherever the package is installed, so it imports nothing of it until there is
an FMU to verify.
"""

from __future__ import annotations

import glob
import hashlib
import os
import warnings
from collections.abc import Callable, Container, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from .findings import Examined, Finding
    from .settings import Settings

_FMUS = pytest.StashKey[list[str]]()
"""The files of the FMUs."""

_SHARED = pytest.StashKey[TemporaryDirectory[str]]()
"""Where workers of pytest-xdist leave for each other what they found."""

_MOST_DETAILS = 20
"""Places that are shown where the same is wrong."""


class FmuWarning(UserWarning):
    """The standard allows what a check found, but somebody will stumble over it."""


class FmuFailure(Exception):  # noqa: N818 - it is what a check found, no slip of a program
    """A check failed; the text is all that is known of it, in lines."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """What to verify, and how."""
    group = parser.getgroup("fmu", "FMUs, verified as by `emla verify`")
    group.addoption("--fmu", action="append", default=[], metavar="GLOB", help="FMUs to verify (repeatable).")
    group.addoption("--fmu-reference", metavar="DIR", help="Folder of reference files; else beside each FMU.")
    for name, help_ in (
        ("only", "Check, group, or pattern of checks, to do (repeatable)."),
        ("skip", "Check, group, or pattern of checks, to leave out (repeatable)."),
    ):
        group.addoption(f"--fmu-{name}", action="append", default=[], metavar="CHECK", help=help_)
    group.addoption(
        "--fmu-tolerance",
        action="append",
        default=[],
        metavar="[PATTERN=]NUMBER",
        help="How wide tubes are: relative to a signal's range (repeatable). Default: 1e-3.",
    )
    parser.addini("fmus", "FMUs to verify where no paths are given: globs.", type="linelist", default=[])


def pytest_configure(config: pytest.Config) -> None:
    """Register the mark of these tests."""
    config.addinivalue_line("markers", "fmu(check, group): a check of an FMU, as `emla verify` does it.")


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Find the FMUs before anything is collected; workers of pytest-xdist are told which they are."""
    config = session.config
    if (told := _worker_data(config)) is not None:
        config.stash[_FMUS] = told["fmus"]
        return
    found = list(_match_files(_texts(config, "fmu"), config.invocation_params.dir, "--fmu"))
    if config.args_source != pytest.Config.ArgsSource.ARGS:
        found += _match_files(config.getini("fmus"), config.rootpath, "fmus")
    if found:
        _settings(config)  # what is wrong with it is said once
    config.stash[_FMUS] = list(dict.fromkeys(found))


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """Tell a worker of pytest-xdist which FMUs there are, and where all leave what they found."""
    config: pytest.Config = node.config
    if _SHARED not in config.stash:
        config.stash[_SHARED] = TemporaryDirectory(prefix="emla-verify-")
        config.add_cleanup(config.stash[_SHARED].cleanup)
    node.workerinput["emla_verify"] = {"fmus": config.stash[_FMUS], "folder": config.stash[_SHARED].name}


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """An FMU that is an argument, as in `pytest build/x.fmu::state.restored`; others are left alone."""
    if file_path.suffix.lower() == ".fmu" and parent.session.isinitpath(file_path):
        return FmuCollector.from_parent(parent, path=file_path)
    return None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(session: pytest.Session, items: list[pytest.Item]) -> None:
    """Add the tests of the FMUs, before any are deselected.

    Their files are no arguments of pytest, which leaves out those that lie in others, and does not
    look into folders like `build`.
    """
    named = {item.path for item in items if isinstance(item, FmuItem)}
    for path in map(Path, session.config.stash[_FMUS]):
        if path not in named:
            items += session.genitems(FmuCollector.from_parent(session, path=path))


class FmuCollector(pytest.File):
    """An FMU, whose tests are its checks."""

    _examined: Examined | None = None

    def collect(self) -> Iterator[FmuItem]:
        """A test for each check that the options mean."""
        from .examination import select_checks

        for check in select_checks(_settings(self.config)):
            item = FmuItem.from_parent(self, name=check.name)
            item.add_marker(pytest.mark.fmu(check=check.name, group=check.group))
            yield item

    def finding(self, item: FmuItem) -> Finding:
        """What a check found, or one that it needs, that failed, and that nobody selected.

        All selected ones are done when the first is asked for, by whichever worker that is.
        """
        selected = [i.name for i in self.session.items if i.parent is self]
        if self._examined is None:
            self._examined = self._shared(lambda: self._verified(selected))
        return _of(item.name, self._examined, selected)

    def _shared(self, do: Callable[[], Examined]) -> Examined:
        """What is to be done, done by one worker of pytest-xdist for all."""
        told = _worker_data(self.config)
        if told is None:
            return do()
        from .compute_once import compute_once

        name = hashlib.sha256(os.fsencode(self.path)).hexdigest()
        return compute_once(Path(told["folder"], name), do)

    def _verified(self, checks: list[str]) -> Examined:
        from .runner import verify

        said = _settings(self.config)
        report = verify(
            self.path, reference=said.reference, tolerance=said.tolerance, only=checks, skip=said.skip
        )
        return report.examined[0]


class FmuItem(pytest.Item):
    """One check of an FMU."""

    def runtest(self) -> None:
        """Raise FmuFailure, or skip, or warn, as the check found."""
        from .verdict import Verdict

        assert isinstance(self.parent, FmuCollector)
        found = self.parent.finding(self)
        if found.verdict == Verdict.FAILED:
            needed = "" if found.check == self.name else f"It needs {found.check}, which failed. "
            raise FmuFailure(needed + explain_finding(found))
        if found.verdict == Verdict.SKIPPED:
            raise pytest.skip.Exception(f"{self.name}: {found.sentence}", _use_item_location=True)
        if found.verdict == Verdict.WARNING:
            warnings.warn_explicit(FmuWarning(explain_finding(found)), None, str(self.path), 0)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """What is wrong with the FMU; the way through this program is nobody's concern."""
        from ..base.errors import CosimError

        if isinstance(excinfo.value, (FmuFailure, FmuWarning, CosimError)):
            return _FailureText(self.reportinfo()[0], str(excinfo.value))
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int, str]:
        """Where it is, and what headlines call it."""
        return self.path, 0, f"{self.name} of {self.path.name}"


@dataclass(frozen=True)
class _Crash:
    """What summaries and JUnit files say of a failure, in pytest's words for it."""

    path: Path
    message: str

    def __str__(self) -> str:
        return f"{self.path}: {self.message}"


class _FailureText:
    """A failure as pytest shows it."""

    def __init__(self, path: Path, text: str) -> None:
        self.text = text
        self.reprcrash = _Crash(path, text.partition("\n")[0])

    def __str__(self) -> str:
        return self.text

    def toterminal(self, terminal: Any) -> None:
        """Write it."""
        first, _, rest = self.text.partition("\n")
        terminal.line(first, red=True, bold=True)
        terminal.line(rest)


def explain_finding(found: Finding) -> str:
    """The sentence, further places, what it rests on, and what to do, each in lines of its own."""
    details = found.outcome.details
    lines = [found.sentence, *(f"    {detail}" for detail in details[:_MOST_DETAILS])]
    if len(details) > _MOST_DETAILS:
        lines.append(f"    and {len(details) - _MOST_DETAILS} more")
    return "\n".join([*lines, f'{found.clause}: "{found.clause.sentence}"', found.hint])


def _worker_data(config: pytest.Config) -> dict[str, Any] | None:
    """What a worker of pytest-xdist was told; None for other processes."""
    return getattr(config, "workerinput", {}).get("emla_verify")


def _of(check: str, examined: Examined, selected: Container[str]) -> Finding:
    """The finding of a check, or what a failed one says that no test of its own tells."""
    from .verdict import Verdict

    lost = [f for f in examined.of(Verdict.FAILED) if f.check not in selected]
    found = next((f for f in examined.findings if f.check == check), None)
    if found is None or (lost and found.verdict == Verdict.SKIPPED):
        return (lost or examined.findings)[0]
    return found


def _match_files(patterns: Iterable[str], folder: Path, where: str) -> Iterator[str]:
    """The files that globs mean, seen from a folder. Raises UsageError for one that means none."""
    for pattern in patterns:
        # Path.glob has no absolute patterns
        found = glob.glob(pattern, root_dir=folder, recursive=True) or [pattern]  # noqa: PTH207
        files = sorted(str(path) for path in (folder / name for name in found) if path.is_file())
        if not files:
            raise pytest.UsageError(f"{where}: there is no file '{pattern}' in {folder}.")
        if odd := [path for path in files if not path.lower().endswith(".fmu")]:
            raise pytest.UsageError(f"{where}: '{odd[0]}', which '{pattern}' means, is no FMU.")
        yield from files


def _settings(config: pytest.Config) -> Settings:
    """What the options say. Raises UsageError for what cannot be meant."""
    from ..base.errors import CommandError
    from ..recorders.tubes.tolerance import read_tolerances
    from .examination import check_names
    from .settings import Settings

    only, skip = _texts(config, "fmu_only"), _texts(config, "fmu_skip")
    reference = config.getoption("fmu_reference")
    folder = None if reference is None else config.invocation_params.dir / reference
    try:
        check_names([*only, *skip])
        tolerance = read_tolerances(_texts(config, "fmu_tolerance"))
    except CommandError as error:
        raise pytest.UsageError(str(error)) from None
    if folder is not None and not folder.is_dir():
        raise pytest.UsageError(f"--fmu-reference: there is no folder '{folder}'.")
    return Settings(only=only, skip=skip, reference=folder, tolerance=tolerance)


def _texts(config: pytest.Config, option: str) -> list[str]:
    """What an option says that may be given several times."""
    return config.getoption(option) or []
