"""Sanitizers: sound sources pass, reports are read, and gaps are reported."""

from pathlib import Path

import pytest

from fmu_verify.check import Verdict
from fmu_verify.checks import sanitizer
from fmu_verify.sanitizer import compiling, run
from fmu_verify.sanitizer.run import Leak, read_leaks, read_memory_error, read_undefined
from fmu_verify.settings import Settings
from fmu_verify.subject import Subject
from tests.support.broken.examining import unpacked
from tests.support.broken.memory import build_memory_fmu

Patch = pytest.MonkeyPatch
ALL = (sanitizer.address, sanitizer.leaks, sanitizer.undefined)

SOURCES = Path("/fmu/sources")
OVERRUN = """heap-buffer-overflow on address 0x60 at pc 0x1 bp 0x2 sp 0x3
WRITE of size 8 at 0x60 thread T0
    #0 0x7f1 in __interceptor_memcpy ../../libsanitizer/interceptors.inc:827
    #1 0x7f2 in keep /fmu/sources/deep/keep.c:12
    #2 0x7f3 in fmi2SetReal /fmu/sources/model.c:30
    #3 0x7f4 in main /host.c:5

0x60 is located 0 bytes to the right of 8-byte region
allocated by thread T0 here:
    #0 0x7f5 in malloc
    #1 0x7f6 in fmi2Instantiate /fmu/sources/model.c:3
"""
LEAKS = """==7==ERROR: LeakSanitizer: detected memory leaks

Direct leak of 100 byte(s) in 1 object(s) allocated from:
    #0 0x7f1 in __interceptor_malloc ../malloc.cpp:69
    #1 0x7f2 in fmi2Instantiate /fmu/sources/model.c:33

Indirect leak of 20 byte(s) in 1 object(s) allocated from:
    #0 0x7f1 in __interceptor_malloc ../malloc.cpp:69
    #1 0x7f2 in fmi2Instantiate /fmu/sources/model.c:33

Direct leak of 9 byte(s) in 1 object(s) allocated from:
    #0 0x7f1 in __interceptor_malloc ../malloc.cpp:69
    #1 0x7f2 in dlerror /other/library.c:33

SUMMARY: AddressSanitizer: 129 byte(s) leaked in 3 allocation(s).
"""


@pytest.mark.slow
def test_sound_sources_pass_and_both_kinds_run(tmp_path: Path) -> None:
    if not compiling.list_compilers()[0].has_address:
        pytest.skip("There is no compiler with AddressSanitizer.")
    subject = unpacked(build_memory_fmu(tmp_path))
    outcomes = [check.examine(subject) for check in ALL]
    assert [o.verdict for o in outcomes] == [Verdict.PASSED] * 3, outcomes
    assert not any(o.gaps for o in outcomes)
    result = run.run_sanitized(subject)
    assert result.ran and result.judges_leaks


@pytest.mark.parametrize(("text", "sentence"), [
    (OVERRUN, "writes 8 bytes outside of allocated memory in keep (deep/keep.c:12), called by fmi2SetReal."),
    ("attempting double-free on 0x60 in thread T0:\n", "frees memory twice in fmi2Reset."),
    ("SEGV on unknown address 0x0\nThe signal is caused by a READ\n",
        "reads at an invalid address in fmi2Reset."),
])  # fmt: skip
def test_error_has_its_line_and_the_function_of_the_standard(text: str, sentence: str) -> None:
    fault = read_memory_error(f"==7==ERROR: AddressSanitizer: {text}", SOURCES, "fmi2Reset")
    assert fault is not None and fault.sentence == f"It {sentence}"
    assert read_memory_error("nothing", SOURCES) is None


def test_only_leaks_of_the_sources_count() -> None:
    assert read_leaks(LEAKS, SOURCES) == [Leak(120, "fmi2Instantiate (model.c:33)")]


def test_undefined_behavior_is_read_from_gcc_and_zig() -> None:
    text = (
        "/fmu/sources/model.c:7:3: runtime error: store to misaligned address 0x61 for type 'int'\n"
        "/fmu/sources/model.c:7:3: runtime error: store to misaligned address 0x65 for type 'int'\n"
        "/other/host.c:7:3: runtime error: shift exponent 32 is too large\n"
        "thread 9 panic: signed integer overflow: 1 + 2\n/fmu/sources/model.c:9:4: 0x7f in f (model.c)\n"
    )
    assert read_undefined(text, SOURCES) == [
        "model.c:7: store to misaligned address for type 'int'.",
        "model.c:9: signed integer overflow: 1 + 2.",
    ]


def test_machine_without_sanitizers_skips(tmp_path: Path, monkeypatch: Patch) -> None:
    lacking = compiling.Compiler(("false",), (), has_address=True)
    monkeypatch.setattr(run, "list_compilers", lambda: [lacking])
    outcome = sanitizer.address.examine(unpacked(build_memory_fmu(tmp_path)))
    assert outcome.verdict == Verdict.SKIPPED and not outcome.blocked
    assert "has no sanitizers" in outcome.sentence and outcome.gaps == (outcome.sentence,)


def test_zig_judges_only_what_is_undefined(tmp_path: Path, monkeypatch: Patch) -> None:
    undefined = run.SanitizedRun(has_address=False, ran=True, undefined=("model.c:1: it overflows.",))
    monkeypatch.setattr(sanitizer, "run_sanitized", lambda _: undefined)
    outcomes = [check.examine(Subject(tmp_path / "X.fmu", tmp_path)) for check in ALL]
    assert [o.verdict for o in outcomes] == [Verdict.SKIPPED, Verdict.SKIPPED, Verdict.FAILED]
    assert sanitizer.undefined.advisory  # so that it only warns


def test_sources_that_do_not_run_are_skipped(monkeypatch: Patch, tmp_path: Path) -> None:
    still = run.SanitizedRun(has_address=True, gaps=("CoSimulation: fmi2Instantiate answered NULL.",))
    monkeypatch.setattr(sanitizer, "run_sanitized", lambda _: still)
    outcome = sanitizer.address.examine(Subject(tmp_path / "X.fmu", tmp_path))
    assert (outcome.verdict, outcome.gaps) == (Verdict.SKIPPED, still.gaps)
    assert "answered NULL" in outcome.sentence


def test_sources_that_do_not_compile_in_time_are_not_examined(tmp_path: Path) -> None:
    outcome = sanitizer.address.examine(unpacked(build_memory_fmu(tmp_path), Settings(seconds=1e-4)))
    assert outcome.verdict == Verdict.SKIPPED and outcome.gaps


def test_build_description_lists_sources_and_macros(tmp_path: Path) -> None:
    subject = unpacked(build_memory_fmu(tmp_path))
    text = (
        '<fmiBuildDescription fmiVersion="3.0"><BuildConfiguration modelIdentifier="Memory">'
        '<SourceFileSet><SourceFile name="good.c"/><PreprocessorDefinition name="A" value="3"/>'
        "</SourceFileSet></BuildConfiguration></fmiBuildDescription>"
    )
    (subject.folder / "sources" / "buildDescription.xml").write_text(text)
    sources = compiling.find_sources(subject, "CoSimulation")
    assert sources is not None
    assert ([p.name for p in sources.files], sources.macros) == (["good.c"], ("-DA=3",))
