"""From a system description to a network of FMU instances."""

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from fmpy.model_description import Unknown

from ..fmu.file import FmuFile, open_fmu
from ..system.model import Alias, System
from ..system.resolution import resolved
from ..units import IDENTITY, LinearTransformation
from .network import Link, Network
from .slaves.fmu_log import FmuLog
from .slaves.fmu_slave import FmuSlave


@dataclass(frozen=True)
class Assembly:
    """A network of FMU instances, and the FMU file of every component.

    Signals have the names that the system knows them by. Where it has them in other units than
    the FMU, `shown` says what makes the system's value, by position.
    """

    network: Network
    files: Mapping[str, FmuFile]
    shown: Mapping[int, LinearTransformation]


@contextlib.contextmanager
def assembled(system: System, fmus: Mapping[str, Path]) -> Iterator[Assembly]:
    """Instantiate and wire the system, and free it afterwards.

    `fmus` gives the FMU file of every component by name. Raises CommandError for anything in
    the system or its files that does not fit, SlaveError where an FMU refuses a start value.
    """
    with TemporaryDirectory(prefix="emla-") as folder, contextlib.ExitStack() as instances:
        files = _open_files(fmus, Path(folder))
        plain = resolved(system, {name: file.interface for name, file in files.items()})
        inputs = {
            c.name: [x.input for x in plain.connections if x.target == c.name] for c in plain.components
        }
        outputs = {c.name: _outputs(files[c.name], plain, c.name) for c in plain.components}
        slaves, log = [], FmuLog()
        for component in plain.components:
            name = component.name
            slave = FmuSlave(name, files[name], inputs[name], outputs[name], log)
            instances.callback(slave.close)
            slave.set_start_values(component.parameters)
            slaves.append(slave)
        links = _links(plain, files, inputs, outputs)
        names, shown = _signals(system, outputs)
        yield Assembly(Network(slaves, links, names), files, shown)


def _open_files(fmus: Mapping[str, Path], folder: Path) -> dict[str, FmuFile]:
    opened = {path: open_fmu(path, folder / str(i)) for i, path in enumerate(dict.fromkeys(fmus.values()))}
    return {name: opened[path] for name, path in fmus.items()}


def _outputs(file: FmuFile, system: System, name: str) -> list[str]:
    """All Real outputs of a component, and those of other types that are connected."""
    connected = {x.output for x in system.connections if x.source == name}
    outputs = [v for v in file.variables.values() if v.causality == "output"]
    return [v.name for v in outputs if v.type == "Real" or v.name in connected]


def _signals(
    system: System, outputs: Mapping[str, list[str]]
) -> tuple[list[str], dict[int, LinearTransformation]]:
    """Names of all signals as the system has them, and what makes the system's values of the FMUs'."""
    names, shown = [], {}
    for component in system.components:
        known = {a.variable: (n, a) for n, a in component.aliases.items() if a.transformation.factor != 0.0}
        for output in outputs[component.name]:
            name, alias = known.get(output, (output, Alias(output)))
            if alias.transformation != IDENTITY:
                shown[len(names)] = alias.transformation.inverse()
            names.append(f"{component.name}.{name}")
    return names, shown


def _links(
    system: System,
    files: Mapping[str, FmuFile],
    inputs: Mapping[str, list[str]],
    outputs: Mapping[str, list[str]],
) -> list[Link]:
    position = {c.name: i for i, c in enumerate(system.components)}
    used = {c.name: {x.output for x in system.connections if x.source == c.name} for c in system.components}
    return [
        Link(
            source=position[x.source],
            output=outputs[x.source].index(x.output),
            target=position[x.target],
            input=inputs[x.target].index(x.input),
            direct=_depends(used[x.target], files[x.target].description.outputs, x.input),
            initial=_depends(used[x.target], files[x.target].description.initialUnknowns, x.input),
            factor=(x.transformation or IDENTITY).factor,
            offset=(x.transformation or IDENTITY).offset,
        )
        for x in system.connections
    ]


def _depends(outputs: set[str], unknowns: Sequence[Unknown], known: str) -> bool:
    """Whether one of these outputs depends on a known; what is not declared is taken to depend.

    An output without an entry has a value of its own, unless the model description says nothing at all.
    """
    for unknown in unknowns:
        if unknown.variable is not None and unknown.variable.name in outputs:
            knowns = unknown.dependencies
            if knowns is None or known in {v.name for v in knowns}:
                return True
    return bool(outputs) and not unknowns
