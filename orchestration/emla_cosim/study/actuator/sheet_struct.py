"""The tables of an actuator's file as structs of msgspec."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from ...base.table_entries import Location
from ...base.toml_structs import QUANTITY, extend_struct
from .entries import NEEDED, TABLES, SheetEntry
from .sheet_values import SheetValue, read_sheet_value


def _reader(table: str, entry: SheetEntry) -> Callable[[Any, Location, Path | None], SheetValue]:
    return lambda value, _at, _folder: read_sheet_value(value, entry, f"{table}.{entry.key}")


def _field(table: str, entry: SheetEntry) -> Any:
    schema: dict[str, Any] = {} if entry.choices or entry.kind is bool else {"pattern": QUANTITY}
    if entry.most < math.inf and not entry.unit:
        schema["maximum"] = entry.most
    meta = msgspec.Meta(
        description=entry.about,
        examples=[entry.example],
        extra={"read": _reader(table, entry)},
        extra_json_schema=schema,
    )
    type_ = Annotated[_type_in_file(entry), meta]
    return (entry.key, type_) if entry.needed else (entry.key, type_, msgspec.UNSET)


def _type_in_file(entry: SheetEntry) -> Any:
    if entry.choices:
        return Literal[entry.choices]
    if entry.kind is bool:
        return bool
    return str if entry.unit else float


class SheetTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An actuator as its data sheets describe it; docs/actuator.md has the entries."""

    name: str = ""
    source: str = ""


def _table(name: str, entries: tuple[SheetEntry, ...]) -> Any:
    struct = extend_struct(msgspec.Struct, name, [_field(name, entry) for entry in entries])
    return (name, struct) if name in NEEDED else (name, struct, msgspec.UNSET)


ACTUATOR = extend_struct(SheetTable, "Actuator", [_table(name, entries) for name, entries in TABLES.items()])
"""The struct of an actuator's file; entries become `SheetValue`."""
