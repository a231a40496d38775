"""The FMUs, both flavours and run by fmpy, against the reference solutions beside them."""

from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.util import read_csv, read_ref_opt_file

from emla_cosim.fmu.models import FLAVOURS, fmu_path
from fmus import make_references
from tests.support.blocks import FACTS, OWN
from tests.support.paths import ROOT
from tests.support.tiers import mostly_slow

FMUS = ROOT / "fmus"
LARGEST_FILE = 150_000
"""Bytes; the cross-check rules allow a megabyte."""


def table(model: str, kind: str) -> Any:
    """A file as a structured array, None without such a file."""
    path = FMUS / model / f"{model}_{kind}.csv"
    return read_csv(path) if path.is_file() else None


def differences(actual: Any, expected: Any) -> dict[str, float]:
    """Largest difference of every column, per its largest value."""
    largest = {name: float(np.abs(expected[name]).max()) or 1.0 for name in expected.dtype.names}
    return {
        name: float(np.abs(actual[name] - expected[name]).max()) / scale for name, scale in largest.items()
    }


EACH = [(m, f) for m in OWN for f in FLAVOURS]


@pytest.mark.parametrize(("model", "flavour"), mostly_slow(EACH, [(m, "native") for m in OWN]))
def test_fmu_gives_the_reference_solution(model: str, flavour: str, request: pytest.FixtureRequest) -> None:
    folder = request.getfixturevalue("fmu_folder" if flavour == "native" else "python_fmu_folder")
    fmu = fmu_path(model, flavour, folder)
    expected = table(model, "ref")
    options = read_ref_opt_file(FMUS / model / f"{model}_ref.opt")
    outputs = [name for name in expected.dtype.names if name != "time"]
    # fmpy sets inputs at the start of a step to what it interpolates for that time. Steps begin at
    # the rows of the file, so this is the row's value (to the rounding of times), held over the step.
    rows = fmpy.simulate_fmu(
        str(fmu),
        start_time=options["StartTime"],
        stop_time=options["StopTime"],
        step_size=options["StepSize"],
        output_interval=options["OutputIntervalLength"],
        start_values=make_references.START_VALUES[model],
        input=table(model, "in"),
        output=outputs,
    )
    assert len(rows) == len(expected)
    too_large = {n: d for n, d in differences(rows, expected).items() if d > make_references.RELATIVE[model]}
    assert too_large == {}


@pytest.mark.parametrize("model", OWN)
def test_files_cover_the_model_and_keep_the_rules(model: str, fmu_folder: Path) -> None:
    description = fmpy.read_model_description(str(fmu_path(model, "native", fmu_folder)))
    names = {
        causality: ["time", *(v.name for v in description.modelVariables if v.causality == causality)]
        for causality in ("input", "output")
    }
    solution, inputs = table(model, "ref"), table(model, "in")
    assert sorted(solution.dtype.names) == sorted(names["output"])
    assert inputs is None or sorted(inputs.dtype.names) == sorted(names["input"])
    assert (inputs is None) == (names["input"] == ["time"])
    options = read_ref_opt_file(FMUS / model / f"{model}_ref.opt")
    times = np.arange(len(solution)) * options["StepSize"]
    assert times[-1] == pytest.approx(options["StopTime"], rel=1e-12)
    for file in (solution, inputs):
        assert file is None or file["time"] == pytest.approx(times, rel=1e-12, abs=0.0)
    for path in (FMUS / model).glob(f"{model}_*"):
        assert path.stat().st_size < LARGEST_FILE


QUICK = [m for m in OWN if FACTS[m].exchange is None] + ["FocController"]


@pytest.mark.parametrize("model", mostly_slow(OWN, QUICK))
def test_files_are_those_that_the_script_writes(model: str, tmp_path: Path) -> None:
    """Up to the last digits, which differ between machines."""
    for name, text in make_references.files(model).items():
        (tmp_path / name).write_text(text, encoding="utf-8")
        if not name.endswith(".csv"):
            assert (FMUS / model / name).read_text(encoding="utf-8") == text
        else:
            now, then = read_csv(tmp_path / name), read_csv(FMUS / model / name)
            assert now.dtype.names == then.dtype.names
            # solved to 1e-12 in each of 400 steps; P_3 of the controller has eight digits
            assert max(differences(now, then).values()) < 1e-8


@pytest.mark.parametrize("model", OWN)
def test_reference_solution_excites_every_output(model: str) -> None:
    """A column of zeros would agree with anything. The default controller has no limits to meet."""
    solution = table(model, "ref")
    still = {name for name in solution.dtype.names if np.ptp(solution[name]) == 0.0}
    assert still == FACTS[model].still
