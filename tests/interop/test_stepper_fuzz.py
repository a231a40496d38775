"""The stepper in C on random systems, programs and failing FMUs, in hosts without Python, under sanitizers.

stepper_host.c, events_host.c and lanes_host.c say what is done and checked. Everything depends on fixed
seeds; a failure says which one to repeat. With other seeds than those of CI:

    EMLA_FUZZ_SEED=100000 EMLA_FUZZ_SEEDS=50000 pytest -m "slow or nightly" tests/interop/test_stepper_fuzz.py
"""

import hashlib
import os
import shutil
import sys
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from fmublock.cache import VARIABLE
from tests.support.c_programs import SANITIZERS, needs_cc, run_program
from tests.support.paths import SUPPORT
from tests.support.processes import run

pytestmark = needs_cc

SEED = int(os.environ.get("EMLA_FUZZ_SEED", "1"))
SEEDS = int(os.environ.get("EMLA_FUZZ_SEEDS", "10000"))
FEW = 500
"""Seeds of the default tier: enough for each failure."""

_HOSTS = SUPPORT / "c_host"
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
def test_random_systems_under_sanitizers(
    optimization: str, first: int, seeds: int, program: str, good: str
) -> None:
    counts = _run_host(program, [optimization, *SANITIZERS["address"]], first, seeds)
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
def test_lanes_have_the_results_of_one_thread(sanitizer: str, first: int, seeds: int) -> None:
    flags = ["-O1", "-frounding-math", "-pthread", str(_NATIVE / "system.c"), *SANITIZERS[sanitizer]]
    _run_host("lanes_host", flags, first, seeds)


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
    listed = run("nm", "--defined-only", "--format=posix", binary, check=True)
    kinds = {name: kind for name, kind, *_ in map(str.split, listed.stdout.splitlines())}
    assert {"stepper_run", "stepper_sizes"} <= kinds.keys()
    # text and data that is only read; anything else is writable, or has no place yet
    assert {name: kind for name, kind in kinds.items() if kind not in "TtRr"} == {}


def _run_host(name: str, flags: Sequence[str], first: int, seeds: int) -> dict[str, int]:
    """Run a host on some seeds; return how often what it counts has occurred."""
    output = run_program(_compile_host(name, flags), str(first), str(seeds))
    print(output)
    counts = dict(zip(output.split()[::2], map(int, output.split()[1::2]), strict=True))
    # systems in which nothing fails, or nothing happens, would prove nothing
    assert [name for name, count in counts.items() if count == 0] == []
    return counts


def _compile_host(name: str, flags: Sequence[str]) -> Path:
    """Compile a host, which takes longer than a run; it is kept for the next one."""
    words = [*_FLAGS, "-g", *flags, *_HEADERS, "-I", str(_NATIVE)]
    sources = sorted(f for folder in (_NATIVE, _HOSTS) for f in folder.iterdir() if f.suffix in (".c", ".h"))
    compiler = run("cc", "--version").stdout
    content = repr([name, words, compiler, *(f.read_bytes() for f in sources)])
    host = Path(os.environ[VARIABLE], "c-hosts", hashlib.sha256(content.encode()).hexdigest())
    if not host.exists():
        host.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=host.parent) as folder:
            _compile("cc", *words, str(_HOSTS / f"{name}.c"), "-o", f"{folder}/{name}", "-lm")
            Path(folder, name).replace(host)
    return host


def _compile(*command: str) -> None:
    process = run(*command)
    assert (process.returncode, process.stderr) == (0, "")
