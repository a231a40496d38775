"""Instances of an FMU for FMI 3.0, freed together, and everything they log."""

import sys
import zipfile
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import fmpy
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave
from lxml import etree

from tests.support.c_programs import SANITIZERS
from tests.support.processes import run
from tests.support.sessions import ERROR

WARNINGS = ["-std=c11", "-O1", "-g", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wno-unused-function"]


class Host:
    """Instances of an FMU for FMI 3.0, and what they logged."""

    def __init__(self, path: Path, folder: Path) -> None:
        self.description = fmpy.read_model_description(str(path))
        self.folder = folder
        self.lines: list[tuple[int, str]] = []
        self.instances: list[Any] = []
        fmpy.extract(str(path), folder)

    def new(self, kind: Any = FMU3Slave, token: str | None = None, name: str = "toy", **options: Any) -> Any:
        instance = kind(
            guid=self.description.guid if token is None else token,
            unzipDirectory=str(self.folder),
            modelIdentifier=self.description.modelName,
            instanceName=name,
        )
        instance.instantiate(logMessage=self._log, loggingOn=True, **options)
        self.instances.append(instance)
        return instance

    def started(self, kind: Any = FMU3Slave, running: bool = True, time: float = 0.0) -> Any:
        instance = self.new(kind)
        instance.enterInitializationMode(startTime=time)
        if running:
            instance.exitInitializationMode()
        return instance

    def refused(self, call: Callable[..., Any], *arguments: Any, status: int = ERROR) -> str:
        """Return the one message with which a call is refused."""
        before = len(self.lines)
        with pytest.raises(FMICallException) as failure:
            call(*arguments)
        assert failure.value.status == status
        ((logged, text),) = self.lines[before:]
        assert logged == status
        return text

    def close(self) -> None:
        for instance in self.instances:
            instance.freeInstance()

    def _log(self, environment: Any, status: int, category: bytes, message: bytes) -> None:
        self.lines.append((status, message.decode()))


def root_of(fmu: Path, name: str) -> Any:
    """Return the root element of an XML file in an FMU."""
    with zipfile.ZipFile(fmu) as archive:
        return etree.fromstring(archive.read(name))


def call_at_random(
    host: Host, folder: Path, calls: int, references: int, clock: int, *needed: int
) -> dict[str, list[int]]:
    """Return how often each function returned each status in random calls; see `fmi3_calls.py`.

    The sources are compiled for the address sanitizer, which ends the process at the first wrong access.
    """
    library, headers = folder / "Toy.so", files("fmpy").joinpath("c-code")
    runtime = run("cc", "-print-file-name=libasan.so").stdout.strip()
    source = host.folder / "sources" / "fmi3_block.c"
    shared = ["-shared", "-fPIC", "-fvisibility=hidden"]
    options = [*WARNINGS, *SANITIZERS["address"], *shared, "-I", str(headers)]
    run("cc", *options, source, "-o", library, "-lm", check=True)
    script = files("tests.support").joinpath("fmi3_calls.py")
    numbers = (references, 1, calls, clock, *needed)
    environment = {"LD_PRELOAD": runtime, "PYTHONMALLOC": "malloc", "ASAN_OPTIONS": "detect_leaks=0"}
    process = run(sys.executable, script, library, host.description.guid, *numbers, environment=environment)
    assert (process.returncode, process.stderr) == (0, "")
    return {name: [int(n) for n in counts] for name, *counts in map(str.split, process.stdout.splitlines())}
