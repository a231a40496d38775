"""What varies, with names instead of patterns, and what that means for a run."""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any

from ..errors import CommandError
from ..fmu.interface import Interface
from ..fmu.variables import find_variable
from ..options import table
from ..simulation import OF_THE_COMMAND
from ..system.model import Component, System, Value
from ..system.resolution import refuse_driven
from ..values import converted
from .distributions import Distribution, distribution
from .reserved import RESERVED
from .targets import FMU, OPTION, START, Target, options_of

_FIXED = (*OF_THE_COMMAND, "set", "mapping", "isolate", "fmus", "require", "compiled", "signals")
"""Options that are the same for all variants."""


@dataclass(frozen=True)
class Factor:
    """One thing that varies: its name, where its value goes, and how it is distributed.

    What the table of variants has of it is in `unit`: the value itself, or, where several targets have
    values of their own, what multiplies these.
    """

    name: str
    targets: Sequence[Target]
    distribution: Distribution
    unit: str = ""

    def value(self, drawn: Value | None) -> Value | None:
        """The value that the table of variants has, of one that was drawn; None for none."""
        alone = self.targets[0].nominal if len(self.targets) == 1 else None
        return drawn if drawn is None or alone is None else alone * float(drawn)

    def options(self, value: Value | None) -> dict[str, Any]:
        """The options that give a run a value of the table; None gives none."""
        return options_of(self.targets, value)


def factors(
    vary: Mapping[str, Any], system: System, interfaces: Mapping[str, Interface], where: str
) -> list[Factor]:
    """What varies in this system; a pattern makes a factor of each start value that fits.

    Raises CommandError for names that are not there, are driven or would be columns twice, and for
    values that are no distribution.
    """
    found = list[Factor]()
    taken = dict[str, str]()
    for name, given in vary.items():
        label = f"'{name}' of {where}"
        for factor in _factors(str(name), given, system, interfaces, label):
            if factor.name in RESERVED:
                raise CommandError(f"{label} needs another name: every table of variants has this column.")
            for target in factor.targets:
                if (other := taken.setdefault(target.name, factor.name)) != factor.name:
                    raise CommandError(
                        f"{where} varies {target.name} twice: as {other} and as {factor.name}."
                    )
            found.append(factor)
    if twice := {f.name for f in found if [g.name for g in found].count(f.name) > 1}:
        raise CommandError(f"{where} has two factors '{min(twice)}'; give one another name.")
    return found


def _factors(
    name: str, given: Any, system: System, interfaces: Mapping[str, Interface], label: str
) -> list[Factor]:
    of = [name]
    if isinstance(given, Mapping) and "of" in given:
        given = dict(given)
        of = converted(given.pop("of"), Sequence[str], f"'of' in {label}")
        if not of:
            raise CommandError(f"'of' in {label} is empty; it must be a list of names.")
        targets = [t for pattern in of for t in _targets(pattern, system, interfaces, label)]
        return [_factor(name, list(dict.fromkeys(targets)), given, system, interfaces, label)]
    targets = _targets(name, system, interfaces, label)
    return [_factor(target, [target], given, system, interfaces, label) for target in targets]


def _factor(
    name: str,
    targets: Sequence[str],
    given: Any,
    system: System,
    interfaces: Mapping[str, Interface],
    label: str,
) -> Factor:
    distributed = distribution(given, label)
    nominal = dict[str, float]()
    if distributed.relative:
        nominal = {target: _nominal(target, system, interfaces, label) for target in targets}
    kinds = [Target(t, _kind(t, system), nominal.get(t)) for t in targets]
    if len(kinds) > 1 and any(t.kind != START for t in kinds):
        raise CommandError(f"{label} varies several things at once; that is for start values.")
    units = {_unit(target, system, interfaces) for target in targets}
    own = len(units) == 1 and not (nominal and len(targets) > 1)
    return Factor(name, kinds, distributed, units.pop() if own else "")


def _kind(target: str, system: System) -> str:
    if target in table():
        return OPTION
    return FMU if any(c.name == target for c in system.components) else START


def _targets(name: str, system: System, interfaces: Mapping[str, Interface], label: str) -> list[str]:
    """The options, components or start values that a name or a pattern means."""
    known = table()
    if name in known:
        if name in _FIXED or not known[name].about.in_file:
            raise CommandError(f"{label}: the option {name} is the same for all variants.")
        return [name]
    if any(c.name == name for c in system.components):
        return [name]
    if any(letter in name for letter in "*?[") and (found := _matching(name, system, interfaces)):
        return found
    if "." not in name:
        everything = [*known, *(c.name for c in system.components)]
        near = difflib.get_close_matches(name, everything, n=2, cutoff=0.6)
        meant = f"did you mean {' or '.join(near)}?" if near else "write a start value as component.variable."
        raise CommandError(f"{label} is no start value, no component and no option; {meant}", name=name)
    component, variable = system.split(name)
    interface, own = interfaces[component.name], component.alias(variable).variable
    find_variable(component.name, interface.variables, own)
    if not interface.settable(own):
        near = [n for n in interface.variables if n.endswith(f".{own}") and interface.settable(n)]
        meant = f"; did you mean {component.name}.{near[0]}?" if near else "."
        raise CommandError(f"{label} is computed by the FMU and cannot be varied{meant}", name=name)
    refuse_driven(_with(component, own), system.connections)
    return [name]


def _matching(pattern: str, system: System, interfaces: Mapping[str, Interface]) -> list[str]:
    """Real and Integer start values that fit."""
    driven = {x.ends[1] for x in system.connections}
    found = list[str]()
    for component in system.components:
        named = {a.variable: n for n, a in component.aliases.items()}
        interface = interfaces[component.name]
        for own, variable in interface.variables.items():
            name = f"{component.name}.{named.get(own, own)}"
            free = interface.settable(own) and (component.name, own) not in driven
            if free and variable.type in ("Real", "Integer") and fnmatchcase(name, pattern):
                found.append(name)
    return found


def _with(component: Component, variable: str) -> Component:
    return replace(component, parameters={variable: 0.0})


def _nominal(target: str, system: System, interfaces: Mapping[str, Interface], label: str) -> float:
    """The start value that the scenario has; CommandError where there is no number to multiply."""
    problem = f"{label} is relative, but {target} has no number in the scenario that it could multiply."
    if _kind(target, system) != START:
        raise CommandError(problem)
    component, variable = system.split(target)
    value = component.parameters.get(variable)
    if value is None:
        alias = component.alias(variable)
        start = interfaces[component.name].variables[alias.variable].start
        if start is None:
            raise CommandError(problem)
        value = alias.transformation.inverse()(float(start))
    try:
        number = float(value)
    except ValueError as error:
        raise CommandError(problem) from error
    if number == 0.0:
        raise CommandError(f"{label} is relative, but {target} is 0 in the scenario; give it values.")
    return number


def _unit(target: str, system: System, interfaces: Mapping[str, Interface]) -> str:
    if (kind := _kind(target, system)) != START:
        return table()[target].about.unit if kind == OPTION else ""
    component, variable = system.split(target)
    alias = component.aliases.get(variable)
    unit = alias.unit if alias is not None else interfaces[component.name].unit(variable)
    return str(unit) if unit is not None else ""
