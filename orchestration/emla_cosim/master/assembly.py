"""From a system description to a network of FMU instances."""

import contextlib
from collections.abc import Container, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..base.files import temporary_folder
from ..base.units import IDENTITY, LinearTransformation
from ..fmu.file import FmuFile, open_fmu
from ..fmu.interface import Interface
from ..fmu.log import FmuLog
from ..fmu.variables import TypedValue, convert_start_values
from ..system.model import Alias, Component, Connection, System
from ..system.resolution import convert_to_fmu_terms, refuse_driven, resolve_system
from ..system.signal_faults import MODEL
from .instances.described_instance import DescribedInstance
from .instances.in_process_instance import InProcessInstance
from .instances.isolated_instance import IsolatedInstance
from .network import Link, Network


class Assembly:
    """A network of FMU instances, and the FMU file of every component.

    Signals have the names that the system knows them by. Where it has them in other units than
    the FMU, `shown` says what makes the system's value, by position. `close` frees all of it.
    """

    def __init__(self, system: System, fmus: Mapping[str, Path], isolated: Container[str] = ()) -> None:
        """Open the files and wire the system.

        `fmus` gives the FMU file of every component by name; those that are `isolated` run in
        processes of their own. Raises CommandError for anything in the system or its files that does
        not fit.
        """
        with contextlib.ExitStack() as held:
            folder = held.enter_context(temporary_folder("emla-"))
            self.files: Mapping[str, FmuFile] = _open_files(fmus, folder)
            self.system = system
            self._wired = resolve_system(system, {name: file.interface for name, file in self.files.items()})
            self._instances = held.enter_context(contextlib.ExitStack())
            self._isolated = isolated
            self._used = False
            self._instantiate()
            self.start(system)
            self._used = False  # nothing was initialized, and start values can be set again
            self._held = held.pop_all()

    def __enter__(self) -> "Assembly":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the instances, and remove what was unpacked."""
        self._held.close()

    def _instantiate(self) -> None:
        """Make instances of all components, and the network of them."""
        components = self._wired.components
        inputs = {c.name: [x.input for x in self._wired.into(c.name)] for c in components}
        outputs = {c.name: _outputs(self.files[c.name], self._wired, c.name) for c in components}
        self.slaves: dict[str, DescribedInstance] = {}
        log = FmuLog()
        for number, name in enumerate(c.name for c in components):
            described = (name, self.files[name], inputs[name], outputs[name])
            isolated = name in self._isolated
            slave = IsolatedInstance(*described) if isolated else InProcessInstance(*described, log, number)
            self._instances.callback(slave.close)
            self.slaves[name] = slave
        for slave in self.slaves.values():
            slave.ready()
        links = _links(self._wired, self.files, inputs, outputs)
        names, self.shown = _signals(self.system, outputs)
        faults = [
            i for i, f in enumerate(self.files[n] for n in self.slaves) if f.description.modelName == MODEL
        ]
        self.network = Network(list(self.slaves.values()), links, names, faults)
        self._order = [self.network.instances[i].name for i in self.network.order]
        self._values: dict[str, tuple[Component, list[TypedValue]]] = {}
        self._parameters: dict[str, tuple[Component, dict[str, float]]] = {}
        self._changed: dict[str, tuple[Component, dict[str, dict[str, Any]]]] = {}

    def start(self, system: System, fresh: bool = False) -> None:
        """Bring all instances to where initialization begins, with the start values of this system.

        It is the same system but for these values. Instances that have run are reset, or made anew
        where `fresh` says so. Raises CommandError for a value that does not fit, InstanceError where an
        FMU refuses one.
        """
        for component in system.components:
            if self._values.get(component.name, (None,))[0] is not component:
                self._values[component.name] = component, self._typed(component)
        if self._used and fresh:
            values = self._values
            self._instances.close()
            self._instantiate()
            self._values = values
        elif self._used:
            for slave in self.slaves.values():
                slave.reset()
            self.network.signals[:] = 0.0
        self.network.reorder(self._order)
        self._used = True
        for name, slave in self.slaves.items():
            slave.set_start_values(self._values[name][1])

    def parameters(self) -> dict[str, float]:
        """The parameters of all components that are numbers, by full name and as the system has them."""
        found: dict[str, float] = {}
        for name, (component, given) in self._values.items():
            if self._parameters.get(name, (None,))[0] is not component:
                self._parameters[name] = component, self._parameters_of(component, given)
            found |= self._parameters[name][1]
        return found

    def list_non_default_values(self, component: Component) -> dict[str, dict[str, Any]]:
        """Start values of a component that are not those of its FMU, with these and the unit of both.

        The same object for the same component, so that many runs share it.
        """
        if self._changed.get(component.name, (None,))[0] is not component:
            interface = self.files[component.name].interface
            self._changed[component.name] = component, _non_default_values(component, interface)
        return self._changed[component.name][1]

    def _parameters_of(self, component: Component, given: Sequence[TypedValue]) -> dict[str, float]:
        found: dict[str, float] = {}
        known, values = _map_known_names(component), {v.name: x for v, x in given}
        for variable in self.files[component.name].variables.values():
            value = values.get(variable.name, variable.start)
            number = variable.causality == "parameter" and variable.type in ("Real", "Integer")
            if number and value is not None:
                name, alias = known.get(variable.name, (variable.name, Alias(variable.name)))
                found[f"{component.name}.{name}"] = alias.transformation.inverse()(float(value))
        return found

    def _typed(self, component: Component) -> list[TypedValue]:
        """The start values of a component as its FMU has them."""
        given = convert_to_fmu_terms(component)
        refuse_driven(given, self._wired)
        return convert_start_values(component.name, self.files[component.name].interface, given.parameters)


def _non_default_values(component: Component, interface: Interface) -> dict[str, dict[str, Any]]:
    """Start values of a component that are not those of its FMU, with these and the unit of both."""
    found = {}
    for name, value in component.parameters.items():
        alias = component.alias(name)
        default: Any = interface.variables[alias.variable].start
        unit = alias.unit or interface.unit(alias.variable)
        if default is not None and isinstance(value, (int, float)) and not isinstance(value, bool):
            default = alias.transformation.inverse()(float(default))
        if str(default).lower() != str(value).lower() and default != value:
            found[name] = {"value": value, "default": default, "unit": None if unit is None else str(unit)}
    return found


def _open_files(fmus: Mapping[str, Path], folder: Path) -> dict[str, FmuFile]:
    opened = {path: open_fmu(path, folder / str(i)) for i, path in enumerate(dict.fromkeys(fmus.values()))}
    return {name: opened[path] for name, path in fmus.items()}


def _outputs(file: FmuFile, system: System, name: str) -> list[str]:
    """All Real outputs of a component, and those of other types that are connected."""
    connected = {x.output for x in system.out_of(name)}
    outputs = [v for v in file.variables.values() if v.causality == "output"]
    return [v.name for v in outputs if v.type == "Real" or v.name in connected]


def _signals(
    system: System, outputs: Mapping[str, list[str]]
) -> tuple[list[str], dict[int, LinearTransformation]]:
    """Names of all signals as the system has them, and what makes the system's values of the FMUs'."""
    names, shown = [], {}
    for component in system.components:
        known = _map_known_names(component)
        for output in outputs[component.name]:
            name, alias = known.get(output, (output, Alias(output)))
            if alias.transformation != IDENTITY:
                shown[len(names)] = alias.transformation.inverse()
            names.append(f"{component.name}.{name}")
    return names, shown


def _map_known_names(component: Component) -> dict[str, tuple[str, Alias]]:
    """What the system calls the FMU's variables that it has by another name or unit."""
    return {a.variable: (n, a) for n, a in component.aliases.items() if a.transformation.factor != 0.0}


def _links(
    system: System,
    files: Mapping[str, FmuFile],
    inputs: Mapping[str, list[str]],
    outputs: Mapping[str, list[str]],
) -> list[Link]:
    position = {c.name: i for i, c in enumerate(system.components)}
    used = {name: {x.output for x in system.out_of(name)} for name in position}
    read = {name: {v: i for i, v in enumerate(inputs[name])} for name in position}
    written = {name: {v: i for i, v in enumerate(outputs[name])} for name in position}

    def link(x: Connection) -> Link:
        interface, taken = files[x.target].interface, used[x.target]
        direct = interface.direct.among(taken, x.input)
        transformation = x.transformation or IDENTITY
        return Link(
            source=position[x.source],
            output=written[x.source][x.output],
            target=position[x.target],
            input=read[x.target][x.input],
            direct=bool(direct),
            initial=bool(interface.initial.among(taken, x.input)),
            factor=transformation.factor,
            offset=transformation.offset,
            name=str(x),
            through=tuple(sorted(written[x.target][output] for output in direct)),
        )

    return [link(x) for x in system.connections]
