"""A system of components, which are FMUs, and of the connections between them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from ..base.errors import CommandError, join_names
from ..base.units import IDENTITY, LinearTransformation, SiUnit
from ..base.values import list_elements
from ..base.wording import format_count
from .bond import Bond

Value = float | int | bool | str


class ShortNameError(CommandError):
    """A name is too short to have a component and a variable."""


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
    """One FMU in a system, with its start values.

    Args:
        name: path with dots, such as joint.component.
        model: name of an FMU of this project, or a block of `fmublock`; or leave it out and pass `fmu`.
        parameters: start values by name of the variable; those of enumerations by number or name.
        fmu: path of an FMU.
        aliases: variables that have another name or unit in the FMU.
        samples: whether it computes at communication points only, as a digital controller does. Holding its
            values between them does not count as a coupling error.
        kind: as what its FMU runs: `cs` (co-simulation) or `me` (Model Exchange). Default: co-simulation if
            the FMU has that.
        event_mode: whether its FMU uses event mode and early return, if it has them.
        note: message for the user when the system is prepared, or a function that returns it for the system
            with all start values; empty for none.
    """

    name: str
    model: str | type = ""
    parameters: Mapping[str, Value] = field(default_factory=dict)
    fmu: Path | None = None
    aliases: Mapping[str, Alias] = field(default_factory=dict)
    samples: bool = False
    kind: str = ""
    event_mode: bool = True
    note: "str | Callable[[System], str]" = field(default="", compare=False)

    @property
    def branch(self) -> str:
        """Part of the name before the first dot."""
        return self.name.partition(".")[0]

    def alias(self, name: str) -> Alias:
        """Return the alias of a variable; one without conversion if it has the same name in the FMU."""
        return self.aliases.get(name) or Alias(name)

    @property
    def by_fmu_name(self) -> dict[str, tuple[str, Alias]]:
        """Name and alias of each variable with another name or unit in the FMU, by its name there."""
        # with the factor 0, a value of the FMU has no value in the system
        return {a.variable: (n, a) for n, a in self.aliases.items() if a.transformation.factor != 0.0}


@dataclass(frozen=True)
class Replacement:
    """FMU that replaces a component.

    Args:
        fmu: path of the FMU.
        mapping: SSP parameter mapping (.ssm) from the names of the component to those of the FMU.
    """

    fmu: Path
    mapping: Path | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "fmu", Path(self.fmu))
        if self.mapping is not None:
            object.__setattr__(self, "mapping", Path(self.mapping))


@dataclass(frozen=True)
class Connection:
    """Connection from an output to an input.

    Args:
        source: name of the component with the output.
        output: name of the output in its FMU.
        target: name of the component with the input.
        input: name of the input in its FMU.
        transformation: how values are transformed. Default: from the unit of the output to that of the input.
        from_text: whether it was written as a text; its ends may then be vectors.
    """

    source: str
    output: str
    target: str
    input: str
    transformation: LinearTransformation | None = None
    from_text: bool = field(default=False, compare=False)

    @property
    def ends(self) -> tuple[tuple[str, str], tuple[str, str]]:
        """Return component and variable of both ends."""
        return (self.source, self.output), (self.target, self.input)

    def __str__(self) -> str:
        return f"{self.source}.{self.output} -> {self.target}.{self.input}"


@dataclass(frozen=True, repr=False)
class System:
    """Components and their connections. `System.of` makes one from names.

    Args:
        components: components in the order of declaration.
        connections: connections between them.
        bonds: power bonds by name.
        main: component whose variables need no component's name. A system of one component needs no `main`.
        record: further entries of run.json.
    """

    components: tuple[Component, ...]
    connections: tuple[Connection, ...]
    bonds: Mapping[str, Bond] = field(default_factory=dict)
    main: str | None = field(default=None, compare=False)
    record: Mapping[str, Any] = field(default_factory=dict, compare=False)

    def __repr__(self) -> str:
        """Return one line: the numbers of components and connections."""
        return f"<System of {', '.join(count_parts(self))}>"

    def _repr_html_(self) -> str:
        """Return the HTML for notebooks: diagram, components and connections."""
        return render_cell(self)

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
            components: an FMU file, a block of `fmublock` or the name of an FMU of this project, by
                component.
            connections: texts such as "lift.plant.x_L -> lift.observer.y"; vectors and matrices of the same
                shape connect as a whole, such as "mass.x -> link.x".
            set: start values by full name; of vectors and matrices as lists or arrays.

        Raises:
            CommandError: a component does not exist, or a connection cannot be read.

        Examples:
            >>> import emla_cosim as ec
            >>> system = ec.System.of(
            ...     {"reference": "Reference", "load": "Disturbance"},
            ...     ["reference.v_d -> load.v_L"],
            ...     set={"reference.waypoint[2]": 0.1},
            ... )
            >>> ec.load(system, step_size=1e-3, stop_time=0.01).prepare().run().steps
            10
        """
        system = cls(tuple(_make_component(name, content) for name, content in components.items()), ())
        connected = replace(system, connections=tuple(map(system._read_connection, connections)))
        return connected.with_parameters(list_elements(set or {}))

    @property
    def branches(self) -> list[str]:
        """Parts of the component names before the first dot, in order."""
        return list(dict.fromkeys(c.branch for c in self.components))

    def __add__(self, other: "System") -> "System":
        """Return a system with the components and connections of both."""
        bonds = {**self.bonds, **other.bonds}
        return System(
            self.components + other.components, self.connections + other.connections, bonds, self.main
        )

    def component(self, name: str) -> Component:
        """Return the component of this name; raise CommandError if it does not exist."""
        if name not in self._by_name:
            raise self._make_unknown_component_error(name)
        return self._by_name[name]

    def into(self, name: str) -> Sequence[Connection]:
        """Return the connections to inputs of a component, in order."""
        return self._by_ends[1].get(name, ())

    def out_of(self, name: str) -> Sequence[Connection]:
        """Return the connections from outputs of a component, in order."""
        return self._by_ends[0].get(name, ())

    def split(self, path: str) -> tuple[Component, str]:
        """Split a full name into the component and the name of the variable; both may contain dots.

        For the main component, or the only one, the name of the variable is enough.

        Raises:
            CommandError: the component does not exist, or the text has no variable (`ShortNameError`).
        """
        path = str(path)
        dots = (i for i in reversed(range(len(path) - 1)) if path[i] == ".")
        dot = next((i for i in dots if path[:i] in self._by_name), None)  # the longest name wins
        if dot is None and path and (main := self.find_main()) is not None:
            return main, path
        if dot is None:
            longest = max(c.name.count(".") for c in self.components) + 1 if self.components else 1
            names = path.split(".")
            if len(names) <= longest or not names[-1]:
                example = f"{self.components[0].name}.VARIABLE" if self.components else "COMPONENT.VARIABLE"
                raise ShortNameError(f"'{path}' is not a variable; write it as {example}.", name=path)
            raise self._make_unknown_component_error(".".join(names[:longest]))
        return self._by_name[path[:dot]], path[dot + 1 :]

    def find_main(self) -> Component | None:
        """Return the component whose variables need no component's name; None if there is none."""
        if len(self.components) == 1:
            return self.components[0]
        return None if self.main is None else self._by_name.get(self.main)

    @property
    def main_name(self) -> str:
        """Name of the component of `find_main`; empty if there is none."""
        main = self.find_main()
        return "" if main is None else main.name

    def with_main(self) -> "System":
        """Return the system with its only component as `main`, so that this holds when others are added."""
        return replace(self, main=self.components[0].name) if len(self.components) == 1 else self

    def with_parameters(self, values: Mapping[str, Value]) -> "System":
        """Return the system with further start values.

        Args:
            values: start values by full name.

        Raises:
            CommandError: a component does not exist.
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
        """Return the system with another component of the same name."""
        # raises an error for a component that does not exist
        self.component(changed.name)
        return replace(
            self, components=tuple(changed if c.name == changed.name else c for c in self.components)
        )

    def with_connections(self, *connections: str) -> "System":
        """Return the system with further connections, which replace earlier ones of the same inputs.

        Args:
            *connections: texts as for `of`.

        Raises:
            CommandError: a connection cannot be read.
        """
        added = {x.ends[1]: x for x in map(self._read_connection, connections)}
        remaining = (x for x in self.connections if x.ends[1] not in added)
        return replace(self, connections=(*remaining, *added.values()))

    def without_connections(self, *inputs: str) -> "System":
        """Return the system without the connections to these inputs, so that you can set them.

        Args:
            *inputs: full names.

        Raises:
            CommandError: an input has no connection.
        """
        freed = set()
        for name in inputs:
            component, variable = self.split(name)
            freed.add((component.name, variable))
        missing = freed - {x.ends[1] for x in self.connections}
        if missing:
            input_names = join_names(sorted(".".join(end) for end in missing))
            raise CommandError(
                f"nothing drives {input_names}, so no connection can be removed.", names=sorted(missing)
            )
        return replace(self, connections=tuple(x for x in self.connections if x.ends[1] not in freed))

    @cached_property
    def _by_name(self) -> dict[str, Component]:
        # of two with one name the first, until `resolve_system` refuses them
        return {c.name: c for c in reversed(self.components)}

    @cached_property
    def _by_ends(self) -> tuple[dict[str, list[Connection]], dict[str, list[Connection]]]:
        """Connections by their source, and by their target."""
        by_source, by_target = dict[str, list[Connection]](), dict[str, list[Connection]]()
        for x in self.connections:
            by_source.setdefault(x.source, []).append(x)
            by_target.setdefault(x.target, []).append(x)
        return by_source, by_target

    def _read_connection(self, text: str) -> Connection:
        """Return the connection that a text describes; CommandError if a component does not exist."""
        source, arrow, target = (part.strip() for part in str(text).partition("->"))
        if not (source and arrow and target):
            raise CommandError(f"'{text}' is not a connection; write a.output -> b.input.", name=text)
        (source, output), (target, input_) = self.split(source), self.split(target)
        return Connection(source.name, output, target.name, input_, from_text=True)

    def _make_unknown_component_error(self, name: str) -> CommandError:
        """Return the error for a component that does not exist, with those that do."""
        branch = name.partition(".")[0]
        siblings = [c.name for c in self.components if c.branch == branch]
        existing = siblings or [c.name for c in self.components] or ["none"]
        more = f", and {len(existing) - 8} more" if len(existing) > 8 else ""
        return CommandError(
            f"there is no component '{name}'; there are {join_names(existing[:8])}{more}.",
            name=name,
            choices=existing,
        )


def _make_component(name: str, content: str | Path | type) -> Component:
    """Return a component from a file, a block, or the name of one of our models."""
    if isinstance(content, type):
        return Component(name, model=content)
    if not isinstance(content, (str, Path)):
        raise CommandError(f"{name} is {content!r}; it must be an FMU file, a block class or a model name.")
    if isinstance(content, Path) or content.lower().endswith(".fmu"):
        return Component(name, fmu=Path(content))
    return Component(name, model=content)


def count_parts(system: System) -> list[str]:
    """Return the numbers of components and connections as short texts."""
    return [
        format_count(len(system.components), "component"),
        format_count(len(system.connections), "connection"),
    ]


def render_cell(
    system: System,
    title: str = "System",
    description: str = "",
    facts: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> str:
    """Return the HTML for notebooks of a system, scenario or simulation; see `render_system`."""
    from ..views.notebook_cells import render_system

    return render_system(system, title, description, facts, notes)


def find_main_component(record: Mapping[str, Any]) -> str:
    """Return the component of a run of one FMU, whose variables need no component's name; empty without one.

    Data and faults are components, too.

    Args:
        record: Content of run.json.
    """
    components = record.get("components")
    if not isinstance(components, Mapping):
        return ""
    if len(components) == 1:
        return str(next(iter(components)))
    scenario, is_fmu = record.get("scenario"), str(record.get("source")).lower().endswith(".fmu")
    return str(scenario) if is_fmu and scenario in components else ""
