"""Any command, files and surroundings: code 0, 1 or 2, one error message, whole files, no process left.

EMLA_COMMAND_EXAMPLES=1000 pytest -m nightly tests/e2e/test_any_command.py tries ten times as many.
"""

import os
import re
import shutil
import signal
import stat
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import HealthCheck, example, given

from emla_cosim.cli.app import app
from tests.support.command_lines import (
    CLOSED,
    FMUS,
    FOLDER,
    FULL,
    USABLE,
    Surroundings,
    commands,
    make_files,
    surroundings,
)
from tests.support.odd_files import Materials
from tests.support.tiers import examples
from tests.support.whole_files import assert_whole

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="Only Linux has `prlimit` and `/dev/full`."),
]

EXAMPLES = int(os.environ.get("EMLA_COMMAND_EXAMPLES", "100"))
PATIENCE = 10.0
"""Seconds after which a command gets Ctrl-C."""
LIFT_RUN = ("run", "lift", "--fmus", FMUS, "--no-plots", "--stop-time", "0.002", "--output", "out")
CONTROL = re.compile(r"\x1b\[[?0-9;]*[A-Za-z]")
MESSAGE = re.compile(r"Error: |Interrupted\.$")
"""How the one line begins that says what is wrong."""


@pytest.fixture(scope="module")
def materials(python_fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Materials:
    folder = tmp_path_factory.mktemp("materials")
    fmus = ("--fmus", str(python_fmu_folder))
    materials = Materials(python_fmu_folder, folder / "ok.ssp", folder / "ok.checkpoint")
    output = ("--output", str(folder / "out"), "--checkpoint", str(materials.checkpoint), "--no-plots")
    for command in (
        ["export", "lift", str(materials.package), *fmus],
        ["run", "lift", "--stop-time", "0.001", *output, *fmus],
    ):
        assert CliRunner().invoke(app, command).exit_code == 0
    return materials


def call(arguments: list[str], folder: Path, around: Surroundings, temporary: Path) -> tuple[int, str, str]:
    """Run a command; return its exit code and what it wrote. No process of it is left."""
    changed = {n: v and v.replace(FOLDER, str(folder)) for n, v in around.environment.items()}
    environment = {**os.environ, "TMPDIR": str(temporary), "PYTHONIOENCODING": around.encoding, **changed}
    redirections = "".join(
        f" {n}{'<&-' if n == 0 else '>&-'}" if kind == CLOSED else f" {n}>/dev/full" if kind == FULL else ""
        for n, kind in enumerate(around.streams)
    )
    limit = [] if around.largest is None else ["prlimit", f"--fsize={around.largest}"]
    shell = ["/bin/sh", "-c", f'exec "$@"{redirections}', "sh", sys.executable, "-m", "emla_cosim"]
    process = subprocess.Popen(
        [*limit, *shell, *arguments],
        cwd=folder,
        env={n: v for n, v in environment.items() if v is not None},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        output, errors = process.communicate(timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGINT)
        output, errors = process.communicate(timeout=300.0)
    until = time.monotonic() + 30.0
    with suppress(ProcessLookupError):
        while time.monotonic() < until:
            os.killpg(process.pid, 0)
            time.sleep(0.01)
        os.killpg(process.pid, signal.SIGKILL)
        raise AssertionError("a process survives")
    return process.returncode, *(text.decode(around.encoding, "replace") for text in (output, errors))


def find_files(folder: Path) -> dict[Path, tuple[int, bytes]]:
    """What kind of file each one is, and its content."""
    kinds = {p: p.lstat().st_mode for p in folder.rglob("*")}
    return {p: (stat.S_IFMT(k), b"" if not stat.S_ISREG(k) else p.read_bytes()) for p, k in kinds.items()}


def check_files(folder: Path, inputs: dict[Path, tuple[int, bytes]], arguments: list[str]) -> None:
    """New files are whole, and earlier ones are unchanged; what may be replaced is whole too."""
    after = find_files(folder)
    command_text = "\0".join(arguments)
    for path, before in inputs.items():
        assert path in after and after[path][0] == before[0], f"{path.name} is gone"
        changed = after[path] != before
        empty = before == (stat.S_IFREG, b"")
        ours = empty or path.suffix in (".ssp", ".checkpoint") or "--overwrite" in arguments
        assert not changed or (path.name in command_text and ours)
        if not changed and path.is_file() and not path.is_symlink():
            path.unlink()
    assert_whole(folder)


@examples(6, EXAMPLES, suppress_health_check=[HealthCheck.function_scoped_fixture], print_blob=False)
@example(arguments=LIFT_RUN, around=Surroundings(largest=1))
@example(arguments=("run", "ok.ssp", *LIFT_RUN[2:]), around=Surroundings(largest=0))
@example(arguments=("--help",), around=Surroundings((USABLE, FULL, USABLE)))
@given(arguments=commands, around=surroundings)
def test_any_command_ends_with_at_most_one_message(
    arguments: tuple[str, ...],
    around: Surroundings,
    materials: Materials,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    root = tmp_path_factory.mktemp("call")
    folder, temporary = root / "here", root / "temporary"
    folder.mkdir()
    temporary.mkdir()
    command = make_files(arguments, folder, materials)
    inputs = find_files(folder)
    code, output, errors = call(command, folder, around, temporary)
    assert code in (0, 1, 2), errors
    assert "Traceback" not in output + errors, errors
    if around.streams[2] == USABLE:
        messages = [x for x in CONTROL.sub("", errors).splitlines() if MESSAGE.match(x)]
        shows_help = not arguments and code == 2
        assert len(messages) == (1 if code and not shows_help else 0), errors
    assert not list(temporary.iterdir()), "temporary files are left"
    check_files(root, inputs, command)
    shutil.rmtree(root)
