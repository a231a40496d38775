"""FMUs with one fault: the check for it reports it, what needs that check is skipped, and all others pass."""

from dataclasses import replace
from pathlib import Path

import pytest

from fmu_verify.catalogue import CHECKS
from fmu_verify.check import Verdict
from fmu_verify.findings import Examined, Finding
from fmu_verify.settings import Settings
from tests.support.broken.asking import examined_all
from tests.support.broken.broken import Broken
from tests.support.broken.dynamic import build_good_fmu
from tests.support.broken.editing import good_bytes
from tests.support.broken.examining import CALLING, examine
from tests.support.broken.layered import LAYERED
from tests.support.broken.static import STATIC
from tests.support.broken.table import BROKEN, FILE, table
from tests.support.broken.third import CLOCKED, INTERVAL, THIRD
from tests.support.broken.wide import WIDE, build_wide_fmu
from tests.support.tiers import mostly_slow

LONG = (
    "instance.cycles",
    "instance.memory",
    "instance.threads",
    "run.deterministic",
    "state.freed",
    "process",
    "sanitizer",
)
"""Checks that take longest."""

SANITIZER = {c.name for c in CHECKS if c.group == "sanitizer"}
LONGEST = {"instance.threads", "process.resources", *SANITIZER}
MAY_BE_SKIPPED = {
    "serializes-nothing": {"state.restored"},  # is not claimed then
    "no-binary": {"sources.compile", *SANITIZER},  # a failure, were there sources
    "cut-library": {"binaries.imports"},
    "no-type": {"binaries.loads"},  # the description cannot be read
    "derivative-of-nothing": {"binaries.loads"},
    "depends-on-nothing": {"binaries.loads"},
    "AsksToEnd": {"state.serialized"},
    "Shared": {"values.shared"},  # they refuse the values that would show it
    "StateEmpty": {"values.state"},
    "UnmappedText": {"values.state"},
    "UnusedAll": {"exchange.interpolation"},  # no input has an effect
    "third-same-reference": SANITIZER,  # its sources refuse one of the start values
    "third-starts": {"binaries.loads", *SANITIZER},
    "third-clock": SANITIZER,
    "third-build": {"sources.compile", *SANITIZER},
    "third-platform": {"binaries.symbols", "binaries.imports"},
}
"""Checks that say themselves why they cannot run on an FMU, by its name."""

SHOWS_ELSEWHERE = {
    "UnmappedText": {"exchange.inputs", "exchange.interpolation"},  # they read Strings, too
    "SharedK": {"values.state"},  # its second instance changes the first one
    "SharedEnabled": {"values.state"},
    "SharedTag": {"values.state"},
    "SharedUsedName": {"values.state"},
    "GetKeep": {"instance.cycles"},  # nor are they freed with the instance
    "SetKeep": {"instance.cycles"},
    "third-directional-second": {"derivatives.adjoint"},
    "StepNothing": {"exchange.interpolation"},  # derivatives of inputs do nothing, either
    "third-clock": {"instance.created"},  # has an event mode then, which the library does not
    "third-directional": {"derivatives.adjoint"},  # is compared with it
    "DerivativesSwapped": {"model_exchange.agrees"},  # only the model has these faults
    "EventKick": {"model_exchange.agrees"},
    "Stale": {"steps.split", "model_exchange.agrees"},  # with other steps, they are late by less
}
"""Other checks that the same fault fails, by the name of the FMU."""

WORDS = {
    "Segfault": ["fmi2DoStep at t = 0.5 s", "SIGSEGV"],
    "Exit": ["fmi2DoStep at t = 0.5 s", "exit code 0"],
    "TerminateCrash": ["fmi2Terminate", "SIGSEGV"],
    "Pending": ["fmi2DoStep at t = 0.5 s", "fmi2Pending"],
    "Hang": ["It did not return from fmi2DoStep at t = 0.5 s within 1.5 s."],
    "AsksToEnd": ["50 of 100 steps"],
    "StateSize": [f"returned {2**60} bytes, which is not a plausible size"],
    "StateEmpty": ["returned 0 bytes, which is not a plausible size"],
    "StepTermItself": ["fmi2DoStep at t = 0 s", "SIGTERM"],
}
"""What the message of an FMU has: the call, the time, and how it ended."""

NEEDS_AN_EXAMINER = (
    *("StepKillParent", "StepKillGroup", "Leak", "StateNotReused", "Exit", "Category", "LogOff"),
    *("RelatedSmokeReference", "RelatedSmokeInput", "RelatedValidationReference"),
)
"""FMUs that would end the process of the tests, leave memory behind, unload what that process has, or read
tables, which a copy of a process cannot do that has read one: the threads of Polars are not copied."""

SAFE_TO_RUN = [b for b in BROKEN if b.check.split(".")[0] not in ("instance", "run", "process", "binaries")]
"""FMUs that do no harm until their check calls them."""

FIRST = {b.check: b for b in reversed(BROKEN)}
IN_MEMORY = [
    b
    for b in (*STATIC, *THIRD, *LAYERED)
    if b.check not in CALLING | {"sources.compile"} and b.name != "bomb"
]
"""FMUs that are made and examined without a compiler, and without a call."""

TAKES_SECONDS = {
    *("Shared", "Reset", "StateNotReused", "Clock", "Range", "Order", "StepFloodErrors", "StepWriteOwn"),
    *("Category", "UnloadAbort", "Leak", "RelatedSmokeReference", "RelatedValidationReference"),
}

BY_DEFAULT = [
    *(b for b in BROKEN if b in IN_MEMORY or b.name in WORDS),
    *(
        b
        for b in FIRST.values()
        if b not in IN_MEMORY
        and b.name not in WORDS
        and b.check not in LONGEST
        and b.name not in TAKES_SECONDS
    ),
]
"""All of those, and one for each check, except where it takes a build with sanitizers, or seconds."""

ORIGINS = {"Clocked": CLOCKED, "Toy3": (*THIRD, *LAYERED), "Toy": STATIC, "Wide": WIDE, "Good": BROKEN}


@pytest.fixture(scope="session")
def good(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Broken]:
    """Return the FMUs before they were broken, by name."""
    folder = tmp_path_factory.mktemp("good")
    (folder / "Toy.fmu").write_bytes(good_bytes())
    (folder / "Toy3.fmu").write_bytes(good_bytes(fmi=3))
    (folder / "Clocked.fmu").write_bytes(good_bytes(fmi=3, clock=INTERVAL))
    build_good_fmu(folder)
    build_wide_fmu(folder)
    build_wide_fmu(folder, "jumps", name="Jumping")
    return {p.stem: Broken(p.stem, "", "", lambda _, p=p: p) for p in folder.iterdir()}


def _is_reported(finding: Finding) -> bool:
    """Return whether a check fails, warns, or passes with a note."""
    return finding.is_noted or finding.verdict in (Verdict.FAILED, Verdict.WARNING)


def _reported(examined: Examined) -> dict[str, str]:
    return {f.check: f.sentence for f in examined.findings if _is_reported(f)}


NOISY = ["steps.split", "model_exchange.agrees"]
"""The toy draws its noise once per step, so that half steps and Model Exchange differ."""

OF_RUNS = ("steps", "run.frozen", "values.late")

NEW_IN_FMI_3 = ("clocks", "steps.events", "calls.arguments", "derivatives", "dependencies.elements", "run")


@pytest.mark.parametrize(
    ("name", "only", "skipped"),
    mostly_slow(
        [
            *((name, (), ()) for name in ("Jumping", *ORIGINS)),
            ("Jumping", OF_RUNS, LONG),
            *((name, (), LONG) for name in ("Good", "Wide")),
            ("Clocked", NEW_IN_FMI_3, LONG),
        ],
        [("Good", (), LONG), ("Clocked", NEW_IN_FMI_3, LONG), ("Jumping", OF_RUNS, LONG)],
    ),
)
def test_good_fmus_pass(
    name: str, only: tuple[str, ...], skipped: tuple[str, ...], good: dict[str, Broken], tmp_path: Path
) -> None:
    settings = Settings(only=only, skip=skipped)
    examined = examine(good[name].build(tmp_path), settings=settings, apart=() if skipped else CALLING)
    assert list(_reported(examined)) == (NOISY if name.startswith("Toy") else [])
    assert examined.passed


@pytest.mark.parametrize("broken", mostly_slow(BROKEN, BY_DEFAULT), ids=lambda broken: broken.name)
def test_fault_is_reported_by_its_check(broken: Broken, tmp_path: Path) -> None:
    if broken.name in NEEDS_AN_EXAMINER:
        settings = replace(broken.settings, only=(broken.check,))
        examined = examined_all([(broken, settings)], tmp_path)[broken.name]
    else:
        separate_checks = CALLING & {broken.check} if broken in SAFE_TO_RUN else CALLING
        examined = examine(
            broken.build(tmp_path), broken.check, settings=broken.settings, apart=separate_checks
        )
    reported = _reported(examined)
    assert list(reported) == [broken.check], reported
    assert examined[broken.check].verdict == broken.verdict
    message = reported[broken.check]
    assert message.endswith(".") and "itself has an error" not in message
    assert all(words in message for words in WORDS.get(broken.name, [])), message


SAMPLE = [FIRST[check] for check in ("archive.format", "variables.attributes", "structure.dependencies")]
FEW = [FIRST[check] for check in ("run.finite", "values.start", "state.restored", "derivatives.directional")]
FIRST_OF_VERSION = list({(b.check, b in (*THIRD, *LAYERED, *CLOCKED)): b for b in reversed(BROKEN)}.values())


def _arguments(broken: Broken) -> pytest.param:
    return pytest.param(broken, marks=pytest.mark.slow if broken in FEW else pytest.mark.nightly)


@pytest.mark.parametrize(
    "broken", [*SAMPLE, *map(_arguments, FIRST_OF_VERSION)], ids=lambda broken: broken.name
)
def test_fault_is_reported_by_no_other_check(
    broken: Broken, good: dict[str, Broken], tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """In the default tier, by no check of the file alone."""
    origin = good[next(name for name, members in ORIGINS.items() if broken in members)]
    if request.node.get_closest_marker("slow") or request.node.get_closest_marker("nightly"):
        settings = replace(broken.settings, skip=tuple({"instance.cycles"} - {broken.check}))
        reports = examined_all([(broken, settings), (origin, settings)], tmp_path)
        examined, before = reports[broken.name], reports[origin.name]
    else:
        settings = Settings(skip=(*CALLING, "sources.compile"))
        examined, before = (examine(b.build(tmp_path), settings=settings) for b in (broken, origin))
    reported = {
        f.check: f.sentence
        for f in examined.findings
        if _is_reported(f) and (f.verdict != before[f.check].verdict or not _is_reported(before[f.check]))
    }
    assert reported.keys() - SHOWS_ELSEWHERE.get(broken.name, set()) == {broken.check}, reported
    for finding in examined.findings:
        assert "has an error" not in finding.sentence
        if finding.verdict == Verdict.SKIPPED and before[finding.check].verdict != Verdict.SKIPPED:
            may = finding.check in MAY_BE_SKIPPED.get(broken.name, ())
            assert may or finding.sentence.startswith("It needs "), finding


def test_every_check_that_can_fail_has_an_fmu_that_fails_it() -> None:
    names = [broken.name for broken in BROKEN]
    assert len(set(names)) == len(names)
    # of what the standard allows
    only_warn = {"binaries.imports", "documents.present"}
    only_warn |= {"description.experiment", "description.semantics"}
    assert {c.name for c in CHECKS} - {b.check for b in BROKEN} == only_warn


def test_documentation_lists_the_broken_fmus() -> None:
    assert FILE.read_text(encoding="utf-8") == table(), "python -m tests.support.broken.table writes it"
