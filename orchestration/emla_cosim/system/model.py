"""A system of components that are FMUs, and the connections between them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from ..errors import CommandError, listed
from ..units import IDENTITY, LinearTransformation, Unit

Value = float | int | bool | str


@dataclass(frozen=True)
class Alias:
    """What the FMU calls a variable that start values and results have another name or unit for.

    `transformation` makes the FMU's value of the one here, `unit` is the one here.
    """

    variable: str
    transformation: LinearTransformation = IDENTITY
    unit: Unit | None = None


@dataclass(frozen=True)
class Component:
    """One FMU instance in a system, and the start values it gets.

    `name` is a path with dots, such as joint.component. `model` is the name of one of our FMUs,
    or `fmu` a file. `parameters` maps variable names to values; enumerations by number or by the
    literal's name. `aliases` has those variables that the FMU knows by another name or unit.
    """

    name: str
    model: str = ""
    parameters: Mapping[str, Value] = field(default_factory=dict)
    fmu: Path | None = None
    aliases: Mapping[str, Alias] = field(default_factory=dict)

    def alias(self, name: str) -> Alias:
        """What the FMU calls a variable that has a start value here."""
        return self.aliases.get(name) or Alias(name)


@dataclass(frozen=True)
class Connection:
    """An output of one component that drives an input of another, by the names of their FMUs.

    Without a `transformation`, values are converted from the output's unit to the input's; with
    one, it makes the input of the output whatever their units.
    """

    source: str
    output: str
    target: str
    input: str
    transformation: LinearTransformation | None = None

    @property
    def ends(self) -> tuple[tuple[str, str], tuple[str, str]]:
        """Component and variable of both ends."""
        return (self.source, self.output), (self.target, self.input)

    def __str__(self) -> str:
        return f"{self.source}.{self.output} -> {self.target}.{self.input}"


@dataclass(frozen=True)
class System:
    """Components in the order in which they are declared, and their connections."""

    components: tuple[Component, ...]
    connections: tuple[Connection, ...]

    @property
    def joints(self) -> list[str]:
        """Names of the joints, in order: what stands before the first dot of a component's name."""
        return list(dict.fromkeys(c.name.split(".")[0] for c in self.components))

    def __add__(self, other: "System") -> "System":
        """Both systems side by side."""
        return System(self.components + other.components, self.connections + other.connections)

    def component(self, name: str) -> Component:
        """The component of this name; CommandError names the choices if there is none."""
        for component in self.components:
            if component.name == name:
                return component
        raise CommandError(self._unknown(name))

    def split(self, path: str) -> tuple[Component, str]:
        """joint.component.variable as component and variable name (which may hold dots itself)."""
        inside = [c for c in self.components if path.startswith(f"{c.name}.") and path != f"{c.name}."]
        if not inside:
            names = path.split(".")
            if len(names) < 3 or not names[-1]:
                raise CommandError(f"'{path}' is not a variable; write joint.component.variable.")
            raise CommandError(self._unknown(".".join(names[:2])))
        component = max(inside, key=lambda c: len(c.name))
        return component, path.removeprefix(f"{component.name}.")

    def with_parameters(self, values: Mapping[str, Value]) -> "System":
        """The system with further start values, given as joint.component.variable."""
        changed = {c.name: dict(c.parameters) for c in self.components}
        for path, value in values.items():
            component, variable = self.split(path)
            changed[component.name][variable] = value
        return replace(
            self, components=tuple(replace(c, parameters=changed[c.name]) for c in self.components)
        )

    def with_component(self, changed: Component) -> "System":
        """The system with the component of this name changed."""
        self.component(changed.name)
        return replace(
            self, components=tuple(changed if c.name == changed.name else c for c in self.components)
        )

    def _unknown(self, name: str) -> str:
        joint = name.split(".")[0]
        if joint not in self.joints:
            return f"there is no joint '{joint}'; the system has {listed(self.joints)}."
        inside = [c.name for c in self.components if c.name.startswith(f"{joint}.")] or [joint]
        return f"there is no component '{name}'; the joint has {listed(inside)}."
