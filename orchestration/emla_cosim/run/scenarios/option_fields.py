"""Options as fields of the structs of files."""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import msgspec

from ...base.option import Option
from ...base.table_entries import Location, list_fields
from ...base.toml_structs import Struct, extend_struct, quantity
from ..options import list_options, read_option


def with_options(table: type[Struct], name: str, command: str) -> type[Struct]:
    """Return a struct with the fields of another one and the options of a command that files can have.

    Args:
        table: The other struct; its fields have priority over options of the same name.
        name: The name of the struct.
        command: The command.
    """
    fields = [
        (option.name, _field_type(option), msgspec.UNSET)
        for option in list_options(command).values()
        if option.about.in_file and option.name not in table.__struct_fields__
    ]
    return extend_struct(table, name, fields)


def _field_type(option: Option) -> Any:
    def read(value: Any, at: Location, folder: Path | None) -> Any:
        return read_option(option.name, value, at.label, folder)

    extra: dict[str, Any] = {"read": read}
    schema: dict[str, Any] = {}
    if get_origin(option.type) is Mapping:
        has_tables = dataclasses.is_dataclass(get_args(option.type)[1])
        extra["is_value"] = lambda _: has_tables
        schema = {} if has_tables else {"x-dotted": True}
    meta = msgspec.Meta(description=option.about.help, extra=extra, extra_json_schema=schema)
    return Annotated[_option_type(option), meta]


def _option_type(option: Option) -> Any:
    """Return the type of the value as TOML has it, from which the schema follows."""
    about, type_ = option.about, option.type if option.about.takes is bool else option.plain_type
    if about.choices is not None:
        names = Literal[tuple(about.choices())]  # type: ignore[misc]
        return list[names] if get_origin(type_) is Sequence else names
    if about.unit:
        return Annotated[float, quantity(about.unit)]
    if about.arrays:
        return dict[str, float | bool | str | list[Any]]
    return type_in_file(type_)


def type_in_file(type_: Any) -> Any:
    """Return the type of a value in a file, for its schema: texts for paths, structs for dataclasses."""
    origin, inner = get_origin(type_), get_args(type_)
    if type_ is Path:
        return str
    if origin in (Union, UnionType):
        return Union[tuple(type_in_file(t) for t in inner if t is not type(None))]  # noqa: UP007
    if origin is Mapping:
        return dict[str, type_in_file(inner[1])]
    if origin is Sequence:
        return list[type_in_file(inner[0])]
    return str | _record_struct(type_) if dataclasses.is_dataclass(type_) else type_


@cache
def _record_struct(record: Any) -> Any:
    """Return the struct with the fields of a dataclass."""
    fields: list[Any] = [
        (f.attribute, type_in_file(f.type), *([] if f.is_required else [msgspec.UNSET]))
        for f in list_fields(record)
    ]
    return extend_struct(msgspec.Struct, record.__name__, fields)
