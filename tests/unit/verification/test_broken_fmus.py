"""FMUs with one thing wrong: the check for it says so, what needs that is skipped, and all others pass.

Every check of every FMU: EMLA_ALL_CHECKS=1 pytest -m slow tests/unit/verification/test_broken_fmus.py
"""

import os
from dataclasses import replace

import pytest

import emla_cosim as ec
from emla_cosim.verification.catalogue import CHECKS
from emla_cosim.verification.catalogue import DYNAMIC as DYNAMIC_CHECKS
from emla_cosim.verification.findings import Examined, Finding
from emla_cosim.verification.verdict import Verdict
from tests.support.broken.asking import examined_all
from tests.support.broken.broken import Broken
from tests.support.broken.clocked import CLOCKED, INTERVAL
from tests.support.broken.dynamic import DYNAMIC, Fault, build_good_fmu
from tests.support.broken.editing import good_bytes
from tests.support.broken.static import STATIC
from tests.support.broken.table import BROKEN, table
from tests.support.broken.third import THIRD
from tests.support.broken.wide import WIDE, build_wide_fmu
from tests.support.paths import ROOT
from tests.support.tiers import mostly_slow

ALL = bool(os.environ.get("EMLA_ALL_CHECKS"))
SLOW = ["instance.cycles", "instance.threads", "instance.independent", "instance.reset", "run.deterministic"]
WORSE = (Verdict.FAILED, Verdict.WARNING)
SANITIZER = {c.name for c in CHECKS if c.group == "sanitizer"}
MAY_BE_SKIPPED = {
    "serializes-nothing": {"state.restored"},  # is not claimed then
    "no-binary": {"sources.compile"},  # a failure, were there sources
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
    "third-platform": {"binaries.symbols"},
}
"""Checks that say themselves why they cannot be done on an FMU, by its name."""

SHOWS_ELSEWHERE = {
    "UnmappedText": {"exchange.inputs", "exchange.interpolation"},  # they read Strings, too
    "SharedK": {"values.state"},  # its second instance changes the first one
    "SharedEnabled": {"values.state"},
    "SharedTag": {"values.state"},
    "StepNothing": {"exchange.interpolation"},  # derivatives of inputs do nothing, either
    "third-clock": {"instance.created"},  # has an event mode then, which the library does not
    "third-directional": {"derivatives.adjoint"},  # is compared with it
    "Stale": {"steps.split", "model_exchange.agrees"},  # with other steps, they are late by less
}
"""Other checks that the same fault fails, by the name of the FMU."""


Request, Folders = pytest.FixtureRequest, pytest.TempPathFactory


@pytest.fixture(scope="module")
def good(tmp_path_factory: Folders) -> dict[str, Examined]:
    """What is found about the FMUs that were broken, before they were: by the name of the file."""
    folder = tmp_path_factory.mktemp("good")
    (folder / "Toy.fmu").write_bytes(good_bytes())
    (folder / "Toy3.fmu").write_bytes(good_bytes(fmi=3))
    (folder / "Clocked.fmu").write_bytes(good_bytes(fmi=3, clock=INTERVAL))
    names = ("Toy.fmu", "Toy3.fmu", "Clocked.fmu")
    report = ec.verify([*(folder / name for name in names), build_good_fmu(folder), build_wide_fmu(folder)])
    return {one.path.stem: one for one in report.examined}


@pytest.fixture(scope="module")
def asked_one(request: Request, tmp_path_factory: Folders) -> dict[str, Examined]:
    """What its check, and what that needs, find about each broken FMU, by the FMU's name."""
    asked = [(b, replace(b.settings, only=(b.check,))) for b in _broken(request, "asked_one")]
    return examined_all(asked, tmp_path_factory.mktemp("one"))


@pytest.fixture(scope="module")
def asked_all(request: Request, tmp_path_factory: Folders) -> dict[str, Examined]:
    """What all checks find."""
    asked = [(b, replace(b.settings, skip=_skipped(b))) for b in _broken(request, "asked_all")]
    return examined_all(asked, tmp_path_factory.mktemp("all"))


def _broken(request: Request, fixture: str) -> list[Broken]:
    """Broken FMUs that the selected tests of a fixture are to look at."""
    found = {}
    for item in request.session.items:
        if item.path == request.path and fixture in getattr(item, "fixturenames", ()):
            broken: Broken = item.callspec.params["broken"]  # type: ignore[attr-defined]
            found[broken.name] = broken
    return list(found.values())


def _skipped(broken: Broken) -> list[str]:
    """Slow checks of runs, where a run is that of the good FMU: all are done with EMLA_ALL_CHECKS=1."""
    if ALL:
        return []
    if broken in STATIC:
        return [g for g in {c.group for c in DYNAMIC_CHECKS} if g not in ("instance", "run")] + SLOW
    return [] if broken.check in SLOW else ["instance.cycles"]


def _is_told(finding: Finding) -> bool:
    """Whether a check fails, warns, or passes with a note."""
    noted = finding.verdict == Verdict.PASSED and finding.sentence in finding.outcome.gaps
    return noted or finding.verdict in WORSE


def test_the_good_ones_pass(good: dict[str, Examined]) -> None:
    """The toy draws its noise once per step, so that half steps and Model Exchange differ; that is said."""
    told = {name: [f.check for f in one.findings if _is_told(f)] for name, one in good.items()}
    noisy = ["steps.split", "model_exchange.agrees"]
    assert told == {"Toy": noisy, "Toy3": noisy, "Clocked": [], "Good": [], "Wide": []}
    assert not any(one.of(Verdict.FAILED) for one in good.values())


FIRST = list({b.check: b for b in reversed(BROKEN)}.values())
"""One broken FMU for each check."""

FIRST_OF_VERSION = list({(b.check, b in (*THIRD, *CLOCKED)): b for b in reversed(BROKEN)}.values())
"""One broken FMU for each check and version of FMI."""


@pytest.mark.parametrize("broken", mostly_slow(BROKEN, FIRST), ids=lambda broken: broken.name)
def test_a_fault_is_told_by_its_check(broken: Broken, asked_one: dict[str, Examined]) -> None:
    found = asked_one[broken.name]
    told = {f.check: f.sentence for f in found.findings if _is_told(f)}
    assert list(told) == [broken.check], told
    assert found[broken.check].verdict == broken.verdict
    assert told[broken.check].endswith(".") and "itself has an error" not in told[broken.check]


FEW = [
    next(b for b in BROKEN if b.check.startswith(f"{group}."))
    for group in ("archive", "binaries", "description", "variables", "run", "state", "derivatives")
]
"""One broken FMU for each of the groups of checks that say most."""


@pytest.mark.parametrize(
    "broken", mostly_slow(BROKEN if ALL else FIRST_OF_VERSION, FEW), ids=lambda broken: broken.name
)
def test_one_fault_is_told_by_no_other_check(
    broken: Broken, asked_all: dict[str, Examined], good: dict[str, Examined]
) -> None:
    found = asked_all[broken.name]
    before = good[
        "Clocked"
        if broken in CLOCKED
        else "Toy3"
        if broken in THIRD
        else "Toy"
        if broken in STATIC
        else "Wide"
        if broken in WIDE
        else "Good"
    ]
    told = {
        f.check: f.sentence
        for f in found.findings
        if _is_told(f) and (f.verdict != before[f.check].verdict or not _is_told(before[f.check]))
    }
    assert told.keys() - SHOWS_ELSEWHERE.get(broken.name, set()) == {broken.check}, told
    for finding in found.findings:
        assert "has an error" not in finding.sentence
        if finding.verdict == Verdict.SKIPPED and before[finding.check].verdict != Verdict.SKIPPED:
            may = finding.check in MAY_BE_SKIPPED.get(broken.name, ())
            assert may or finding.sentence.startswith("It needs "), finding


@pytest.mark.parametrize(
    "broken", [b for b in BROKEN if b.name in ("StateSize", "StateEmpty")], ids=lambda broken: broken.name
)
def test_a_size_that_no_state_has_is_told(broken: Broken, asked_one: dict[str, Examined]) -> None:
    size = {"StateSize": 2**60, "StateEmpty": 0}[broken.name]
    sentence = asked_one[broken.name]["state.serialized"].sentence
    assert f"returned {size} bytes, which is not a plausible size" in sentence


def test_there_are_many_ways_to_be_wrong() -> None:
    names = [broken.name for broken in BROKEN]
    assert len(set(names)) == len(names) >= 90
    assert len([b for b in BROKEN if b.verdict == Verdict.FAILED]) >= 70
    assert len(DYNAMIC) == len({*Fault} - {Fault.ONLY_ONCE})  # which is no fault where it is said


def test_every_check_that_can_fail_has_an_fmu_that_fails_it() -> None:
    """Else nobody knows whether it says anything; these only warn, of what the standard allows."""
    only_warn = {
        "archive.layout",
        "binaries.imports",
        "description.experiment",
        "description.semantics",
        "documents.present",
    }
    assert {c.name for c in CHECKS} - {b.check for b in BROKEN} == only_warn


def test_the_documentation_lists_them() -> None:
    page = (ROOT / "docs" / "verify.md").read_text(encoding="utf-8")
    assert table() in page, "python -m tests.support.broken.table writes it"
