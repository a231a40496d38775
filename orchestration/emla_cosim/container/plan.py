"""The content of a system as one FMU: its FMUs, and how the master steps them."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..base.arrays import Vector
from ..base.errors import CommandError, join_names
from ..fmu.elements import is_clocked, is_version_3
from ..fmu.file import FmuFile
from ..fmu.interface import CO_SIMULATION
from ..fmu.variables import TypedValue
from ..master.algorithms.algorithm import Algorithm
from ..master.algorithms.group import CoupledGroup
from ..master.algorithms.initialization import find_initial_groups, solve_initial_values
from ..master.algorithms.newton import Scale
from ..master.algorithms.program import Operation
from ..master.assembly import Assembly
from ..master.instances.in_process_instance import InProcessInstance
from ..master.network import Network
from ..master.stepping.timing import CommunicationPoints
from ..system.model import System
from .system_image import SystemImage, make_system_image

_COMPILED = ("fmi2_block.c", "fmi2_table.c")
"""Source files of FMUs whose C can be compiled into another FMU."""

_MAIN_STEMS = ("fmi2_container", "fmi3_container", "stepper")
"""Names of the container's own C files and folders."""

_BUILDER = "fmublock"
"""End of the name of the tool that builds these."""


@dataclass(frozen=True)
class Library:
    """An FMU of the system, and where its files are inside.

    Attributes:
        file: the FMU; its unpacked files are gone.
        folder: name of its folders.
        source: its source file if its C is compiled in, otherwise None.
        content: its files by path.
    """

    file: FmuFile
    folder: str
    source: str | None
    content: Mapping[str, bytes]

    @property
    def fmi(self) -> int:
        """Return its version of FMI, 2 or 3."""
        return 3 if is_version_3(self.file.description) else 2

    def list_files(self, folder: str) -> dict[str, bytes]:
        """Return the files in one of its folders, by their path there."""
        start = f"{folder}/"
        return {p.removeprefix(start): c for p, c in self.content.items() if p.startswith(start)}


@dataclass(frozen=True)
class Part:
    """A component: its FMU, and how it exchanges values."""

    name: str
    library: int
    instance: InProcessInstance
    mode: int
    multiple: int
    starts: Sequence[TypedValue]


@dataclass(frozen=True)
class InitialGroup:
    """Parts that are initialized until they agree, with the first guess of the exchanged values."""

    members: Sequence[int]
    coupling: Sequence[int]
    guess: Vector


@dataclass(frozen=True)
class ContainerPlan:
    """The content of the FMU of a system, except its variables.

    Attributes:
        libraries: its FMUs.
        parts: its components, as the network has them.
        network: the connected components.
        operations: calls of the components in a step, outside of groups.
        groups: groups of strong coupling.
        initial_groups: groups that are initialized together.
        image: the stepper as C.
        times: start, stop and step size.
        system_names: names in the system of variables with another name in their FMU, by component.
        changed_start_values: start values that an FMU changed, by component.
    """

    libraries: Sequence[Library]
    parts: Sequence[Part]
    network: Network
    operations: Sequence[Operation]
    groups: Sequence[CoupledGroup]
    initial_groups: Sequence[InitialGroup]
    image: SystemImage
    times: CommunicationPoints
    system_names: Mapping[str, Mapping[str, str]]
    changed_start_values: Mapping[str, Mapping[str, Any]]

    def any_has(self, capability: str) -> bool:
        """Return whether any FMU has a capability of the standard."""
        return any(library.file.has_capability(capability) for library in self.libraries)

    def all_can(self, capability: str) -> bool:
        """Return whether all FMUs have a capability of the standard."""
        return all(library.file.has_capability(capability) for library in self.libraries)


def plan_container(
    system: System, fmus: Mapping[str, Path], algorithm: Algorithm, times: CommunicationPoints
) -> ContainerPlan:
    """Prepare a system as for a run, initialize it once, and return what its FMU needs.

    Args:
        system: The system, with its start values.
        fmus: FMU file of every component.
        algorithm: The algorithm that steps it.
        times: Start, stop and step size.

    Raises:
        CommandError: The system cannot be one FMU.
        RunError: It cannot be initialized.
    """
    with Assembly(system, fmus) as assembly:
        _check_support(assembly)
        assembly.start(system)
        algorithm.setup(assembly.network)
        guesses = _solve_initial_loops(assembly.network, times)
        if any(len(guess) for guess in guesses):  # solving for them initialized the instances
            assembly.start(system, fresh=True)
            algorithm.setup(assembly.network)
        try:
            algorithm.initialize(times.start, times.stop)
            return _make_plan(assembly, algorithm, guesses, times)
        finally:
            algorithm.close()


def _check_support(assembly: Assembly) -> None:
    """Raise CommandError if an FMU or a connection cannot be in the FMU of a system."""
    model_exchange = [name for name, file in assembly.files.items() if file.kind != CO_SIMULATION]
    if model_exchange:
        raise CommandError(
            f"{join_names(model_exchange)} would run as Model Exchange; an FMU of a system needs "
            "co-simulation FMUs."
        )
    links = assembly.network.opaque_links
    clocked = [f"{x.target.name}.{x.input.name}" for x in links if is_clocked(x.input)]
    if clocked:
        raise CommandError(
            f"an FMU of a system cannot pass on Strings or Binary values of clocks; {join_names(clocked)} "
            "has a connection."
        )
    # the tables of the container have fixed sizes
    sizes = [f"{n}.{p}" for n, file in assembly.files.items() for p in file.interface.structure]
    if sizes:
        raise CommandError(f"an FMU of a system cannot change structural parameters such as {sizes[0]}.")
    python = [n for n, f in assembly.files.items() if (f.folder / "resources/slavemodule.txt").exists()]
    if python:
        raise CommandError(
            f"the FMUs of {join_names(python)} run in Python; an FMU of a system needs native ones."
        )


def _solve_initial_loops(network: Network, times: CommunicationPoints) -> list[Vector]:
    """Return the solution of each loop of initial values, as `initialize` finds it; empty without a loop.

    With loops, this initializes the instances, which must be started anew.
    """
    loops = find_initial_groups(network)
    if not any(len(coupling_variables) for _, coupling_variables in loops):
        return [np.empty(0) for _ in loops]
    for instance in network.instances:
        instance.enter_initialization(times.start, times.stop)
    for i in range(len(network.instances)):
        network.assume_inputs(i)
    solve_initial_values(network, Scale(network))
    return [network.signals[coupling_variables].copy() for _, coupling_variables in loops]


def _make_plan(
    assembly: Assembly, algorithm: Algorithm, guesses: Sequence[Vector], times: CommunicationPoints
) -> ContainerPlan:
    """Return the plan of a system that is initialized, with the solutions of its initial loops."""
    network, exchange = assembly.network, algorithm.exchange
    # components with one FMU share its folder, and so its library
    libraries = _list_libraries(list(assembly.files.values()))
    library_numbers = {library.file.folder: i for i, library in enumerate(libraries)}
    instances = [x for x in network.instances if isinstance(x, InProcessInstance)]  # all of co-simulation are
    numbers = [library_numbers[instance.file.folder] for instance in instances]
    parts = [
        Part(
            name=instance.name,
            library=numbers[i],
            instance=instance,
            mode=exchange.modes[i],
            multiple=int(algorithm.multiples[i]),
            starts=assembly.start_values(instance.name),
        )
        for i, instance in enumerate(instances)
    ]
    return ContainerPlan(
        libraries=libraries,
        parts=parts,
        network=network,
        operations=algorithm.operations,
        groups=algorithm.groups,
        initial_groups=[
            InitialGroup(members, coupling_variables.tolist(), guess)
            for (members, coupling_variables), guess in zip(
                find_initial_groups(network), guesses, strict=True
            )
        ],
        image=make_system_image(algorithm, instances, numbers),
        times=times,
        system_names={name: assembly.names_in_system(name) for name in assembly.files},
        changed_start_values={
            c.name: assembly.list_rejected_start_values(c) for c in assembly.system.components
        },
    )


def _list_libraries(files: Sequence[FmuFile]) -> list[Library]:
    """Return each FMU once, with a folder of its own."""
    libraries: dict[Path, Library] = {}
    for file in files:
        if file.folder in libraries:
            continue
        used_folders = {*_MAIN_STEMS, *(library.folder.casefold() for library in libraries.values())}
        name = re.sub(r"\W", "_", file.model_identifier, flags=re.ASCII)  # a path from outside
        folder, number = name, 2  # some file systems ignore case
        while folder.casefold() in used_folders:
            folder, number = f"{name}_{number}", number + 1
        content = {
            p.relative_to(file.folder).as_posix(): p.read_bytes()
            for p in file.folder.rglob("*")
            if p.is_file()
        }
        libraries[file.folder] = Library(file, folder, _find_source(file, content), content)
    return list(libraries.values())


def _find_source(file: FmuFile, content: Collection[str]) -> str | None:
    """Return the source file of an FMU that can be compiled in; None if its library must be packed."""
    # the prefix of functions, with which several can be compiled together, needs our sources
    is_ours = str(file.description.generationTool).endswith(_BUILDER)
    present = (source for source in _COMPILED if f"sources/{source}" in content)
    return next(present, None) if is_ours else None
