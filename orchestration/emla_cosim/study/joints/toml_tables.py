"""Read tables of a joint file into dataclasses, arguments of rules and parameters of blocks."""

import difflib
import inspect
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import NoneType
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from fmublock import Block
from fmublock.variables import Variable

from ...base.errors import CommandError, join_names
from ...base.quantities import read_quantity
from ...base.values import as_float


@dataclass(frozen=True)
class EntryFormat:
    """The format of an entry: its meaning, its unit (empty for a plain number), and an example."""

    about: str
    unit: str = ""
    example: str = "..."
    positive: bool = False


@dataclass(frozen=True)
class TomlTable:
    """A table of a joint file: its content, its name, and the name of the file in messages."""

    content: Mapping[str, Any]
    name: str
    file: str

    @property
    def label(self) -> str:
        """The name of the table in messages."""
        return f"[{self.name}] of {self.file}" if self.name else self.file

    def label_of(self, key: str) -> str:
        """Return the name of an entry in messages."""
        return f"'{key}' in {self.label}"

    def inner(self, key: str, about: str = "") -> "TomlTable":
        """Return a table inside this one, empty if it is optional and missing.

        Args:
            key: Name of the inner table.
            about: The content of the table, if it is required.

        Raises:
            CommandError: The table is required and missing, or is not a table.
        """
        name = f"{self.name}.{key}" if self.name else key
        if key not in self.content and about:
            raise CommandError(f"{self.file} lacks the table [{name}], {about}.", table=name)
        content = self.content.get(key, {})
        if not isinstance(content, Mapping):
            raise CommandError(f"{self.label_of(key)} is {content!r}; it must be a table, [{name}].")
        return TomlTable(content, name, self.file)

    def check_keys(self, known: Iterable[str], what: str = "entry") -> None:
        """Raise CommandError for an unknown entry."""
        known = list(known)
        for key in self.content:
            if key not in known:
                near = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
                meant = f"did you mean '{near[0]}'?" if near else f"use {join_names(known or ['none'])}."
                raise CommandError(f"{self.label} has the unknown {what} '{key}'; {meant}", key=key)


def read_call(target: Callable[..., Any], table: TomlTable, ignored: Iterable[str] = ()) -> Any:
    """Call a class or a function with the entries of a table as its arguments.

    Args:
        target: The class or function. Its type hints give the types of entries: numbers, true or false,
            texts, tuples of numbers, or None for optional ones. `Annotated` with an `EntryFormat` adds the
            unit.
        table: The entries, by argument name.
        ignored: Entries that are not arguments.

    Raises:
        CommandError: An entry is unknown, missing or of the wrong type, or values are out of range.
    """
    hints = get_type_hints(target, include_extras=True)
    arguments = inspect.signature(target).parameters
    skipped = set(ignored)
    table.check_keys([*arguments, *skipped])
    values: dict[str, Any] = {}
    for name, argument in arguments.items():
        kind, entry = _kind(hints[name])
        if name in table.content and name not in skipped:
            values[name] = _value(table.content[name], kind, entry, table.label_of(name))
        elif argument.default is inspect.Parameter.empty:
            about = f", the {entry.about}" if entry.about else ""
            raise CommandError(
                f"{table.label} lacks {name}{about}; write {name} = {_example(kind, entry)}.", key=name
            )
    try:
        return target(**values)
    except ArithmeticError as error:
        raise CommandError(f"{table.label} has values that cannot be used: {error}.") from error


def _kind(hint: Any) -> tuple[Any, EntryFormat]:
    entry = EntryFormat("")
    if get_origin(hint) is Annotated:
        hint, entry = get_args(hint)[:2]
    inner = [kind for kind in get_args(hint) if kind is not NoneType]
    if NoneType in get_args(hint) and len(inner) == 1:
        return inner[0], entry
    return hint, entry


def _example(kind: Any, entry: EntryFormat) -> str:
    if entry.example != "...":
        return entry.example
    if get_origin(kind) is tuple:
        return f"[{', '.join(['...'] * len(get_args(kind)))}]"
    return {bool: "true", str: '"..."'}.get(kind, "...")


def _value(value: Any, kind: Any, entry: EntryFormat, label: str) -> Any:
    if kind in (bool, str):
        if not isinstance(value, kind):
            right = "true or false" if kind is bool else "a text"
            raise CommandError(f"{label} is {value!r}; it must be {right}.")
        return value
    if kind is int:
        if isinstance(value, bool) or not isinstance(value, int):
            raise CommandError(f"{label} is {value!r}; it must be a whole number.")
        return value
    if kind is float:
        return _number(value, entry, label)
    parts = get_args(kind)
    if get_origin(kind) is not tuple:
        raise TypeError(f"a joint file cannot hold {kind}")
    values = value if isinstance(value, list) else [value]
    if Ellipsis in parts:
        return tuple(_number(one, entry, label) for one in values)
    if not isinstance(value, list) or len(values) != len(parts):
        raise CommandError(f"{label} is {value!r}; it must be a list of {len(parts)} numbers.")
    return tuple(_number(one, entry, label) for one in values)


def _number(value: Any, entry: EntryFormat, label: str) -> float:
    """Return a number in the unit of the entry; a text can give another unit of the same kind."""
    if isinstance(value, str):
        value = read_quantity(value, label, entry.unit or None)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        in_unit = f" in {entry.unit}, or a text with a unit" if entry.unit else ""
        raise CommandError(f"{label} is {value!r}; it must be a number{in_unit}.")
    number = as_float(value)
    if not math.isfinite(number):
        raise CommandError(f"{label} is {number!r}; it must be a finite number.")
    if entry.positive and number <= 0.0:
        raise CommandError(f"{label} is {value!r}; it must be more than 0.")
    return number


def read_block(block: type[Block], table: TomlTable, reserved: Mapping[str, str]) -> dict[str, Any]:
    """Read parameters of a block, by the names of its FMU, into values by attribute.

    Args:
        block: The block.
        table: The entries. TOML nests names with dots: `d_2.omega` is `omega` in `[disturbance.d_2]`.
        reserved: Parameters that another table sets, each with what to do instead.

    Raises:
        CommandError: A parameter is unknown, reserved, or of the wrong shape or type.
    """
    known = {str(x.name): x for x in block.layout().parameters if x.name not in reserved}
    flat = TomlTable(dict(_flatten(table.content)), table.name, table.file)
    for name in flat.content:
        if name in reserved:
            raise CommandError(f"{flat.label} must not have the entry '{name}'; {reserved[name]}.", key=name)
    flat.check_keys(known)
    return {
        known[name].attribute: _parameter(value, known[name], flat.label_of(name))
        for name, value in flat.content.items()
    }


def _parameter(value: Any, parameter: Variable, label: str) -> Any:
    """Return the value of a parameter: a number, or a tuple of them for an array."""
    if parameter.fmi_type != "Real":
        return _value(value, bool if parameter.fmi_type == "Boolean" else int, EntryFormat(""), label)
    entry, size = EntryFormat("", parameter.unit or ""), math.prod(parameter.shape)
    if not parameter.shape:
        return _number(value, entry, label)
    if not isinstance(value, list) or len(value) != size:
        raise CommandError(f"{label} is {value!r}; it must be a list of {size} numbers.")
    return tuple(_number(one, entry, label) for one in value)


def _flatten(content: Mapping[str, Any]) -> Iterable[tuple[str, Any]]:
    for key, value in content.items():
        if isinstance(value, Mapping):
            yield from ((f"{key}.{name}", inner) for name, inner in _flatten(value))
        else:
            yield key, value
