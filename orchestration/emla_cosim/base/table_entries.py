"""Entries of tables: where they are, which a table may have, and messages for unknown and missing ones."""

import dataclasses
import difflib
from collections.abc import Collection, Sequence
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

import msgspec

from .errors import CommandError, join_names

_LEAST_SIMILARITY = 0.6
"""Of names that may be meant, from 0 to 1; as `difflib.get_close_matches` counts it."""


@dataclass(frozen=True)
class Location:
    """Where a value is, as messages name it.

    Attributes:
        label: The value: `'x_L' in [start] of the joint 'tilt'`.
        file: The file with the value; empty if messages do not name it; None if tables inside the value have
            no names of their own.
        path: The keys of a table, joined with dots: `gains.rsba`.
        brackets: The name of a table: `[gains.rsba]`; empty for a whole file.
    """

    label: str
    file: str | None = None
    path: str = ""
    brackets: str = ""

    @property
    def table(self) -> str:
        """The value, if it is a table: `[start] of the joint 'tilt'`."""
        if not self.brackets:
            return self.label
        return f"{self.brackets} of {self.file}" if self.file else self.brackets

    def entry(self, key: str) -> "Location":
        """Return the location of an entry of this table."""
        preposition = "in" if self.brackets or self.file is None else "of"
        label = f"'{key}' {preposition} {self.table}" if self.table else f"'{key}'"
        if self.file is None:
            return Location(label)
        path = f"{self.path}.{key}" if self.path else key
        return Location(label, self.file, path, f"[{path}]")

    def item(self, index: int) -> "Location":
        """Return the location of an item of this list."""
        if self.file is None:
            return Location(f"'{index}' in {self.label}")
        return Location(f"'{index}' in {self.label}", self.file, self.path, f"[{self.brackets}] {index + 1}")


class Field(NamedTuple):
    """A field of a table: its name in files, its name in Python, its type, and whether it is required."""

    name: str
    attribute: str
    type: Any
    is_required: bool


def list_fields(type_: Any) -> list[Field]:
    """Return the fields of a struct or of a dataclass."""
    if not is_dataclass(type_):
        return [Field(f.encode_name, f.name, f.type, f.required) for f in msgspec.structs.fields(type_)]
    types = get_type_hints(type_, include_extras=True)
    return [
        Field(f.name, f.name, types[f.name], f.default is f.default_factory is dataclasses.MISSING)
        for f in dataclasses.fields(type_)
        if f.init
    ]


def combine_problems(label: str, problems: Sequence[str]) -> CommandError:
    """Return one error for all problems, which are sentences; `fields["problems"]` has them."""
    lines = "".join(f"\n  {problem}" for problem in problems)
    text = f": {problems[0]}" if len(problems) == 1 else f" for {len(problems)} reasons:{lines}"
    return CommandError(f"{label} cannot be used{text}", problems=list(problems))


def _find_nearest(name: str, names: Collection[str], absent: Collection[str]) -> list[str]:
    """Return the most similar name, or none; of equal ones, one that is absent."""

    def similarity(candidate: str) -> tuple[float, bool]:
        is_same = candidate.lower() == name.lower()
        return 1.0 if is_same else difflib.SequenceMatcher(None, candidate, name).ratio(), candidate in absent

    nearest = max(names, key=similarity, default="")
    return [nearest] if nearest and similarity(nearest)[0] >= _LEAST_SIMILARITY else []


def unknown_entry(
    table: str, key: object, names: Collection[str], absent: Collection[str] = ()
) -> CommandError:
    """Return the error for an entry that a table cannot have, with the nearest name or all names.

    Args:
        table: What messages call the table.
        key: The entry.
        names: The entries that the table can have.
        absent: Those of them that it does not have; one of them is meant rather than another one.
    """
    near = _find_nearest(str(key), names, absent)
    remedy = f"did you mean '{near[0]}'?" if near else f"use {join_names(names or ['none'])}."
    return CommandError(f"{table} has the unknown entry '{key}'; {remedy}", key=key, near=near)


def missing_entry(field: Field, at: Location) -> CommandError:
    """Return the error for a required entry that a table lacks, with its meaning and an example."""
    type_, metas = field.type, list[msgspec.Meta]()
    while get_origin(type_) is Annotated:
        type_, *more = get_args(type_)
        metas += more
    about = next((f", the {m.description}" for m in metas if m.description), "")
    if any(isinstance(t, type) and issubclass(t, msgspec.Struct) for t in (type_, *get_args(type_))):
        path = at.entry(field.name).path
        return CommandError(f"{at.file or 'it'} lacks the table [{path}]{about}.", table=path)
    example = next((m.examples[0] for m in metas if m.examples), None)
    if get_origin(type_) is Literal:
        example = get_args(type_)[0]
    text = example_of(type_) if example is None else write_toml(example)
    return CommandError(f"{at.table} lacks {field.name}{about}; write {field.name} = {text}.", key=field.name)


def example_of(type_: Any) -> str:
    """Return a placeholder of a type as TOML."""
    if get_origin(type_) is tuple:
        return f"[{', '.join(['...'] * len(get_args(type_)))}]"
    return {bool: "true", str: '"..."', Path: '"..."'}.get(type_, "...")


def write_toml(value: Any) -> str:
    """Return a number, a text, a Boolean or a list as TOML."""
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(write_toml, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else f"{value:.12g}"
