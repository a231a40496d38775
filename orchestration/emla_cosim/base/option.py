"""The definition of an option: a dataclass field that holds all information on it."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

from .errors import CommandError, check_choice

SYSTEM, STEPPING, OUTPUT = "What is run", "How it is stepped", "What comes out"
RUNS = "Where it runs"
"""The groups of options in the help of the command line."""

ARGUMENTS, OTHER_OPTIONS = "Arguments", "Options"
"""The groups of what only one command has: arguments without a flag, and options without another group."""

RUN, EXPORT, SWEEP, COMPARE, INFO = "run", "export", "sweep", "compare", "info"
BUILD, PLOT, TRAJECTORY, VERIFY = "build", "plot", "trajectory", "verify"
REPAIR = "repair"
LINEARIZE, SIZE = "linearize", "size"
"""The commands that take options."""

STEPPED = (RUN, EXPORT, SWEEP, COMPARE, LINEARIZE)
"""The commands that decide how components step."""

BUILDING, PREPARING, LOADING, RUNNING, SHOWING = "building", "preparing", "loading", "running", "showing"
SHARING = "sharing"
"""What uses an option: building our own FMUs, preparing a system, loading FMUs, running, showing results, and
sharing many runs among processes."""

VARIES, SAME, LEFT_OUT = "varies", "same", "left out"
"""How a sweep treats an option: it can vary it, keeps it the same in all variants, or ignores it."""


class FileOrObject:
    """Base class of objects that can replace the file from which they can be read."""

    file: Path | None = None
    """The file from which it was read; None if it was made in Python."""

    def record(self) -> dict[str, Any]:
        """Return the content for run.json."""
        raise NotImplementedError

    def repeatable(self) -> Any:
        """Return the value of an option that reads it again, as JSON; None if only Python can make it."""
        return None if self.file is None else str(self.file)


@dataclass(frozen=True)
class Option:
    """An option: a field of a dataclass, whose name, type and default it has.

    Attributes:
        help: The help text.
        group: One of the groups above.
        flag: The flag of the command line; default: derived from the name.
        short_flag: Another flag, of one letter; the help text mentions it.
        metavar: The placeholder of the value in the help.
        choices: Returns the allowed names.
        above: The lower bound of a number, excluded.
        below: The upper bound of a number, excluded.
        unit: The unit of the value.
        identity: The name in error messages if a checkpoint requires the same value; empty if the value may
            change.
        record: The name in run.json; default: name and unit.
        recorded: Whether run.json has the option.
        in_file: Whether a scenario file can set it.
        commands: The commands that take it.
        parse: Converts the text of the command line, or the list of texts if the option can be repeated.
        takes: A type whose objects Python code can pass unchanged, also as entries of a table.
        flag_value: The value of a flag without a value on the command line, and of True elsewhere.
        negative: Whether a switch has a second flag `--no-...`.
        repeated: Whether commands that repeat a run keep the option.
        arrays: Whether a list in a table sets the elements `name[1]`, `name[2]`.
        stage: What uses the option.
        in_sweep: How a sweep treats it.
        makes: The part of a built-in system that the option decides; other systems refuse the option.
        name: The name of the field.
        type: The type of the field.
        default: The default of the field; `MISSING` if the option is required.
    """

    help: str
    group: str = STEPPING
    flag: str = ""
    short_flag: str = ""
    metavar: str | None = None
    choices: Callable[[], Iterable[Any]] | None = None
    above: float = -math.inf
    below: float = math.inf
    unit: str = ""
    identity: str = ""
    record: str = ""
    recorded: bool = True
    in_file: bool = True
    commands: tuple[str, ...] = (RUN, SWEEP, COMPARE)
    parse: Callable[[Any], Any] | None = None
    takes: type | None = None
    flag_value: str = ""
    negative: bool = True
    repeated: bool = True
    arrays: bool = False
    stage: str = RUNNING
    in_sweep: str = VARIES
    makes: str = ""
    name: str = ""
    type: Any = None
    default: Any = None

    @property
    def is_required(self) -> bool:
        """Return whether it has no default."""
        return self.default is MISSING

    @property
    def is_table(self) -> bool:
        """Return whether its values have names."""
        return get_origin(self.plain_type) is Mapping

    @property
    def flags(self) -> tuple[str, ...]:
        """Return the flag, and of a switch the flag that turns it off."""
        if self.type is not bool or not self.negative:
            return (self.flag,)
        return self.flag, f"--no-{self.flag.removeprefix('--')}"

    @property
    def is_repeatable(self) -> bool:
        """Return whether the command line takes it several times."""
        return self.is_table or (get_origin(self._kinds[0]) is Sequence and self.parse is None)

    @property
    def text_type(self) -> Callable[[str], Any]:
        """Return the type of a text of the command line: of the value, or of each in a list."""
        kind = self._kinds[0]
        (kind,) = get_args(kind) if get_origin(kind) is Sequence else (kind,)
        return kind if kind in (int, float, Path) else str

    @property
    def _kinds(self) -> Sequence[Any]:
        """Return the types that a value can have, without None."""
        is_union = get_origin(self.plain_type) in (Union, UnionType)
        kinds = get_args(self.plain_type) if is_union else (self.plain_type,)
        return [kind for kind in kinds if kind is not NoneType]

    @property
    def placeholder(self) -> str:
        """Return the placeholder of the value in the help; empty for a switch."""
        if self.metavar is not None or self.type is bool:
            return self.metavar or ""
        if self.unit:
            return "TIME"
        return {Path: "PATH", float: "NUMBER", int: "N"}.get(self.text_type, "NAME")

    @property
    def headline(self) -> str:
        """Return the flags with the placeholder of the value; of an argument the placeholder."""
        if self.group != ARGUMENTS:
            return f"{', '.join(self.flags)} {self.placeholder}".rstrip()
        text = f"{self.placeholder}..." if self.is_repeatable else self.placeholder
        return text if self.is_required else f"[{text}]"

    @property
    def meaning(self) -> str:
        """Return the help text with choices, unit and default."""
        text = self.help
        if self.choices is not None:
            text += f" One of {', '.join(map(str, self.choices()))}."
        if self.unit:
            text += f" In {self.unit}, or with a unit as in 0.1ms."
        if isinstance(self.default, (str, int, float)) and not isinstance(self.default, bool):
            default = self.default if isinstance(self.default, str) else f"{self.default:g}"
            text += f" Default: {default} {self.unit}".rstrip() + "."
        return text

    @property
    def is_prepared(self) -> bool:
        """Return whether its value is fixed once a simulation is prepared."""
        return self.stage in (BUILDING, PREPARING, LOADING)

    @property
    def can_vary(self) -> bool:
        """Return whether a sweep can vary it."""
        return self.in_sweep == VARIES and self.in_file

    @property
    def plain_type(self) -> Any:
        """Return the type without the type `takes`."""
        if get_origin(self.type) is Mapping:
            name, of = get_args(self.type)
            return Mapping[name, self._drop_objects(of)]
        return self._drop_objects(self.type)

    def _drop_objects(self, of: Any) -> Any:
        """Return a union without the type `takes`; other types unchanged."""
        inner = get_args(of)
        if self.takes not in inner:
            return of
        return Union[tuple(t for t in inner if t is not self.takes)]  # noqa: UP007

    @property
    def noun(self) -> str:
        """Return the name for error messages."""
        return self.name.replace("_", " ")

    def check(self, value: Any) -> None:
        """Check a value.

        Raises:
            CommandError: If it is not one of the choices, or out of range.
        """
        if value is None:
            return
        if self.choices is not None:
            check_choice(self.noun, value, self.choices())
        bounded = math.isfinite(self.above) or math.isfinite(self.below)
        if bounded and isinstance(value, (int, float)) and not self.above < value < self.below:
            raise CommandError(f"the {self.noun} {value:g} must be {self._format_range()}.", option=self.name)

    def _format_range(self) -> str:
        above, below = self.above, self.below
        if math.isinf(below):
            return "a positive number" if above == 0.0 else f"more than {above:g}"
        return f"between {above:g} and {below:g}"


def option(default: Any = None, /, help: str = "", **about: Any) -> Any:
    """Declare a field of a dataclass as an option.

    Args:
        default: default value of the option.
        help: one line for the help of the command line.
        **about: further properties, such as `unit`, `above`, `below` and `choices`; see `Option`.

    Returns:
        A dataclass field.

    Examples:
        >>> from dataclasses import dataclass
        >>> import emla_cosim as ec
        >>> @dataclass(eq=False)
        ... class Relaxed(ec.Jacobi):
        ...     relaxation: float = ec.option(1.0, help="Factor of each correction.", above=0.0)
        >>> Relaxed(relaxation=0.5).relaxation
        0.5
    """
    metadata = {"option": Option(help, **about)}
    if isinstance(default, (list, dict)):
        return field(default_factory=default.copy, metadata=metadata)  # dataclasses refuse shared lists
    return field(default=default, metadata=metadata)


def argument(default: Any = MISSING, /, help: str = "", metavar: str | None = None) -> Any:
    """Declare a field of a dataclass as an argument without a flag; one without a default is required."""
    return option(default, help=help, metavar=metavar, group=ARGUMENTS)


def switch(help: str, group: str = OTHER_OPTIONS) -> Any:
    """Declare a field of a dataclass as a flag that turns something on."""
    return option(False, help=help, group=group, negative=False)


@cache
def options_of(kind: type) -> list[Option]:
    """Return the options among the fields of a class, none if it is not a dataclass."""
    described = [f for f in fields(kind) if "option" in f.metadata] if is_dataclass(kind) else []
    types = get_type_hints(kind) if described else {}
    return [_complete_option(f, types[f.name]) for f in described]


def _complete_option(field: Field[Any], type_: Any) -> Option:
    """Return the option that a field declares, with its name, type and default."""
    declared: Option = field.metadata["option"]
    return replace(
        declared,
        name=field.name,
        type=type_,
        default=field.default if field.default_factory is MISSING else field.default_factory(),
        flag=declared.flag or f"--{field.name.replace('_', '-')}",
        record=declared.record or "_".join(filter(None, (field.name, declared.unit))),
    )
