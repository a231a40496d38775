"""The resolver of names: which variables of a system a text names, and whether they can be set."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import count, takewhile

from fmpy.model_description import ModelVariable

from ..base.arrays import SignalType
from ..base.errors import CommandError, join_names, suggest_names
from ..base.quantities import has_unit, read_quantity
from ..base.units import SiUnit
from ..base.wording import find_names, has_wildcard, is_pattern
from ..fmu.interface import Interface
from ..fmu.variables import explain_fixed, find_variable, suggest_settable
from .model import Component, System, Value

_MAX_LISTED = 3
"""The number of variables that a message lists."""


@dataclass(frozen=True)
class NamedVariable:
    """A variable of a component.

    Attributes:
        component: The component.
        name: The name in the system, which an alias may define.
        interface: The model description of the FMU.
    """

    component: Component
    name: str
    interface: Interface

    @property
    def full_name(self) -> str:
        """The name with that of the component."""
        return f"{self.component.name}.{self.name}"

    @property
    def fmu_name(self) -> str:
        """The name in the FMU."""
        return self.component.alias(self.name).variable

    @property
    def end(self) -> tuple[str, str]:
        """The component, and the name in the FMU, as in connections."""
        return self.component.name, self.fmu_name

    @property
    def variable(self) -> ModelVariable:
        """The variable of the model description."""
        return self.interface.variables[self.fmu_name]

    @property
    def unit(self) -> SiUnit | None:
        """The unit of start values and results; None without one."""
        alias = self.component.aliases.get(self.name)
        return self.interface.unit(self.name) if alias is None else alias.unit

    @property
    def column_type(self) -> SignalType:
        """The type in tables."""
        return self.interface.column_type(self.fmu_name)

    @property
    def is_discrete(self) -> bool:
        """Whether it holds its value between events."""
        return self.interface.is_discrete(self.fmu_name)

    @property
    def is_structural(self) -> bool:
        """Whether it is a structural parameter."""
        return self.interface.is_structural(self.fmu_name)

    @property
    def start_number(self) -> float | None:
        """The start value in the system, in `unit`; None if it is not a number."""
        value = self.component.parameters.get(self.name)
        try:
            if value is not None:
                return float(value)
            start = self.variable.start
            to_system = self.component.alias(self.name).transformation.inverse()
            return None if start is None else to_system(float(start))
        except ValueError:
            return None

    def convert(self, value: Value) -> Value:
        """Return a value as a number in `unit` if it is a text with a unit, otherwise unchanged.

        Raises:
            CommandError: The unit does not fit the variable.
        """
        if not (isinstance(value, str) and has_unit(value)) or self.variable.type != "Real":
            return value  # a text, or an error that is raised when it is set
        return read_quantity(value, f"{self.full_name} = {value}", self.unit)


class Names:
    """The names of all variables of a system.

    Variables of the main component, or of the only one, need no component's name.

    Args:
        system: The system.
        interfaces: The model descriptions by component.
        replacements: The model descriptions of FMUs that will replace components, by component. Their
            variables can be set, too.
    """

    def __init__(
        self,
        system: System,
        interfaces: Mapping[str, Interface],
        replacements: Mapping[str, Interface] | None = None,
    ) -> None:
        self._system, self.interfaces, self._replacements = system, interfaces, replacements or {}
        self._drivers = {x.ends[1]: x.ends[0] for x in system.connections}

    def find(self, text: str) -> NamedVariable:
        """Return the variable of a name.

        Raises:
            CommandError: It does not exist, or the name of its component is missing.
        """
        try:
            component, name = self._system.split(text)
        except CommandError as error:
            if full := [n for n in self.all if n.endswith(f".{text}")][:_MAX_LISTED]:
                raise CommandError(
                    f"'{text}' is not a full name; write {' or '.join(full)}.", name=text
                ) from error
            raise
        interface, fmu_name = self.interfaces[component.name], component.alias(name).variable
        replacement = self._replacements.get(component.name)
        is_settable = fmu_name in interface.variables and interface.is_settable(fmu_name)
        # an FMU that replaces a component may have further variables
        if replacement is not None and not is_settable and name in replacement.variables:
            return NamedVariable(component, name, replacement)
        if fmu_name not in interface.variables:
            find_variable(component.name, _map_variables(component, interface), name)
        return NamedVariable(component, name, interface)

    def get(self, text: str) -> NamedVariable | None:
        """Return the variable of a name; None if there is none."""
        with suppress(CommandError):
            component, name = self._system.split(text)
            variable = NamedVariable(component, name, self.interfaces[component.name])
            return variable if variable.fmu_name in variable.interface.variables else None
        return None

    def find_elements(self, text: str) -> list[NamedVariable]:
        """Return the variable of a name, or the elements `[1]`, `[2]` of an array; none for other texts."""
        for name in (text, f"{self._system.main_name}.{text}"):
            if name in self.all:
                return [self.all[name]]
            elements = takewhile(self.all.__contains__, (f"{name}[{i}]" for i in count(1)))
            if variables := [self.all[element] for element in elements]:
                return variables
        return []

    def match(self, text: str) -> list[NamedVariable]:
        """Return the variable of a name, or those that match a pattern; none if nothing matches."""
        if text in self.all:
            return [self.all[text]]
        return [self.all[n] for n in find_names(text, self.all, self._system.main_name)]

    def is_structural(self, text: str) -> bool:
        """Return whether a text is the name of a structural parameter."""
        return any(v.is_structural for v in self.find_elements(text))

    def explain_fixed(self, variable: NamedVariable) -> str | None:
        """Return why a variable accepts no start value, such as `it is driven by a.y`; None if it does."""
        if (driver := self._drivers.get(variable.end)) is not None:
            return f"it is driven by {'.'.join(driver)}"
        return explain_fixed(variable.interface, variable.fmu_name)

    def is_free(self, variable: NamedVariable) -> bool:
        """Return whether patterns include a variable: it accepts a start value, and is not structural."""
        return not variable.is_structural and self.explain_fixed(variable) is None

    def resolve(
        self,
        text: str,
        subject: str = "",
        action: str = "set",
        is_suitable: Callable[[NamedVariable], bool] = lambda _: True,
    ) -> list[NamedVariable]:
        """Return the variable of a name, or those that match a pattern, to give them start values.

        A pattern matches the variables that are free, and suitable.

        Args:
            text: The name or pattern.
            subject: What error messages call a single variable. Default: its full name.
            action: What cannot be done with a variable that accepts no start value.
            is_suitable: Returns whether a variable is among those that a pattern searches.

        Raises:
            CommandError: There is no such variable, or it accepts no start value.
        """
        # the brackets of `x[1]` are also those of a pattern
        is_name = not is_pattern(text) or text in self.all
        matching = [] if is_name else self.match(text)
        if matching or (has_wildcard(text) and not is_name):
            free = [v for v in matching if self.is_free(v) and is_suitable(v)]
            if not free:
                raise self._make_no_match_error(text, matching)
            return free
        variable = self.find(text)
        if (reason := self.explain_fixed(variable)) is not None:
            suggestion = "."
            if variable.end not in self._drivers:
                suggestion = suggest_settable(variable.component.name, variable.interface, variable.fmu_name)
            raise CommandError(
                f"{subject or variable.full_name} cannot be {action}: {reason}{suggestion}", name=text
            )
        return [variable]

    def start_values(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Return start values by full name, in the units of the variables.

        A pattern matches all variables that accept a start value. Names take precedence over patterns, and
        later patterns over earlier ones.

        Args:
            values: Start values by name or pattern.

        Raises:
            CommandError: A name does not exist or accepts no start value, or a unit does not fit.
        """
        by_pattern, by_name = dict[str, Value](), dict[str, Value]()
        for text, value in values.items():
            variables = self.resolve(text)
            is_name = text in (variables[0].full_name, variables[0].name)
            values_of_kind = by_name if is_name else by_pattern
            values_of_kind |= {v.full_name: v.convert(value) for v in variables}
        return by_pattern | by_name

    def with_converted_values(self) -> System:
        """Return the system with its start values as numbers in the units of their variables.

        Raises:
            CommandError: A unit does not fit the variable, or the variable does not exist.
        """
        texts = [
            (self.find(f"{c.name}.{name}"), value)
            for c in self._system.components
            for name, value in c.parameters.items()
            if has_unit(value)
        ]
        return self._system.with_parameters({v.full_name: v.convert(value) for v, value in texts})

    @cached_property
    def all(self) -> dict[str, NamedVariable]:
        """All variables by full name, in the order of the system."""
        return {
            f"{c.name}.{name}": NamedVariable(c, name, self.interfaces[c.name])
            for c in self._system.components
            for name in _map_variables(c, self.interfaces[c.name])
        }

    def _make_no_match_error(self, pattern: str, matching: list[NamedVariable]) -> CommandError:
        """Return the error for a pattern: why its matches cannot be set, or what to write if it has none."""
        reasons = {v.full_name: reason for v in matching if (reason := self.explain_fixed(v)) is not None}
        if reasons:
            hidden_count = len(reasons) - _MAX_LISTED
            listed = [*list(reasons)[:_MAX_LISTED], *([f"{hidden_count} more"] if hidden_count > 0 else [])]
            first = next(iter(reasons.values()))
            why = first if len(set(reasons.values())) == 1 else "they are computed or driven"
            return CommandError(
                f"'{pattern}' matches {join_names(listed)}, which cannot be set: {why}.", name=pattern
            )
        stem = pattern.replace("*", "").replace("?", "").strip(".")
        count = stem.count(".") + 1
        words = [name.split(".") for name, v in self.all.items() if self.is_free(v)]
        parts = {".".join(w[i : i + count]): None for w in words for i in range(len(w) - count + 1)}
        suggestion = suggest_names(stem, parts, "* matches any text, ? one character.")
        return CommandError(f"no variable that can be set matches '{pattern}'; {suggestion}", name=pattern)


def _map_variables(component: Component, interface: Interface) -> dict[str, ModelVariable]:
    """Return the variables of a component by their names in the system, in the order of the FMU."""
    names = {fmu_name: name for fmu_name, (name, _) in component.by_fmu_name.items()}
    return {names.get(fmu_name, fmu_name): variable for fmu_name, variable in interface.variables.items()}
