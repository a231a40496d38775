"""Files with roles of FMI-LS-REF in FMUs: all are used or judged, and the rest is reported."""

from pathlib import Path

import pytest

import emla_cosim as ec
from fmu_verify.check import Verdict
from fmu_verify.findings import Finding
from fmu_verify.settings import Settings
from tests.support.broken.dynamic import build_good_fmu
from tests.support.broken.examining import examine
from tests.support.broken.related import (
    EXPERIMENTS,
    RISING,
    SSV,
    Related,
    build_with_related,
    checksum,
    experiment,
    meta_data,
    parameter_set,
    serialized_state,
)

SRMD = "application/x-srmd-meta-data"
BYTES = "application/octet-stream"
AT_REST = "time,moving\n0,0\n0.05,0\n"


def check(folder: Path, related: Related, name: str) -> Finding:
    """Return the finding of a check on the good FMU with related files."""
    name = f"related.{name}"
    return examine(build_with_related(folder, "Good", related), name, apart=())[name]


def test_all_roles_together(tmp_path: Path) -> None:
    """A parameter set, input, results, a state, and meta-data with a checksum."""
    gain = parameter_set(gain=0.0)
    inside = '<Parameters source="p.ssv"/><Stimuli source="in.csv"/><References source="sub/my%20ref.csv"/>'
    setup = experiment(inside, startTime=0, stopTime=0.05, stepSize=0.01, tolerance=1e-4)
    path = build_with_related(
        tmp_path,
        "Good",
        {
            "smoke.exp": ("experiment", EXPERIMENTS, experiment()),
            "validation.exp": ("experiment/validation", EXPERIMENTS, setup),
            "uncertainty.exp": ("experiment/uncertainty-analysis", EXPERIMENTS, experiment()),
            "p.ssv": ("parameter", SSV, gain),
            "in.csv": ("", "", RISING),
            "sub/my ref.csv": ("", "", AT_REST),
            "a.state": ("serialized-state", BYTES, serialized_state()),
            "m.srmd": ("meta-data", SRMD, meta_data(name="m", data="p.ssv", checksum=checksum(gain))),
        },
    )
    examined = examine(path, "related", apart=())
    outcomes = {
        f.check: (f.verdict, f.outcome.gaps) for f in examined.findings if f.check.startswith("related")
    }
    varied = "Nothing was varied: the format of experiments does not say what to vary."
    assert outcomes.pop("related.uncertainty") == (Verdict.PASSED, (varied,))
    assert set(outcomes.values()) == {(Verdict.PASSED, ())} and len(outcomes) == 5


@pytest.mark.parametrize(("with_folder", "verdict"), [(False, Verdict.PASSED), (True, Verdict.FAILED)])
def test_tolerance_of_a_folder_of_references_is_not_for_experiments(
    with_folder: bool, verdict: Verdict, tmp_path: Path
) -> None:
    inside = '<Parameters source="p.ssv"/><Stimuli source="in.csv"/><References source="ref.csv"/>'
    related: Related = {
        "a.exp": ("experiment/validation", EXPERIMENTS, experiment(inside, stopTime=0.05, stepSize=0.01)),
        "p.ssv": ("parameter", SSV, parameter_set(gain=0.0)),
        "in.csv": ("", "", RISING),
        "ref.csv": ("", "", "time,moving\n0,1\n0.05,1\n"),
    }
    path = build_with_related(tmp_path, "Good", related)
    wide = {"*": ec.Tolerance(absolute=2.0)}
    settings = Settings(reference=tmp_path if with_folder else None, tolerance=wide)
    finding = examine(path, "related.validation", settings=settings, apart=())["related.validation"]
    assert finding.verdict == verdict


def test_times_of_an_experiment_are_used(tmp_path: Path) -> None:
    inside = '<TransientSimulation startTime="0.5" stopTime="0.75"/>'
    finding = check(tmp_path, {"a.exp": ("experiment", EXPERIMENTS, experiment(inside))}, "smoke_tests")
    assert finding.verdict == Verdict.PASSED and "It ran to t = 0.75 s" in finding.sentence


def test_each_experiment_is_named(tmp_path: Path) -> None:
    text = experiment(name="first").replace(
        "</Experiments>",
        '<Experiment name="line"><Linearization/></Experiment>'
        '<Experiment name="bad"><Stimuli source="gone.csv"/></Experiment></Experiments>',
    )
    finding = check(tmp_path, {"a.exp": ("experiment", EXPERIMENTS, text)}, "smoke_tests")
    assert finding.verdict == Verdict.FAILED
    assert [line.partition(":")[0] for line in finding.outcome.details] == [
        f"The experiment '{name}' of a.exp" for name in ("bad", "first", "line")
    ]
    assert finding.outcome.gaps == ("The experiment 'line' of a.exp: Linearization is not run.",)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<Experiments>\n</x>", ", line 2, column 5."),
        ("<Tests/>", "has the root element Tests, not Experiments."),
        ("<Experiments/>", "has no Experiment."),
        ("<Experiments><Experiment/></Experiments>", "has an Experiment without a name in line 1."),
        (experiment(stopTime="x"), "has stopTime = x; it must be a finite number."),
        (experiment(stepSize="-1"), "has stepSize = -1; it must be a positive number."),
        (experiment("<Stimuli/>"), "has the element Stimuli without the attribute 'source'."),
        (experiment("<Inputs/>"), "has the element Inputs, which an Experiment does not have."),
    ],
)
def test_invalid_files_of_experiments(text: str, words: str, tmp_path: Path) -> None:
    finding = check(tmp_path, {"a.exp": ("experiment", EXPERIMENTS, text)}, "smoke_tests")
    assert finding.verdict == Verdict.FAILED and words in finding.sentence


@pytest.mark.parametrize(("name", "role", "type_", "content", "gap"), [
    ("smoke_tests", "experiment", "text/plain", "?", "It has the type text/plain."),
    ("smoke_tests", "experiment", EXPERIMENTS, experiment('<References type="x/hdf5" source="a"/>'),
        "Its References have the type x/hdf5, which is not read."),
    ("smoke_tests", "experiment", EXPERIMENTS, experiment('<Stimuli source="https://a.b/c.csv"/>'),
        "Its Stimuli are at 'https://a.b/c.csv', outside of the FMU."),
    ("smoke_tests", "experiment", EXPERIMENTS, experiment(stopTime=1, stepSize=0.3),
        "0 s to 1 s is not a whole number of steps of stepSize = 0.3 s."),
    ("parameters", "parameter", "text/csv", "a\n1\n", "It has the type text/csv"),
    ("states", "serialized-state/riscv64-linux", BYTES, b"1", "It is for riscv64-linux"),
    ("metadata", "meta-data", SRMD, meta_data(name="m", data="../gone.fmu"),
        "It is about '../gone.fmu', which is not in the FMU."),
    ("metadata", "document", "application/pdf", b"1", "document 'a'"),
])  # fmt: skip
def test_unused_related_files_are_reported(
    name: str, role: str, type_: str, content: str | bytes, gap: str, tmp_path: Path
) -> None:
    finding = check(tmp_path, {"a": (role, type_, content)}, name)
    expected = Verdict.PASSED if name == "metadata" else Verdict.SKIPPED  # other checks need it
    assert finding.verdict == expected and len(finding.outcome.gaps) == 1
    assert gap in finding.outcome.gaps[0]


@pytest.mark.parametrize(
    ("values", "verdicts"),
    [
        ({"position": 1.0}, (Verdict.FAILED, Verdict.SKIPPED)),
        ({"gain": 2.0, "mass": 1.0}, (Verdict.WARNING, Verdict.PASSED)),
    ],
)
def test_fault_of_a_listed_set_is_reported_once(
    values: dict[str, float], verdicts: tuple[Verdict, ...], tmp_path: Path
) -> None:
    """By its own check: an experiment with it was not run, or says nothing of names that do not exist."""
    related: Related = {
        "a.exp": ("experiment/validation", EXPERIMENTS, experiment('<Parameters source="p.ssv"/>')),
        "p.ssv": ("parameter", SSV, parameter_set(**values)),
    }
    path = build_with_related(tmp_path, "Good", related)
    examined = examine(path, "related", apart=())
    set_, validation = examined["related.parameters"], examined["related.validation"]
    assert (set_.verdict, validation.verdict) == verdicts
    if validation.verdict == Verdict.SKIPPED:
        fault = set_.sentence.split(": ", 1)[1]
        assert f"'p.ssv' has a fault (`related.parameters`): {fault}" in validation.outcome.gaps[0]


def test_truncated_state_fails(tmp_path: Path) -> None:
    finding = check(tmp_path, {"a": ("serialized-state", BYTES, serialized_state()[:-1])}, "states")
    assert finding.verdict == Verdict.FAILED
    assert "fmi2DeSerializeFMUstate answered fmi2Error" in finding.sentence


def test_fmu_without_related_files_is_not_called_for_them(tmp_path: Path) -> None:
    examined = examine(build_good_fmu(tmp_path), "related", apart=())
    findings = [f for f in examined.findings if f.check.startswith("related.")]
    assert {f.verdict for f in findings} == {Verdict.SKIPPED} and not any(f.outcome.blocked for f in findings)
    assert all(f.sentence.endswith("The FMU lists no related files.") for f in findings)
