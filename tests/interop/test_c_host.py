"""Our native FMUs in a host that is a C program: same bits, no leak, no race, no Python."""

import re
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import pytest

from emla_cosim.fmu.file import FmuFile
from emla_cosim.master.algorithms.jacobi import Jacobi
from emla_cosim.master.assembly import Assembly
from emla_cosim.master.stepping.timing import CommunicationPoints, make_communication_points
from emla_cosim.study.loading import load
from tests.support.c_programs import Build, host_plan, needs_cc, run_program
from tests.support.simulated import simulated

pytestmark = needs_cc

LIFT = load("lift").system
"""The lift joint of the study: all five models, with the study's start values."""
SIGNALS = [f"{x.source}.{x.output}" for x in LIFT.connections]
STEP = 1e-4


@pytest.fixture
def shipped(unpacked_fmus: dict[str, FmuFile]) -> dict[str, Path]:
    """The FMUs' own libraries, by model."""
    return {model: fmu.library for model, fmu in unpacked_fmus.items()}


def write_plan(
    path: Path,
    fmus: Mapping[str, FmuFile],
    libraries: Mapping[str, Path],
    times: CommunicationPoints,
    printed: Iterable[str] = SIGNALS,
) -> Path:
    path.write_text(host_plan(LIFT, fmus, libraries, times, printed))
    return path


def test_the_closed_loop_has_the_bits_of_our_master(
    plain_host: Path, shipped: dict[str, Path], unpacked_fmus: dict[str, FmuFile], tmp_path: Path
) -> None:
    """All outputs of the lift joint over 0.2 s, by Jacobi."""
    times = make_communication_points(0.2, STEP)
    with Assembly(LIFT, {c.name: unpacked_fmus[c.model].path for c in LIFT.components}) as assembly:
        names = assembly.network.names
        expected = simulated(assembly.network, Jacobi(), times)[:, 1:]
    plan = write_plan(tmp_path / "plan", unpacked_fmus, shipped, times, names)
    run_program(plain_host, plan, tmp_path / "results")
    lines = (tmp_path / "results").read_text().splitlines()
    found = np.array([[float.fromhex(value) for value in line.split()] for line in lines])
    same = (found.view("i8") == np.ascontiguousarray(expected).view("i8")).all(axis=0)
    assert [name for name, is_same in zip(names, same, strict=True) if not is_same] == []
    assert np.ptp(found, axis=0)[names.index("lift.plant.x_L")] > 0


def test_no_python_is_in_the_process(
    plain_host: Path, shipped: dict[str, Path], unpacked_fmus: dict[str, FmuFile], tmp_path: Path
) -> None:
    plan = write_plan(tmp_path / "plan", unpacked_fmus, shipped, make_communication_points(STEP, STEP))
    run_program(plain_host, "-m", tmp_path / "maps", plan, tmp_path / "results")
    fields = [line.split(maxsplit=5) for line in (tmp_path / "maps").read_text().splitlines()]
    mapped = {Path(line[5]).name for line in fields if len(line) > 5}
    assert {f"{component.model}.so" for component in LIFT.components} <= mapped
    assert [name for name in mapped if "python" in name.lower()] == []


def test_one_library_serves_two_components(
    plain_host: Path, shipped: dict[str, Path], unpacked_fmus: dict[str, FmuFile], tmp_path: Path
) -> None:
    """Two joints in one process, one of each library: the second does not see the first."""
    names = ["lift", "telescope"]
    systems = [load(name).system for name in names]
    printed = [[f"{x.source}.{x.output}" for x in system.connections] for system in systems]
    alone = []
    for name, system, signals in zip(names, systems, printed, strict=True):
        plan, results = tmp_path / name, tmp_path / f"{name}.txt"
        plan.write_text(
            host_plan(system, unpacked_fmus, shipped, make_communication_points(0.01, STEP), signals)
        )
        run_program(plain_host, plan, results)
        alone.append(results.read_text().splitlines())
    both = host_plan(
        systems[0] + systems[1],
        unpacked_fmus,
        shipped,
        make_communication_points(0.01, STEP),
        printed[0] + printed[1],
    )
    (tmp_path / "both").write_text(both)
    run_program(plain_host, tmp_path / "both", tmp_path / "both.txt")
    expected = [" ".join(rows) for rows in zip(*alone, strict=True)]
    assert (tmp_path / "both.txt").read_text().splitlines() == expected


def test_a_status_that_is_an_error_ends_the_host_with_a_message(
    plain_host: Path, shipped: dict[str, Path], unpacked_fmus: dict[str, FmuFile], tmp_path: Path
) -> None:
    """Otherwise the tests here would prove nothing."""
    plan = write_plan(tmp_path / "plan", unpacked_fmus, shipped, make_communication_points(0.01, STEP))
    mass = unpacked_fmus["EmlaPlant"].variables["screw.M_BS"].valueReference
    plant = [c.model for c in LIFT.components].index("EmlaPlant")
    plan.write_text(plan.read_text() + f"real {plant} {mass} -1\n")
    with pytest.raises(
        AssertionError, match=r"lift\.plant answered fmi2ExitInitializationMode with fmi2Error"
    ):
        run_program(plain_host, plan, tmp_path / "results")


def test_address_leak_and_undefined_behaviour_sanitizers_report_nothing(
    address_build: Build, unpacked_fmus: dict[str, FmuFile], tmp_path: Path
) -> None:
    """1,000 times instantiated, run and freed, in two threads."""
    plan = write_plan(
        tmp_path / "plan", unpacked_fmus, address_build.libraries, make_communication_points(5 * STEP, STEP)
    )
    host = address_build.programs["host"]
    run_program(host, "-c", "1000", "-t", "2", plan, tmp_path / "results")


def test_thread_sanitizer_reports_nothing(
    thread_build: Build, unpacked_fmus: dict[str, FmuFile], tmp_path: Path
) -> None:
    plan = write_plan(
        tmp_path / "plan", unpacked_fmus, thread_build.libraries, make_communication_points(5 * STEP, STEP)
    )
    run_program(thread_build.programs["host"], "-c", "200", "-t", "2", plan, tmp_path / "results")


def test_a_thousand_cycles_do_not_grow_the_resident_memory(
    plain_host: Path, shipped: dict[str, Path], unpacked_fmus: dict[str, FmuFile], tmp_path: Path
) -> None:
    """Between 100 and 1,000 cycles; 32 bytes lost per instance of one model would be 28 KiB."""
    plan = write_plan(tmp_path / "plan", unpacked_fmus, shipped, make_communication_points(5 * STEP, STEP))
    said = run_program(plain_host, "-c", "1000", plan, tmp_path / "results")
    early, late = (int(kib) for kib in re.findall(r"(\d+) KiB", said))
    assert late - early <= 16


@pytest.mark.skipif(shutil.which("valgrind") is None, reason="Valgrind is not installed.")
def test_memcheck_finds_no_error_in_the_shipped_libraries(
    plain_host: Path, shipped: dict[str, Path], unpacked_fmus: dict[str, FmuFile], tmp_path: Path
) -> None:
    plan = write_plan(tmp_path / "plan", unpacked_fmus, shipped, make_communication_points(5 * STEP, STEP))
    valgrind = ["valgrind", "--quiet", "--error-exitcode=9", "--leak-check=full"]
    run_program(*valgrind, plain_host, "-c", "20", plan, tmp_path / "results")
