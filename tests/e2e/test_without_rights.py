"""Commands of a user who may not write everywhere: what belongs to others stays, and nothing half-written.

Root may write everywhere. So these tests are root without the rights that ignore permissions, and files of
another user.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.commands import Emla

ANOTHER = 65534
RIGHTS = "--bounding-set=-dac_override,-dac_read_search,-fowner"
RUN = ("run", "lift", "--stop-time", "0.002", "--no-plots", "--output")

pytestmark = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0 or shutil.which("setpriv") is None,
    reason="Files of another user need root, and setpriv takes its rights.",
)


def emla_without_rights(*arguments: str, folder: Path) -> tuple[int, str]:
    """Run a command; return the exit code and the error message."""
    done = subprocess.run(
        ["setpriv", RIGHTS, sys.executable, "-m", "emla_cosim", *arguments],
        cwd=folder, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    if "setpriv:" in done.stderr:
        pytest.skip("Rights cannot be taken here.")
    assert "Traceback" not in done.stderr
    errors = [line for line in done.stderr.splitlines() if line.startswith("Error:")]
    assert len(errors) == (done.returncode != 0), done.stderr
    return done.returncode, "".join(errors)


def give_away(folder: Path, mode: int) -> dict[str, bytes]:
    """Give a folder and its files to another user; return their contents."""
    for path in (folder, *folder.rglob("*")):
        os.chown(path, ANOTHER, ANOTHER)
    folder.chmod(mode)
    return contents(folder)


def contents(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize("mode", [0o555, 0o1777], ids=["read-only", "sticky"])
def test_results_of_another_user_stay(mode: int, emla: Emla, tmp_path: Path) -> None:
    """Another user ran the same in a folder that nobody else may write to, or where names are kept."""
    assert emla(*RUN, "theirs/out").exit_code == 0
    assert emla("export", "lift", "theirs/x.ssp").exit_code == 0
    give_away(tmp_path / "theirs", mode)
    before = {**give_away(tmp_path / "theirs/out", mode), **contents(tmp_path / "theirs")}
    reason = "Permission denied" if mode == 0o555 else "Operation not permitted"
    for arguments in ((*RUN, "theirs/out"), ("export", "lift", "theirs/x.ssp")):
        code, said = emla_without_rights(*arguments, folder=tmp_path)
        assert code in (1, 2) and reason in said, said
        assert contents(tmp_path / "theirs") == before


def test_a_file_that_cannot_be_read_is_not_replaced(emla: Emla, tmp_path: Path) -> None:
    """Nobody can see that an earlier command wrote it."""
    assert emla(*RUN, "out").exit_code == 0
    before = (tmp_path / "out/run.json").read_bytes()
    os.chown(tmp_path / "out/run.json", ANOTHER, ANOTHER)
    (tmp_path / "out/run.json").chmod(0o600)
    code, said = emla_without_rights(*RUN, "out", folder=tmp_path)
    assert code == 2 and "'out/run.json' was" in said
    assert (tmp_path / "out/run.json").read_bytes() == before
