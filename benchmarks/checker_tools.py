"""The tools that look for faults in FMUs: how they are called, and what they say.

A tool complains about an FMU if its exit code is not 0, or if it prints a warning or an error. It runs in a
process and folder of its own.
"""

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import fmpy

KINDS = {"CoSimulation": "cs", "ModelExchange": "me"}
"""Names of the kinds of an FMU in its model description, and those of fmusim."""

MEMORY_KIB = 4 * 2**20
"""Limit of the data of a tool that runs the FMU without a limit of its own."""

MOST_OUTPUT = 2**20
"""Bytes of a tool's output that are read: FMUs may print without end."""

NOT_FOUND, FOUND, CRASHED, HUNG, NOT_APPLICABLE = "not found", "found", "crashed", "hung", "not applicable"

OF_SIMULATOR = r"^\S*(Error|Exception)\b|\[(?i:warning|error|fatal)\]"
"""Warnings and errors in the output of simulators, also those of the FMU."""


@dataclass(frozen=True)
class Checker:
    """A tool.

    Attributes:
        name: Its name in the table.
        version: What it says about its version.
        command: Its command, without options and the FMU.
        complaint: What lines with a warning or an error match.
        versions: Versions of FMI that it is for.
        kinds: Options that select a kind of FMU. Default: one run, without an option.
        calls: It calls the FMU, and its memory is limited from outside.
    """

    name: str
    version: str
    command: Sequence[str]
    complaint: str
    versions: Sequence[int] = (2, 3)
    kinds: Mapping[str, Sequence[str]] = field(default_factory=dict)
    calls: bool = False


@dataclass(frozen=True)
class Answer:
    """What a tool says about an FMU: its complaints, or the reason why it did not answer."""

    complaints: Sequence[str] = ()
    exit_code: int = 0
    verdict: str = ""

    def __add__(self, further: "Answer") -> "Answer":
        """Return both answers as one."""
        complaints = [*self.complaints, *further.complaints]
        return Answer(complaints, self.exit_code or further.exit_code, self.verdict or further.verdict)

    def words(self, path: Path) -> dict[str, str]:
        """Return the complaints by what they say without numbers and the name of the FMU."""
        return {re.sub(rf"\d+|{re.escape(path.stem)}", "#", line): line for line in self.complaints}


def find_checkers(arguments: argparse.Namespace) -> tuple[list[Checker], list[str]]:
    """Return the tools that are there, and the names of the others."""
    python = [sys.executable, "-m"]
    checkers = [
        Checker(
            "FMPy, validate",
            fmpy.__version__,
            [*python, "fmpy", "validate"],
            r"^(?!No problems found|\d+ problems were found).",
        ),
        Checker(
            "FMPy, simulate",
            fmpy.__version__,
            [*python, "fmpy", "simulate"],
            OF_SIMULATOR,
            kinds={kind: ["--interface-type", kind] for kind in KINDS},
            calls=True,
        ),
    ]
    missing = []
    if fmusim := arguments.fmusim or shutil.which("fmusim"):
        options = {kind: ["--interface-type", name] for kind, name in KINDS.items()}
        command = [str(fmusim), "--output-file", "out.csv"]
        number = ask_version(str(fmusim), "--version")
        checkers.append(Checker("fmusim", number, command, OF_SIMULATOR, kinds=options, calls=True))
    else:
        missing.append("fmusim")
    for number, jar in ((2, arguments.vdmcheck2), (3, arguments.vdmcheck3)):
        if jar and shutil.which("java"):
            command = ["java", "-jar", str(jar)]
            pattern = r"^(?!No errors found|Errors found|Warning \d|See:|https?:)."
            checkers.append(Checker(f"VDMCheck{number}", version_of_jar(jar), command, pattern, (number,)))
        else:
            missing.append(f"VDMCheck{number}")
    if path := arguments.fmu_compliance_checker or shutil.which("fmuCheck.linux64"):
        command = [str(path), "-o", "out.csv"]
        pattern = r"\[(WARNING|ERROR|FATAL)\]"
        checkers.append(Checker("FMUComplianceChecker", "", command, pattern, (2,), calls=True))
    else:
        missing.append("FMUComplianceChecker")
    return checkers, missing


def ask_version(*command: str) -> str:
    """Return the version that a command prints: its first number with points."""
    output = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    match = re.search(r"\d+(\.\d+)+", output)
    return match[0] if match else ""


def version_of_jar(path: Path) -> str:
    """Return the version in the manifest of a jar."""
    with zipfile.ZipFile(path) as archive:
        manifest = archive.read("META-INF/MANIFEST.MF").decode()
    match = re.search(r"^Implementation-Version: (\S+)", manifest, flags=re.MULTILINE)
    return match[1] if match else ""


def ask(checker: Checker, path: Path, limit: float, answers: dict[tuple[str, object], Answer]) -> Answer:
    """Return what a tool says about an FMU, of each kind that it has; `answers` has earlier answers."""
    text = read_description(path)
    if text and fmi_version(path) not in checker.versions:
        return Answer(verdict=NOT_APPLICABLE)
    key = (checker.name, path if checker.calls else content_of(path))
    if key not in answers:
        answer = Answer()
        for options in [checker.kinds[kind] for kind in checker.kinds if f"<{kind}" in text] or [()]:
            answer += run(checker, options, path, limit)
        answers[key] = answer
    return answers[key]


def content_of(path: Path) -> object:
    """Return what tools read that do not call an FMU, without its name; its path if the file is damaged."""
    name = path.stem
    try:
        with zipfile.ZipFile(path) as archive:
            texts = [archive.read(n).decode("latin-1") for n in archive.namelist() if n.endswith(".xml")]
            names = [entry.orig_filename for entry in archive.infolist()]
    except (OSError, NotImplementedError, zipfile.BadZipFile, zlib.error):
        return path
    return tuple(text.replace(name, "") for text in [*names, *texts])


def run(checker: Checker, options: Sequence[str], path: Path, limit: float) -> Answer:
    """Run a tool. A shell is between: an FMU may end the parent process."""
    words = [*checker.command, *options, str(path)]
    script = f'{f"ulimit -d {MEMORY_KIB}; " if checker.calls else ""}"$@"; exit $?'
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        tempfile.TemporaryFile() as output,
    ):
        process = subprocess.Popen(
            ["sh", "-c", script, "sh", *words],
            cwd=folder,
            env=os.environ | {"HOME": folder},
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            code = process.wait(limit)
        except subprocess.TimeoutExpired:
            return Answer(verdict=HUNG)
        finally:
            with suppress(OSError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        output.seek(0)
        text = output.read(MOST_OUTPUT).decode("utf-8", "replace")
    number = -code if code < 0 else code - 128  # of the shell, or of the tool, as the shell says it
    if number in signal.valid_signals():
        return Answer([signal.Signals(number).name], code, CRASHED)
    lines = [without_paths(line) for line in text.splitlines() if line.strip()]
    complaints = [line for line in lines if re.search(checker.complaint, line)]
    if code and not complaints:
        complaints = [f"exit code {code}: {lines[-1] if lines else ''}".rstrip(": ")]
    return Answer(complaints, code)


def read_description(path: Path) -> str:
    """Return the model description of an FMU, or an empty text."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.read("modelDescription.xml").decode("utf-8", "replace")
    except (OSError, KeyError, zipfile.BadZipFile, zlib.error):
        return ""


def fmi_version(path: Path) -> int:
    """Return the version of FMI of a good FMU."""
    return 3 if 'fmiVersion="3' in read_description(path) else 2


def without_paths(line: str) -> str:
    """Return a line without colors, and with names of files instead of paths."""
    return re.sub(r"(file:)?(/[\w.+-]+)+/", "", re.sub(r"\x1b\[[\d;]*m", "", line)).strip()
