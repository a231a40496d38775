"""Two commands with the same output at once: one is refused, or each result is whole."""

import json
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from emla_cosim.sandbox.locking import exclusive_lock
from fmublock.archive import read_built
from fmublock.files import UNFINISHED
from tests.support.commands import Emla, sentence
from tests.support.tiers import mostly_slow

SHORT = ("--stop-time", "0.01", "--output", "out")
R_S = "lift.plant.motor.R_s=0.1,0.2"

FOLDERS = {
    "run": ("run", "lift", *SHORT),
    "sweep": ("sweep", "lift", "--vary", R_S, *SHORT),
    "resume": ("sweep", "lift", "--vary", R_S, *SHORT, "--resume"),
    "compare": ("compare", "lift", "--controllers", "rsba,foc", *SHORT),
    "tune": (
        *("tune", "lift", "--vary", "lift.controller.beta[1]=400:1600", "--evaluations", "2"),
        *("--training", "1", "--validation", "1", "--objective", "lift.position_error_m", *SHORT),
    ),
    "size": ("size", "lift", *SHORT),
    "linearize": ("linearize", "lift", "--open", "lift", "--stop-time", "0.01", "--output", "out"),
}
"""Commands that write to an output folder."""


@pytest.mark.usefixtures("on_one_cluster")
@pytest.mark.parametrize("command", mostly_slow(FOLDERS, FOLDERS.keys() - {"resume"}))
def test_a_folder_takes_one_command_at_a_time(command: str, emla: Emla, tmp_path: Path) -> None:
    out = tmp_path / "out"
    if command == "resume":
        assert emla(*FOLDERS["sweep"]).exit_code == 0
    out.mkdir(exist_ok=True)
    with exclusive_lock(out):
        before = {p: p.read_bytes() for p in out.rglob("*") if p.is_file()}
        said = sentence(emla(*FOLDERS[command]), 2)
        assert "another run writes to" in said
        assert {p: p.read_bytes() for p in out.rglob("*") if p.is_file()} == before


FILES = {
    "info": (("info", "Reference.fmu", "--json", "i.json"), "i.json"),
    "export": (("export", "lift", "x.ssp"), "x.ssp"),
    "verify": (("verify", "Reference.fmu", "--only", "description.*", "--json", "v.json"), "v.json"),
    "build": (("build", "Reference", "--output", "built"), "built/Reference/Reference.fmu"),
}
"""Commands that write one file, and the file."""


@pytest.mark.parametrize("command", mostly_slow(list(FILES), ["info"]))
def test_each_file_of_two_commands_is_whole(command: str, fmu_folder: Path, tmp_path: Path) -> None:
    arguments, file = FILES[command]
    fmus = ("--fmus", str(fmu_folder)) if command == "export" else ()
    (tmp_path / "Reference.fmu").write_bytes((fmu_folder / "Reference/Reference.fmu").read_bytes())
    call = [sys.executable, "-m", "emla_cosim", *arguments, *fmus]
    pipe = subprocess.PIPE
    both = [subprocess.Popen(call, cwd=tmp_path, stdout=pipe, stderr=pipe) for _ in range(2)]
    said = [process.communicate(timeout=120)[1].decode() for process in both]
    assert [process.returncode for process in both] == [0, 0], said
    written = tmp_path / file
    if written.suffix == ".json":
        assert json.loads(written.read_bytes())["format"]
    else:
        with zipfile.ZipFile(written) as archive:
            assert archive.testzip() is None
    assert written.suffix != ".fmu" or read_built(written).key
    assert not [p for p in tmp_path.rglob("*") if p.name.startswith(UNFINISHED)]
