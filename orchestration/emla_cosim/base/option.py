"""The definition of an option: a dataclass field that holds all information on it."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

from .errors import CommandError, check_choice

SYSTEM, STEPPING, OUTPUT = "What is run", "How it is stepped", "What comes out"
RUNS = "Where it runs"
"""The groups of options in the help of the command line."""

RUN, EXPORT, SWEEP, COMPARE, INFO = "run", "export", "sweep", "compare", "info"
BUILD, PLOT, TRAJECTORY, VERIFY = "build", "plot", "trajectory", "verify"
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


@dataclass(frozen=True)
class OptionInfo:
    """Information on an option beside its name, type and default.

    Attributes:
        help: The help text.
        group: One of the groups above.
        flag: The flag of the command line; default: derived from the name.
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
        alone: The value of a flag without a value on the command line.
        writes: `file` or `folder` if the value names an output.
        repeated: Whether commands that repeat a run keep the option.
        arrays: Whether a list in a table sets the elements `name[1]`, `name[2]`.
        stage: What uses the option.
        in_sweep: How a sweep treats it.
        makes: The part of a built-in system that the option decides; other systems refuse the option.
    """

    help: str
    group: str = STEPPING
    flag: str = ""
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
    alone: str = ""
    writes: str = ""
    repeated: bool = True
    arrays: bool = False
    stage: str = RUNNING
    in_sweep: str = VARIES
    makes: str = ""


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


def option(default: Any = None, /, help: str = "", **about: Any) -> Any:
    """Declare a field of a dataclass as an option.

    Args:
        default: default value of the option.
        help: one line for the help of the command line.
        **about: further properties, such as `unit`, `above`, `below` and `choices`; see `OptionInfo`.

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
    described = {"about": OptionInfo(help, **about)}
    if isinstance(default, (list, dict)):
        return field(default_factory=default.copy, metadata=described)
    return field(default=default, metadata=described)


@dataclass(frozen=True)
class Option:
    """An option with its name, type and default."""

    name: str
    type: Any
    default: Any
    about: OptionInfo

    @property
    def flag(self) -> str:
        """Return the flag of the command line."""
        return self.about.flag or f"--{self.name.replace('_', '-')}"

    @property
    def record(self) -> str:
        """Return the name in run.json."""
        return self.about.record or self.name + (f"_{self.about.unit}" if self.about.unit else "")

    @property
    def is_prepared(self) -> bool:
        """Return whether its value is fixed once a simulation is prepared."""
        return self.about.stage in (BUILDING, PREPARING, LOADING)

    @property
    def can_vary(self) -> bool:
        """Return whether a sweep can vary it."""
        return self.about.in_sweep == VARIES and self.about.in_file

    @property
    def plain_type(self) -> Any:
        """Return the type without the type `takes`."""
        if get_origin(self.type) is Mapping:
            name, of = get_args(self.type)
            return Mapping[name, self._without_objects(of)]
        return self._without_objects(self.type)

    def _without_objects(self, of: Any) -> Any:
        inner = get_args(of)
        if self.about.takes not in inner:
            return of
        return Union[tuple(t for t in inner if t is not self.about.takes)]  # noqa: UP007

    @property
    def noun(self) -> str:
        """Return the name for error messages."""
        return self.name.replace("_", " ")

    def check(self, value: Any) -> None:
        """Check a value.

        Raises:
            CommandError: If it is not one of the choices, or out of range.
        """
        about = self.about
        if value is None:
            return
        if about.choices is not None:
            check_choice(self.noun, value, about.choices())
        bounded = math.isfinite(about.above) or math.isfinite(about.below)
        if bounded and isinstance(value, (int, float)) and not about.above < value < about.below:
            raise CommandError(f"the {self.noun} {value:g} must be {self._range()}.", option=self.name)

    def _range(self) -> str:
        above, below = self.about.above, self.about.below
        if math.isinf(below):
            return "a positive number" if above == 0.0 else f"more than {above:g}"
        return f"between {above:g} and {below:g}"


@cache
def options_of(kind: type) -> list[Option]:
    """Return the options among the fields of a class, none if it is not a dataclass."""
    if not is_dataclass(kind):
        return []
    described = [f for f in fields(kind) if "about" in f.metadata]
    types = get_type_hints(kind) if described else {}
    return [
        Option(
            f.name,
            types[f.name],
            f.default_factory() if f.default_factory is not MISSING else f.default,
            f.metadata["about"],
        )
        for f in described
    ]
