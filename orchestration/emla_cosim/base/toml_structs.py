"""Files in TOML as structs of msgspec: annotations of their fields, and their JSON Schemas.

A struct is the one description of a file: `convert_value` reads and checks a file with it, `schemas.py`
writes its JSON Schema.
"""

import inspect
import re
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType, NoneType, UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

import msgspec

from .errors import CommandError
from .table_entries import Location, list_fields
from .values import convert_value

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
    """Return the annotation of an entry with its meaning.

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
    """Return the annotation of a number with a unit, or of a tuple of numbers.

    A file can also have a text with another unit.

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
    """Return the annotation of a table whose names may have dots, which TOML nests.

    Args:
        about: Its meaning.
        is_value: Whether an inner table is a value, not a part of a name.
    """
    return describe(about, extra={"is_value": is_value}, extra_json_schema={"x-dotted": True})


def one_of(tag: str, types: Mapping[str | None, type[msgspec.Struct]], about: str = "") -> msgspec.Meta:
    """Return the annotation of `Any` as one of several structs, of which the entry `tag` names one.

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


_record_struct = cache(struct_of)
"""Returns the struct of a dataclass, the same one each time."""


def _read_arguments(class_: Any) -> dict[str, str]:
    """Return the descriptions of arguments in a docstring, by name."""
    text = (inspect.getdoc(class_) or "").partition("Args:\n")[2].partition("\n\n")[0]
    entries = re.findall(r"^    (\w+): (.*(?:\n {8}.*)*)", text, re.M)
    return {name: " ".join(about.split()).rstrip(".") for name, about in entries}


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
    return (float if float in (first, *get_args(first)) else str) | _record_struct(type_)


def record(type_: Any) -> Any:
    """Return the type of an entry that is a dataclass: a table of its fields, or its first field."""

    def read(value: Any, at: Location, folder: Path | None) -> Any:
        return convert_value(value, type_, at.label, folder)

    return Annotated[type_in_file(type_), describe(read=read)]


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


DRAFT = "http://json-schema.org/draft-07/schema#"


def make_schema(type_: type[msgspec.Struct], title: str) -> dict[str, Any]:
    """Return the JSON Schema of a file.

    Args:
        type_: The struct that reads the file.
        title: The title of the schema.
    """
    types = dict.fromkeys([type_, *_list_alternatives(type_, set())])
    _, components = msgspec.json.schema_components(types, ref_template="#/definitions/{name}")
    definitions = {name: _adapt(components[name]) for name in sorted(components)}
    top = definitions.pop(type_.__name__)
    return {"$schema": DRAFT, **top, "title": title, "definitions": definitions}


def _list_alternatives(type_: Any, visited: set[Any]) -> Iterator[type[msgspec.Struct]]:
    """Yield the structs that `one_of` names in a type; msgspec does not see them."""
    if isinstance(type_, msgspec.Meta):
        for alternative in (type_.extra or {}).get("types", {}).values():
            yield alternative
            yield from _list_alternatives(alternative, visited)
    elif isinstance(type_, type) and issubclass(type_, msgspec.Struct):
        if type_ not in visited:
            visited.add(type_)
            for field in msgspec.structs.fields(type_):
                yield from _list_alternatives(field.type, visited)
    else:
        for part in get_args(type_):
            yield from _list_alternatives(part, visited)


def _adapt(node: Any) -> Any:
    """Return a part of a schema of msgspec as a file in TOML has it, in draft 7."""
    if isinstance(node, list):
        return [_adapt(part) for part in node]
    if not isinstance(node, Mapping):
        return node
    schema = {
        key: {name: _adapt(part) for name, part in value.items()} if key == "properties" else _adapt(value)
        for key, value in node.items()
        if key not in ("default", "x-dotted")
    }
    if "description" in schema and isinstance(schema["description"], str):
        schema["description"] = " ".join(schema["description"].split())
    if "anyOf" in schema:
        parts = [part for part in schema.pop("anyOf") if part != {"type": "null"}]  # TOML has no null
        schema = {**parts[0], **schema} if len(parts) == 1 else {"anyOf": parts, **schema}
    if "prefixItems" in schema:
        items = schema.pop("prefixItems")
        schema["items"] = items[0] if all(item == items[0] for item in items) else items
    if "pattern" in schema and schema.get("type") == "number":
        schema["type"] = ["number", "string"]
    if "pattern" in schema and schema.get("type") == "array":  # a single quantity is a list of one
        schema["type"] = ["array", "number", "string"]
        schema["items"] = {"type": ["number", "string"], "pattern": schema["pattern"]}
    if "properties" in schema:
        schema["additionalProperties"] = False
        schema["properties"] = _nest(schema["properties"])
    if node.get("x-dotted") and isinstance(schema.get("additionalProperties"), Mapping):
        schema["additionalProperties"] = {"anyOf": [schema["additionalProperties"], {"type": "object"}]}
    return schema


def _nest(properties: Mapping[str, Any]) -> dict[str, Any]:
    """Return the properties, and for names with dots also the tables as which TOML reads them."""
    tables, inner = dict(properties), dict[str, dict[str, Any]]()
    for name, value in properties.items():
        first, dot, rest = name.partition(".")
        if dot:
            inner.setdefault(first, {})[rest] = value
    for first, parts in inner.items():
        tables[first] = {"type": "object", "properties": _nest(parts), "additionalProperties": False}
    return tables
