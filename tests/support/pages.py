"""Pages of the documentation, done as they say.

Blocks are read in order, by the words after their fence:

    python              run in one namespace for the whole page, in this process
    python run          a script of its own
    python file=NAME    the block is a file; any language
    sh                  commands, which end with 0, or the last one as in `sh exit=2`
    text output         lines that the block just before has shown, in this order; ... leaves out other
                        lines, or the rest of a line
    python not-run      shown only; any language

Blocks in other languages, and in none, are shown only.
"""

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from unittest.mock import patch

from click.testing import CliRunner

import emla_cosim as ec
import emla_cosim.study.loading  # registers what the study brings, before registries are kept
from emla_cosim.cli.app import app

from .paths import ROOT

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
"""All pages that may show something."""

_REGISTRIES = (
    ec.ALGORITHMS,
    ec.CONTROLLERS,
    ec.METRICS,
    ec.RECORDERS,
    ec.STEP_SIZE_CONTROLS,
    ec.TABLES,
)

Ended = tuple[int, str]
"""Exit code and everything that was shown."""


class PageError(AssertionError):
    """What a page shows does not work as shown."""


@dataclass(frozen=True)
class Fence:
    """The block between two fences; `line` is that of the first fence."""

    line: int
    language: str
    info: str
    content: str


def fences(text: str) -> Iterator[Fence]:
    """All blocks of a page, in order."""
    for match in re.finditer(r"^```(.*)\n((?:.*\n)*?)```$", text, re.MULTILINE):
        language, _, info = match[1].partition(" ")
        yield Fence(text.count("\n", 0, match.start()) + 1, language, info, match[2])


class Reader:
    """Does what a page says, one block after the other, in the current folder."""

    def __init__(self, page: Path) -> None:
        self.page = page
        self._output = ""
        self._module = ModuleType("page")

    def read(self) -> None:
        """Do all of it. Raises PageError for what does not work as shown."""
        with contextlib.ExitStack() as stack:
            for registry in _REGISTRIES:
                stack.enter_context(patch.dict(registry))
            sys.modules["page"] = self._module  # alone: what a page imports stays imported
            stack.callback(sys.modules.pop, "page")
            for fence in fences(self.page.read_text(encoding="utf-8")):
                self._do(fence)

    def _do(self, fence: Fence) -> None:
        name, _, value = fence.info.partition("=")
        match fence.language, name:
            case _, "not-run":
                pass
            case _, "file":
                Path(value).write_text(fence.content, encoding="utf-8")
            case _, "output":
                self._check(fence, not (lacking := missing(fence.content, self._output)), f"{lacking}")
            case "python", "run":
                self._expect(fence, _started([sys.executable, "-c", fence.content]), 0)
            case "python", "":
                self._expect(fence, self._executed(fence), 0)
            case "sh", "" | "exit":
                self._expect(fence, _commanded(fence.content), int(value or 0))
            case _, "":
                pass
            case _:
                self._check(fence, False, f"unknown word '{fence.info}'")

    def _expect(self, fence: Fence, ended: Ended, expected: int) -> None:
        code, self._output = ended
        self._check(fence, code == expected, f"ended with {code}")

    def _check(self, fence: Fence, holds: bool, otherwise: str) -> None:
        if not holds:
            raise PageError(f"{self.page.name}, line {fence.line}: {otherwise}\n{self._output}")

    def _executed(self, fence: Fence) -> Ended:
        """The block in this process; lines of a traceback are those of the page."""
        output = io.StringIO()
        code = compile("\n" * fence.line + fence.content, str(self.page), "exec")
        with contextlib.redirect_stdout(output):
            exec(code, vars(self._module))
        return 0, output.getvalue()


def _started(command: str | list[str]) -> Ended:
    """A command in a process of its own, which finds the programs of this environment."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    process = subprocess.run(
        command,
        shell=isinstance(command, str),
        env={**os.environ, "PATH": path},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        check=False,
    )
    return process.returncode, process.stdout


def _emla(command: str) -> Ended:
    """The `emla` command in this process, which has it ready."""
    result = CliRunner().invoke(app, shlex.split(command, comments=True)[1:])
    return result.exit_code, result.output


def _commanded(content: str) -> Ended:
    """Commands up to the first that fails."""
    all_output, code = "", 0
    for command in content.splitlines():
        code, output = _emla(command) if command.startswith("emla ") else _started(command)
        all_output += output
        if code != 0:
            break
    return code, all_output


def missing(expected: str, output: str) -> list[str]:
    """Lines that were not shown, or not in this order."""
    rest = iter(output.splitlines())

    def was_shown(line: str) -> bool:
        start = line.removesuffix("...").rstrip()
        return any(x.startswith(start) if line.endswith("...") else x.rstrip() == start for x in rest)

    return [line for line in expected.splitlines() if line != "..." and not was_shown(line)]
