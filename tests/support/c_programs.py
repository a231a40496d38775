"""The C programs of these tests: compiled, run, and told by a plan file what to do."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from fmpy.model_description import ModelVariable
from numpy.typing import NDArray

from emla_cosim.fmu.file import FmuFile
from emla_cosim.master.stepping.timing import CommunicationPoints
from emla_cosim.system.model import System, Value

CC = shutil.which("cc")

needs_cc = pytest.mark.skipif(
    CC is None or sys.platform != "linux", reason="The C programs need Linux and its C compiler `cc`."
)

SANITIZERS = {
    "none": [],
    # gcc's "undefined" lacks conversions from floats; divisions by zero are defined by IEEE 754
    "address": [
        "-fsanitize=address,undefined,float-cast-overflow",
        "-fno-sanitize-recover=all",
        "-fno-omit-frame-pointer",
    ],
    "thread": ["-fsanitize=thread"],
}
_SOURCES = Path(__file__).parent / "c_host"
_FLAGS = ["-std=c11", "-O1", "-g", "-ffp-contract=off", "-I", str(files("fmpy").joinpath("c-code"))]
_STRICT = ["-Wall", "-Wextra", "-Wpedantic", "-Werror"]
_ENVIRONMENT = {
    "ASAN_OPTIONS": "detect_leaks=1:detect_stack_use_after_return=1:strict_string_checks=1",
    "UBSAN_OPTIONS": "print_stacktrace=1",
}


@dataclass(frozen=True)
class Build:
    """Our C programs by name, and the FMUs' libraries by model, all compiled in one way."""

    programs: Mapping[str, Path]
    libraries: Mapping[str, Path]


def build(sanitizer: str, programs: Sequence[str], fmus: Iterable[FmuFile], folder: Path) -> Build:
    """Compile programs of this folder and the sources of FMUs, as many at a time as there are cores.

    What the folder has is not compiled again.
    """
    flags = [*_FLAGS, *SANITIZERS[sanitizer]]
    binaries, libraries = {p: folder / p for p in programs}, {}
    commands = [
        [*flags, *_STRICT, str(_SOURCES / f"{p}.c"), "-o", str(binary), "-pthread", "-ldl", "-lm"]
        for p, binary in binaries.items()
    ]
    for fmu in fmus:
        libraries[fmu.model_identifier] = library = folder / f"{fmu.model_identifier}.so"
        source = fmu.folder / "sources" / "fmi2_block.c"
        shared = ["-shared", "-fPIC", "-fvisibility=hidden"]
        commands.append([*flags, *shared, str(source), "-o", str(library), "-lm"])
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(_compile, (c for c in commands if not Path(c[c.index("-o") + 1]).exists())))
    return Build(binaries, libraries)


def _compile(arguments: Sequence[str]) -> None:
    run = subprocess.run([str(CC), *arguments], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


def windows_host(folder: Path) -> Path:
    """Compile host.c for Windows on x86-64."""
    program = folder / "host.exe"
    zig = [sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-windows-gnu", *_FLAGS, "-g0"]
    command = [*zig, str(_SOURCES / "host.c"), "-o", str(program), "-lpthread"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return program


def read_results(path: Path) -> NDArray[np.float64]:
    """Read what host.c has written: a row for each communication point, shape (points, printed)."""
    lines = path.read_text().splitlines()
    return np.array([[float.fromhex(value) for value in line.split()] for line in lines])


def run_program(*command: str | Path, **environment: str) -> str:
    """Run a program to its end, which must be without any complaint; returns its output."""
    words = [*without_randomization(), *map(str, command)]
    settings = {**os.environ, **_ENVIRONMENT, **environment}
    run = subprocess.run(words, capture_output=True, text=True, errors="replace", check=False, env=settings)
    assert (run.returncode, run.stderr) == (0, ""), f"{' '.join(words)}\n{run.returncode}\n{run.stderr}"
    return run.stdout


@cache
def without_randomization() -> list[str]:
    """What to put before a command so that its addresses are not random, where that is allowed.

    The sanitizers of gcc 13 and older may not find their place otherwise (vm.mmap_rnd_bits = 32).
    """
    command = ["setarch", "-R"]
    allowed = shutil.which("setarch") and subprocess.run([*command, "true"], capture_output=True, check=False)
    return command if allowed and allowed.returncode == 0 else []


def host_plan(
    system: System,
    fmus: Mapping[str, FmuFile],
    libraries: Mapping[str, Path],
    times: CommunicationPoints,
    printed: Iterable[str],
) -> str:
    """The plan for host.c: a system, the FMU and library of each model, what to print by full name."""
    first, per_step, denominator = (x.hex() for x in times.clock)
    lines = [f"time {first} {per_step} {denominator} {times.steps}"]
    position = {c.name: i for i, c in enumerate(system.components)}
    model = {c.name: fmus[c.model] for c in system.components}

    def end(component: str, variable: str) -> str:
        return f"{position[component]} {model[component].variables[variable].valueReference}"

    for c in system.components:
        fmu = model[c.name]
        resources = (fmu.folder / "resources").as_uri()
        lines.append(f"component {c.name} {fmu.description.guid} {resources} {libraries[c.model]}")
        for name, value in c.parameters.items():
            lines.append(_start_value(fmu.variables[name], end(c.name, name), value))
    lines += [f"connect {end(x.source, x.output)} {end(x.target, x.input)}" for x in system.connections]
    lines += [f"print {end(component.name, variable)}" for component, variable in map(system.split, printed)]
    return "\n".join(lines) + "\n"


def _start_value(variable: ModelVariable, variable_key: str, value: Value) -> str:
    match variable.type:
        case "Real":
            return f"real {variable_key} {float(value).hex()}"
        case "Boolean":
            return f"boolean {variable_key} {int(value)}"
        case _:
            return f"integer {variable_key} {int(value)}"


def fuzz_plan(fmu: FmuFile, library: Path, foreign: FmuFile, foreign_library: Path) -> str:
    """The plan for fuzz.c: a model, and another one for its states."""
    description = fmu.description
    lines = [
        f"model {description.guid} {library}",
        f"foreign {foreign.description.guid} {foreign_library}",
        f"continuous {description.numberOfContinuousStates} {description.numberOfEventIndicators}",
        *(f"category {category.name}" for category in description.logCategories),
        *(_described(v) for v in description.modelVariables),
    ]
    if step := fmu.variables.get("solver.internal_step"):
        lines.append(f"internal_step {step.valueReference}")
    return "\n".join(lines) + "\n"


def _described(variable: ModelVariable) -> str:
    kind = {"Real": "r", "Boolean": "b"}.get(variable.type, "i")
    settable = variable.initial == "exact"
    role = {"input": "i", "parameter": "p", "output": "s" if settable else "o"}.get(variable.causality, "l")
    start = {"true": 1.0, "false": 0.0, None: 0.0}.get(variable.start) if kind == "b" else variable.start or 0
    low = "-inf" if variable.min is None else variable.min
    high = "inf" if variable.max is None else variable.max
    return f"variable {kind} {variable.valueReference} {role} {start} {low} {high}"
