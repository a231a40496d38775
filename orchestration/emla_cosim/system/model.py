"""A system of components that are FMUs, and the connections between them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from ..errors import CommandError, listed

Value = float | int | bool | str


@dataclass(frozen=True)
class Component:
    """One FMU instance in a system, and the start values it gets.

    `name` is joint.component, `model` the name of one of our FMUs; `fmu` is a file to use
    instead. `parameters` maps FMI variable names to values; enumerations by number or by the
    literal's name.
    """

    name: str
    model: str
    parameters: Mapping[str, Value] = field(default_factory=dict)
    fmu: Path | None = None


@dataclass(frozen=True)
class Connection:
    """An output of one component that drives an input of another."""

    source: str
    output: str
    target: str
    input: str

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
        parts = path.split(".", 2)
        if len(parts) < 3 or not parts[2]:
            raise CommandError(f"'{path}' is not a variable; write joint.component.variable.")
        return self.component(".".join(parts[:2])), parts[2]

    def with_parameters(self, values: Mapping[str, Value]) -> "System":
        """The system with further start values, given as joint.component.variable."""
        changed = {c.name: dict(c.parameters) for c in self.components}
        for path, value in values.items():
            component, variable = self.split(path)
            changed[component.name][variable] = value
        return replace(
            self, components=tuple(replace(c, parameters=changed[c.name]) for c in self.components)
        )

    def with_fmus(self, files: Mapping[str, Path]) -> "System":
        """The system with some components replaced by these FMU files."""
        for name in files:
            self.component(name)
        return replace(
            self, components=tuple(replace(c, fmu=files.get(c.name, c.fmu)) for c in self.components)
        )

    def _unknown(self, name: str) -> str:
        joint = name.split(".")[0]
        if joint not in self.joints:
            return f"there is no joint '{joint}'; the system has {listed(self.joints)}."
        inside = [c.name for c in self.components if c.name.startswith(f"{joint}.")]
        return f"there is no component '{name}'; the joint has {listed(inside)}."
