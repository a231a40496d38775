"""Files in TOML as structs of msgspec: reading, and annotations of their fields.

A struct is the one description of a file: `read_table` reads and checks a file with it, `schemas.py` writes
its JSON Schema.
"""

import tomllib
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from .errors import CommandError
from .table_entries import Location

Table = Mapping[str, Any]
Struct = TypeVar("Struct", bound=msgspec.Struct)

QUANTITY = r"^\s*[-+]?[.,]?[0-9]"
"""Pattern of a text with a number and a unit, for editors; the reader decides."""


def read_toml(text: str, label: str) -> dict[str, Any]:
    """Return the content of a text in TOML; raise CommandError, with line and column, if it is not TOML."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also for huge numbers and deep nesting
        raise CommandError(f"{label} is not TOML: {error}.") from error


def describe(
    about: str = "",
    example: Any = None,
    read: Callable[[Any, Location, Path | None], Any] | None = None,
    **settings: Any,
) -> msgspec.Meta:
    """Annotate an entry with its meaning.

    Args:
        about: Its meaning, without an article.
        example: A value as files have it.
        read: A function of the value, its location and the folder of relative paths that reads the entry;
            the annotated type is that in files, for the schema.
        **settings: Bounds and other arguments of `msgspec.Meta`.
    """
    if read is not None:
        settings["extra"] = {"read": read, **settings.get("extra", {})}
    return msgspec.Meta(
        description=about or None, examples=None if example is None else [example], **settings
    )


def quantity(unit: str, about: str = "", example: Any = None, **bounds: Any) -> msgspec.Meta:
    """Annotate a number, or a tuple of numbers: a file can also have a text with another unit.

    Args:
        unit: The unit of the number; empty for a plain number.
        about: Its meaning, without an article.
        example: A value as files have it.
        **bounds: `gt`, `ge`, `lt` or `le`, as of `msgspec.Meta`.
    """
    described = " ".join(part for part in (about, f"[{unit}]" if unit else "") if part)
    schema = {"pattern": QUANTITY, **({"description": described} if described else {})}
    return describe(about, example, extra={"unit": unit}, extra_json_schema=schema, **bounds)


def dotted(about: str, is_value: Callable[[Table], bool] = lambda _: False) -> msgspec.Meta:
    """Annotate a table whose names may have dots, which TOML nests.

    Args:
        about: Its meaning.
        is_value: Whether an inner table is a value, not a part of a name.
    """
    return describe(about, extra={"is_value": is_value}, extra_json_schema={"x-dotted": True})


def one_of(tag: str, types: Mapping[str | None, type[msgspec.Struct]], about: str = "") -> msgspec.Meta:
    """Annotate `Any` as one of several structs, of which the entry `tag` names one.

    Args:
        tag: The entry that names a struct.
        types: The structs by the value of the entry; None for a table without it.
        about: The meaning of the table.
    """
    schema = {"anyOf": [{"$ref": f"#/definitions/{t.__name__}"} for t in types.values()]}
    return describe(about, extra={"tag": tag, "types": types}, extra_json_schema=schema)


def extend_struct(base: type[Struct], name: str, fields: Sequence[Any], about: str = "") -> type[Struct]:
    """Return a struct with further fields, which files may leave out if they have a default.

    Args:
        base: The struct with the other fields, or `msgspec.Struct`.
        name: The name of the new struct; a schema needs different names.
        fields: Name, type and, if any, default of each field, as for `msgspec.defstruct`.
        about: The description of the table. Default: that of `base`.
    """
    about = about or ("" if base is msgspec.Struct else base.__doc__ or "")
    return msgspec.defstruct(  # type: ignore[return-value]
        name,
        fields,
        bases=(base,),
        namespace={"__doc__": about},
        frozen=True,
        kw_only=True,
        forbid_unknown_fields=True,
    )


def list_given(table: msgspec.Struct, without: Collection[str] = ()) -> dict[str, Any]:
    """Return the fields that a file has, by attribute: those that are not UNSET."""
    values = {name: getattr(table, name) for name in table.__struct_fields__ if name not in without}
    return {name: value for name, value in values.items() if value is not msgspec.UNSET}
