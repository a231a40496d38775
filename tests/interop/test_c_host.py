"""Our native FMUs in a host that is a C program: same bits, no leak, no race, no Python."""

import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import pytest

from emla_cosim.fmu.file import FmuFile
from emla_cosim.master.algorithms.registry import Jacobi
from emla_cosim.master.assembly import Assembly
from emla_cosim.master.stepping.timing import make_communication_points
from emla_cosim.study.loading import load
from emla_cosim.system.model import System
from tests.interop.conftest import Compile
from tests.support.c_programs import host_plan, needs_cc, read_results, run_program
from tests.support.simulated import simulated

pytestmark = [needs_cc, pytest.mark.slow]

LIFT = load("lift").system
"""The lift joint of the study: all five models, with the study's start values."""
STEP = 1e-4
Fmus = dict[str, FmuFile]


@pytest.fixture
def plain_host(compiled: Compile) -> Path:
    return compiled("none", "host").programs["host"]


def write_plan(
    path: Path,
    fmus: Fmus,
    steps: int,
    libraries: Mapping[str, Path] | None = None,
    system: System = LIFT,
    printed: Iterable[str] = (),
) -> Path:
    """Write the plan of a run, by default with the libraries of the FMUs and all connected signals."""
    libraries = libraries or {model: fmu.library for model, fmu in fmus.items()}
    printed = printed or [f"{x.source}.{x.output}" for x in system.connections]
    times = make_communication_points(steps * STEP, STEP)
    path.write_text(host_plan(system, fmus, libraries, times, printed))
    return path


def test_closed_loop_has_the_bits_of_our_master(
    plain_host: Path, unpacked_fmus: Fmus, tmp_path: Path
) -> None:
    """All outputs of the lift joint over 0.05 s, by Jacobi; Python is not in the process."""
    times = make_communication_points(0.05, STEP)
    with Assembly(LIFT, {c.name: unpacked_fmus[c.model].path for c in LIFT.components}) as assembly:
        names = assembly.network.names
        expected = simulated(assembly.network, Jacobi(), times)[:, 1:]
    plan = write_plan(tmp_path / "plan", unpacked_fmus, 500, printed=names)
    run_program(plain_host, "-m", tmp_path / "maps", plan, tmp_path / "results")
    results = read_results(tmp_path / "results")
    same = (results.view("i8") == np.ascontiguousarray(expected).view("i8")).all(axis=0)
    assert [name for name, is_same in zip(names, same, strict=True) if not is_same] == []
    assert np.ptp(results, axis=0)[names.index("lift.plant.x_L")] > 0
    fields = [line.split(maxsplit=5) for line in (tmp_path / "maps").read_text().splitlines()]
    mapped = {Path(line[5]).name for line in fields if len(line) > 5}
    assert {f"{component.model}.so" for component in LIFT.components} <= mapped
    assert [name for name in mapped if "python" in name.lower()] == []


def test_two_components_of_one_library_are_independent(
    plain_host: Path, unpacked_fmus: Fmus, tmp_path: Path
) -> None:
    lift, telescope = (load(name).system for name in ("lift", "telescope"))
    rows = []
    for i, system in enumerate((lift, telescope, lift + telescope)):
        plan = write_plan(tmp_path / f"plan{i}", unpacked_fmus, 100, system=system)
        run_program(plain_host, plan, tmp_path / f"results{i}")
        rows.append((tmp_path / f"results{i}").read_text().splitlines())
    assert rows[2] == [" ".join(pair) for pair in zip(*rows[:2], strict=True)]


@pytest.mark.parametrize(
    ("sanitizer", "cycles"),
    [("address", 100), ("thread", 50), pytest.param("address", 1000, marks=pytest.mark.nightly)],
)
def test_sanitizers_report_nothing(
    sanitizer: str, cycles: int, compiled: Compile, unpacked_fmus: Fmus, tmp_path: Path
) -> None:
    """Instantiated, run and freed many times, in two threads; leaks and undefined behaviour, too."""
    build = compiled(sanitizer, "host", {c.model for c in LIFT.components})
    plan = write_plan(tmp_path / "plan", unpacked_fmus, 5, build.libraries)
    run_program(build.programs["host"], "-c", str(cycles), "-t", "2", plan, tmp_path / "results")


@pytest.mark.skipif(shutil.which("valgrind") is None, reason="Valgrind is not installed.")
def test_valgrind_reports_nothing(plain_host: Path, unpacked_fmus: Fmus, tmp_path: Path) -> None:
    """In the libraries as built for release."""
    plan = write_plan(tmp_path / "plan", unpacked_fmus, 5)
    valgrind = ["valgrind", "--quiet", "--error-exitcode=9", "--leak-check=full"]
    run_program(*valgrind, plain_host, "-c", "5", plan, tmp_path / "results")
