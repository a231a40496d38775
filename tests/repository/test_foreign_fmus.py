"""The script that compares FMUs with FMPy, on an FMU of ours and on a file that is none."""

import csv
import shutil
import subprocess
import sys
from pathlib import Path

from tests.support.paths import ROOT


def test_both_kinds_agree_and_copies_count_once(fmu_folder: Path, tmp_path: Path) -> None:
    folder = tmp_path / "fmus"
    folder.mkdir()
    for name in ("plant.fmu", "copy.fmu"):
        shutil.copy(fmu_folder / "EmlaPlant" / "EmlaPlant.fmu", folder / name)
    (folder / "none.fmu").write_text("version https://git-lfs")
    command = [sys.executable, str(ROOT / "docs" / "foreign_fmus.py"), str(folder), str(tmp_path / "out")]
    subprocess.run(command, check=True, capture_output=True, timeout=300)
    with (tmp_path / "out" / "fmus.csv").open() as stream:
        rows = {(row["fmu"], row["kind"]): row for row in csv.DictReader(stream)}
    assert set(rows) == {("copy.fmu", "CS"), ("copy.fmu", "ME"), ("none.fmu", "")}
    for kind in ("CS", "ME"):
        row = rows["copy.fmu", kind]
        assert (row["fmpy"], row["emla"], row["agrees"]) == ("yes", "yes", "True"), row
        assert int(row["signals"]) > 3
    assert "not an FMU" in rows["none.fmu", ""]["reason"]
    summary = (tmp_path / "out" / "comparison.md").read_text()
    assert "| all | ME | 1 | 1 | 0 | 1 | 0 | 1 of 1 |" in summary
