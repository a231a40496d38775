"""Resolve the names and patterns of a plan into factors, and into targets of their values."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_origin

from ...base.errors import CommandError, join_names, suggest_names
from ...base.option import SWEEP, FileOrObject, Option
from ...base.quantities import parse_unit_name, read_quantity, split_quantity
from ...base.units import SiUnit
from ...base.values import convert_value
from ...fmu.interface import Interface
from ...fmu.units import read_si_number
from ...inputs.input import Input
from ...run.options import list_options, select_repeatable
from ...system.model import Replacement, System, Value
from ...system.names import Names
from .distributions import parse_distribution
from .kinds import Distribution
from .measures import RESERVED

OPTION, FMU, START = "option", "replace", "set"
ACTUATOR, SHEET = "actuator", "sheet"
"""Kinds of targets: an option, a component whose FMU varies, a start value by its full name, a joint whose
actuator varies, or an entry of a data sheet by JOINT.TABLE.ENTRY.
"""


@dataclass(frozen=True)
class Target:
    """Where a value goes. A relative value multiplies `nominal`; one of a data sheet is in `unit`."""

    name: str
    kind: str = START
    nominal: float | None = None
    unit: str = ""


def needs_preparation(target: Target) -> bool:
    """Return whether another value of a target needs another simulation."""
    return target.kind in (FMU, ACTUATOR, SHEET) or (
        target.kind == OPTION and list_options()[target.name].is_prepared
    )


def select_run_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options that a run of a prepared simulation accepts."""
    declared = list_options()
    return {name: value for name, value in options.items() if not declared[name].is_prepared}


def assign_value(targets: Sequence[Target], value: Value | None) -> dict[str, Any]:
    """Return the options that set these targets to a value of the table of variants; none for None."""
    options: dict[str, Any] = {}
    if value is None:
        return options
    for target in targets:
        assigned = value
        # the table has the multiplier only where several targets have different nominal values
        if target.nominal is not None and len(targets) > 1:
            assigned = target.nominal * float(value)
        if target.unit:
            assigned = f"{float(value)!r} {target.unit}"
        if target.kind == OPTION:
            takes_several = get_origin(list_options()[target.name].type) is Sequence
            options[target.name] = [assigned] if takes_several else assigned
        else:
            options.setdefault(target.kind, {})[target.name] = assigned
    return options


def merge_options(parts: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Merge options: of values with the same name the last one counts, and tables are merged by key."""
    merged: dict[str, Any] = {}
    for part in parts:
        for name, value in part.items():
            merged[name] = {**merged.get(name, {}), **value} if isinstance(value, Mapping) else value
    return merged


def format_arguments(options: Mapping[str, Any]) -> list[str] | None:
    """Return options as arguments of `emla run`; None if one is an object that only Python has."""
    declared = list_options(SWEEP)
    parts = [_format_option(declared[name], value) for name, value in select_repeatable(options).items()]
    return None if None in parts else [text for part in parts for text in part or ()]


def _format_option(option: Option, value: Any) -> list[str] | None:
    """Return the arguments of an option; empty if it is off, None if only Python has its value."""
    flag = option.flag
    if value is None or (value is False and option.type is not bool):
        return []
    if isinstance(value, bool):
        return [flag if value else f"--no-{flag.removeprefix('--')}"]
    if isinstance(value, Mapping):
        if any(isinstance(inner, FileOrObject) and inner.file is None for inner in value.values()):
            return None
        arguments = list[str]()
        for name, inner in value.items():
            is_fmu = isinstance(inner, Replacement)
            arguments += [flag, f"{name}={inner.fmu if is_fmu else _format_value(inner)}"]
            if is_fmu and inner.mapping is not None:
                arguments += ["--mapping", f"{name}={inner.mapping}"]
        return arguments
    if isinstance(value, (list, tuple)):
        if option.parse is not None:
            return [flag, ",".join(map(_format_value, value))]
        if any(isinstance(inner, Input) and not inner.is_text for inner in value):
            return None
        return [text for inner in value for text in (flag, _format_value(inner))]
    return [flag, _format_value(value)] if isinstance(value, (str, int, float, Path)) else None


def _format_value(value: Any) -> str:
    if isinstance(value, FileOrObject):
        return str(value.file)
    if isinstance(value, bool):
        return str(value).lower()
    # repr: the command must repeat the run to the last bit
    return repr(value) if isinstance(value, float) else str(value)


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
        nominal = self.targets[0].nominal if len(self.targets) == 1 else None
        return drawn if drawn is None or nominal is None else nominal * float(drawn)

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
    factors, names = list[Factor](), Names(system, interfaces)
    for name, entry in vary.items():
        factors += _FactorResolver(str(name), f"'{name}' of {where}", system, names).resolve(entry)
    names_in_use, owners = set[str](), dict[str, str]()
    for factor in factors:
        if (name := factor.name) in RESERVED:
            raise CommandError(f"'{name}' of {where} is a reserved column name; rename it.")
        if name in names_in_use:
            raise CommandError(f"{where} has two factors '{name}'; rename one of them.")
        names_in_use.add(name)
        for target in factor.targets:
            if (owner := owners.setdefault(target.name, name)) != name:
                text = f"{where} varies {target.name} twice: as {owner} and as {name}; remove one."
                raise CommandError(text, name=target.name)
    return factors


def find_start_values(
    pattern: str, system: System, interfaces: Mapping[str, Interface]
) -> dict[str, float | None]:
    """Return the names of settable numbers that match a pattern, with start values (None if unknown)."""
    names = Names(system, interfaces)
    return {
        v.full_name: v.start_number
        for v in names.match(pattern)
        if names.is_free(v) and v.variable.type in ("Real", "Integer")
    }


@dataclass(frozen=True)
class _Subject:
    """What varies: an option, the FMU of a component, or a start value, with its `number` in the scenario.

    If it `takes_text`, values that look like quantities may be texts: files, names of levels.
    """

    name: str
    kind: str
    unit: SiUnit | None = None
    takes_text: bool = False
    number: float | None = None


@dataclass(frozen=True)
class _FactorResolver:
    """Resolves one entry of a plan, `name`, in a system with these `names`. Messages call it `label`."""

    name: str
    label: str
    system: System
    names: Names

    def resolve(self, entry: Any) -> list[Factor]:
        """Return a factor for each match of the name, or a single one for all names in `of`."""
        of = None
        if isinstance(entry, Mapping) and "of" in entry:
            of = convert_value(entry["of"], Sequence[str], f"'of' in {self.label}")
            if not of:
                raise CommandError(f"'of' in {self.label} is empty; it must be a list of names.")
            entry = {key: value for key, value in entry.items() if key != "of"}
        joints = self.system.branches
        if of is None and self.name.partition(".")[0] == ACTUATOR and ACTUATOR not in joints:
            return [self._resolve_actuator(entry, joints)]
        units = [interface.units for interface in self.names.interfaces.values()]

        def convert(text: str) -> float:  # a number in SI units keeps the order of values
            return read_si_number(text, f"{self.label}: {text}", units)

        distribution = parse_distribution(entry, self.label, convert)
        if of is None:
            subjects = self._find_subjects(self.name, distribution)
            return [self._make_factor(s.name, [s], entry) for s in subjects]
        unique = {s.name: s for pattern in of for s in self._find_subjects(pattern, distribution)}
        return [self._make_factor(self.name, list(unique.values()), entry)]

    def _resolve_actuator(self, entry: Any, joints: Sequence[str]) -> Factor:
        """Return the factor of `actuator.JOINT` or `actuator.JOINT.TABLE.ENTRY`.

        JOINT may be left out only if the system has one joint.
        """
        parts = self.name.split(".")[1:]
        if parts and parts[0] in joints:
            joint, *path = parts
        elif len(joints) == 1 and len(parts) in (0, 2):
            joint, path = joints[0], parts
        else:
            joint, path = "", []
        if not joint or len(path) not in (0, 2):
            raise CommandError(
                f"{self.label} is not an actuator or an entry of its data sheet; write actuator.JOINT or "
                "actuator.JOINT.TABLE.ENTRY.",
                name=self.name,
            )
        if not path:
            return Factor(self.name, [Target(joint, ACTUATOR)], parse_distribution(entry, self.label))
        units = set[str]()

        # the data sheet reads the entry later, with its own rules for units such as "Ohm line to line"
        def convert(text: str) -> float:
            number, unit = split_quantity(text, self.label)
            units.add(unit)
            return number

        distribution = parse_distribution(entry, self.label, convert)
        if len(units) > 1:
            raise CommandError(
                f"{self.label} has values in different units: {join_names(sorted(units))}; use one."
            )
        if distribution.relative:
            raise CommandError(
                f"{self.label} is relative; entries of data sheets need values with their units."
            )
        unit = "".join(units)
        return Factor(self.name, [Target(".".join([joint, *path]), SHEET, unit=unit)], distribution, unit)

    def _find_subjects(self, name: str, distribution: Distribution) -> list[_Subject]:
        """Return the option, component or start value of a name, or the start values of a pattern."""
        options = list_options()
        if name in options:
            if not options[name].can_vary:
                raise CommandError(
                    f"{self.label}: the option {name} cannot vary between variants; set it for all."
                )
            unit = options[name].unit
            return [_Subject(name, OPTION, parse_unit_name(unit, self.label) if unit else None, not unit)]
        components = [c.name for c in self.system.components]
        if name in components:
            return [_Subject(name, FMU, takes_text=True)]
        if "." not in name and not self.names.match(name):
            hint = suggest_names(name, [*options, *components], "write it as component.variable.")
            raise CommandError(f"{self.label} is not an option, component or start value; {hint}", name=name)
        # a product with a factor is seldom whole
        is_integer = not distribution.relative and all(isinstance(end, int) for end in distribution.ends)
        types = ("Real", "Integer") if is_integer else ("Real",)
        variables = self.names.resolve(name, self.label, "varied", lambda v: v.variable.type in types)
        if variables[0].is_structural:
            raise CommandError(
                f"{self.label} is a structural parameter and cannot be varied: all variants have arrays of "
                "the same sizes. Set it in the scenario or with --set.",
                name=name,
            )
        texts = ("String", "Enumeration")
        return [
            _Subject(v.full_name, START, v.unit, v.variable.type in texts, v.start_number) for v in variables
        ]

    def _make_factor(self, name: str, subjects: Sequence[_Subject], entry: Any) -> Factor:
        """Return a factor with its distribution in the common unit of the subjects."""
        units = {subject.unit for subject in subjects}

        def convert(text: str) -> Any:
            label = f"{self.label}: {text}"
            if len(units) > 1:
                raise CommandError(f"{label} is for variables with different units; vary each separately.")
            return read_quantity(text, label, next(iter(units)))

        takes_text = any(subject.takes_text for subject in subjects)
        distribution = parse_distribution(entry, self.label, None if takes_text else convert)
        relative = distribution.relative
        for subject in subjects:
            if relative and not subject.number:
                reason = "has no number in" if subject.number is None else "is 0 in"
                remedy = "" if subject.number is None else "; give it values"
                raise CommandError(
                    f"{self.label} is relative, but {subject.name} {reason} the scenario{remedy}."
                )
        targets = [Target(s.name, s.kind, s.number if relative else None) for s in subjects]
        if len(targets) > 1 and any(t.kind != START for t in targets):
            raise CommandError(f"{self.label} varies several names at once; only start values can do that.")
        unit = units.pop() if len(units) == 1 and not (relative and len(targets) > 1) else None
        return Factor(name, targets, distribution, "" if unit is None else str(unit))
