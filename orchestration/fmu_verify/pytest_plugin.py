"""`pytest --fmu 'build/*.fmu'`: every check of every FMU is a test.

    build/Plant.fmu::state.restored

pytest loads this module in every environment with this package. Therefore it imports the rest of the
package only when there is an FMU to verify.
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
"""Paths of the FMUs."""

_SHARED = pytest.StashKey[TemporaryDirectory[str]]()
"""Folder in which workers of pytest-xdist share their findings."""

_MOST_DETAILS = 20
"""Most lines of details in a failure."""


class FmuWarning(UserWarning):
    """A check warned: the standard allows it, but it causes problems for some users."""


class FmuFailure(Exception):  # noqa: N818 - a finding, not an error of the program
    """A check failed. The text is that of `explain_finding`."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options."""
    group = parser.getgroup("fmu", "verification of FMUs, like `emla verify`")
    group.addoption("--fmu", action="append", default=[], metavar="GLOB", help="FMUs to verify (repeatable).")
    group.addoption(
        "--fmu-reference", metavar="DIR", help="Folder of reference files. Default: next to each FMU."
    )
    for name, help_ in (
        ("only", "Run only this check, group or pattern (repeatable)."),
        ("skip", "Skip this check, group or pattern (repeatable)."),
    ):
        group.addoption(f"--fmu-{name}", action="append", default=[], metavar="CHECK", help=help_)
    group.addoption(
        "--fmu-tolerance",
        action="append",
        default=[],
        metavar="[PATTERN=]NUMBER",
        help="Width of tubes, relative to a signal's range (repeatable). Default: 1e-3.",
    )
    parser.addini("fmus", "FMUs to verify if no paths are given: globs.", type="linelist", default=[])


def pytest_configure(config: pytest.Config) -> None:
    """Register the marker of these tests."""
    config.addinivalue_line("markers", "fmu(check, group): a check of an FMU, as in `emla verify`.")


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Find the FMUs before collection. Workers of pytest-xdist receive their list."""
    config = session.config
    if (shared := _read_worker_data(config)) is not None:
        config.stash[_FMUS] = shared["fmus"]
        return
    paths = list(_match_files(_read_option(config, "fmu"), config.invocation_params.dir, "--fmu"))
    if config.args_source != pytest.Config.ArgsSource.ARGS:
        paths += _match_files(config.getini("fmus"), config.rootpath, "fmus")
    if paths:
        _read_settings(config)  # report errors in options once, not for each FMU
    config.stash[_FMUS] = list(dict.fromkeys(paths))


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """Send a worker of pytest-xdist the list of FMUs and the shared folder."""
    config: pytest.Config = node.config
    if _SHARED not in config.stash:
        config.stash[_SHARED] = TemporaryDirectory(prefix="emla-verify-")
        config.add_cleanup(config.stash[_SHARED].cleanup)
    node.workerinput["emla_verify"] = {"fmus": config.stash[_FMUS], "folder": config.stash[_SHARED].name}


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Collect an FMU that is an argument, as in `pytest build/x.fmu::state.restored`. Ignore others."""
    if file_path.suffix.lower() == ".fmu" and parent.session.isinitpath(file_path):
        return FmuCollector.from_parent(parent, path=file_path)
    return None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(session: pytest.Session, items: list[pytest.Item]) -> None:
    """Add the tests of the FMUs before tests are deselected.

    The FMUs cannot be arguments of pytest: it ignores arguments inside of others, and folders like `build`.
    """
    collected = {item.path for item in items if isinstance(item, FmuItem)}
    for path in map(Path, session.config.stash[_FMUS]):
        if path not in collected:
            items += session.genitems(FmuCollector.from_parent(session, path=path))


class FmuCollector(pytest.File):
    """An FMU. Its tests are the checks."""

    _examined: Examined | None = None

    def collect(self) -> Iterator[FmuItem]:
        """Yield a test for each selected check."""
        from .examination import select_checks

        for check in select_checks(_read_settings(self.config)):
            item = FmuItem.from_parent(self, name=check.name)
            item.add_marker(pytest.mark.fmu(check=check.name, group=check.group))
            yield item

    def examine_item(self, item: FmuItem) -> tuple[Examined, Finding | None]:
        """Return all findings, and that of a check, or of a failed check that it needs and is not selected.

        It is None for a check of what another version of FMI has.

        The first request runs all selected checks, in whichever worker it comes from.
        """
        selected = [i.name for i in self.session.items if i.parent is self]
        if self._examined is None:
            self._examined = self._share_result(lambda: self._verify(selected))
        return self._examined, _find_finding(item.name, self._examined, selected)

    def _share_result(self, do: Callable[[], Examined]) -> Examined:
        """Call `do` in one worker of pytest-xdist and share the result with all."""
        shared = _read_worker_data(self.config)
        if shared is None:
            return do()
        from .compute_once import compute_once

        name = hashlib.sha256(os.fsencode(self.path)).hexdigest()
        return compute_once(Path(shared["folder"], name), do)

    def _verify(self, checks: list[str]) -> Examined:
        from .runner import verify

        options = _read_settings(self.config)
        report = verify(
            self.path,
            reference=options.reference,
            tolerance=options.tolerance,
            only=checks,
            skip=options.skip,
        )
        return report.examined[0]


class FmuItem(pytest.Item):
    """One check of an FMU."""

    def runtest(self) -> None:
        """Fail, skip or warn according to the verdict."""
        from .check import Verdict
        from .findings import explain_finding

        assert isinstance(self.parent, FmuCollector)
        examined, finding = self.parent.examine_item(self)
        if finding is None:
            reason = f"{self.name}: the FMI version of the FMU does not have it."
            raise pytest.skip.Exception(reason, _use_item_location=True)
        text = explain_finding(examined, finding, _MOST_DETAILS)
        if finding.verdict == Verdict.FAILED:
            needed = "" if finding.check == self.name else f"It needs {finding.check}, which failed. "
            raise FmuFailure(needed + text)
        # what could not be examined must not look as if it had passed
        if finding.verdict == Verdict.SKIPPED and finding.outcome.blocked and not self._has_cause(finding):
            raise FmuFailure(f"It could not run. {text}")
        if finding.verdict == Verdict.SKIPPED:
            raise pytest.skip.Exception(f"{self.name}: {finding.sentence}", _use_item_location=True)
        if finding.verdict == Verdict.WARNING:
            warnings.warn_explicit(FmuWarning(text), None, str(self.path), 0)

    def _has_cause(self, finding: Finding) -> bool:
        """Return whether a check could not run because of another one that has a test."""
        return any(
            finding.sentence.startswith(f"It needs {item.name},")
            for item in self.session.items
            if item.parent is self.parent
        )

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Show the finding without a traceback."""
        from emla_cosim.base.errors import CosimError

        if isinstance(excinfo.value, (FmuFailure, FmuWarning, CosimError)):
            return _FailureText(self.reportinfo()[0], str(excinfo.value))
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int, str]:
        """Return the path, the line and the headline."""
        return self.path, 0, f"{self.name} of {self.path.name}"


@dataclass(frozen=True)
class _Crash:
    """Location and message for summaries and JUnit files, as pytest expects them."""

    path: Path
    message: str

    def __str__(self) -> str:
        return f"{self.path}: {self.message}"


class _FailureText:
    """A failure in the form that pytest displays."""

    def __init__(self, path: Path, text: str) -> None:
        self.text = text
        self.reprcrash = _Crash(path, text.partition("\n")[0])

    def __str__(self) -> str:
        return self.text

    def toterminal(self, terminal: Any) -> None:
        """Write the failure to the terminal."""
        first, _, rest = self.text.partition("\n")
        terminal.line(first, red=True, bold=True)
        terminal.line(rest)


def _read_worker_data(config: pytest.Config) -> dict[str, Any] | None:
    """Return the data sent to this worker of pytest-xdist; None in other processes."""
    return getattr(config, "workerinput", {}).get("emla_verify")


def _find_finding(check: str, examined: Examined, selected: Container[str]) -> Finding | None:
    """Return the finding of a check, or one that explains its lack: a failed check without a test, if any.

    None for a check of another version of FMI without such a failure.
    """
    from .catalogue import CHECKS
    from .check import Verdict

    untested_failures = [f for f in examined.of(Verdict.FAILED) if f.check not in selected]
    finding = next((f for f in examined.findings if f.check == check), None)
    if finding is None and any(c.name == check and c.only_for for c in CHECKS):
        return next(iter(untested_failures), None)
    if finding is None or (untested_failures and finding.verdict == Verdict.SKIPPED):
        return (untested_failures or examined.findings)[0]
    return finding


def _match_files(patterns: Iterable[str], folder: Path, where: str) -> Iterator[str]:
    """Yield the files that match globs, relative to a folder. Raise UsageError if a glob matches none."""
    for pattern in patterns:
        # Path.glob has no absolute patterns
        names = glob.glob(pattern, root_dir=folder, recursive=True) or [pattern]  # noqa: PTH207
        files = sorted(str(path) for path in (folder / name for name in names) if path.is_file())
        if not files:
            raise pytest.UsageError(f"{where}: there is no file '{pattern}' in {folder}.")
        if no_fmus := [path for path in files if not path.lower().endswith(".fmu")]:
            raise pytest.UsageError(f"{where}: '{no_fmus[0]}', which matches '{pattern}', is not an FMU.")
        yield from files


def _read_settings(config: pytest.Config) -> Settings:
    """Read the options. Raise UsageError for invalid ones."""
    from emla_cosim.base.errors import CommandError
    from emla_cosim.base.tolerances import read_tolerances

    from .examination import check_names
    from .settings import Settings

    only, skip = _read_option(config, "fmu_only"), _read_option(config, "fmu_skip")
    reference = config.getoption("fmu_reference")
    folder = None if reference is None else config.invocation_params.dir / reference
    try:
        check_names([*only, *skip])
        tolerance = read_tolerances(_read_option(config, "fmu_tolerance"))
    except CommandError as error:
        raise pytest.UsageError(str(error)) from None
    if folder is not None and not folder.is_dir():
        raise pytest.UsageError(f"--fmu-reference: there is no folder '{folder}'.")
    return Settings(only=only, skip=skip, reference=folder, tolerance=tolerance)


def _read_option(config: pytest.Config, option: str) -> list[str]:
    """Return the values of a repeatable option."""
    return config.getoption(option) or []
