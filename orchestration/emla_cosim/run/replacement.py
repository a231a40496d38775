"""Replace a component with another FMU: match variables, convert units, report what is missing."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from fmpy.model_description import ModelVariable

from ..base.errors import CommandError
from ..base.faults import convert_documents_units
from ..base.files import read_file
from ..base.progress import FITS, CompatibilityReport, VariableMatch
from ..base.units import IDENTITY, LinearTransformation, SiUnit
from ..fmu.interface import Interface
from ..system.model import Alias, Component, Connection, Replacement, System
from ..system.resolution import convert_to_fmu_terms, find_transformation

if TYPE_CHECKING:
    from ..ssp.documents.ssd_data import MappingEntry


def replace_component(
    system: System,
    name: str,
    replacement: Replacement,
    target: Interface,
    interfaces: Mapping[str, Interface],
) -> tuple[System, CompatibilityReport]:
    """Replace a component with an FMU that has the interface `target`.

    Start values and results keep their names and units. Connections get those of the new FMU.

    Args:
        system: System to change.
        name: Component to replace.
        replacement: The FMU and its mapping.
        target: Interface of the new FMU.
        interfaces: Interfaces of the present FMUs, by component.

    Returns:
        The changed system, or the same one if the FMU does not fit, and a report on how the variables match.

    Raises:
        CommandError: If the mapping cannot be read, or names a variable that neither FMU has.
    """
    component, original = convert_to_fmu_terms(system.component(name)), interfaces[name]
    entries = _read_mapping_entries(replacement, original, target)
    matching = _VariableMatcher(system, component, original, target, entries)
    fit = CompatibilityReport(name, replacement.fmu, matching.matches, len(matching.same))
    if fit.problems:
        return system, fit
    remaining = {n: v for n, v in component.parameters.items() if n not in matching.left_out}
    # the new FMU may not have the kind as which the old one ran
    changed = replace(
        component, model="", fmu=replacement.fmu, parameters=remaining, aliases=matching.aliases, kind=""
    )
    connections = tuple(_reconnect(x, changed, interfaces) for x in system.connections)
    return replace(system.with_component(changed), connections=connections), fit


def _reconnect(
    connection: Connection, component: Component, interfaces: Mapping[str, Interface]
) -> Connection:
    """Express a connection with the names and units of the component's new FMU."""
    source_alias = component.aliases.get(connection.output) if connection.source == component.name else None
    target_alias = component.aliases.get(connection.input) if connection.target == component.name else None
    if source_alias is None and target_alias is None:
        return connection
    # first, as it needs the names and units of the old FMU
    between = find_transformation(connection, interfaces)
    if source_alias is not None:
        between = between.after(source_alias.transformation.inverse())
        connection = replace(connection, output=source_alias.variable)
    if target_alias is not None:
        between = target_alias.transformation.after(between)
        connection = replace(connection, input=target_alias.variable)
    return replace(connection, transformation=between)


def _read_mapping_entries(
    replacement: Replacement, original: Interface, target: Interface
) -> "dict[str, MappingEntry]":
    """Return the entries of the mapping by variable of the original FMU; empty without a mapping.

    Raises:
        CommandError: If the mapping cannot be read, names a variable that does not exist, or is not linear.
    """
    path = replacement.mapping
    if path is None:
        return {}
    from ..ssp.documents.mappings import parse_mapping
    from ..ssp.documents.ssd_data import TableTransformation

    content = read_file(path, "the mapping")
    entries: dict[str, MappingEntry] = {}
    for entry in parse_mapping(content, str(path)):
        for name, interface in ((entry.source, original), (entry.target, target)):
            if name not in interface.variables:
                model = interface.description.modelName
                raise CommandError(f"the mapping '{path}' names '{name}', which {model} does not have.")
        if isinstance(entry.transformation, TableTransformation):
            raise CommandError(
                f"the mapping '{path}' has a {entry.transformation.kind}MappingTransformation for "
                f"'{entry.source}'; only linear ones are supported."
            )
        if entry.source in entries:
            raise CommandError(f"the mapping '{path}' maps '{entry.source}' twice.")
        entries[entry.source] = entry
    return entries


class _VariableMatcher:
    """Matches all variables of a component that the system uses or can record."""

    def __init__(
        self,
        system: System,
        component: Component,
        original: Interface,
        target: Interface,
        entries: "Mapping[str, MappingEntry]",
    ) -> None:
        self._original, self._new, self._entries = original, target, entries
        self._mapped_targets = {entry.target for entry in entries.values()}
        self.aliases: dict[str, Alias] = {}
        self.matches: list[VariableMatch] = []
        self.left_out: set[str] = set()
        self.same: set[str] = set()
        """The variables with the same name and unit."""
        inputs = [x.input for x in system.into(component.name)]
        outputs = list(dict.fromkeys(x.output for x in system.out_of(component.name)))
        for name in inputs:
            self._match_connected("input", name)
        for name in outputs:
            self._match_connected("output", name)
        for name in component.parameters:
            self._match_start_value(name)
        self._match_unconnected_outputs(outputs)
        self.matches += self._list_undriven_inputs(inputs)
        if any(match.fatal for match in self.matches):  # then a mapping may help
            self.matches += self._list_unused()

    def _choose_target(self, name: str) -> str:
        """Return the new FMU's name of a variable; empty if another variable already has that name."""
        entry = self._entries.get(name)
        if entry is not None:
            return entry.target
        return "" if name in self._mapped_targets else name

    def _match_connected(self, kind: str, name: str) -> None:
        """Match a variable that is connected."""
        variable = self._new.variables.get(self._choose_target(name))
        if variable is None:
            self._add_match(kind, name, "", "is missing", fatal=True)
        elif variable.causality != kind or variable.type != self._original.variables[name].type:
            self._add_match(
                kind, name, variable.name, f"is {variable.causality}, {variable.type}", fatal=True
            )
        else:
            self._add_alias(kind, name, variable)

    def _match_start_value(self, name: str) -> None:
        """Match a variable that has a start value."""
        if name not in self._original.variables:
            return  # it may belong to the new FMU; setting it reports that
        parameter = self._original.variables[name].causality == "parameter"
        kind = "parameter" if parameter else "start value"
        variable = self._new.variables.get(self._choose_target(name))
        if variable is None:
            self.left_out.add(name)
            self._add_match(kind, name, "", "is left out")
        else:
            self._add_alias(kind, name, variable)

    def _match_unconnected_outputs(self, connected: Sequence[str]) -> None:
        """Match outputs that are not among the connected ones, but recorded under the old names."""
        for name, variable in self._original.variables.items():
            replacement_variable = self._new.variables.get(self._choose_target(name))
            if variable.causality != "output" or name in connected or replacement_variable is None:
                continue
            if (
                replacement_variable.causality == "output"
                and replacement_variable.type == variable.type != "String"
            ):
                self._add_alias("output", name, replacement_variable)

    def _list_undriven_inputs(self, inputs: Sequence[str]) -> Iterator[VariableMatch]:
        """Yield the inputs of the new FMU that nothing drives."""
        driven = {self._choose_target(name) for name in inputs}
        for name, variable in self._new.variables.items():
            if variable.causality == "input" and name not in driven:
                yield VariableMatch("input", "", self._with_unit(name, self._new), "keeps its start value")

    def _list_unused(self) -> Iterator[VariableMatch]:
        """Yield the outputs and parameters of the new FMU that a mapping could still name."""
        used = {*self._mapped_targets, *self.same}
        for name, variable in self._new.variables.items():
            if variable.causality in ("output", "parameter") and name not in used:
                yield VariableMatch(variable.causality, "", self._with_unit(name, self._new), "is not used")

    def _add_alias(self, kind: str, name: str, variable: ModelVariable) -> None:
        """Match a variable with that of the new FMU: note its alias, or a problem if the units do not fit."""
        if name in self.aliases:
            return  # an output that also has a start value
        old_unit, new_unit = self._original.unit(name), self._new.unit(variable.name)
        try:
            transformation = self._make_transformation(name, old_unit, new_unit)
            if transformation.factor == 0.0 and variable.causality == "output":
                raise ValueError("a factor of 0, which cannot be inverted")
        except ValueError as error:
            self._add_match(kind, name, variable.name, f"has {error}", fatal=True)
            return
        if variable.name == name and transformation == IDENTITY:
            self.same.add(name)
            return
        self.aliases[name] = Alias(variable.name, transformation, old_unit)
        self._add_match(
            kind, name, variable.name, FITS if transformation == IDENTITY else str(transformation)
        )

    def _make_transformation(
        self, name: str, old_unit: SiUnit | None, new_unit: SiUnit | None
    ) -> LinearTransformation:
        """Return the transformation to the new FMU. Raise ValueError if the units do not fit."""
        entry = self._entries.get(name)
        prescribed = None if entry is None else entry.transformation
        linear = prescribed if isinstance(prescribed, LinearTransformation) else IDENTITY
        if entry is not None and entry.suppress_unit_conversion:
            return linear
        return linear.after(convert_documents_units(f"the replacement of {name}", old_unit, new_unit))

    def _add_match(self, kind: str, old_name: str, new_name: str, verdict: str, fatal: bool = False) -> None:
        new_label = self._with_unit(new_name, self._new) if new_name else ""
        self.matches.append(
            VariableMatch(kind, self._with_unit(old_name, self._original), new_label, verdict, fatal)
        )

    def _with_unit(self, name: str, interface: Interface) -> str:
        unit = interface.unit(name) if name in interface.variables else None
        return f"{name} [{unit}]" if unit is not None else name
