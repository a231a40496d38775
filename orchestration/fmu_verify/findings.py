"""The findings about FMUs, and what reports say of them."""

import shlex
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from .check import CheckOutcome, Clause, Verdict
from .settings import Settings


@dataclass(frozen=True)
class Finding:
    """Outcome of one check of one FMU.

    Attributes:
        check: name of the check.
        title: one line on what it checks.
        outcome: verdict, message and details.
        clause: section of the standard that the check is based on.
        hint: what to do about it.
        seconds: duration in s.
        done: what was done to find it.
    """

    check: str
    title: str
    outcome: CheckOutcome
    clause: Clause
    hint: str
    seconds: float
    done: str = ""

    @property
    def verdict(self) -> Verdict:
        """Verdict of the check."""
        return self.outcome.verdict

    @property
    def sentence(self) -> str:
        """What was found, as one message."""
        return self.outcome.sentence

    @property
    def is_noted(self) -> bool:
        """Whether it passed with a note, because no sentence of the standard judges what was found."""
        return self.verdict == Verdict.PASSED and self.sentence in self.outcome.gaps


@dataclass(frozen=True)
class Examined:
    """Findings for one FMU or one system, in the order of the checks.

    Attributes:
        path: path of the file.
        facts: model, generation tool, kinds, platforms, size and SHA-256, by name.
        findings: one for each check.
        seconds: duration in s.
        name: name that the report uses; empty for the path.
        objections: why it does not pass, in addition to failed checks.
        not_examined: what could not be judged, as sentences.
        options: options of `emla verify` that a command needs to repeat a check.
    """

    path: Path
    facts: dict[str, str]
    findings: tuple[Finding, ...]
    seconds: float
    name: str = ""
    objections: tuple[str, ...] = ()
    not_examined: tuple[str, ...] = ()
    options: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Name of the file in reports: its name if it has one, otherwise its path."""
        return self.name or str(self.path)

    @property
    def file(self) -> Path:
        """The file on the disk: the package, if the FMU is in one."""
        return next((p for p in self.path.parents if p.suffix.lower() in (".ssp", ".ssd")), self.path)

    def of(self, verdict: Verdict) -> list[Finding]:
        """Return the findings with this verdict."""
        return [f for f in self.findings if f.verdict == verdict]

    def __getitem__(self, check: str) -> Finding:
        """Return the finding of a check by name.

        Raises:
            KeyError: The check was not selected.
        """
        for finding in self.findings:
            if finding.check == check:
                return finding
        raise KeyError(check)

    @property
    def passed(self) -> bool:
        """Whether no check failed, and there is no other objection."""
        return not self.of(Verdict.FAILED) and not self.objections


@dataclass(frozen=True)
class Findings:
    """The findings about all FMUs. `Report` writes them to files."""

    examined: tuple[Examined, ...]
    version: str
    """Version of EMLA-Cosim."""
    started: str
    """Start time in ISO 8601."""
    complete: bool = True
    """Whether all checks ran; false after an interruption."""

    @property
    def passed(self) -> bool:
        """Whether all checks ran, and all FMUs passed."""
        return self.complete and all(examined.passed for examined in self.examined)

    @property
    def failures(self) -> list[tuple[Path, Finding]]:
        """Every failed check, with the path of its FMU."""
        return [(examined.path, f) for examined in self.examined for f in examined.of(Verdict.FAILED)]

    @property
    def counts(self) -> Counter[Verdict]:
        """The number of checks with each verdict."""
        return Counter(f.verdict for examined in self.examined for f in examined.findings)

    def __getitem__(self, path: str | Path) -> Examined:
        """Return the findings about one FMU by its name, path or file name.

        Raises:
            KeyError: The report has no such FMU.
        """
        for examined in self.examined:
            if str(path) in (examined.label, str(examined.path), examined.path.name):
                return examined
        raise KeyError(str(path))


def find_worst(findings: Sequence[Finding]) -> Verdict:
    """Return the worst verdict: failed, warning, passed; skipped if all checks were skipped."""
    verdicts = {f.verdict for f in findings}
    # a skipped check says nothing about an FMU that passes others
    order = (Verdict.FAILED, Verdict.WARNING, Verdict.PASSED)
    return next((v for v in order if v in verdicts), Verdict.SKIPPED)


def shorten_names(names: Sequence[str]) -> list[str]:
    """Shorten paths to the last parts that distinguish them."""
    paths = [Path(name) for name in names]
    short_names = [path.name for path in paths]
    for depth in range(2, max((len(p.parts) for p in paths), default=0) + 1):
        count = Counter(short_names)
        clashes = {n for n, k in count.items() if k > 1}
        short_names = [
            "/".join(p.parts[-depth:]) if n in clashes else n for p, n in zip(paths, short_names, strict=True)
        ]
    return short_names


def explain_finding(examined: Examined, finding: Finding, most: int | None = None) -> str:
    """Return message, at most `most` details, clause, what was done, hint and the command to repeat it."""
    details = list(finding.outcome.details[:most])
    if more := len(finding.outcome.details) - len(details):
        details.append(f"and {more} more")
    clause = f"{finding.clause}: \u201c{finding.clause.sentence}\u201d"
    procedure = f"What was done: {finding.done}" if finding.done else ""
    repeat = f"Repeat it: {format_command(examined, finding)}"
    parts = (finding.sentence, "\n".join(details), clause, procedure, finding.hint, repeat)
    return "\n\n".join(part for part in parts if part)


def list_options(settings: Settings) -> tuple[str, ...]:
    """Return the options of `emla verify` that change what a check finds, if they are not the defaults."""
    plain = Settings()
    options: list[str] = []
    if settings.reference is not None:
        options += ["--reference", str(settings.reference)]
    for pattern, tolerance in settings.tolerance.items():
        parts = [f"{name}:{value!r}" for name, value in vars(tolerance).items() if value is not None]
        options += ["--tolerance", f"{pattern}={','.join(parts)}"] if parts else []
    if settings.seconds != plain.seconds:
        options += ["--seconds", f"{settings.seconds:g}"]
    if settings.memory != plain.memory:
        options += ["--memory", f"{settings.memory / 2**20:g}"]
    return tuple(options)


def format_command(examined: Examined, finding: Finding) -> str:
    """Return the command that repeats a check and explains what it finds."""
    only = [] if finding.check.startswith("system.") else ["--only", finding.check]
    file = f"./{examined.file}" if str(examined.file).startswith("-") else str(examined.file)  # no option
    return shlex.join(["emla", "verify", file, *only, "--explain", *examined.options])
