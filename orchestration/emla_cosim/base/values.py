"""Conversion of values from outside to the types that they must have: of Python calls and of TOML files."""

import ast
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import msgspec

from .errors import CommandError
from .quantities import read_quantity
from .table_entries import Location, combine_problems, example_of, list_fields, missing_entry, unknown_entry

_NAMES = {float: "a number", int: "a whole number", bool: "true or false", str: "a text", Path: "a text"}
_BOUNDS = {">": "more than", ">=": "at least", "<": "less than", "<=": "at most"}
"""Words for the bounds in messages of msgspec, such as "Expected `float` >= 0.0"."""


def as_float(value: float) -> float:
    """Return a number as a float; infinity for a whole number that is too large for one."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def convert_value(value: Any, type_: Any, label: str, folder: Path | None = None) -> Any:
    """Convert a value to a type.

    Args:
        value: The value.
        type_: A number, a text, a path, a list or a table of these, a dataclass, or a struct of msgspec.
            `toml_structs` has annotations for units, bounds, and names with dots.
        label: What error messages call the value; for a struct, the name of the file.
        folder: The folder of relative paths.

    Raises:
        CommandError: If the value does not fit the type. The message lists all faults of a table.
    """
    is_file = isinstance(type_, type) and issubclass(type_, msgspec.Struct)
    return convert_at(value, type_, Location(label, label if is_file else None), folder)


def convert_at(value: Any, type_: Any, at: Location, folder: Path | None = None) -> Any:
    """Convert a value at a location in a file; see `convert_value`."""
    meta, extra = None, {}
    if get_origin(type_) is Annotated:
        type_, meta = get_args(type_)[:2]
        extra = meta.extra or {}
    if "is_value" in extra and isinstance(value, Mapping):
        value = _flatten(value, extra["is_value"], at)
    if "read" in extra:
        return extra["read"](value, at, folder)
    if "tag" in extra:
        type_ = _choose_by_tag(value, extra["tag"], extra["types"], at)
    if get_origin(type_) in (Union, UnionType):
        if value is None and NoneType in get_args(type_):
            return None
        type_ = _choose_member(value, [t for t in get_args(type_) if t not in (NoneType, msgspec.UnsetType)])
        if get_origin(type_) is Annotated:
            return convert_at(value, type_, at, folder)
    origin, inner = get_origin(type_), get_args(type_)
    if type_ is Any or value is msgspec.UNSET:
        return value
    if origin in (Mapping, dict):
        return _convert_mapping(value, inner[1], at, folder)
    if origin is tuple:
        quantities = meta is not None and "unit" in extra
        return _convert_tuple(
            value, [Annotated[t, meta] if quantities and t is float else t for t in inner], at
        )
    if origin in (Sequence, list):
        if isinstance(value, (str, bytes)) or not isinstance(value, Sequence):
            raise _make_type_error(at.label, value, "a list")
        return [convert_at(v, inner[0], at.item(i), folder) for i, v in enumerate(value)]
    if is_dataclass(type_):
        return _convert_record(value, type_, at, folder)
    if isinstance(type_, type) and issubclass(type_, msgspec.Struct):
        return _convert_table(value, type_, at, folder)
    return _convert_plain(value, type_, meta, at.label, folder)


def _flatten(table: Mapping[str, Any], is_value: Callable[[Mapping[str, Any]], bool], at: Location) -> Any:
    """Return entries by their full name: TOML nests names with dots unless they are quoted.

    An inner table is part of a name unless it `is_value`.
    """
    flat = dict[str, Any]()
    for key, value in table.items():
        nested = isinstance(value, Mapping) and not is_value(value)
        parts = {f"{key}.{name}": v for name, v in _flatten(value, is_value, at).items()} if nested else {}
        for name, inner in (parts if nested else {key: value}).items():
            if name in flat:
                raise CommandError(
                    f"{at.table} has the entry '{name}' twice, with and without quotes; remove one."
                )
            flat[name] = inner
    return flat


def list_elements(values: Mapping[Any, Any]) -> dict[Any, Any]:
    """Return the entries with `name[1]`, `name[2]` in place of one with a list, `name[1,2]` of nested lists.

    Args:
        values: Values by name: single ones, lists, or arrays of NumPy.

    Raises:
        CommandError: If lists in a list differ in length.
    """
    import numpy as np  # loading it takes longer than reading values without lists

    scalars: dict[Any, Any] = {}
    for name, value in values.items():
        many = value.tolist() if getattr(value, "ndim", 0) and value.size != 1 else value
        if not (isinstance(many, (list, tuple)) and many):
            scalars[name] = value
            continue
        array = np.array(many, dtype=object)  # rows of different lengths stay lists
        if not array.size or any(isinstance(element, (list, tuple)) for element in array.flat):
            raise CommandError(f"the rows of '{name}' are empty or differ in length.", name=name)
        for index, element in np.ndenumerate(array):
            scalars[f"{name}[{','.join(str(i + 1) for i in index)}]"] = element
    return scalars


def parse_list(text: str) -> Any:
    """Return the nested lists of texts that a text such as `[[1, 2], [3 kN, 4]]` describes.

    Raises:
        ValueError: The text is not a list.
    """
    quoted = re.sub(r"[^\[\],]+", lambda part: repr(part[0].strip()) if part[0].strip() else "", text)
    try:
        return ast.literal_eval(quoted)
    except SyntaxError as error:
        raise ValueError(text) from error


def _choose_by_tag(value: Any, tag: str, types: Mapping[str | None, Any], at: Location) -> Any:
    """Return the type that an entry of a table names; the type for None if the table lacks the entry."""
    name = value.get(tag) if isinstance(value, Mapping) else None
    if not isinstance(name, str | None) or name not in types:
        names = [repr(t) for t in types if t is not None]
        right = f"it must be {' or '.join(names)}" if names else f"remove it, since there is no {tag}"
        raise CommandError(f"{at.entry(tag).label} is {name!r}; {right}.", key=tag)
    return types[name]


def _choose_member(value: Any, members: Sequence[Any]) -> Any:
    """Return the member of a union for a value: by its form, if the union has tables or lists."""
    bases = [get_args(t)[0] if get_origin(t) is Annotated else t for t in members]
    plain = [t for t, base in zip(members, bases, strict=True) if base in _NAMES or get_origin(t) is Literal]
    if isinstance(value, (Mapping, list, tuple)) or not plain:
        return next((t for t in members if t not in plain), Union[tuple(members)])  # noqa: UP007
    if isinstance(value, str):  # a text that a number or a Boolean would refuse
        plain = [t for t in plain if t in (str, Path)] or plain
    return plain[0] if len(plain) == 1 else Union[tuple(plain)]  # noqa: UP007


def _convert_mapping(value: Any, of: Any, at: Location, folder: Path | None) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        right = f", {at.brackets}" if at.brackets else ' with entries such as "joint.component" = ...'
        raise _make_type_error(at.label, value, f"a table{right}")
    if wrong := [k for k in value if not isinstance(k, str)]:
        raise _make_type_error(f"the name of an entry in {at.label}", wrong[0], "a text")
    return {k: convert_at(v, of, at.entry(k), folder) for k, v in value.items()}


def _convert_tuple(value: Any, types: Sequence[Any], at: Location) -> tuple[Any, ...]:
    """Return a tuple; if it may have any length, a single value is a tuple, too."""
    is_list = isinstance(value, (list, tuple))
    if Ellipsis in types:
        return tuple(convert_at(v, types[0], at) for v in (value if is_list else [value]))
    if not is_list or len(value) != len(types):
        raise _make_type_error(at.label, value, f"a list of {len(types)} numbers")
    return tuple(convert_at(v, t, at) for v, t in zip(value, types, strict=True))


def _convert_table(value: Any, type_: Any, at: Location, folder: Path | None) -> Any:
    """Make a struct or a dataclass from a table of its fields."""
    if isinstance(value, type_):
        return value
    if not isinstance(value, Mapping):
        raise _make_type_error(at.label, value, f"a table, {at.brackets}" if at.brackets else "a table")
    fields, values, problems = list_fields(type_), dict[str, Any](), list[CommandError]()
    names = [field.name for field in fields]
    absent = [name for name in names if name not in value]
    problems += [unknown_entry(at.table, key, names, absent) for key in value if key not in names]
    misspelt = {name for error in problems for name in error.fields["near"]}
    for field in fields:
        if field.name in value:
            try:
                values[field.attribute] = convert_at(
                    value[field.name], field.type, at.entry(field.name), folder
                )
            except CommandError as error:
                problems.append(error)
        elif field.is_required and field.name not in misspelt:
            problems.append(missing_entry(field, at))
    if len(problems) == 1:
        raise problems[0]
    if problems:
        texts = [text for error in problems for text in error.fields.get("problems", [str(error)])]
        raise combine_problems(at.file or at.label, texts)
    return _make_object(type_, values, at)


def _make_object(type_: Any, values: Mapping[str, Any], at: Location) -> Any:
    """Make a struct or a dataclass; errors of its checks get its name."""
    try:
        return type_(**values)
    except ArithmeticError as error:
        raise CommandError(f"{at.table} has values that cannot be used: {error}.") from error
    except ValueError as error:
        raise CommandError(f"{at.table}{':' if is_dataclass(type_) else ''} {error}") from error


def _convert_plain(value: Any, type_: Any, meta: msgspec.Meta | None, label: str, folder: Path | None) -> Any:
    """Convert a value that is neither a table nor a list, and check its bounds."""
    converted = value
    if hasattr(value, "dtype") and hasattr(value, "item"):
        converted = value.item() if value.size == 1 else value.tolist()  # a NumPy scalar or array
    if meta is not None and "unit" in (meta.extra or {}):
        converted = _read_quantity(converted, meta.extra["unit"], label)  # type: ignore[index]
    if meta is not None and isinstance(converted, (int, float)) and not math.isfinite(as_float(converted)):
        raise _make_type_error(label, converted, "a finite number")
    target = str if type_ is Path else type_
    try:
        converted = msgspec.convert(
            str(converted) if isinstance(converted, Path) and type_ is Path else converted,
            target if meta is None else Annotated[target, meta],
        )
    except (msgspec.ValidationError, OverflowError) as error:
        right = _NAMES.get(type_, f"a number{', true, false' if bool in get_args(type_) else ''} or a text")
        if get_origin(type_) is Literal:
            right = " or ".join(map(repr, get_args(type_)))
        elif bound := re.match(r"Expected `\w+` ([<>]=?) ([-+.\w]+)", str(error)):
            right = f"{_BOUNDS[bound[1]]} {float(bound[2]):g}"
        raise _make_type_error(label, value, right) from None  # msgspec does not name the value
    if type_ is not Path:
        return converted
    return folder / converted if folder is not None else Path(converted)


def _read_quantity(value: Any, unit: str, label: str) -> Any:
    """Return a number in the unit; a text can have another unit of the same kind."""
    if isinstance(value, str):
        return read_quantity(value, label, unit or None)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise _make_type_error(
            label, value, f"a number{f' in {unit}, or a text with a unit' if unit else ''}"
        )
    return as_float(value)


def _convert_record(value: Any, type_: Any, at: Location, folder: Path | None) -> Any:
    """Make a dataclass from a table of its fields, from a text, or from the value of its first field."""
    if isinstance(value, (type_, Mapping)):
        return _convert_table(value, type_, at, folder)
    if isinstance(value, str) and hasattr(type_, "of_text"):
        converted = type_.of_text(value)
        return converted.within(folder) if folder is not None and hasattr(converted, "within") else converted
    fields = list_fields(type_)
    first = fields[0].type
    if isinstance(value, (str, Path)) or (isinstance(value, (int, float)) and _is_number_type(first)):
        return _make_object(type_, {fields[0].attribute: convert_at(value, first, at, folder)}, at)
    plain = "a number" if _is_number_type(first) else "a text" if hasattr(type_, "of_text") else "a path"
    texts = (f"{f.name} = {example_of(float if _is_number_type(f.type) else str)}" for f in fields)
    raise _make_type_error(at.label, value, f"{plain}, or {{ {', '.join(texts)} }}")


def _is_number_type(type_: Any) -> bool:
    return float in (type_, *get_args(type_))


def _make_type_error(label: str, value: Any, right: str) -> CommandError:
    return CommandError(f"{label} is {value!r}; it must be {right}.", value=value)
