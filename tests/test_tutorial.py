"""The steps of docs/tutorial.md work as shown.

Blocks are read in order, by the words after their fence:

    python file=NAME    the block is a file; any language
    sh                  commands, which end with 0, or the last one as in `sh exit=2`
    python run          a script
    text output         lines that the commands just before have shown, in this order; ... leaves out other
                        lines, or the rest of a line
    sh not-run          shown only; any language
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from typer.testing import CliRunner

from emla_cosim.cli import app
from tests.support.commands import widen_terminal

DOCS = Path(__file__).parents[1] / "docs"
TEXT = (DOCS / "tutorial.md").read_text(encoding="utf-8")

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="libcosim and Ecos have packages for Linux only"
)


@dataclass(frozen=True)
class Block:
    """What stands between two fences; `line` is that of the first fence."""

    line: int
    info: str
    content: str


def blocks() -> Iterator[Block]:
    for found in re.finditer(r"^```(.+)\n((?:.*\n)*?)```$", TEXT, re.MULTILINE):
        yield Block(TEXT.count("\n", 0, found.start()) + 1, found[1], found[2])


Ended = tuple[int, str]
"""Exit code and everything that was shown."""


def started(command: str | list[str]) -> Ended:
    """A command in a process of its own, which finds the programs of this environment."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        command,
        shell=isinstance(command, str),
        env={**os.environ, "PATH": path},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        check=False,
    )
    return done.returncode, done.stdout


def emla(command: str) -> Ended:
    """The `emla` command in this process, which has it ready."""
    result = CliRunner().invoke(app, shlex.split(command)[1:])
    return result.exit_code, result.output


def run(content: str) -> Ended:
    """Commands up to the first that fails."""
    shown, code = "", 0
    for command in content.splitlines():
        code, output = emla(command) if command.startswith("emla ") else started(command)
        shown += output
        if code != 0:
            break
    return code, shown


def missing(expected: str, shown: str) -> list[str]:
    """Lines that were not shown, or not in this order."""
    rest = iter(shown.splitlines())

    def found(line: str) -> bool:
        start = line.removesuffix("...").rstrip()
        return any(x.startswith(start) if line.endswith("...") else x.rstrip() == start for x in rest)

    return [line for line in expected.splitlines() if line != "..." and not found(line)]


def test_everything_works_as_shown(fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    widen_terminal(monkeypatch)
    shutil.copytree(fmu_folder, "fmus")  # as the first run would build them
    shown, kinds = "", set()
    for block in blocks():
        language, what, where = block.info.split()[0], block.info.partition(" ")[2], f"line {block.line}"
        kinds.add(what.partition("=")[0])
        match what.partition("="):
            case "not-run", _, _:
                continue
            case "file", _, name:
                Path(name).write_text(block.content, encoding="utf-8")
            case "output", _, _:
                assert missing(block.content, shown) == [], f"{where}: {shown}"
            case "run", _, _:
                code, shown = started([sys.executable, "-c", block.content])
                assert code == 0, f"{where}: {shown}"
            case (("" | "exit"), _, expected):
                assert language == "sh", where
                code, shown = run(block.content)
                assert code == int(expected or 0), f"{where}: {shown}"
            case _:
                pytest.fail(f"{where}: nobody knows what to do with '{block.info}'")
    assert kinds == {"not-run", "file", "output", "run", "", "exit"}


def test_a_line_that_was_not_shown_is_found() -> None:
    shown = "one\ntwo  \nthree\n"
    assert missing("one\n...\nthree\n", shown) == []
    assert missing("o...\ntwo ...\nthree\n", shown) == []
    assert missing("on\n", shown) == ["on"]
    assert missing("two\none\n", shown) == ["one"]
    assert missing("four\n", shown) == ["four"]


def test_links_lead_somewhere() -> None:
    headings = re.findall(r"^## (.+)$", TEXT, re.MULTILINE)
    anchors = {re.sub(r"[^\w -]", "", h).lower().replace(" ", "-") for h in headings}
    for target in re.findall(r"\]\(((?!http)[^)]+)\)", TEXT):
        file, _, anchor = target.partition("#")
        assert (DOCS / file).exists(), target
        assert file or anchor in anchors, target
