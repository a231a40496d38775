"""Options as fields of the structs of files."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

import msgspec

from ...base.option import Option
from ...base.table_entries import Location
from ...base.toml_structs import Struct, describe, extend_struct, quantity, type_in_file
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
        if option.in_file and option.name not in table.__struct_fields__
    ]
    return extend_struct(table, name, fields)


def _field_type(option: Option) -> Any:
    def read(value: Any, at: Location, folder: Path | None) -> Any:
        return read_option(option.name, value, at.label, folder)

    settings: dict[str, Any] = {}
    if get_origin(option.type) is Mapping:
        has_tables = dataclasses.is_dataclass(get_args(option.type)[1])
        settings["extra"] = {"is_value": lambda _: has_tables}
        settings["extra_json_schema"] = {} if has_tables else {"x-dotted": True}
    return Annotated[_option_type(option), describe(option.help, read=read, **settings)]


def _option_type(option: Option) -> Any:
    """Return the type of the value as TOML has it, from which the schema follows."""
    type_ = option.plain_type
    if option.choices is not None:
        names = Literal[tuple(option.choices())]  # type: ignore[misc]
        return list[names] if get_origin(type_) is Sequence else names
    if option.unit:
        return Annotated[float, quantity(option.unit)]
    if option.arrays:
        return dict[str, float | bool | str | Annotated[list[Any], msgspec.Meta(min_length=1)]]
    return type_in_file(type_)
