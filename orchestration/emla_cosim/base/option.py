"""One option of a run: a field of a dataclass that says all there is to know of it, once."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

from .errors import CommandError, check_choice

SYSTEM, STEPPING, OUTPUT = "What is run", "How it is stepped", "What comes out"
"""What options are about; the command line's help shows them in these groups."""

RUN, EXPORT, SWEEP, COMPARE, INFO = "run", "export", "sweep", "compare", "info"
BUILD, PLOT, TRAJECTORY, VERIFY = "build", "plot", "trajectory", "verify"
"""Commands that take options."""

BUILDING, PREPARING, LOADING, RUNNING, SHOWING = "building", "preparing", "loading", "running", "showing"
"""What uses an option: to build our own FMUs, prepare a system, load its FMUs, run it, show what came out."""

VARIES, SAME, LEFT_OUT = "varies", "same", "left out"
"""What a sweep does with an option: it can vary it, keeps it the same in all variants, or leaves it out."""


@dataclass(frozen=True)
class OptionInfo:
    """What there is to know of an option beside its name, type and default.

    `group` is one of the groups above. `flag` is the option of the command line, by default its
    name; `metavar` what stands for its value there. `choices` gives the names that it may have,
    `above` and `below` bound a number, ends excluded. `identity` is what messages call the option
    where a checkpoint can only be continued with the same value; empty where it may change. `record`
    is its name in run.json, by default its name and unit; `in_file` says whether a scenario file may
    hold it. `commands` are those that take it. `parse` makes its value of the text of the command
    line, or of all its texts where it may be repeated. In Python an object of the type `takes` is a
    value too, and taken as it is, also as an entry of a table. `alone` is the value of a flag of the command
    line that nothing follows. `writes` is "file" or "folder" where the value names what is written. An
    option that is not `repeated` holds for one command: those that repeat a run leave it out. With `arrays`
    a list in a table is that of the elements `name[1]`, `name[2]`. `stage` says what uses the option,
    `in_sweep` what a sweep does with it. `makes` is the part of a built-in system that the option decides;
    other systems have their own and refuse the option.
    """

    help: str
    group: str = STEPPING
    flag: str = ""
    metavar: str | None = None
    choices: Callable[[], Iterable[str]] | None = None
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
    """Base of what Python can give in the place of the file that it can be read from."""

    file: Path | None = None
    """Where it was read; None for what was made in Python."""

    def record(self) -> dict[str, Any]:
        """All of it as run.json has it."""
        raise NotImplementedError

    def repeatable(self) -> Any:
        """What an option may have in its place, as JSON; None where that has to be made in Python again."""
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
    """An option with its name, its type and its default."""

    name: str
    type: Any
    default: Any
    about: OptionInfo

    @property
    def flag(self) -> str:
        """What the command line calls it."""
        return self.about.flag or f"--{self.name.replace('_', '-')}"

    @property
    def record(self) -> str:
        """What run.json calls it."""
        return self.about.record or self.name + (f"_{self.about.unit}" if self.about.unit else "")

    @property
    def is_prepared(self) -> bool:
        """Whether a run of a prepared simulation cannot change it."""
        return self.about.stage in (BUILDING, PREPARING, LOADING)

    @property
    def can_vary(self) -> bool:
        """Whether a sweep can vary it."""
        return self.about.in_sweep == VARIES and self.about.in_file

    @property
    def plain_type(self) -> Any:
        """Its type but for `takes`."""
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
        """What sentences call it."""
        return self.name.replace("_", " ")

    def check(self, value: Any) -> None:
        """Raise CommandError for a value that is none of the choices, or out of range."""
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
    """The options among the fields of a class; none of one that is no dataclass."""
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
