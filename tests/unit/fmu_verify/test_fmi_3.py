"""FMUs of FMI 3.0: ours pass, and gaps are reported."""

from pathlib import Path
from typing import Any

import fmpy
import pytest
from click.testing import CliRunner

import emla_cosim as ec
from emla_cosim.cli.app import app
from emla_cosim.fmu.models import MODELS
from fmu_verify.check import Verdict
from fmu_verify.settings import Settings
from tests.support.broken.editing import Build, good_bytes, setting, with_text
from tests.support.broken.examining import examine
from tests.support.c_programs import needs_cc
from tests.support.hand_written_fmus import build_event_fmu, edit_description

CLOCKED = ["EmlaObserver", "FocController", "RsbaController"]
"""Models to build with a clock."""


def _in_tier(model: str) -> Any:
    is_slow = model in ("EmlaPlant", "FocController", "Reference")
    return pytest.param(model, (), marks=pytest.mark.slow if is_slow else pytest.mark.nightly)


@pytest.mark.parametrize(
    ("model", "options"),
    [
        *(_in_tier(model) for model in MODELS),
        *(pytest.param(model, ("--clock", "1e-3"), marks=pytest.mark.slow) for model in CLOCKED),
    ],
)
def test_our_fmus_pass(model: str, options: tuple[str, ...], tmp_path: Path) -> None:
    to = ["--output", str(tmp_path), "--platform", fmpy.platform, "--fmi", "3", *options]
    assert CliRunner().invoke(app, ["build", model, *to]).exit_code == 0
    (fmu_report,) = ec.verify(tmp_path / model / f"{model}.fmu").examined
    assert fmu_report.passed, fmu_report.of(Verdict.FAILED)
    assert fmu_report.of(Verdict.WARNING) == []
    passed = {"state.serialized", "sanitizer.address"}
    passed |= {"clocks.intervals", "clocks.ticks"} if options else {"reference.agrees"}  # in the FMU
    passed |= {"model_exchange.runs"} if "ModelExchange" in fmu_report.facts["kinds"] else set()
    assert passed <= {f.check for f in fmu_report.of(Verdict.PASSED)}


def test_messages_are_in_terms_of_fmi_3(tmp_path: Path) -> None:
    (path := tmp_path / "Toy.fmu").write_bytes(good_bytes(fmi=3))
    checks = ("archive", "description", "variables", "structure", "run", "calls.arguments")
    fmu_report = examine(path, *checks, apart=())
    assert fmu_report.passed and all(f.clause.document != "FMI 2.0.4" for f in fmu_report.findings)
    texts = [text for f in fmu_report.findings for text in (f.sentence, f.title, f.hint, *f.outcome.gaps)]
    assert not any("fmi2" in text for text in texts)


@pytest.mark.parametrize("clock", ["periodic", "fixed", "changing", "countdown"])
def test_clocks_of_all_kinds_tick(clock: str, tmp_path: Path) -> None:
    """The FMU refuses ticks at other times, and steps over a tick."""
    path = build_event_fmu(tmp_path / "Clocked.fmu", clock=clock)
    fmu_report = examine(path, "run.completes", "state.serialized", "clocks", apart=())
    assert fmu_report["state.serialized"].verdict == Verdict.PASSED, fmu_report.of(Verdict.FAILED)
    assert fmu_report["clocks.ticks"].verdict == Verdict.PASSED
    silent = any("did not tick" in gap for gap in fmu_report["run.completes"].outcome.gaps)
    assert silent == (clock == "countdown")  # its state never reaches the threshold


def test_clock_within_steps_that_cannot_vary_is_reported(tmp_path: Path) -> None:
    path = build_event_fmu(tmp_path / "Clocked.fmu", clock="periodic", varies=False, early=False)
    experiment = '<DefaultExperiment stepSize="0.03"/>'
    edit_description(path, path, "<ModelVariables>", f"{experiment}<ModelVariables>")
    fmu_report = examine(path, "run")
    assert fmu_report["run.completes"].verdict == Verdict.SKIPPED
    (objection,) = fmu_report.objections
    assert "cannot vary its step size" in objection


def without_event_mode(folder: Path) -> Path:
    clock = '<Clock name="c" valueReference="99" causality="input" intervalVariability="triggered"/>'
    return with_text("</ModelVariables>", f"{clock}</ModelVariables>", fmi=3)(folder)


def triggered_from_outside(folder: Path) -> Path:
    return build_event_fmu(folder / "Clocked.fmu", clock="triggered")


@pytest.mark.parametrize(
    ("build", "words"),
    [(without_event_mode, "It has Clocks"), (triggered_from_outside, "triggered from outside")],
)
def test_fmu_with_unsupported_clocks_is_not_called(build: Build, words: str, tmp_path: Path) -> None:
    fmu_report = examine(build(tmp_path), "instance.created", "run")
    assert fmu_report["run.completes"].verdict == Verdict.SKIPPED
    for texts in (fmu_report.objections, fmu_report.not_examined):
        assert any(words in text for text in texts)


@needs_cc
@pytest.mark.slow
@pytest.mark.parametrize("clock", [None, 0.025])
def test_sources_of_fmi_3_run_with_sanitizers(clock: float | None, tmp_path: Path) -> None:
    (tmp_path / "Toy.fmu").write_bytes(good_bytes(fmi=3, clock=clock))
    (fmu_report,) = ec.verify(tmp_path / "Toy.fmu", only=["sanitizer"]).examined
    assert [f.verdict for f in fmu_report.findings] == 3 * [Verdict.PASSED]
    assert not any(f.outcome.gaps for f in fmu_report.findings)


def test_check_of_fmi_3_that_must_run_is_missing_in_fmi_2(tmp_path: Path) -> None:
    (tmp_path / "Toy.fmu").write_bytes(good_bytes())
    fmu_report = examine(tmp_path / "Toy.fmu", "archive", settings=Settings(must_run=("calls.arguments",)))
    assert not fmu_report.passed
    assert "FMI 2.0 does not have" in fmu_report.objections[-1]
    assert "calls.arguments" not in {f.check for f in fmu_report.findings}


OUTPUT = "ModelStructure/Output[@valueReference='16']"


@pytest.mark.parametrize(
    ("path", "attribute", "check", "words"),
    [
        (OUTPUT, "valueReference", "structure.outputs", "Output lists"),
        (OUTPUT, "dependencies", "structure.dependencies", "inverse in Output depends on"),
        ("//*[@name='der(x)']", "derivative", "structure.derivatives", "der(x) is the derivative of"),
    ],
)
def test_unknown_value_reference_is_named(
    path: str, attribute: str, check: str, words: str, tmp_path: Path
) -> None:
    finding = examine(setting(path, fmi=3, **{attribute: "77"})(tmp_path), check)[check]
    assert finding.verdict == Verdict.FAILED
    assert f"{words} value reference 77, which no variable has" in finding.sentence
    assert finding.clause.document == "FMI 3.0.2"


def test_values_that_no_check_reads_are_named(tmp_path: Path) -> None:
    variables = (
        '<Binary name="blob" valueReference="98" causality="local"/>'
        '<UInt64 name="n" valueReference="99" causality="structuralParameter" start="2"/>'
    )
    build = with_text("</ModelVariables>", f"{variables}</ModelVariables>", fmi=3)
    fmu_report = examine(build(tmp_path), "description", "variables")
    assert not fmu_report.of(Verdict.FAILED)
    assert "Values of Binary variables were not examined: blob." in fmu_report.not_examined
    assert "Other values of structural parameters were not examined: n." in fmu_report.not_examined
