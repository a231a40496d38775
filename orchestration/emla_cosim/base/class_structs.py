"""Structs of files from the dataclasses that the files become."""

import inspect
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType, NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import msgspec

from .table_entries import Location, list_fields
from .toml_structs import describe, dotted, extend_struct
from .values import convert_value


def struct_of(
    class_: Any, types: Mapping[str, Any] = MappingProxyType({}), without: Collection[str] = ()
) -> type[msgspec.Struct]:
    """Return the struct with the fields of a dataclass; their meaning is that of its docstring.

    Args:
        class_: The dataclass.
        types: Types of fields in files, if they differ from those in Python; a file can leave out what can
            be None.
        without: Fields that files do not have.
    """
    about = _read_arguments(class_)
    fields = list[Any]()
    for field in list_fields(class_):
        if field.name in without:
            continue
        type_ = types.get(field.name) or type_in_file(field.type)
        is_required = field.is_required and NoneType not in get_args(type_)
        metas = get_args(type_)[1:] if get_origin(type_) is Annotated else ()
        if not any(meta.description for meta in metas):
            has_dots = get_origin(field.type) is Mapping and not is_dataclass(get_args(field.type)[1])
            type_ = Annotated[type_, (dotted if has_dots else describe)(about.get(field.name, ""))]
        fields.append((field.name, type_, *([] if is_required else [msgspec.UNSET])))
    return extend_struct(
        msgspec.Struct, class_.__name__, fields, (inspect.getdoc(class_) or "").partition("\n")[0]
    )


def _read_arguments(class_: Any) -> dict[str, str]:
    """Return the descriptions of arguments in a docstring, by name."""
    text = (inspect.getdoc(class_) or "").partition("Args:\n")[2].partition("\n\n")[0]
    entries = re.findall(r"^    (\w+): (.*(?:\n {8}.*)*)", text, re.M)
    return {name: " ".join(about.split()).rstrip(".") for name, about in entries}


record_struct = cache(struct_of)
"""Return the struct of a dataclass, the same one each time."""


def type_in_file(type_: Any) -> Any:
    """Return the type of a value in a file, for its schema: texts for paths, structs for dataclasses."""
    origin, inner = get_origin(type_), get_args(type_)
    if type_ is Path:
        return str
    if origin in (Union, UnionType):
        return Union[tuple(map(type_in_file, inner))]  # noqa: UP007
    if origin is Mapping:
        return dict[str, type_in_file(inner[1])]
    if origin is Sequence:
        return list[type_in_file(inner[0])]
    if not is_dataclass(type_):
        return type_
    first = list_fields(type_)[0].type  # a dataclass can be read from its first field alone
    return (float if float in (first, *get_args(first)) else str) | record_struct(type_)


def record(type_: Any, about: str = "") -> Any:
    """Return the type of an entry that is a dataclass: a table of its fields, or its first field."""

    def read(value: Any, at: Location, folder: Path | None) -> Any:
        return convert_value(value, type_, at.label, folder)

    return Annotated[type_in_file(type_), describe(about, read=read)]


def check_fields(of: Any, type_: type[msgspec.Struct], label: str, without: Collection[str] = ()) -> None:
    """Check the attributes of an object with the types and bounds of a struct.

    Args:
        of: The object.
        type_: The struct.
        label: What error messages call the object.
        without: Fields that are not checked.

    Raises:
        CommandError: An attribute has a wrong type or is out of range.
    """
    for field in msgspec.structs.fields(type_):
        if field.name not in without:
            convert_value(getattr(of, field.name), field.type, f"'{field.name}' of {label}")
