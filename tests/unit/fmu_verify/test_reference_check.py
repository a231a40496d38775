"""FMUs against reference files: next to them, in them, in another folder, and invalid ones."""

import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from fmu_verify.check import Verdict
from fmu_verify.findings import Finding
from fmu_verify.references.reference_files import find_solution, read_reference
from fmu_verify.settings import Settings
from tests.support.broken.examining import examine
from tests.support.broken.related import EXPERIMENTS, build_with_related, experiment
from tests.support.paths import ROOT

FMUS = ROOT / "fmus"


def compare(fmu: Path, reference: Path | None = None, **tolerance: ec.Tolerance) -> Finding:
    """Compare an FMU with references in a folder, by default those next to the FMU or in it."""
    settings = Settings(reference=reference, tolerance=tolerance)
    return examine(fmu, "reference.agrees", settings=settings, apart=())["reference.agrees"]


@pytest.fixture
def plant(fmu_folder: Path, tmp_path: Path) -> Path:
    """The plant's FMU in a folder, with its reference beside it, to be changed."""
    for path in (FMUS / "EmlaPlant").glob("EmlaPlant_*"):
        shutil.copy(path, tmp_path)
    return Path(shutil.copy(fmu_folder / "EmlaPlant" / "EmlaPlant.fmu", tmp_path))


def changed(path: Path, column: str, by: np.ndarray | float) -> None:
    """Add something to a column of a CSV file."""
    rows = np.genfromtxt(path, delimiter=",", names=True, deletechars="", dtype=float)
    rows[column] += by
    np.savetxt(path, rows, delimiter=",", header=",".join(rows.dtype.names), comments="", fmt="%.17g")


# ---- results inside the FMU ---------------------------------------------------------------------

RELATED = "extra/org.fmi-standard.fmi-ls-ref"
MANIFEST = f"{RELATED}/fmi-ls-manifest.xml"


def build_without_experiments(plant: Path, folder: Path, **changes: str | None) -> Path:
    """The plant's FMU in a folder of its own, with other texts of its related files; None removes one.

    It has no experiments, so that files belong together by their names.
    """
    kinds = {MANIFEST: "manifest", **{f"{RELATED}/EmlaPlant_{kind}.csv": kind for kind in ("ref", "in")}}
    (folder / "alone").mkdir()
    path = folder / "alone" / "Renamed.fmu"
    with zipfile.ZipFile(plant) as source, zipfile.ZipFile(path, "w") as target:
        for name in source.namelist():
            text = changes.get(kinds.get(name, ""), source.read(name))
            if text is not None and not name.endswith(".exp"):
                target.writestr(name, text)
    return path


@pytest.mark.parametrize(("by", "verdict"), [(0.0, Verdict.PASSED), (1.0, Verdict.FAILED)])
def test_result_in_the_fmu_is_compared(by: float, verdict: Verdict, plant: Path, tmp_path: Path) -> None:
    changed(reference := tmp_path / "EmlaPlant_ref.csv", "i_q", by)
    finding = compare(build_without_experiments(plant, tmp_path, ref=reference.read_text()))
    assert finding.verdict == verdict and "i_q" in {c.signal for c in finding.outcome.comparisons}


def test_result_without_its_inputs_is_skipped(plant: Path, tmp_path: Path) -> None:
    finding = compare(build_without_experiments(plant, tmp_path, **{"in": None}))
    message = "The result in the FMU was not compared. There is no file with its inputs, "
    assert finding.verdict == Verdict.SKIPPED and finding.sentence.startswith(message)
    assert finding.sentence in finding.outcome.gaps


def test_result_that_cannot_be_read_warns_without_temporary_paths(plant: Path, tmp_path: Path) -> None:
    finding = compare(build_without_experiments(plant, tmp_path, ref="time,i_q\n0,false\n1,true\n"))
    assert finding.verdict == Verdict.WARNING
    assert "cannot be compared: The reference 'EmlaPlant_ref.csv' " in finding.sentence


@pytest.mark.parametrize(
    "related",
    [
        '<Related type="text/csv" role="result" source="gone.csv"/>',
        '<Related type="text/csv" role="result" source="../../../EmlaPlant_ref.csv"/>',
        '<Related type="text/csv" role="result" source="https://example.com/EmlaPlant_ref.csv"/>',
        '<Related type="text/csv" role="other" source="EmlaPlant_ref.csv"/>',
        '<Related type="application/x-mat" role="result" source="EmlaPlant_ref.csv"/>',
        "<Related/>",
        "",
    ],
)
def test_related_files_that_are_not_results_are_not_compared(
    related: str, plant: Path, tmp_path: Path
) -> None:
    shutil.copy(plant.with_name("EmlaPlant_ref.csv"), tmp_path / "outside_ref.csv")
    finding = compare(
        build_without_experiments(plant, tmp_path, manifest=f"<fmiReferences>{related}</fmiReferences>")
    )
    assert (finding.verdict, finding.sentence) == (
        Verdict.SKIPPED,
        "There is no Renamed_ref.csv next to the FMU, and no result in it.",
    )


def test_list_of_related_files_that_is_not_xml(plant: Path, tmp_path: Path) -> None:
    """The check of manifests says that it fails; results are not compared."""
    finding = compare(build_without_experiments(plant, tmp_path, manifest="<fmiReferences>"))
    assert finding.verdict == Verdict.SKIPPED and finding.outcome.blocked
    assert f"'{MANIFEST}' is not valid XML" in finding.sentence


def test_all_results_in_the_fmu_are_compared(tmp_path: Path) -> None:
    """Two along the experiments that name them; the inputs of the third are not known."""
    texts = {
        "right": "time,moving\n0,0\n0.02,0\n",
        "wrong": "time,moving\n0,1\n0.02,1\n",
        "other": "time,u\n0,0\n",
    }
    related = {f"{name}.csv": ("result", "text/csv", text) for name, text in texts.items()}
    for name in ("right", "wrong"):
        setup = experiment(f'<References source="{name}.csv"/>', stopTime=0.02)
        related[f"{name}.exp"] = ("experiment", EXPERIMENTS, setup)
    finding = compare(build_with_related(tmp_path, "Good", related))
    assert finding.verdict == Verdict.FAILED
    assert finding.sentence.startswith("The result wrong.csv: moving left its tube at t = 0 s")
    assert [line.partition(":")[0] for line in finding.outcome.details] == [
        f"The result {name}.csv" for name in ("wrong", "right", "other")
    ]
    assert finding.outcome.gaps == (
        "The result other.csv: The result in the FMU was not compared. There is no file with its inputs, "
        "other_in.csv.",
    )


def test_named_folder_without_reference_is_skipped(plant: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    finding = compare(plant, tmp_path / "empty")
    assert finding.verdict == Verdict.SKIPPED and finding.outcome.blocked
    assert finding.sentence == f"There is no EmlaPlant_ref.csv in {tmp_path / 'empty'}."


def test_drift_of_a_ten_thousandth_leaves_a_narrow_tube(plant: Path, tmp_path: Path) -> None:
    clean = read_reference(tmp_path / "EmlaPlant_ref.csv")
    time, i_q = clean.solution["time"], clean.solution["i_q"]
    drift = 1e-4 * np.ptp(i_q) * time / time[-1]
    changed(tmp_path / "EmlaPlant_ref.csv", "i_q", drift)
    finding = compare(plant, tmp_path)
    assert finding.verdict == Verdict.FAILED
    assert finding.sentence.startswith("i_q left its tube at t = ")
    (departure,) = [c for c in finding.outcome.comparisons if not c.inside]
    assert departure.worst == pytest.approx(1e-4 * np.ptp(i_q), rel=1e-3)
    assert departure.worst_at == pytest.approx(time[-1])
    # the file allows 1e-7 of the range, which the drift passes in the first step or two
    assert departure.left_at is not None and departure.left_at < 0.002
    # by default it would be within the tube, which is 1e-3 of the range
    assert compare(plant, tmp_path, **{"*": ec.Tolerance(1e-3, time=0.0)}).verdict == Verdict.PASSED
    assert compare(plant, tmp_path, i_q=ec.Tolerance(1.1e-4)).verdict == Verdict.PASSED
    assert compare(plant, tmp_path, i_q=ec.Tolerance(0.9e-4)).verdict == Verdict.FAILED


def test_other_inputs_fail(plant: Path, tmp_path: Path) -> None:
    changed(tmp_path / "EmlaPlant_in.csv", "F_L", 100.0)
    assert compare(plant, tmp_path).sentence.startswith("a_L left its tube at t = 0 s")


def test_start_values_come_from_the_file_next_to_the_reference(plant: Path, tmp_path: Path) -> None:
    about = tmp_path / "EmlaPlant_ref.toml"
    about.write_text(about.read_text().replace("[set]", '[set]\n"motor.R_s" = 0.15'))
    assert "left its tube" in compare(plant, tmp_path).sentence


WRONG = [
    ("ref.csv", "time,", "x,", "has no column called time or t"),
    ("ref.csv", "0.0005,", "oops,", "has 'oops' in row 2 of the column 'time'"),
    ("ref.csv", "\n0.001,", "\n-0.001,", "has the time -0.001 s in row 3, after 0.0005 s"),
    ("ref.csv", "x_L,", "x_Q,", "has the column 'x_Q', but the FMU has no such variable"),
    ("in.csv", "F_L", "F_Q", "the column 'F_Q', but the FMU has no such input"),
    ("in.csv", "F_L", "a_L", "the column 'a_L', but the FMU has no such input"),
    ("ref.opt", "StepSize, 0.0005", "StepSize, x", "write StepSize, NUMBER"),
    ("ref.opt", "StopTime, 0.18", "StopTime, nan", "it must be a finite number"),
    ("ref.opt", "StepSize, 0.0005", "StepSize, 0.3", "not a whole number of steps of 0.3 s"),
    ("ref.opt", "StopTime, 0.18", "StopTime, -1", "not a whole number of steps"),
    ("ref.toml", "made_by", "maid_by", "has the unknown entry 'maid_by'; did you mean 'made_by'?"),
    ("ref.toml", "made_by =", "made_by", "is not TOML"),
    ("ref.toml", "[set]", '[set]\n"motor.R_q" = 1', "has no variable 'motor.R_q'"),
    ("ref.toml", "[set]", '[set]\n"motor.R_s" = -1', "is out of range"),
    ("ref.toml", "relative = ", "relativ = ", "has the unknown entry 'relativ'; did you mean 'relative'?"),
]
"""The file of a reference, the text to replace, the new text, and the message."""


@pytest.mark.parametrize(("file", "old", "new", "message"), WRONG, ids=[row[3] for row in WRONG])
def test_invalid_reference_files(
    file: str, old: str, new: str, message: str, plant: Path, tmp_path: Path
) -> None:
    path = tmp_path / f"EmlaPlant_{file}"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    finding = compare(plant)
    assert finding.verdict == Verdict.FAILED
    assert message in finding.sentence and finding.sentence[-1] in ".?"
    assert finding.hint == "Correct the reference files."


def test_options_may_have_comments_and_unknown_names(plant: Path, tmp_path: Path) -> None:
    options = tmp_path / "EmlaPlant_ref.opt"
    options.write_text(
        "StartTime, 0.0         // in seconds\nStopTime, 0.18\nStepSize, 0.0005 // s\n"
        "RelTol, 0.0001\nSolverType, FixedStep\n\n"
    )
    assert compare(plant, tmp_path).verdict == Verdict.PASSED


def test_without_options_times_are_those_of_the_rows(plant: Path, tmp_path: Path) -> None:
    (tmp_path / "EmlaPlant_ref.opt").unlink()
    # steps are the FMU's own, inputs linear between rows
    finding = compare(plant, tmp_path, **{"*": ec.Tolerance(1e-3)})
    assert {c.signal: c.time[-1] for c in finding.outcome.comparisons}["x_L"] == pytest.approx(0.18)


def test_names_with_commas_and_quotes_are_names(tmp_path: Path) -> None:
    (tmp_path / "M_ref.csv").write_text('"time","a[1,2]","say ""x"""\n0,1,2\n1,3,4\n', encoding="utf-8-sig")
    reference = read_reference(tmp_path / "M_ref.csv")
    assert list(reference.solution) == ["time", "a[1,2]", 'say "x"']
    assert (reference.start, reference.stop, reference.step) == (0.0, 1.0, None)


def test_folder_with_references_of_several_fmus(tmp_path: Path) -> None:
    (tmp_path / "M").mkdir()
    (tmp_path / "M" / "M_ref.csv").touch()
    solution = tmp_path / "M" / "M_ref.csv"
    assert find_solution(Path("/elsewhere/M.fmu"), tmp_path) == solution
    assert find_solution(tmp_path / "M" / "python" / "M.fmu", None) == solution
    assert find_solution(Path("/elsewhere/N.fmu"), tmp_path) is None


def test_missing_folder_is_an_invalid_command(plant: Path, tmp_path: Path) -> None:
    with pytest.raises(CommandError, match=r"the folder of references '.*nowhere' does not exist"):
        ec.verify(plant, reference=tmp_path / "nowhere")
