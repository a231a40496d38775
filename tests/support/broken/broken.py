"""What is wrong with an FMU that was broken on purpose, and which check has to say so."""

import csv
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import fmpy

from fmu_verify.check import Verdict
from fmu_verify.settings import Settings
from fmublock.archive import write_archive


@dataclass(frozen=True)
class Broken:
    """An FMU that is as it should be but for one thing.

    `what` is that thing, as the documentation's table says it, and `check` the name of the check that
    has to fail for it, and alone: what needs it is skipped, and everything else passes. `build` makes
    the FMU in a folder and returns its file. `verdict` is WARNING for what the standard allows, and
    PASSED for what is only noted, since no sentence of the standard judges it.
    """

    name: str
    what: str
    check: str
    build: Callable[[Path], Path]
    settings: Settings = field(default_factory=Settings)
    verdict: Verdict = Verdict.FAILED


def name_fault(*words: str) -> str:
    """Return the name of an FMU, by its fault: StepKillGroup."""
    return "".join(word.capitalize() for word in re.split(r"[:_ .()]+", " ".join(words)))


def read_faults(
    fmu: str,
    build: Callable[[Path, Mapping[str, str], str], Path],
    settings: Mapping[str, Settings] | None = None,
) -> list[Broken]:
    """Read the faults of an FMU from faults.csv.

    Args:
        fmu: The FMU.
        build: Makes an FMU in a folder, from a row of the file and with a name.
        settings: Settings by fault. Default: the defaults of `emla verify`.
    """
    verdicts = {"failed": Verdict.FAILED, "warning": Verdict.WARNING, "noted": Verdict.PASSED}
    with Path(__file__).with_name("faults.csv").open(newline="", encoding="utf-8") as stream:
        rows = [row for row in csv.DictReader(stream) if row["fmu"] == fmu]
    return [
        Broken(
            name := row["name"] or name_fault(row["fault"], row["target"]),
            row["what"],
            row["check"],
            lambda folder, row=row, name=name: build(folder, row, name),
            (settings or {}).get(row["fault"], Settings()),
            verdicts[row["verdict"]],
        )
        for row in rows
    ]


def write_fmu(
    path: Path, description: str, library: bytes, fault: str, more: Mapping[str, bytes] | None = None
) -> Path:
    """Write an FMU of FMI 2.0 whose library reads a fault; `more` are further files by path."""
    content = {
        "modelDescription.xml": description.encode(),
        f"binaries/{fmpy.platform}/{path.stem}{fmpy.sharedLibraryExtension}": library,
        "documentation/index.html": b"<!doctype html><title>About</title><p>It does what it says.",
        "documentation/licenses/license.txt": b"Do what you want.",
        "resources/fault.txt": f"{fault}\n".encode(),
    }
    write_archive(path, {**content, **(more or {})})
    return path
