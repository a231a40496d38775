"""What a system as one FMU consists of: its FMUs, and how the master steps them."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..base.arrays import Vector
from ..base.errors import CommandError, join_names
from ..fmu.elements import is_version_3
from ..fmu.file import FmuFile
from ..fmu.interface import CO_SIMULATION
from ..fmu.variables import TypedValue
from ..master.algorithms.algorithm import Algorithm
from ..master.algorithms.initialization import find_initial_loops, settle_initial_values
from ..master.algorithms.program import Operation
from ..master.algorithms.scale import Scale
from ..master.assembly import Assembly
from ..master.instances.described_instance import DescribedInstance
from ..master.instances.event_mode_instance import handles_events
from ..master.network import Network
from ..master.stepping.timing import CommunicationPoints
from ..system.model import System

_COMPILED = ("fmi2_block.c", "fmi2_table.c")
"""Source files of FMUs whose C can be compiled into another FMU."""

_MAIN_STEMS = ("fmi2_container", "fmi3_container")
"""Names of the container's own C files."""

_BUILDER = "fmublock"
"""End of the name of the tool that builds these."""


_NOT_IN_STEPS: Mapping[str, Callable[[FmuFile], bool]] = {
    "clocks": lambda file: bool(file.interface.clocks),
    "event mode (hasEventMode)": lambda file: file.has_capability("hasEventMode"),
    "early return (mightReturnEarlyFromDoStep)": handles_events,
}
"""What FMUs of FMI 3.0 do in runs and not in an FMU of a system."""


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

    def files_in(self, folder: str) -> dict[str, bytes]:
        """Return the files in one of its folders, by their path there."""
        start = f"{folder}/"
        return {p.removeprefix(start): c for p, c in self.content.items() if p.startswith(start)}


@dataclass(frozen=True)
class Part:
    """A component: its FMU, and how it exchanges values."""

    name: str
    library: int
    instance: DescribedInstance
    mode: int
    multiple: int
    rare: bool
    saved: bool
    starts: Sequence[TypedValue]


@dataclass(frozen=True)
class Group:
    """Parts that are stepped, or initialized, until they agree."""

    members: Sequence[int]
    coupling: Sequence[int]
    saved: bool = False
    halves: bool = False
    values: Vector = field(default_factory=lambda: np.empty(0))
    """First Jacobian of a group that steps, or first guess of one that is initialized."""


@dataclass(frozen=True)
class ContainerPlan:
    """All that the FMU of a system knows, besides the variables that it shows."""

    libraries: Sequence[Library]
    parts: Sequence[Part]
    network: Network
    smooth: Sequence[bool]
    floors: Vector
    operations: Sequence[Operation]
    groups: Sequence[Group]
    initial_groups: Sequence[Group]
    coupling_tolerance: float
    times: CommunicationPoints
    known: Mapping[str, Mapping[str, str]]
    """Names in the system of variables that their FMU calls otherwise, by component."""
    lost: Mapping[str, Mapping[str, Any]]
    """Start values that an FMU did not take, by component."""

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
        _refuse_what_does_not_fit(assembly)
        assembly.start(system)
        algorithm.setup(assembly.network)
        if not algorithm.is_plain:
            raise CommandError(
                f"an FMU cannot combine values or solve loops as {type(algorithm).__name__} does; "
                "choose another algorithm."
            )
        guesses = _initial_guesses(assembly.network, times)
        if any(len(guess) for guess in guesses):  # which initialized the instances
            assembly.start(system, fresh=True)
            algorithm.setup(assembly.network)
        try:
            algorithm.initialize(times.start, times.stop)
            return _plan(assembly, algorithm, guesses, times)
        finally:
            algorithm.close()


def _refuse_what_does_not_fit(assembly: Assembly) -> None:
    others = [name for name, file in assembly.files.items() if file.kind != CO_SIMULATION]
    if others:
        raise CommandError(
            f"{join_names(others)} would run as Model Exchange; an FMU of a system needs co-simulation FMUs."
        )
    for what, has in _NOT_IN_STEPS.items():
        owners = [name for name, file in assembly.files.items() if has(file)]
        if owners:
            raise CommandError(
                f"an FMU of a system cannot step FMUs with {what}; {join_names(owners)} has it."
            )
    opaque = [f"{x.target.name}.{x.input.name}" for x in assembly.network.opaque_links]
    if opaque:
        raise CommandError(
            f"an FMU of a system cannot pass on Strings or Binary values; {join_names(opaque)} has a "
            "connection."
        )
    sizes = [f"{name}.{own}" for name, file in assembly.files.items() for own in file.interface.structure]
    if sizes:
        raise CommandError(f"an FMU of a system cannot change structural parameters such as {sizes[0]}.")
    python = [n for n, f in assembly.files.items() if (f.folder / "resources/slavemodule.txt").exists()]
    if python:
        raise CommandError(
            f"the FMUs of {join_names(python)} run in Python; an FMU of a system needs native ones."
        )


def _initial_guesses(network: Network, times: CommunicationPoints) -> list[Vector]:
    """Return the solution of each loop of initial values, as `initialize` finds it."""
    loops = find_initial_loops(network)
    if not any(len(cut) for _, cut in loops):
        return [np.empty(0) for _ in loops]
    for instance in network.instances:
        instance.enter_initialization(times.start, times.stop)
    for i in range(len(network.instances)):
        network.assume_inputs(i)
    settle_initial_values(network, Scale(network))
    return [network.signals[cut].copy() for _, cut in loops]


def _plan(
    assembly: Assembly,
    algorithm: Algorithm,
    guesses: Sequence[Vector],
    times: CommunicationPoints,
) -> ContainerPlan:
    network, exchange = assembly.network, algorithm.exchange
    libraries = _libraries(list(assembly.files.values()))
    place = {library.file.folder: i for i, library in enumerate(libraries)}
    groups = [
        Group(
            members=g.members,
            coupling=g.coupling_variables.tolist(),
            saved=g.is_saved,
            halves=g.is_halved,
            values=g.jacobian.ravel().copy(),
        )
        for g in algorithm.groups
    ]
    saved = {i for group in groups if group.saved for i in group.members}
    parts = []
    for i, stepped in enumerate(network.instances):
        instance = assembly.instances[stepped.name]
        parts.append(
            Part(
                name=stepped.name,
                library=place[instance.file.folder],
                instance=instance,
                mode=exchange.modes[i],
                multiple=int(algorithm.multiples[i]),
                rare=exchange.rare[i],
                saved=i in saved,
                starts=assembly.start_values(stepped.name),
            )
        )
    return ContainerPlan(
        libraries=libraries,
        parts=parts,
        network=network,
        smooth=exchange.smooth.tolist(),
        floors=Scale(network).floor,
        operations=algorithm.operations,
        groups=groups,
        initial_groups=[
            Group(members, cut.tolist(), values=guess)
            for (members, cut), guess in zip(find_initial_loops(network), guesses, strict=True)
        ],
        coupling_tolerance=algorithm.coupling_tolerance if groups else 0.0,
        times=times,
        known={name: assembly.names_in_system(name) for name in assembly.files},
        lost={c.name: assembly.list_lost_values(c) for c in assembly.system.components},
    )


def _libraries(files: Sequence[FmuFile]) -> list[Library]:
    """Return each FMU once, with a folder of its own."""
    found: dict[Path, Library] = {}
    for file in files:
        if file.folder in found:
            continue
        taken = {*_MAIN_STEMS, *(library.folder.casefold() for library in found.values())}
        name = re.sub(r"\W", "_", file.model_identifier, flags=re.ASCII)  # a path from outside
        folder, number = name, 2
        while folder.casefold() in taken:
            folder, number = f"{name}_{number}", number + 1
        content = {
            p.relative_to(file.folder).as_posix(): p.read_bytes()
            for p in file.folder.rglob("*")
            if p.is_file()
        }
        found[file.folder] = Library(file, folder, _source(file, content), content)
    return list(found.values())


def _source(file: FmuFile, content: Collection[str]) -> str | None:
    """Return the source file of an FMU that can be compiled in."""
    is_ours = str(file.description.generationTool).endswith(_BUILDER)
    present = (source for source in _COMPILED if f"sources/{source}" in content)
    return next(present, None) if is_ours else None
