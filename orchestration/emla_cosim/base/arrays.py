"""Array types that all packages use, and types of signals."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
"""Numbers in one or two dimensions."""

Indices = NDArray[np.intp]
"""Positions in a vector."""

Mask = NDArray[np.bool_]
"""Truth values in one or two dimensions."""


def count_true_per_row(rows: Mask) -> Indices:
    """Return the number of true values per row; NumPy's count along an axis takes ten times as long."""
    return np.array([np.count_nonzero(row) for row in rows], dtype=np.intp)


def read_stored_array(values: Any, *shapes: tuple[int, ...]) -> Vector:
    """Return numbers of a checkpoint as an array.

    Args:
        values: Nested lists, or an array.
        *shapes: The allowed shapes.

    Raises:
        ValueError: If the numbers have none of these shapes.
    """
    array = np.array(values, dtype=float)
    for shape in shapes:
        if array.shape == shape or (array.size == 0 and 0 in shape):  # a list cannot store the shape (0, 3)
            return array.reshape(shape)
    raise ValueError(f"numbers of shape {array.shape} instead of {' or '.join(map(str, shapes))}")


_NUMBERS: Mapping[str, type] = {"Integer": np.int32, "Enumeration": np.int32, "Boolean": np.bool_}

COLUMN_TYPES = "types"
"""The entry of run.json, and of the metadata of a Parquet file, with the types of signals."""


@dataclass(frozen=True)
class SignalType:
    """The type of a signal.

    Attributes:
        kind: Real, Integer, Boolean, Enumeration or String.
        items: names of the values of an enumeration.
    """

    kind: str = "Real"
    items: Mapping[int, str] = field(default_factory=dict)

    @property
    def is_text(self) -> bool:
        """Whether values are texts, which rows carry as positions in a list of texts."""
        return self.kind == "String"

    @property
    def is_discrete(self) -> bool:
        """Whether values jump, so that plots draw steps."""
        return self.kind != "Real"

    def convert(self, values: Vector) -> Any:
        """Return values of a table in this type: int32, bool or float64; texts are returned as they are.

        Values of another type, such as NaN for an Integer, leave the whole column in float64.
        """
        number = _NUMBERS.get(self.kind)
        if number is None:
            return values
        with np.errstate(invalid="ignore"):
            converted = values.astype(number)
        return converted if np.array_equal(converted, values) else values


REAL = SignalType()


class Texts:
    """The texts of a run, in the order in which they came."""

    def __init__(self) -> None:
        self._codes: dict[str, int] = {}
        self._texts: list[str] = []

    def encode(self, text: str) -> float:
        """Return the position of a text in the list."""
        if text not in self._codes:
            self._codes[text] = len(self._texts)
            self._texts.append(text)
        return float(self._codes[text])

    def decode(self, codes: Vector) -> Any:
        """Return texts by position as an array of objects; empty texts where nothing was recorded."""
        texts = [self._texts[int(c)] if np.isfinite(c) else "" for c in codes]
        return np.array(texts, dtype=object)


def write_types(types: Mapping[str, SignalType]) -> dict[str, Any]:
    """Return the types of signals as plain data, without those of Reals."""
    return {
        name: {"type": t.kind} | ({"items": {str(k): v for k, v in t.items.items()}} if t.items else {})
        for name, t in types.items()
        if t.kind != "Real"
    }


def read_types(content: Any) -> dict[str, SignalType]:
    """Return types of signals from plain data or its JSON, without Reals; none if any content is wrong."""
    try:
        entries = json.loads(content) if isinstance(content, str) else content
        return {
            str(name): SignalType(entry["type"], {int(k): str(v) for k, v in entry.get("items", {}).items()})
            for name, entry in entries.items()
            if entry["type"] in (*_NUMBERS, "String")
        }
    except (AttributeError, KeyError, TypeError, ValueError):
        return {}
