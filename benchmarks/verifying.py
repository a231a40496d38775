"""Measure how long `emla verify` takes for FMUs with many variables: python -m benchmarks.verifying 10000.

Each FMU is made from wide.c, with as many variables as an argument says. `--keep FOLDER` keeps the FMUs.
"""

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path

import fmpy

STATES = 10
GUID = "{71de0000-0000-4000-8000-000000000000}"


def build_wide_fmu(folder: Path, count: int) -> Path:
    """Build an FMU with `count` variables, at least 100, in a folder; return its file."""
    name, tenth = f"Wide{count}", count // 10
    library = folder / f"{name}{fmpy.sharedLibraryExtension}"
    headers = Path(fmpy.__file__).parent / "c-code"
    macros = [f"-DN={count}", f"-DSTATES={STATES}", f'-DMODEL_GUID="{GUID}"', f"-I{headers}"]
    source = Path(__file__).with_name("wide.c")
    subprocess.run(["cc", "-shared", "-fPIC", "-O2", *macros, str(source), "-o", str(library)], check=True)
    path = folder / f"{name}.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", "\n".join(_describe(name, count, tenth)))
        archive.write(library, f"binaries/{fmpy.platform}/{library.name}")
        archive.writestr("documentation/index.html", "<!doctype html><title>About</title><p>Many variables.")
    library.unlink()
    return path


def _describe(name: str, count: int, tenth: int) -> Iterator[str]:
    """Yield the lines of modelDescription.xml."""
    inputs, parameters, outputs, states = 0, tenth, 2 * tenth, 3 * tenth
    derivatives, others = states + STATES, states + 2 * STATES
    yield (
        '<?xml version="1.0" encoding="UTF-8"?>'
        f'<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{GUID}" generationTool="wide.c">'
        f'<CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true" '
        'canGetAndSetFMUstate="true" canSerializeFMUstate="true" providesDirectionalDerivative="true"/>'
        '<DefaultExperiment startTime="0" stopTime="1" stepSize="0.01"/><ModelVariables>'
    )
    for k in range(count):
        attributes, value = 'causality="local" initial="calculated"', "<Real/>"
        if k < parameters:
            attributes, value = 'causality="input"', '<Real start="0"/>'
        elif k < outputs:
            attributes = 'causality="parameter" variability="fixed" initial="exact"'
            value = '<Real start="2"/>'
        elif k < states:
            attributes = 'causality="output" initial="calculated"'
        elif k < derivatives:
            attributes, value = 'causality="local" initial="exact"', '<Real start="1"/>'
        elif k < others:
            value = f'<Real derivative="{k - STATES + 1}"/>'
        name = f"part[{k // 100}].v{k}"
        yield f'<ScalarVariable name="{name}" valueReference="{k}" {attributes}>{value}</ScalarVariable>'
    unknowns = [(outputs + k, f"{inputs + k + 1} {states + 1}") for k in range(tenth)]
    slopes = [(derivatives + k, f"{inputs + k + 1} {states + k + 1}") for k in range(STATES)]
    yield "</ModelVariables><ModelStructure>"
    at_start = [(k, f"{k - outputs + 1} {parameters + k - outputs + 1} {states + 1}") for k, _ in unknowns]
    listed = {"Outputs": unknowns, "Derivatives": slopes, "InitialUnknowns": [*at_start, *slopes]}
    for element, entries in listed.items():
        lines = (f'<Unknown index="{k + 1}" dependencies="{on}"/>' for k, on in entries)
        yield f"<{element}>{''.join(lines)}</{element}>"
    yield "</ModelStructure></fmiModelDescription>"


def main() -> None:
    """Build, verify and print times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("counts", nargs="+", type=int, help="numbers of variables")
    parser.add_argument("--keep", type=Path, help="folder for the FMUs")
    arguments, emla = parser.parse_args(), str(Path(sys.executable).with_name("emla"))
    with contextlib.ExitStack() as stack:
        folder = arguments.keep or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.mkdir(exist_ok=True)
        for count in arguments.counts:
            path = build_wide_fmu(folder, count)
            before, start = os.times(), time.perf_counter()
            process = subprocess.run([emla, "verify", str(path)], capture_output=True, text=True)
            after, took = os.times(), time.perf_counter() - start
            used = sum(after[2:4]) - sum(before[2:4])
            print(f"{count} variables: {took:.1f} s, CPU time {used:.1f} s, exit code {process.returncode}")


if __name__ == "__main__":
    main()
