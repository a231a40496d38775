"""Resolve the names and patterns of a plan into factors and their targets."""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..base.errors import CommandError, join_names
from ..base.patterns import is_pattern, matches_pattern
from ..base.quantities import parse_unit_name, read_quantity, split_quantity
from ..base.units import SiUnit
from ..base.values import convert_value
from ..fmu.interface import Interface
from ..fmu.units import read_si_number
from ..fmu.variables import find_variable
from ..run.options import list_options
from ..system.model import System, Value
from ..system.resolution import refuse_driven
from .distributions import Distribution, parse_distribution
from .kinds.discrete import ValueList
from .reserved import RESERVED
from .targets import ACTUATOR, FMU, OPTION, SHEET, START, Target, assign_value


@dataclass(frozen=True)
class Factor:
    """A factor: its name, its targets, and its distribution.

    The table of variants has its value in `unit`. If several targets have different nominal values, it has
    the multiplier.
    """

    name: str
    targets: Sequence[Target]
    distribution: Distribution
    unit: str = ""

    def value(self, drawn: Value | None) -> Value | None:
        """Return the value in the table of variants for a drawn one; None for the nominal value."""
        alone = self.targets[0].nominal if len(self.targets) == 1 else None
        return drawn if drawn is None or alone is None else alone * float(drawn)

    def options(self, value: Value | None) -> dict[str, Any]:
        """Return the options that set a value of the table in a run; none for None."""
        return assign_value(self.targets, value)


def resolve_factors(
    vary: Mapping[str, Any], system: System, interfaces: Mapping[str, Interface], where: str
) -> list[Factor]:
    """Return the factors of a plan for this system. A pattern gives a factor for each matching start value.

    Raises:
        CommandError: A name does not exist, is driven or occurs twice, or a value is not a distribution.
    """
    found = list[Factor]()
    for name, given in vary.items():
        varying = _FactorResolver(str(name), f"'{name}' of {where}", system, interfaces)
        found += varying.factors(given)
    _check_names(found, where)
    return found


def find_start_values(
    pattern: str, system: System, interfaces: Mapping[str, Interface]
) -> dict[str, float | None]:
    """Return the names of settable numbers that match a pattern, with start values (None if unknown)."""
    varying = _FactorResolver(pattern, f"'{pattern}'", system, interfaces)
    names = varying._matching(pattern, ValueList((0,)))
    return {name: find_start_number(name, system, interfaces) for name in names}


def _check_names(found: Sequence[Factor], where: str) -> None:
    """Raise CommandError if two factors share a name or target, or a name is reserved."""
    names, targets = set[str](), dict[str, str]()
    for factor in found:
        if factor.name in RESERVED:
            raise CommandError(
                f"'{factor.name}' of {where} needs another name: every table of variants has this column."
            )
        if factor.name in names:
            raise CommandError(f"{where} has two factors '{factor.name}'; rename one of them.")
        names.add(factor.name)
        for target in factor.targets:
            if target.name in targets:
                both = f"as {targets[target.name]} and as {factor.name}"
                raise CommandError(f"{where} varies {target.name} twice: {both}.", name=target.name)
        targets |= {target.name: factor.name for target in factor.targets}


def find_start_number(name: str, system: System, interfaces: Mapping[str, Interface]) -> float | None:
    """Return the start value of a variable in the scenario, in its unit there; None if it is not a number."""
    component, variable = system.split(name)
    value = component.parameters.get(variable)
    try:
        if value is not None:
            return float(value)
        alias = component.alias(variable)
        start = interfaces[component.name].variables[alias.variable].start
        return None if start is None else alias.transformation.inverse()(float(start))
    except ValueError:
        return None


@dataclass(frozen=True)
class _FactorResolver:
    """Resolves one entry of a plan, `name`, in a system. Messages call it `label`."""

    name: str
    label: str
    system: System
    interfaces: Mapping[str, Interface]

    def factors(self, given: Any) -> list[Factor]:
        """Return a factor for each match of the name, or a single one for all names in `of`."""
        of = None
        if isinstance(given, Mapping) and "of" in given:
            of = convert_value(given["of"], Sequence[str], f"'of' in {self.label}")
            if not of:
                raise CommandError(f"'of' in {self.label} is empty; it must be a list of names.")
            given = {key: value for key, value in given.items() if key != "of"}
        joints = self.system.branches
        if of is None and self.name.partition(".")[0] == ACTUATOR and ACTUATOR not in joints:
            return [self._of_actuator(given, joints)]
        in_si = parse_distribution(given, self.label, self._in_si)
        if of is None:
            names = self._names(self.name, in_si)
            return [self._factor(name, [name], self._distribution(given, [name])) for name in names]
        names = list(dict.fromkeys(name for pattern in of for name in self._names(pattern, in_si)))
        return [self._factor(self.name, names, self._distribution(given, names))]

    def _of_actuator(self, given: Any, joints: Sequence[str]) -> Factor:
        """Return the factor of `actuator[.JOINT]` or `actuator[.JOINT].TABLE.ENTRY`."""
        parts = self.name.split(".")[1:]
        if parts and parts[0] in joints:
            joint, *entry = parts
        elif len(joints) == 1 and len(parts) in (0, 2):
            joint, entry = joints[0], parts
        else:
            joint, entry = "", []
        if not joint or len(entry) not in (0, 2):
            raise CommandError(
                f"{self.label} is not an actuator or an entry of its data sheet; write actuator.JOINT or "
                "actuator.JOINT.TABLE.ENTRY.",
                name=self.name,
            )
        if not entry:
            return Factor(self.name, [Target(joint, ACTUATOR)], parse_distribution(given, self.label))
        units = set[str]()

        def convert(text: str) -> float:
            number, unit = split_quantity(text, self.label)
            units.add(unit)
            return number

        distributed = parse_distribution(given, self.label, convert)
        if len(units) > 1:
            raise CommandError(f"{self.label} has values in different units: {join_names(sorted(units))}.")
        if distributed.relative:
            raise CommandError(
                f"{self.label} is relative; entries of data sheets need values with their units."
            )
        unit = "".join(units)
        return Factor(self.name, [Target(".".join([joint, *entry]), SHEET, unit=unit)], distributed, unit)

    def _in_si(self, text: str) -> float:
        """Return a quantity as a number in SI units, which keeps the order of values."""
        return read_si_number(text, f"{self.label}: {text}", (i.units for i in self.interfaces.values()))

    def _distribution(self, given: Any, names: Sequence[str]) -> Distribution:
        """Return the distribution in the common unit of these names."""

        def convert(text: str) -> Any:
            units = {self._unit(self._kind(name), name) for name in names}
            label = f"{self.label}: {text}"
            if len(units) > 1:
                raise CommandError(f"{label} is for variables with different units; vary each separately.")
            return read_quantity(text, label, units.pop())

        if any(self._takes_text(name) for name in names):
            return parse_distribution(given, self.label)
        return parse_distribution(given, self.label, convert)

    def _takes_text(self, name: str) -> bool:
        """Return whether values that look like quantities may be texts: files, names of levels."""
        kind = self._kind(name)
        if kind == OPTION:
            return not list_options()[name].about.unit
        if kind == FMU:
            return True
        component, variable = self.system.split(name)
        variables = self.interfaces[component.name].variables
        return variables[component.alias(variable).variable].type in ("String", "Enumeration")

    def _factor(self, name: str, names: Sequence[str], distributed: Distribution) -> Factor:
        relative = distributed.relative
        targets = [Target(n, self._kind(n), self._nominal(n) if relative else None) for n in names]
        if len(targets) > 1 and any(t.kind != START for t in targets):
            raise CommandError(f"{self.label} varies several names at once; only start values can do that.")
        units = {self._unit(target.kind, target.name) for target in targets}
        own = units.pop() if len(units) == 1 and not (relative and len(targets) > 1) else None
        return Factor(name, targets, distributed, "" if own is None else str(own))

    def _kind(self, name: str) -> str:
        if name in list_options():
            return OPTION
        return FMU if any(c.name == name for c in self.system.components) else START

    def _names(self, name: str, distributed: Distribution) -> list[str]:
        """Return the option, component or start value of a name, or the start values of a pattern."""
        kind = self._kind(name)
        if kind == OPTION and not list_options()[name].can_vary:
            raise CommandError(f"{self.label}: the option {name} cannot vary between variants.")
        if kind == START and is_pattern(name) and (found := self._matching(name, distributed)):
            return found
        if kind == START:
            self._check_start_value(name)
        return [name]

    def _matching(self, pattern: str, distributed: Distribution) -> list[str]:
        """Return the matching Real start values, and Integer ones if all values are whole."""
        whole = not distributed.relative and all(isinstance(end, int) for end in distributed.ends)
        types = ("Real", "Integer") if whole else ("Real",)
        driven = {x.ends[1] for x in self.system.connections}
        found = list[str]()
        for component in self.system.components:
            named = {alias.variable: name for name, alias in component.aliases.items()}
            interface = self.interfaces[component.name]
            for own, variable in interface.variables.items():
                name = f"{component.name}.{named.get(own, own)}"
                free = interface.is_settable(own) and not interface.is_structural(own)
                free = free and (component.name, own) not in driven
                if free and variable.type in types and matches_pattern(name, pattern):
                    found.append(name)
        return found

    def _check_start_value(self, name: str) -> None:
        """Raise CommandError if a name is not a start value, or is driven or computed."""
        if "." not in name:
            everything = [*list_options(), *(c.name for c in self.system.components)]
            near = difflib.get_close_matches(name, everything, n=2, cutoff=0.6)
            meant = f"did you mean {' or '.join(near)}?" if near else "write it as component.variable."
            raise CommandError(f"{self.label} is not an option, component or start value; {meant}", name=name)
        component, variable = self.system.split(name)
        interface, own = self.interfaces[component.name], component.alias(variable).variable
        find_variable(component.name, interface.variables, own)
        if interface.is_structural(own):
            raise CommandError(
                f"{self.label} is a structural parameter and cannot be varied: all variants have arrays of "
                "the same sizes. Set it in the scenario or with --set.",
                name=name,
            )
        if not interface.is_settable(own):
            near = [n for n in interface.variables if n.endswith(f".{own}") and interface.is_settable(n)]
            meant = f"; did you mean {component.name}.{near[0]}?" if near else "."
            raise CommandError(f"{self.label} is computed by the FMU and cannot be varied{meant}", name=name)
        refuse_driven(replace(component, parameters={own: 0.0}), self.system)

    def _nominal(self, name: str) -> float:
        """Return the start value in the scenario. Raise CommandError if it is not a number to multiply."""
        number = find_start_number(name, self.system, self.interfaces) if self._kind(name) == START else None
        if number is None:
            raise CommandError(f"{self.label} is relative, but {name} has no number in the scenario.")
        if number == 0.0:
            raise CommandError(f"{self.label} is relative, but {name} is 0 in the scenario; give it values.")
        return number

    def _unit(self, kind: str, name: str) -> SiUnit | None:
        """Return the unit of a start value or option, or None."""
        if kind == OPTION:
            unit = list_options()[name].about.unit
            return parse_unit_name(unit, self.label) if unit else None
        if kind == FMU:
            return None
        component, variable = self.system.split(name)
        alias = component.aliases.get(variable)
        return alias.unit if alias is not None else self.interfaces[component.name].unit(variable)
