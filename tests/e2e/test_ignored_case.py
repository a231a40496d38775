"""Names that differ only in case are one file on some file systems: nothing replaces another file there."""

import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from emla_cosim.fmu.unpack import UnsafeArchiveError, unpack
from tests.support.commands import Emla, sentence
from tests.support.ignoring_case import folder_ignoring_case, ignores_case

MINE = b"years of work"
RUN = ("run", "lift", "--stop-time", "0.002", "--no-plots", "--output", "out")


@pytest.fixture
def ignoring_case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, emla: Emla) -> Iterator[Path]:
    with folder_ignoring_case(tmp_path) as folder:
        monkeypatch.chdir(folder)
        yield folder


def test_files_of_the_user_stay(ignoring_case: Path, emla: Emla, faulty_fmu: Path) -> None:
    shutil.copy(faulty_fmu, "Faulty.fmu")
    Path("out").mkdir()
    cases = (
        ("out/Results.csv", RUN),
        ("out/METRICS.json", RUN),
        ("OUT/Variants.parquet", ("sweep", "lift", "--vary", "step_size=0.001", *RUN[2:])),
        ("X.SSP", ("export", "lift", "x.ssp")),
        ("I.json", ("info", "lift", "--json", "i.json")),
        ("V.json", ("verify", "Faulty.fmu", "--only", "archive", "--json", "v.json")),
        ("Reference", ("build", "Reference", "--platform", "linux64", "--output", ".")),
    )
    for mine, command in cases:
        file = Path(mine.replace("Reference", "reference"))
        file.write_bytes(MINE)
        sentence(emla(*command), 2)
        assert file.read_bytes() == MINE
        file.unlink()


def test_results_are_replaced_and_listed_once(ignoring_case: Path, emla: Emla) -> None:
    """A second run to the same folder by another name of it."""
    assert emla(*RUN).exit_code == 0
    before = sorted(p.name for p in Path("out").iterdir())
    assert emla(*RUN[:-1], "OUT").exit_code == 0
    assert sorted(p.name for p in Path("out").iterdir()) == before


def test_an_archive_with_names_that_differ_in_case_is_not_unpacked(
    ignoring_case: Path, tmp_path: Path
) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("resources/Pump.fmu", b"one")
        archive.writestr("resources/pump.fmu", b"another")
    assert ignores_case(ignoring_case)
    with pytest.raises(UnsafeArchiveError, match="names differ only in case"):
        unpack(tmp_path / "a.zip", ignoring_case / "unpacked")


def test_both_are_unpacked_where_case_matters(tmp_path: Path) -> None:
    if ignores_case(tmp_path):
        pytest.skip("The temporary folder ignores case.")
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for name in ("a", "A"):
            archive.writestr(name, name.encode())
    unpack(tmp_path / "a.zip", tmp_path / "unpacked")
    assert [(tmp_path / "unpacked" / name).read_bytes() for name in ("a", "A")] == [b"a", b"A"]


BLOCKS = '''
from fmublock import Block, Output, Parameter


class Pump(Block):
    """A pump."""

    a = Parameter(1.0, unit="1", description="a")
    y = Output(unit="1", description="y")

    def outputs(self, v):
        return {"y": v.a}


class pump(Pump):
    """Another one."""
'''


def test_two_outputs_whose_names_differ_in_case_are_one(emla: Emla, tmp_path: Path, faulty_fmu: Path) -> None:
    """Before anything is computed, and on every file system."""
    for name in ("Faulty.fmu", "f/FAULTY.fmu"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(faulty_fmu, tmp_path / name)
    for name in ("b.py", "c.py"):
        (tmp_path / name).write_text(BLOCKS)
    for command, words in (
        (("verify", "Faulty.fmu", "--json", "r", "--html", "R"), "the page 'R' is also the JSON report 'r'"),
        (("verify", "Faulty.fmu", "f/FAULTY.fmu", "--record", "r"), "two FMUs have the name FAULTY"),
        ((*RUN, "--checkpoint", "out/RUN.json"), "is also a file of the results"),
        (("build", "b.py:Pump", "b.py:pump"), "the FMUs of 'b.py:Pump' and 'b.py:pump' have the same name"),
        (("build", "b.py:Pump", "c.py:Pump"), "the FMUs of 'b.py:Pump' and 'c.py:Pump' have the same name"),
        (("trajectory", "--output", "x.PNG"), "must not end in .png"),
    ):
        assert words in sentence(emla(*command), 2)
    there = {str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file()}
    assert there == {"Faulty.fmu", "b.py", "c.py", "f/FAULTY.fmu"}
