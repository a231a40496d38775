"""Conversion of values from outside to the types that they must have."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

import msgspec

from .errors import CommandError

_NAMES = {float: "a number", int: "a whole number", bool: "true or false", str: "a text", Path: "a text"}


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
        type_: A number, a text, a path, a list or a table of these, or a dataclass.
        label: What error messages call the value.
        folder: The folder of relative paths.

    Raises:
        CommandError: If the value does not fit the type.
    """
    origin, inner = get_origin(type_), get_args(type_)
    if origin in (Union, UnionType) and NoneType in inner:
        return None if value is None else convert_value(value, Union[inner[:-1]], label, folder)  # noqa: UP007
    if origin is Mapping:
        if not isinstance(value, Mapping):
            raise _type_error(label, value, 'a table with entries such as "joint.component" = ...')
        if wrong := [k for k in value if not isinstance(k, str)]:
            raise _type_error(f"the name of an entry in {label}", wrong[0], "a text")
        return {k: convert_value(v, inner[1], f"'{k}' in {label}", folder) for k, v in value.items()}
    if origin is Sequence:
        if isinstance(value, (str, bytes)) or not isinstance(value, Sequence):
            raise _type_error(label, value, "a list")
        return [convert_value(v, inner[0], f"'{i}' in {label}", folder) for i, v in enumerate(value)]
    if is_dataclass(type_):
        return _convert_record(value, type_, label, folder)
    return _convert_plain(value, type_, label, folder)


def list_elements(values: Mapping[Any, Any]) -> dict[Any, Any]:
    """Replace each entry that has a list by entries `name[1]`, `name[2]`, of nested lists by `name[1,2]`.

    Args:
        values: Values by name: single ones, lists, or arrays of NumPy.

    Raises:
        CommandError: If lists in a list differ in length.
    """
    found: dict[Any, Any] = {}
    for name, value in values.items():
        many = value.tolist() if getattr(value, "ndim", 0) and value.size != 1 else value
        if not (isinstance(many, (list, tuple)) and many):
            found[name] = value
            continue
        elements = dict(_elements_of(many))
        if (
            not elements
            or len({len(index) for index in elements}) > 1
            or len(elements)
            != math.prod(max(index[k] for index in elements) for k in range(len(next(iter(elements)))))
        ):
            raise CommandError(f"the rows of '{name}' are empty or differ in length.", name=name)
        found |= {f"{name}[{','.join(map(str, index))}]": one for index, one in elements.items()}
    return found


def _elements_of(many: Sequence[Any], outer: tuple[int, ...] = ()) -> Iterator[tuple[tuple[int, ...], Any]]:
    """Yield the elements of nested lists with their indices, which begin at 1."""
    for i, one in enumerate(many, 1):
        if isinstance(one, (list, tuple)):
            yield from _elements_of(one, (*outer, i))
        else:
            yield (*outer, i), one


def parse_list(text: str) -> Any:
    """Return the nested lists of texts that a text such as `[[1, 2], [3 kN, 4]]` describes.

    Raises:
        ValueError: The text is not a list.
    """
    stack: list[list[Any]] = [[]]
    for token in re.findall(r"[\[\],]|[^\[\],]+", text):
        if token == "[":
            stack.append([])
        elif token == "]" and len(stack) > 1:
            done = stack.pop()
            stack[-1].append(done)
        elif token == "]":
            raise ValueError(text)
        elif token != "," and token.strip():
            stack[-1].append(token.strip())
    if len(stack) != 1 or len(stack[0]) != 1 or not isinstance(stack[0][0], list):
        raise ValueError(text)
    return stack[0][0]


def _convert_plain(value: Any, type_: Any, label: str, folder: Path | None) -> Any:
    """Convert a value that is neither a table nor a list."""
    if hasattr(value, "dtype") and hasattr(value, "item"):
        value = value.item() if value.size == 1 else value.tolist()  # a NumPy scalar or array
    wanted = str if type_ is Path else type_
    if type_ is Path and isinstance(value, Path):
        value = str(value)
    try:
        found = msgspec.convert(value, wanted)
    except (msgspec.ValidationError, OverflowError):
        right = _NAMES.get(type_, "a number, true, false or a text")
        raise _type_error(label, value, right) from None
    if type_ is not Path:
        return found
    return folder / found if folder is not None else Path(found)


def _convert_record(value: Any, type_: Any, label: str, folder: Path | None) -> Any:
    """Make a dataclass from a table of its fields, or from the value of its first field."""
    if isinstance(value, type_):
        return value
    first, *more = fields(type_)
    if isinstance(value, str) and hasattr(type_, "of_text"):
        found = type_.of_text(value)
        return found.within(folder) if folder is not None and hasattr(found, "within") else found
    if isinstance(value, (str, Path)) or (isinstance(value, (int, float)) and _is_number(first.type)):
        return type_(convert_value(value, first.type, label, folder))
    names = {f.name for f in (first, *more)}
    needed = {f.name for f in (first, *more) if f.default is MISSING and f.default_factory is MISSING}
    if not isinstance(value, Mapping) or set(value) - names or needed - set(value):
        plain = "a number" if _is_number(first.type) else "a text" if hasattr(type_, "of_text") else "a path"
        shown = {True: "...", False: '"..."'}
        texts = (f"{f.name} = {shown[_is_number(f.type)]}" for f in (first, *more))
        raise _type_error(label, value, f"{plain}, or {{ {', '.join(texts)} }}")
    types = {f.name: f.type for f in (first, *more)}
    return type_(**{k: convert_value(v, types[k], f"'{k}' in {label}", folder) for k, v in value.items()})


def _is_number(type_: Any) -> bool:
    return float in (type_, *get_args(type_))


def _type_error(label: str, value: Any, right: str) -> CommandError:
    return CommandError(f"{label} is {value!r}; it must be {right}.", value=value)
