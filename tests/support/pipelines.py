"""Folders as a pipeline has them when it verifies FMUs: some that are right, and some that are not."""

import shutil
from pathlib import Path

from emla_cosim.fmu.models import fmu_path

from .paths import ROOT

MODEL = "Reference"
"""The model whose FMU is quickest to verify."""


def good_fmu(folder: Path, fmus: Path) -> Path:
    """An FMU that passes, with its reference files, as Reference.fmu in a folder; `fmus` has it."""
    folder.mkdir(parents=True, exist_ok=True)
    for file in (ROOT / "fmus" / MODEL).glob(f"{MODEL}_*"):
        shutil.copy(file, folder)
    return Path(shutil.copy(fmu_path(MODEL, "native", fmus), folder))


def strayed_fmu(folder: Path, fmus: Path) -> Path:
    """The same beside a reference that it leaves in the second half: reference.agrees fails, and alone."""
    path = good_fmu(folder, fmus)
    reference = folder / f"{MODEL}_ref.csv"
    head, *rows = reference.read_text(encoding="utf-8").splitlines()
    middle = len(rows) // 2
    off = [f"{row.rpartition(',')[0]},123.0" for row in rows[middle:]]
    reference.write_text("\n".join([head, *rows[:middle], *off, ""]), encoding="utf-8")
    return path


def cut_fmu(folder: Path) -> Path:
    """No FMU at all, as Cut.fmu in a folder: archive.safe fails, and everything else is skipped."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "Cut.fmu"
    path.write_bytes(b"PK\x03\x04 and no more")
    return path
