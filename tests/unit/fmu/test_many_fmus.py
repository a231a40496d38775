"""Systems of many FMUs of one model: what is done once, what instances share, and how work grows."""

import shutil
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from fmpy.fmi2 import FMU2Slave

from benchmarks.row import ring
from emla_cosim.base.errors import CommandError
from emla_cosim.fmu import file as fmu_file
from emla_cosim.fmu.instance import FMU2AnnouncedSlave
from emla_cosim.fmu.loaded_library import LoadedLibrary
from emla_cosim.master.assembly import Assembly
from emla_cosim.ssp.reader.flat_document import read_ssp
from emla_cosim.study.loading import load
from emla_cosim.system.model import System
from tests.support.faulty_systems import faulty, open_system, wired
from tests.support.hand_written_fmus import Counts, edit_description
from tests.support.ssp_documents import binding, component, connection, entry, fake_fmu, ssd, ssm, ssv, system
from tests.support.ssp_documents import folder as ssp_folder
from tests.support.tiers import mostly_slow
from tests.support.work import instructions

SIZES = (10, 20, 40)


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Callable[[object, str], list[Any]]:
    """Notes the first argument of every call of a function, which is still called."""

    def noted(owner: Any, name: str) -> list[Any]:
        actual: list[Any] = []
        function = getattr(owner, name)

        def call(*arguments: Any, **options: Any) -> Any:
            actual.append(arguments[0])
            return function(*arguments, **options)

        monkeypatch.setattr(owner, name, call)
        return actual

    return noted


def five(fmu: Path) -> System:
    """Five instances of the faulty FMU, one after the other."""
    names = [f"j.f{i}" for i in range(5)]
    wires = [f"{a}.y -> {b}.u" for a, b in pairwise(names)]
    return wired([faulty(name, fmu) for name in names], *wires)


def test_file_of_many_instances_is_read_and_loaded_once(
    faulty_fmu: Path, calls: Callable[[object, str], list[Any]]
) -> None:
    recorded_calls = [calls(fmu_file, name) for name in ("read_interface", "unpack", "hash_file")]
    recorded_calls.append(calls(FMU2AnnouncedSlave, "_loadFunctions"))
    instantiations = calls(FMU2Slave, "instantiate")
    with open_system(five(faulty_fmu)) as assembly:
        assert [len(calls_of_function) for calls_of_function in recorded_calls] == [1, 1, 1, 1]
        assert len(set(map(id, instantiations))) == len(instantiations) == 5
        assert [m.instanceName for m in instantiations] == [s.name for s in assembly.network.instances]
        assert len({m.component for m in instantiations}) == 5


def test_the_library_is_unloaded_with_the_last_instance(
    faulty_fmu: Path, calls: Callable[[object, str], list[Any]]
) -> None:
    unloaded = calls(FMU2Slave, "freeLibrary")
    with open_system(five(faulty_fmu)) as assembly:
        first, *remaining = assembly.network.instances
        library = assembly.files[first.name].library
        for slave in (first, *remaining):
            slave.enter_initialization(0.0, 1.0)
            slave.exit_initialization()
        first.close()
        for slave in remaining:
            slave.do_step(0.0, 0.1)
            slave.get_outputs()
        assert not unloaded
        assembly._instance_stack.pop_all()
        for slave in remaining:
            slave.close()
    assert len(unloaded) == 1
    assert library not in LoadedLibrary._libraries


def test_an_instance_that_cannot_be_made_leaves_nothing_of_the_others(
    faulty_fmu: Path, monkeypatch: pytest.MonkeyPatch, calls: Callable[[object, str], list[Any]]
) -> None:
    unloaded, instantiate = calls(FMU2Slave, "freeLibrary"), FMU2Slave.instantiate
    counts: list[Counts] = []

    def refusing(slave: FMU2Slave, **options: Any) -> None:
        if slave.instanceName == "j.f2":
            counts.append(Counts(Path(slave.unzipDirectory)))
            assert counts[0].instances == 2
            raise Exception("no more")  # as fmpy does
        instantiate(slave, **options)

    monkeypatch.setattr(FMU2Slave, "instantiate", refusing)
    libraries = set(LoadedLibrary._libraries)
    with pytest.raises(CommandError, match=r"of j\.f2 cannot be started: no more"):
        open_system(five(faulty_fmu)).__enter__()
    assert counts[0].instances == 0
    assert len(unloaded) == 1
    assert set(LoadedLibrary._libraries) == libraries


@pytest.mark.parametrize("isolate", mostly_slow([[], ["j.f1"]], [[]]))
def test_one_instance_per_process_needs_isolation(
    faulty_fmu: Path, isolate: list[str], tmp_path: Path
) -> None:
    old, new = "<CoSimulation ", '<CoSimulation canBeInstantiatedOnlyOncePerProcess="true" '
    fmu = edit_description(faulty_fmu, tmp_path / "Faulty.fmu", old, new)
    system = wired([faulty("j.f0", fmu), faulty("j.f1", fmu)], "j.f0.y -> j.f1.u")
    paths = {c.name: c.fmu for c in system.components if c.fmu}
    if not isolate:
        with pytest.raises(CommandError, match=r"of j\.f1 cannot be started: .* one instance per process"):
            Assembly(system, paths).__enter__()
        return
    with Assembly(system, paths, isolate) as assembly:
        assert len(assembly.instances) == 2


def of_system(count: int, folder: Path) -> None:
    """Prepare, run and write down a system of so many FMUs."""
    scenario = load(ring(count), fmus=folder, step_size=1e-3, stop_time=2e-3)
    with scenario.prepare() as simulation:
        simulation.run().save(folder / f"results-{count}", plots=False)


def of_package(count: int, folder: Path) -> None:
    """Read a package of so many FMUs, whose system has a connector and a parameter for each of them."""
    with read_ssp(folder / f"{count}") as document:
        assert len(document.system.components) == count
        assert [c.parameters["k"] for c in document.system.components] == [*range(count)]
        assert len(document.system.connections) == count - 1


def package(count: int, folder: Path) -> None:
    """Write what `of_package` reads."""
    names = [f"c{i}" for i in range(count)]
    parts = [component(name, "link.fmu", "u:input y:output w:input") for name in names]
    parts += [connection(f"{a}.y -> {b}.u") for a, b in pairwise(names)]
    parts += [connection(f"w_{name} -> {name}.w") for name in names]
    bindings = ssv(**{f"p{i}": float(i) for i in range(count)})
    mapping = ssm(*(entry(f"p{i}", f"{name}.k") for i, name in enumerate(names)))
    ports = " ".join(f"w_{name}:input" for name in names)
    root = ssd(system("s", *parts, ports=ports, bindings=binding(bindings, mapping)))
    ssp_folder(folder / f"{count}", root=root)
    fake_fmu(folder / f"{count}" / "link.fmu", "u:input", "w:input", "y:output", "k:parameter")


@pytest.mark.parametrize("work", mostly_slow([of_system, of_package], [of_package]))
def test_work_is_proportional_to_the_fmus(work: Callable[[int, Path], None], tmp_path: Path) -> None:
    """Twice as many more FMUs take twice as many more instructions, as far as Python executes them."""
    for count in SIZES:
        package(count, tmp_path)
    work(SIZES[0], tmp_path)  # builds the FMU, and imports what is imported late
    shutil.rmtree(tmp_path / f"results-{SIZES[0]}", ignore_errors=True)  # a used folder takes more work
    few, more, most = (instructions(lambda n=n: work(n, tmp_path)) for n in SIZES)
    assert most - more < 1.1 * 2 * (more - few)
