"""`emla repair`: what it shows, which files it writes, and how it ends."""

import zipfile
from pathlib import Path

import pytest

import emla_cosim as ec
from tests.support.broken.editing import good_bytes, setting, without
from tests.support.commands import Emla

pytestmark = pytest.mark.slow


@pytest.fixture
def faulty(tmp_path: Path) -> str:
    return without("//Unit[@name='W']")(tmp_path).name


def test_mended_fmu_passes_and_is_shown(faulty: str, emla: Emla) -> None:
    before = Path(faulty).read_bytes()
    result = emla("repair", faulty, "-o", "fixed.fmu")
    assert result.exit_code == 0
    for text in (
        "units.defined Unit 'W'",
        '+ <BaseUnit kg="1" m="2" s="-3">',
        "before: ",
        "after: ",
        "2.2.3",
    ):
        assert text in result.stdout
    assert Path(faulty).read_bytes() == before
    assert ec.verify("fixed.fmu", only=["units", "instance.created"]).passed
    assert emla("repair", faulty, "-o", "fixed.fmu").exit_code == 0  # its own file is replaced


def test_dry_run_writes_nothing(faulty: str, emla: Emla) -> None:
    result = emla("repair", faulty, "--dry-run")
    assert (result.exit_code, [p.name for p in Path().iterdir()]) == (0, [faulty])
    assert "Unit 'W'" in result.stdout


def test_remaining_faults_give_exit_code_1(tmp_path: Path, emla: Emla) -> None:
    path = setting("//ScalarVariable[@name='body.mass']/Real", max="1.0")(tmp_path)
    result = emla("repair", path.name, "-o", "fixed.fmu")
    assert result.exit_code == 1
    assert "not mended variables.range " in result.stdout
    assert "1 check still fails: " in result.stderr
    assert Path("fixed.fmu").read_bytes() == path.read_bytes()  # a copy: nothing was mended


def test_wrong_commands(faulty: str, emla: Emla) -> None:
    Path("mine.txt").write_text("mine")
    with zipfile.ZipFile("system.ssp", "w") as archive:
        archive.writestr("SystemStructure.ssd", "<SystemStructureDescription/>")
        archive.write(faulty, "resources/Toy.fmu")
    for arguments, message in (
        ((faulty,), "--dry-run"),
        ((faulty, "-o", faulty), "is also the FMU to repair"),
        ((faulty, "-o", "mine.txt"), "was not written by emla"),
        (("missing.fmu", "-o", "fixed.fmu"), "does not exist"),
        (
            ("mine.txt", "-o", "fixed.fmu"),
            "cannot be repaired: It cannot be unpacked: File is not a zip file",
        ),
        ((".", "-o", "fixed.fmu"), "'.' is a folder; emla repair takes FMUs. Repair each FMU in it."),
        (("system.ssp", "-o", "fixed.ssp"), "'system.ssp' is a system (SSP); emla repair takes FMUs."),
    ):
        result = emla("repair", *arguments)
        assert (result.exit_code, message in " ".join(result.stderr.split())) == (2, True), result.stderr
    assert not list(Path().glob("fixed.*"))
    assert emla("repair", faulty, "-o", "mine.txt", "--overwrite").exit_code == 0


def test_fmu_without_faults_is_copied(emla: Emla) -> None:
    Path("Toy.fmu").write_bytes(good_bytes())
    result = emla("repair", "Toy.fmu", "-o", "fixed.fmu")
    assert result.exit_code == 0
    assert "Nothing to mend." in result.stdout
    assert Path("fixed.fmu").read_bytes() == good_bytes()
    assert emla("repair", "Toy.fmu", "-o", "fixed.fmu").exit_code == 0  # its own copy is replaced
