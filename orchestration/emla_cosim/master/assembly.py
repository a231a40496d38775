"""From a system description to a network of FMU instances."""

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from fmpy.model_description import ModelVariable, Unknown

from ..errors import CommandError
from ..system.model import Component, Connection, System
from .network import Link, Network
from .slaves.fmu_file import FmuFile, open_fmu
from .slaves.fmu_log import FmuLog
from .slaves.fmu_slave import FmuSlave
from .slaves.start_values import find_variable


@dataclass(frozen=True)
class Assembly:
    """A network of FMU instances, and the FMU file of every component."""

    network: Network
    files: Mapping[str, FmuFile]


@contextlib.contextmanager
def assembled(system: System, fmus: Mapping[str, Path]) -> Iterator[Assembly]:
    """Instantiate and wire the system, and free it afterwards.

    `fmus` gives the FMU file of every component by name. Raises CommandError for anything in
    the system or its files that does not fit, SlaveError where an FMU refuses a start value.
    """
    with TemporaryDirectory(prefix="emla-") as folder, contextlib.ExitStack() as instances:
        files = _open_files(fmus, Path(folder))
        _check_connections(system, files)
        inputs = {
            c.name: [x.input for x in system.connections if x.target == c.name] for c in system.components
        }
        outputs = {c.name: _real_outputs(files[c.name]) for c in system.components}
        slaves, log = [], FmuLog()
        for component in system.components:
            name = component.name
            slave = FmuSlave(name, files[name], inputs[name], outputs[name], log)
            instances.callback(slave.close)
            slave.set_start_values(component.parameters)
            slaves.append(slave)
        links = _links(system, files, inputs, outputs)
        names = [f"{c.name}.{output}" for c in system.components for output in outputs[c.name]]
        yield Assembly(Network(slaves, links, names), files)


def _open_files(fmus: Mapping[str, Path], folder: Path) -> dict[str, FmuFile]:
    opened = {path: open_fmu(path, folder / str(i)) for i, path in enumerate(dict.fromkeys(fmus.values()))}
    return {name: opened[path] for name, path in fmus.items()}


def _real_outputs(file: FmuFile) -> list[str]:
    return [v.name for v in file.variables.values() if v.causality == "output" and v.type == "Real"]


def _check_connections(system: System, files: Mapping[str, FmuFile]) -> None:
    driven: dict[tuple[str, str], Connection] = {}
    for connection in system.connections:
        source = _end(system.component(connection.source), files, connection.output, "output")
        target = _end(system.component(connection.target), files, connection.input, "input")
        if source.unit != target.unit and source.unit and target.unit:
            raise CommandError(
                f"the connection {connection} joins the units {source.unit} and {target.unit}."
            )
        other = driven.setdefault((connection.target, connection.input), connection)
        if other is not connection:
            raise CommandError(f"{connection.target}.{connection.input} is driven by two outputs.")
        if connection.input in system.component(connection.target).parameters:
            raise CommandError(
                f"{connection.target}.{connection.input} cannot be set: it is driven by "
                f"{connection.source}.{connection.output}."
            )


def _end(component: Component, files: Mapping[str, FmuFile], name: str, causality: str) -> ModelVariable:
    variable = find_variable(component.name, files[component.name].variables, name)
    if variable.causality != causality or variable.type != "Real":
        raise CommandError(
            f"{component.name}.{name} must be a Real {causality} to be connected, but it is "
            f"{variable.causality}, {variable.type}."
        )
    return variable


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
