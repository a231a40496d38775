"""Whatever command, files and surroundings: code 0, 1 or 2, one sentence, whole files, nothing left over.

A failure shows its command and how to make its surroundings. To try more than CI does:

    EMLA_COMMAND_EXAMPLES=5000 pytest -m slow -s tests/e2e/test_any_command.py
"""

import os
import re
import shutil
import stat
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given
from typer.testing import CliRunner

from emla_cosim.cli.app import app
from tests.support.command_lines import FMUS, FOLDER, Surroundings, commands, place, surroundings
from tests.support.odd_files import Materials
from tests.support.tiers import examples
from tests.support.whole_files import assert_whole

pytest.importorskip("resource", reason="Windows has no `fork`.")
from tests.support.command_server import CLOSED, FULL, USABLE, Call, CommandServer, Ended

EXAMPLES = int(os.environ.get("EMLA_COMMAND_EXAMPLES", "100"))
COLD = max(EXAMPLES // 25, 1)
"""Examples in processes that import everything themselves."""
FEW = 15
"""Examples that every run of the suite tries."""

ANY: dict[str, Any] = {"suppress_health_check": [HealthCheck.function_scoped_fixture], "print_blob": False}
SHORT = ("run", "lift", "--fmus", FMUS, "--no-plots", "--stop-time", "0.002", "--output", "out")

CONTROL = re.compile(r"\x1b\[[?0-9;]*[A-Za-z]")
"""What makes a terminal show colours and bars."""

SENTENCE = re.compile(r"Error: |Interrupted\.$|.[─-] Error [─-]")
"""How the one line begins that says what was wrong; the last is that of the option parser's box."""

Attempt = Callable[[tuple[str, ...], Surroundings, bool], None]


@pytest.fixture(scope="module")
def materials(python_fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Materials:
    folder = tmp_path_factory.mktemp("materials")
    fmus = ("--fmus", str(python_fmu_folder))
    made = Materials(python_fmu_folder, folder / "ok.ssp", folder / "ok.checkpoint")
    output = ("--output", str(folder / "out"), "--checkpoint", str(made.checkpoint), "--no-plots")
    for command in (
        ["export", "lift", str(made.package), *fmus],
        ["run", "lift", "--stop-time", "0.001", *output, *fmus],
    ):
        assert CliRunner().invoke(app, command).exit_code == 0
    return made


@pytest.fixture(scope="module")
def attempt(materials: Materials, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Attempt]:
    """Make a call in a new folder, and look at what came of it."""
    counts = Counter[str]()
    with CommandServer(materials.fmus) as server:

        def one(arguments: tuple[str, ...], around: Surroundings, cold: bool) -> None:
            folder = tmp_path_factory.mktemp("call")
            try:
                counts[_attempted(server, folder, arguments, around, cold)] += 1
            finally:
                shutil.rmtree(folder)

        def _attempted(
            server: CommandServer, folder: Path, arguments: tuple[str, ...], around: Surroundings, cold: bool
        ) -> str:
            here, temporary = folder / "here", folder / "temporary"
            here.mkdir()
            temporary.mkdir()
            given = place(arguments, here, materials)
            inputs = found(here)
            own = {n: v and v.replace(FOLDER, str(here)) for n, v in around.environment.items()}
            ended = server.call(
                Call(
                    given,
                    str(here),
                    around.streams,
                    {"TMPDIR": str(temporary), **own},
                    around.encoding,
                    around.largest,
                    cold=cold,
                )
            )
            check_said(ended, around, asks_nothing=not arguments)
            assert not list(temporary.iterdir()), "temporary files are left"
            check_files(folder, inputs, given)
            return f"{'cold' if cold else 'warm'}: code {ended.code}{', after Ctrl-C' * ended.asked}"

        yield one
    print(f"\n{sum(counts.values())} commands; " + "; ".join(f"{n} x {w}" for w, n in sorted(counts.items())))


def check_said(ended: Ended, around: Surroundings, asks_nothing: bool) -> None:
    """It ends with one sentence where it fails; help answers who asks nothing."""
    assert ended.alone, "a process survives"
    assert ended.code in (0, 1, 2), ended
    assert "Traceback" not in ended.stdout + ended.stderr, ended.stderr
    if around.streams[2] in (CLOSED, FULL):
        return
    lines = CONTROL.sub("", ended.stderr).splitlines()
    sentences = [x for x in lines if SENTENCE.match(x)]
    told = asks_nothing and ended.code == 2
    assert len(sentences) == (1 if ended.code and not told else 0), ended


def found(folder: Path) -> dict[Path, tuple[int, bytes]]:
    """What kind of file each one is, and its content."""
    kinds = {p: p.lstat().st_mode for p in folder.rglob("*")}
    return {p: (stat.S_IFMT(k), b"" if not stat.S_ISREG(k) else p.read_bytes()) for p, k in kinds.items()}


def check_files(folder: Path, inputs: dict[Path, tuple[int, bytes]], arguments: list[str]) -> None:
    """New files are whole, and earlier ones as they were; what may be replaced is whole too."""
    after = found(folder)
    named = "\0".join(arguments)
    for path, before in inputs.items():
        assert path in after and after[path][0] == before[0], f"{path.name} is gone"
        changed = after[path] != before
        empty = before == (stat.S_IFREG, b"")  # nobody misses its content
        ours = empty or path.suffix in (".ssp", ".checkpoint") or "--overwrite" in arguments
        assert not changed or (path.name in named and ours)
        if not changed and path.is_file() and not path.is_symlink():
            path.unlink()
    assert_whole(folder)


@examples(FEW, EXAMPLES - COLD, **ANY)
@example(arguments=SHORT, around=Surroundings(largest=0))
@example(arguments=SHORT, around=Surroundings(largest=1))
@example(arguments=("run", "ok.ssp", *SHORT[2:]), around=Surroundings(largest=0))
@example(arguments=("list",), around=Surroundings((USABLE, FULL, USABLE)))
@example(arguments=("--help",), around=Surroundings((USABLE, FULL, USABLE)))
@given(arguments=commands, around=surroundings)
def test_any_command(arguments: tuple[str, ...], around: Surroundings, attempt: Attempt) -> None:
    attempt(arguments, around, False)


@examples(1, COLD, **ANY)
@given(arguments=commands, around=surroundings)
def test_any_command_that_imports_everything(
    arguments: tuple[str, ...], around: Surroundings, attempt: Attempt
) -> None:
    attempt(arguments, around, True)
