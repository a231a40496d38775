"""The stepper in C on random systems, programs and failing FMUs, in hosts without Python, under sanitizers.

stepper_host.c, events_host.c and lanes_host.c say what is done and checked. Everything depends on fixed
seeds; a failure says which one to repeat. With other seeds than those of CI:

    EMLA_FUZZ_SEED=100000 EMLA_FUZZ_SEEDS=50000 pytest -m "slow or nightly" tests/interop/test_stepper_fuzz.py
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

import pytest

from tests.support.c_programs import SANITIZERS, needs_cc, run_program
from tests.support.paths import SUPPORT

pytestmark = needs_cc

SEED = int(os.environ.get("EMLA_FUZZ_SEED", "1"))
SEEDS = int(os.environ.get("EMLA_FUZZ_SEEDS", "10000"))
FEW = 500
"""Seeds of the default tier: enough for each failure."""

_NATIVE = Path(str(files("emla_cosim.stepper").joinpath("native")))
_FLAGS = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-ffp-contract=off"]
# clang warns of what the standard's own headers have
_HEADERS = ["-isystem", str(files("fmpy").joinpath("c-code"))]
_ZIG = [sys.executable, "-m", "ziglang", "cc"]
_COMPILERS = {
    "gcc": ["gcc"],
    "clang": _ZIG,
    "clang for Windows": [*_ZIG, "-target", "x86_64-windows-gnu"],
}


@pytest.mark.parametrize(("program", "good"), [("stepper_host", "DONE"), ("events_host", "NO_PROBLEM")])
@pytest.mark.parametrize(
    ("optimization", "first", "seeds"),
    [
        ("-O0", 1, FEW),  # compiled in a third of the time
        pytest.param("-O1", SEED, SEEDS, marks=pytest.mark.slow),
    ],
    ids=["few", "many"],
)
def test_random_systems_do_no_harm(
    optimization: str, first: int, seeds: int, program: str, good: str, tmp_path: Path
) -> None:
    counts = _run_host(program, [optimization, *SANITIZERS["address"]], first, seeds, tmp_path)
    assert counts[good] > seeds // 5


@pytest.mark.parametrize(
    ("sanitizer", "first", "seeds"),
    [
        pytest.param("thread", 1, FEW // 2, marks=pytest.mark.slow),
        pytest.param("thread", SEED, SEEDS // 5, marks=pytest.mark.slow),
        pytest.param("address", SEED, SEEDS // 5, marks=pytest.mark.slow),
    ],
    ids=["few", "many", "addresses"],
)
def test_lanes_have_the_results_of_one_thread(sanitizer: str, first: int, seeds: int, tmp_path: Path) -> None:
    flags = ["-O1", "-frounding-math", "-pthread", str(_NATIVE / "system.c"), *SANITIZERS[sanitizer]]
    _run_host("lanes_host", flags, first, seeds, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("compiler", _COMPILERS)
def test_stepper_compiles_without_warnings(compiler: str, tmp_path: Path) -> None:
    command = _COMPILERS[compiler]
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed.")
    for name in ("stepper", "library", "system"):
        source, binary = str(_NATIVE / f"{name}.c"), str(tmp_path / f"{name}.o")
        _compile(*command, *_FLAGS, "-O2", *_HEADERS, "-c", source, "-o", binary)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("nm") is None, reason="nm is not installed.")
def test_stepper_has_no_writable_global_data(tmp_path: Path) -> None:
    """Several steppers can run at once, so they must not share memory that changes, also not in functions."""
    binary = tmp_path / "stepper.o"
    _compile("cc", *_FLAGS, "-O1", *_HEADERS, "-c", str(_NATIVE / "stepper.c"), "-o", str(binary))
    listed = subprocess.run(
        ["nm", "--defined-only", "--format=posix", str(binary)], capture_output=True, text=True, check=True
    )
    kinds = {name: kind for name, kind, *_ in map(str.split, listed.stdout.splitlines())}
    assert {"stepper_run", "stepper_sizes"} <= kinds.keys()
    # text and data that is only read; anything else is writable, or has no place yet
    assert {name: kind for name, kind in kinds.items() if kind not in "TtRr"} == {}


def _run_host(name: str, flags: Sequence[str], first: int, seeds: int, folder: Path) -> dict[str, int]:
    """Compile a host and run it on some seeds; return how often what it counts has occurred."""
    host, source = folder / name, SUPPORT / "c_host" / f"{name}.c"
    words = [*_FLAGS, "-g", *flags, *_HEADERS, "-I", str(_NATIVE)]
    _compile("cc", *words, str(source), "-o", str(host), "-lm")
    output = run_program(host, str(first), str(seeds))
    print(output)
    counts = dict(zip(output.split()[::2], map(int, output.split()[1::2]), strict=True))
    # systems in which nothing fails, or nothing happens, would prove nothing
    assert [name for name, count in counts.items() if count == 0] == []
    return counts


def _compile(*command: str) -> None:
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (0, "")
