"""A system of components that are FMUs, and the connections between them."""

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
    """What the FMU calls a variable that start values and results have another name or unit for.

    `transformation` makes the FMU's value of the one here, `unit` is the one here.
    """

    variable: str
    transformation: LinearTransformation = IDENTITY
    unit: SiUnit | None = None


@dataclass(frozen=True)
class Component:
    """One FMU instance in a system, and the start values it gets.

    `name` is a path with dots, such as joint.component. `model` is the name of one of our FMUs or a
    block of `fmublock`, which is built as one; or `fmu` is a file. `parameters` maps variable names to
    values; enumerations by number or by the literal's name. `aliases` has those variables that the FMU
    knows by another name or unit. `samples` says that it computes at communication points, as a digital
    controller does: what it holds between them is no error of the coupling.
    """

    name: str
    model: str | type = ""
    parameters: Mapping[str, Value] = field(default_factory=dict)
    fmu: Path | None = None
    aliases: Mapping[str, Alias] = field(default_factory=dict)
    samples: bool = False

    @property
    def branch(self) -> str:
        """What stands before the first dot of the name."""
        return self.name.partition(".")[0]

    def alias(self, name: str) -> Alias:
        """What the FMU calls a variable that has a start value here."""
        return self.aliases.get(name) or Alias(name)


@dataclass(frozen=True)
class Replacement:
    """The FMU to use in the place of a component, and a file (SSM) that maps our names to its names."""

    fmu: Path
    mapping: Path | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "fmu", Path(self.fmu))
        if self.mapping is not None:
            object.__setattr__(self, "mapping", Path(self.mapping))


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
    """Components in the order in which they are declared, and their connections; power bonds by name."""

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
        """A system from names: what each component is, and which output drives which input.

        A component is an FMU file, a block of `fmublock`, or the name of one of our models; a connection is
        written as "lift.plant.x_L -> lift.observer.y". `set` has start values by full name. Raises
        CommandError for names that are not there; units and types are checked when it is prepared.
        """
        made = cls(tuple(_component(name, what) for name, what in components.items()), ())
        wired = replace(made, connections=tuple(made._connection(text) for text in connections))
        return wired.with_parameters(set or {})

    @property
    def branches(self) -> list[str]:
        """What stands before the first dot of the components' names, in order."""
        return list(dict.fromkeys(c.branch for c in self.components))

    def __add__(self, other: "System") -> "System":
        """Both systems side by side."""
        bonds = {**self.bonds, **other.bonds}
        return System(self.components + other.components, self.connections + other.connections, bonds)

    def component(self, name: str) -> Component:
        """The component of this name; CommandError names the choices if there is none."""
        if name not in self._by_name:
            raise self._unknown(name)
        return self._by_name[name]

    def into(self, name: str) -> Sequence[Connection]:
        """The connections that drive inputs of a component, in order."""
        return self._into.get(name, ())

    def out_of(self, name: str) -> Sequence[Connection]:
        """The connections that read outputs of a component, in order."""
        return self._out_of.get(name, ())

    def split(self, path: str) -> tuple[Component, str]:
        """component.variable as component and variable name, both of which may hold dots."""
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
        """The system with further start values, by full name."""
        changed: dict[str, dict[str, Value]] = {}
        for path, value in values.items():
            component, variable = self.split(path)
            changed.setdefault(component.name, dict(component.parameters))[variable] = value
        components = (
            replace(c, parameters=changed[c.name]) if c.name in changed else c for c in self.components
        )
        return replace(self, components=tuple(components)) if changed else self

    def with_component(self, changed: Component) -> "System":
        """The system with the component of this name changed."""
        self.component(changed.name)
        return replace(
            self, components=tuple(changed if c.name == changed.name else c for c in self.components)
        )

    def with_connections(self, *connections: str) -> "System":
        """The system with further connections, written as in `of`; what drove their inputs goes."""
        added = {x.ends[1]: x for x in map(self._connection, connections)}
        kept = (x for x in self.connections if x.ends[1] not in added)
        return replace(self, connections=(*kept, *added.values()))

    def without_connections(self, *inputs: str) -> "System":
        """The system with nothing that drives these inputs, given by full name, so that they can be set.

        Raises CommandError for an input that nothing drives.
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
    """A component that is a file, a block, or one of our models by its name."""
    if isinstance(what, type):
        return Component(name, model=what)
    if not isinstance(what, (str, Path)):
        raise CommandError(f"{name} is {what!r}; it must be an FMU file, a class of block or a model's name.")
    if isinstance(what, Path) or what.lower().endswith(".fmu"):
        return Component(name, fmu=Path(what))
    return Component(name, model=what)
