"""Build a network of FMU instances from a system description."""

import contextlib
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

from fmpy.model_description import ModelVariable

from ..base.errors import CommandError
from ..base.files import temporary_folder
from ..base.units import IDENTITY, LinearTransformation
from ..fmu.cvode import IntegratorSettings
from ..fmu.elements import BINARY, is_triggered_input
from ..fmu.file import FmuFile, open_fmu
from ..fmu.interface import KINDS, Interface
from ..fmu.log import FmuLog
from ..fmu.tables import is_table
from ..fmu.variables import (
    TypedValue,
    complete_start_values,
    convert_start_values,
    convert_structure,
    format_value,
)
from ..system.model import Alias, Component, Connection, System
from ..system.names import NamedVariable, Names
from ..system.resolution import convert_to_fmu_terms, refuse_driven, resolve_system
from ..system.signal_faults import MODEL
from ..system.structure import find_changed_sizes
from .grouping import Sampling, arrange, connect, find_groups, find_sampling
from .instances.described_instance import DescribedInstance
from .instances.instance_kinds import make_instance
from .instances.isolated_instance import IsolatedInstance
from .network import Link, OpaqueLink
from .observer import Observer


class Assembly:
    """A network of FMU instances, and the FMU file of every component.

    Signals have the names of the system. If a signal has another unit in the system than in its FMU,
    `transformations` converts it to the system's value, by position in a row. Call `close` at the end.
    """

    def __init__(
        self,
        system: System,
        fmus: Mapping[str, Path],
        isolated: Container[str] = (),
        integrate_together: bool = True,
    ) -> None:
        """Open the files and connect the components.

        Args:
            system: The components and connections.
            fmus: FMU file of every component, by name.
            isolated: Names of the components that run in processes of their own.
            integrate_together: Whether connected FMUs that run as Model Exchange have one integrator.

        Raises:
            CommandError: The system and its files do not match.
        """
        with contextlib.ExitStack() as resources:
            folder = resources.enter_context(temporary_folder("system"))
            self.files: Mapping[str, FmuFile] = _open_files(system, fmus, folder)
            self.system = system
            interfaces = {name: file.interface for name, file in self.files.items()}
            self._resolved = resolve_system(system, interfaces)
            kinds = {name: file.kind for name, file in self.files.items()}
            self._groups = (
                find_groups(self._resolved, interfaces, kinds, isolated) if integrate_together else []
            )
            self._instance_stack = resources.enter_context(contextlib.ExitStack())
            self._isolated = isolated
            self._is_started = False
            self._instantiate()
            self.start(system)
            self._is_started = False  # nothing is initialized yet, so start values can be set again
            self._resources = resources.pop_all()

    def __enter__(self) -> "Assembly":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the instances, and remove the unpacked files."""
        self._resources.close()

    def _instantiate(self) -> None:
        """Instantiate all components and connect them."""
        components = self._resolved.components
        # signals are doubles, so these pass outside of them
        opaque = [x for x in self._resolved.connections if self._find_ends(x)[0].type in ("String", BINARY)]
        numeric_system = replace(
            self._resolved,
            connections=tuple(x for x in self._resolved.connections if x not in opaque),
        )
        inputs = {c.name: [x.input for x in numeric_system.into(c.name)] for c in components}
        outputs = {c.name: _select_outputs(self.files[c.name], numeric_system, c.name) for c in components}
        self.instances: dict[str, DescribedInstance] = {}
        self._log = FmuLog()
        for number, name in enumerate(c.name for c in components):
            arguments = (name, self.files[name], inputs[name], outputs[name])
            isolated = name in self._isolated and not is_table(self.files[name])  # a table cannot crash
            instance = (
                IsolatedInstance(*arguments, number)
                if isolated
                else make_instance(*arguments, self._log, number)
            )
            self._instance_stack.callback(instance.close)
            self.instances[name] = instance
        for instance in self.instances.values():
            # those in other processes have started at the same time; now their errors are raised
            instance.wait_until_ready()
        links = _make_links(numeric_system, self.files, inputs, outputs)
        arranged = arrange(list(self.instances), self._groups)
        ordered = [self.system.component(name) for members in arranged for name in members]
        names, self._signal_transformations = _name_signals(ordered, outputs)
        self.transformations: Mapping[int, LinearTransformation] = self._signal_transformations
        # components of faults pass on one value, so they must not change the order of the others
        faults = [
            i for i, f in enumerate(self.files[n] for n in self.instances) if f.description.modelName == MODEL
        ]
        self.network = connect(self.instances, arranged, self._groups, links, names, faults)
        for x in opaque:
            output, input_ = self._find_ends(x)
            self.network.opaque_links.append(
                OpaqueLink(self.instances[x.source], output, self.instances[x.target], input_)
            )
        self.network.tables = self._find_positions(
            n for n, x in self.instances.items() if _has_known_outputs(x)
        )
        self.network.samplers = self._find_positions(c.name for c in components if c.samples)
        for stepped in self.network.instances:
            if stepped not in self.instances.values():
                self._instance_stack.callback(stepped.close)
        self._order = [self.network.instances[i].name for i in self.network.order]
        self._values: dict[str, tuple[Component, list[TypedValue]]] = {}
        self._parameters: dict[str, tuple[Component, dict[str, float]]] = {}
        self._overrides: dict[str, tuple[Component, dict[str, dict[str, Any]]]] = {}

    def _find_positions(self, components: Iterable[str]) -> frozenset[int]:
        """Return the positions in the network of instances with these components."""
        names = set(components)
        return frozenset(i for i, x in enumerate(self.network.instances) if names.intersection(x.components))

    def _find_ends(self, connection: Connection) -> tuple[ModelVariable, ModelVariable]:
        """Return the variables of a connection: output and input."""
        output, input_ = (self.files[name].variables[variable] for name, variable in connection.ends)
        return output, input_

    def start(
        self,
        system: System,
        fresh: bool = False,
        tolerance: float | None = None,
        integrator: IntegratorSettings | None = None,
    ) -> None:
        """Prepare all instances for initialization, and set start values.

        Args:
            system: The system of this assembly, possibly with other start values.
            fresh: Whether to replace instances that have run. Otherwise they are reset.
            tolerance: Relative tolerance for the solvers of all FMUs; None takes those of the FMUs.
            integrator: How to integrate the FMUs that run as Model Exchange; its tolerance is for those that
                have none.

        Raises:
            CommandError: A start value does not fit its variable.
            InstanceError: An FMU rejects a start value.
        """
        self._log.listen()  # another simulation may have been prepared or run since
        for component in system.components:
            if self._values.get(component.name, (None,))[0] is not component:
                self._values[component.name] = component, self._type_start_values(component)
        if self._is_started and fresh:
            values = self._values
            self._instance_stack.close()
            self._instantiate()
            self._values = values
        elif self._is_started:
            for stepped in self.network.instances:
                stepped.reset()
            # a signal that no start value defines must not keep its value from the last run
            self.network.signals[:] = 0.0
        self.network.reorder(self._order)
        self._is_started = True
        for name, instance in self.instances.items():
            fmu_tolerance = self.files[name].interface.tolerance if tolerance is None else tolerance
            settings = integrator or IntegratorSettings()
            instance.tolerance = fmu_tolerance
            instance.use_integrator(settings._replace(tolerance=fmu_tolerance or settings.tolerance))
            instance.set_start_values(self._values[name][1])

    @cached_property
    def names(self) -> Names:
        """The names of all variables."""
        return Names(self.system, {name: file.interface for name, file in self.files.items()})

    @cached_property
    def unconnected_variables(self) -> dict[str, NamedVariable]:
        """Variables besides the signals that can be recorded, by full name, in the order of the system."""
        signals = set(self.network.names)
        return {
            name: v
            for name, v in self.names.all.items()
            if name not in signals and v.variable.causality != "independent" and v.variable.type != BINARY
        }

    @cached_property
    def sampling(self) -> Sampling:
        """Which components sample."""
        return find_sampling(self.files, [c.name for c in self.system.components if c.samples])

    @property
    def violations(self) -> list[str]:
        """The violations of the standard that were accepted in the last run."""
        return [text for instance in self.instances.values() for text in instance.violations]

    @cached_property
    def unscheduled_clocks(self) -> list[str]:
        """Full names of the triggered input clocks that no output clock drives."""
        driven = {x.ends[1] for x in self._resolved.connections}
        return [
            name
            for name, entry in self.unconnected_variables.items()
            if is_triggered_input(entry.variable) and entry.end not in driven
        ]

    @cached_property
    def outputs(self) -> list[str]:
        """The outputs that are recorded by default: Reals, then other types except Strings."""
        signals = self.network.names
        unconnected_variables = [
            n for n, v in self.unconnected_variables.items() if v.variable.causality == "output"
        ]
        return sorted(
            (n for n in (*signals, *unconnected_variables) if not self.names.find(n).column_type.is_text),
            key=lambda n: self.names.find(n).column_type.is_discrete,
        )

    def observe(self, names: Iterable[str], steps_per_row: int = 1) -> None:
        """Choose what to record besides the signals, for runs that start after this.

        Args:
            names: names in `unconnected_variables`.
            steps_per_row: every `steps_per_row`-th point has a row in tables.
        """
        observer = Observer(
            self.instances, [self.unconnected_variables[name] for name in names], steps_per_row
        )
        transformations = dict(self._signal_transformations)
        for i, variable in enumerate(observer.variables, len(self.network.names)):
            if (to_fmu := variable.component.alias(variable.name).transformation) != IDENTITY:
                # an alias converts to the FMU, a row has the value of the system
                transformations[i] = to_fmu.inverse()
        self.network.observer, self.transformations = observer, transformations

    def parameters(self) -> dict[str, float]:
        """Return the parameters of all components by full name, in units of the system; Booleans as 0, 1."""
        values: dict[str, float] = {}
        for name, (component, start_values) in self._values.items():
            if self._parameters.get(name, (None,))[0] is not component:
                self._parameters[name] = component, self._list_parameters(component, start_values)
            values |= self._parameters[name][1]
        return values

    def start_values(self, name: str) -> list[TypedValue]:
        """Return the start values of a component, in the names and units of its FMU."""
        return self._values[name][1]

    def names_in_system(self, name: str) -> dict[str, str]:
        """Return the names in the system of variables that a component's FMU calls otherwise."""
        aliases = self.system.component(name).by_fmu_name
        return {fmu_name: in_system for fmu_name, (in_system, _) in aliases.items()}

    def list_non_default_values(self, component: Component) -> dict[str, dict[str, Any]]:
        """Return the start values of a component that differ from its FMU's, with default and unit.

        The same component gets the same object, so that many runs share it.
        """
        if self._overrides.get(component.name, (None,))[0] is not component:
            interface = self.files[component.name].interface
            self._overrides[component.name] = component, _find_non_default_values(component, interface)
        return self._overrides[component.name][1]

    def list_rejected_start_values(self, component: Component) -> dict[str, dict[str, Any]]:
        """Return the start values of a component that its FMU changed in the last initialization.

        Each has the value that was set (`set`), the one that the FMU has instead (`read`, None if it
        cannot be read), and the unit.
        """
        aliases, interface = component.by_fmu_name, self.files[component.name].interface
        entries = {}
        for rejected in self.instances[component.name].rejected_start_values:
            name, alias = aliases.get(rejected.variable, (rejected.variable, Alias(rejected.variable)))
            values = [format_value(interface.variables[rejected.variable], x) for x in rejected[1:]]
            if alias.transformation != IDENTITY:
                values = [x if x is None else alias.transformation.inverse()(x) for x in values]
            unit = alias.unit or interface.unit(rejected.variable)
            entries[name] = {"set": values[0], "read": values[1], "unit": None if unit is None else str(unit)}
        return entries

    def _list_parameters(self, component: Component, start_values: Sequence[TypedValue]) -> dict[str, float]:
        """Return the parameters of a component, except for Strings, by full name in units of the system."""
        parameters: dict[str, float] = {}
        aliases, values = component.by_fmu_name, {v.name: x for v, x in start_values}
        for variable in self.files[component.name].variables.values():
            value = values.get(variable.name, variable.start)
            is_number = variable.causality == "parameter" and variable.type in ("Real", "Integer", "Boolean")
            if is_number and value is not None:
                name, alias = aliases.get(variable.name, (variable.name, Alias(variable.name)))
                # a value may be written as text, also a Boolean
                number = float(value == "true") if value in ("true", "false") else float(value)
                parameters[f"{component.name}.{name}"] = alias.transformation.inverse()(number)
        return parameters

    def _type_start_values(self, component: Component) -> list[TypedValue]:
        """Return the start values of a component in the names and units of its FMU.

        Raises:
            CommandError: One does not fit its variable, is of a connected input, or changes the structure.
        """
        name, interface = component.name, self.files[component.name].interface
        converted = convert_to_fmu_terms(component)
        refuse_driven(converted, self._resolved)
        structure = convert_structure(name, interface, converted.parameters)
        prepared = interface.structure
        for parameter in {**structure, **prepared}:
            if structure.get(parameter) != prepared.get(parameter):
                raise CommandError(
                    f"{name}.{parameter} cannot change between runs or variants: it is a structural "
                    "parameter, and the prepared system has arrays that follow from it. Prepare another "
                    "system.",
                    variable=parameter,
                )
        values = convert_start_values(name, interface, converted.parameters)
        values = [(v, x) for v, x in values if not interface.is_structural(str(v.name))]
        if not structure:
            return values
        return complete_start_values(name, interface, values, [x.input for x in self._resolved.into(name)])


def _find_non_default_values(component: Component, interface: Interface) -> dict[str, dict[str, Any]]:
    """Return the start values that differ from those of the FMU, with default and unit, by name."""
    entries = {}
    for name, value in component.parameters.items():
        alias = component.alias(name)
        default: Any = interface.variables[alias.variable].start
        unit = alias.unit or interface.unit(alias.variable)
        if default is not None and isinstance(value, (int, float)) and not isinstance(value, bool):
            default = alias.transformation.inverse()(float(default))
        if str(default).lower() != str(value).lower() and default != value:
            entries[name] = {"value": value, "default": default, "unit": None if unit is None else str(unit)}
    return entries


def _has_known_outputs(instance: DescribedInstance) -> bool:
    """Return whether an instance is a table that says what its continuous outputs do in a step."""
    has_spans = bool(instance.span_references) or not instance.continuous_outputs.any()
    return is_table(instance.file) and has_spans


def _open_files(system: System, fmus: Mapping[str, Path], folder: Path) -> dict[str, FmuFile]:
    """Return the file of each component, with its event mode and sizes; open each FMU once for each kind."""
    keys = {name: (path, system.component(name).kind) for name, path in fmus.items()}
    # co-simulation and Model Exchange can have different libraries
    opened = {
        (path, kind): open_fmu(path, folder / str(i), KINDS.get(kind))
        for i, (path, kind) in enumerate(dict.fromkeys(keys.values()))
    }
    files = {
        name: replace(opened[key], uses_event_mode=system.component(name).event_mode)
        for name, key in keys.items()
    }
    structures = {
        name: find_changed_sizes(system.component(name), file.interface) for name, file in files.items()
    }
    return {name: file.with_structure(structures[name]) for name, file in files.items()}


def _select_outputs(file: FmuFile, system: System, name: str) -> list[str]:
    """Return all Real outputs of a component, and connected outputs of other types."""
    connected = {x.output for x in system.out_of(name)}
    outputs = [v for v in file.variables.values() if v.causality == "output"]
    return [v.name for v in outputs if v.type == "Real" or v.name in connected]


def _name_signals(
    components: Iterable[Component], outputs: Mapping[str, list[str]]
) -> tuple[list[str], dict[int, LinearTransformation]]:
    """Return the names of all signals of components, and transformations to the system's values."""
    names, transformations = [], {}
    for component in components:
        aliases = component.by_fmu_name
        for output in outputs[component.name]:
            name, alias = aliases.get(output, (output, Alias(output)))
            if alias.transformation != IDENTITY:
                transformations[len(names)] = alias.transformation.inverse()
            names.append(f"{component.name}.{name}")
    return names, transformations


def _make_links(
    system: System,
    files: Mapping[str, FmuFile],
    inputs: Mapping[str, list[str]],
    outputs: Mapping[str, list[str]],
) -> list[Link]:
    """Return a link for each connection, with positions of components, outputs and inputs."""
    position = {c.name: i for i, c in enumerate(system.components)}
    used = {name: {x.output for x in system.out_of(name)} for name in position}
    input_positions = {name: {v: i for i, v in enumerate(inputs[name])} for name in position}
    output_positions = {name: {v: i for i, v in enumerate(outputs[name])} for name in position}

    def make_link(x: Connection) -> Link:
        interface, used_outputs = files[x.target].interface, used[x.target]
        direct = interface.direct.among(used_outputs, x.input)
        transformation = x.transformation or IDENTITY
        return Link(
            source=position[x.source],
            output=output_positions[x.source][x.output],
            target=position[x.target],
            input=input_positions[x.target][x.input],
            direct=bool(direct),
            initial=bool(interface.initial.among(used_outputs, x.input)),
            factor=transformation.factor,
            offset=transformation.offset,
            name=str(x),
            through=tuple(sorted(output_positions[x.target][output] for output in direct)),
            shows=bool(interface.direct.among(set(output_positions[x.target]), x.input)),
        )

    return [make_link(x) for x in system.connections]
