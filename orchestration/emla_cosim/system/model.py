"""A system of components, which are FMUs, and of the connections between them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from ..base.errors import CommandError, join_names
from ..base.units import IDENTITY, LinearTransformation, SiUnit
from .bond import Bond

Value = float | int | bool | str


@dataclass(frozen=True)
class Alias:
    """The FMU's name and unit of a variable, if start values and results use another name or unit.

    Attributes:
        variable: The name in the FMU.
        transformation: Converts a value in `unit` to the FMU's value.
        unit: The unit of start values and results.
    """

    variable: str
    transformation: LinearTransformation = IDENTITY
    unit: SiUnit | None = None


@dataclass(frozen=True)
class Component:
    """One FMU instance in a system, and its start values.

    Attributes:
        name: A path with dots, such as joint.component.
        model: The name of one of our models, or a block of `fmublock` to build.
        parameters: Start values by variable name; enumerations by number or by the name of the literal.
        fmu: The FMU file, instead of a model.
        aliases: The variables that have another name or unit in the FMU.
        samples: Whether it computes at communication points, as a digital controller does. Values held
            between them do not count as coupling errors.
    """

    name: str
    model: str | type = ""
    parameters: Mapping[str, Value] = field(default_factory=dict)
    fmu: Path | None = None
    aliases: Mapping[str, Alias] = field(default_factory=dict)
    samples: bool = False

    @property
    def branch(self) -> str:
        """Return the part of the name before the first dot."""
        return self.name.partition(".")[0]

    def alias(self, name: str) -> Alias:
        """Return the FMU's name and unit of a variable."""
        return self.aliases.get(name) or Alias(name)


@dataclass(frozen=True)
class Replacement:
    """An FMU that replaces a component, and an SSM file that maps our names to its names."""

    fmu: Path
    mapping: Path | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "fmu", Path(self.fmu))
        if self.mapping is not None:
            object.__setattr__(self, "mapping", Path(self.mapping))


@dataclass(frozen=True)
class Connection:
    """An output of one component that drives an input of another one, by the names in their FMUs.

    Without a `transformation`, values are converted from the output's unit to the input's unit. With one, it
    computes the input from the output, and units are ignored.
    """

    source: str
    output: str
    target: str
    input: str
    transformation: LinearTransformation | None = None

    @property
    def ends(self) -> tuple[tuple[str, str], tuple[str, str]]:
        """Return component and variable of both ends."""
        return (self.source, self.output), (self.target, self.input)

    def __str__(self) -> str:
        return f"{self.source}.{self.output} -> {self.target}.{self.input}"


@dataclass(frozen=True)
class System:
    """Components in the order of their declaration, their connections, and power bonds by name."""

    components: tuple[Component, ...]
    connections: tuple[Connection, ...]
    bonds: Mapping[str, Bond] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        components: Mapping[str, str | Path | type],
        connections: Iterable[str] = (),
        set: Mapping[str, Value] | None = None,
    ) -> "System":
        """Return a system from names.

        Units and types are checked when the system is prepared.

        Args:
            components: An FMU file, a block of `fmublock`, or the name of one of our models, by component
                name.
            connections: Connections such as "lift.plant.x_L -> lift.observer.y".
            set: Start values by full name.

        Raises:
            CommandError: If a name does not exist.
        """
        made = cls(tuple(_component(name, what) for name, what in components.items()), ())
        wired = replace(made, connections=tuple(made._connection(text) for text in connections))
        return wired.with_parameters(set or {})

    @property
    def branches(self) -> list[str]:
        """Return the parts of component names before the first dot, in order."""
        return list(dict.fromkeys(c.branch for c in self.components))

    def __add__(self, other: "System") -> "System":
        """Return a system with the components, connections and bonds of both."""
        bonds = {**self.bonds, **other.bonds}
        return System(self.components + other.components, self.connections + other.connections, bonds)

    def component(self, name: str) -> Component:
        """Return a component by its name.

        Raises:
            CommandError: If it does not exist.
        """
        if name not in self._by_name:
            raise self._unknown(name)
        return self._by_name[name]

    def into(self, name: str) -> Sequence[Connection]:
        """Return the connections that drive inputs of a component, in order."""
        return self._into.get(name, ())

    def out_of(self, name: str) -> Sequence[Connection]:
        """Return the connections that read outputs of a component, in order."""
        return self._out_of.get(name, ())

    def split(self, path: str) -> tuple[Component, str]:
        """Split `component.variable` into component and variable name; both names may have dots.

        Raises:
            CommandError: If the component does not exist.
        """
        path = str(path)
        dots = (i for i in reversed(range(len(path) - 1)) if path[i] == ".")
        found = next((i for i in dots if path[:i] in self._by_name), None)  # the longest name wins
        if found is None:
            longest = max(c.name.count(".") for c in self.components) + 1 if self.components else 1
            names = path.split(".")
            if len(names) <= longest or not names[-1]:
                example = f"{self.components[0].name}.VARIABLE" if self.components else "COMPONENT.VARIABLE"
                raise CommandError(f"'{path}' is not a variable; write it as {example}.", name=path)
            raise self._unknown(".".join(names[:longest]))
        return self._by_name[path[:found]], path[found + 1 :]

    def with_parameters(self, values: Mapping[str, Value]) -> "System":
        """Return the system with further start values by full name.

        Raises:
            CommandError: If a component does not exist.
        """
        changed: dict[str, dict[str, Value]] = {}
        for path, value in values.items():
            component, variable = self.split(path)
            changed.setdefault(component.name, dict(component.parameters))[variable] = value
        components = (
            replace(c, parameters=changed[c.name]) if c.name in changed else c for c in self.components
        )
        return replace(self, components=tuple(components)) if changed else self

    def with_component(self, changed: Component) -> "System":
        """Return the system with the component of the same name replaced by `changed`.

        Raises:
            CommandError: If there is no such component.
        """
        self.component(changed.name)
        return replace(
            self, components=tuple(changed if c.name == changed.name else c for c in self.components)
        )

    def with_connections(self, *connections: str) -> "System":
        """Return the system with further connections, which replace those to the same inputs.

        Args:
            *connections: Connections written as in `of`.

        Raises:
            CommandError: If one is invalid.
        """
        added = {x.ends[1]: x for x in map(self._connection, connections)}
        kept = (x for x in self.connections if x.ends[1] not in added)
        return replace(self, connections=(*kept, *added.values()))

    def without_connections(self, *inputs: str) -> "System":
        """Return the system without the connections to these inputs, so that they accept values.

        Args:
            *inputs: Full names of inputs.

        Raises:
            CommandError: If an input is not connected.
        """
        freed = set()
        for name in inputs:
            component, variable = self.split(name)
            freed.add((component.name, variable))
        missing = freed - {x.ends[1] for x in self.connections}
        if missing:
            named = join_names(sorted(".".join(end) for end in missing))
            raise CommandError(f"nothing drives {named}.", names=sorted(missing))
        return replace(self, connections=tuple(x for x in self.connections if x.ends[1] not in freed))

    @cached_property
    def _by_name(self) -> dict[str, Component]:
        return {c.name: c for c in reversed(self.components)}

    @cached_property
    def _into(self) -> dict[str, list[Connection]]:
        return self._connections_by(lambda x: x.target)

    @cached_property
    def _out_of(self) -> dict[str, list[Connection]]:
        return self._connections_by(lambda x: x.source)

    def _connections_by(self, component: Callable[[Connection], str]) -> dict[str, list[Connection]]:
        found: dict[str, list[Connection]] = {}
        for x in self.connections:
            found.setdefault(component(x), []).append(x)
        return found

    def _connection(self, text: str) -> Connection:
        source, arrow, target = (part.strip() for part in str(text).partition("->"))
        if not (source and arrow and target):
            raise CommandError(f"'{text}' is not a connection; write a.output -> b.input.", name=text)
        (source, output), (target, input_) = self.split(source), self.split(target)
        return Connection(source.name, output, target.name, input_)

    def _unknown(self, name: str) -> CommandError:
        branch = name.partition(".")[0]
        inside = [c.name for c in self.components if c.branch == branch]
        known = inside or [c.name for c in self.components] or ["none"]
        more = f", and {len(known) - 8} more" if len(known) > 8 else ""
        return CommandError(
            f"there is no component '{name}'; there are {join_names(known[:8])}{more}.",
            name=name,
            choices=known,
        )


def _component(name: str, what: str | Path | type) -> Component:
    """Return a component from a file, a block, or the name of one of our models."""
    if isinstance(what, type):
        return Component(name, model=what)
    if not isinstance(what, (str, Path)):
        raise CommandError(f"{name} is {what!r}; it must be an FMU file, a block class or a model name.")
    if isinstance(what, Path) or what.lower().endswith(".fmu"):
        return Component(name, fmu=Path(what))
    return Component(name, model=what)
