"""Rows of doubles as data frames whose columns have the types of their signals."""

from collections.abc import Mapping, Sequence

import numpy as np
import polars

from ..base.arrays import Vector
from ..base.signal_types import REAL, SignalType, Texts

_POLARS = {
    "Real": polars.Float64,
    "Integer": polars.Int32,
    "Enumeration": polars.Int32,
    "Boolean": polars.Boolean,
    "String": polars.String,
}


def column_schema(names: Sequence[str], types: Mapping[str, SignalType]) -> dict[str, type[polars.DataType]]:
    """Return the types of columns for polars; Float64 for those without an entry."""
    return {name: _POLARS[types.get(name, REAL).kind] for name in names}


def typed_frame(
    rows: Vector, names: Sequence[str], types: Mapping[str, SignalType], texts: Texts
) -> polars.DataFrame:
    """Return rows as a data frame.

    Args:
        rows: array of shape (n, columns).
        names: names of the columns.
        types: types of the columns by name; Real for those without an entry.
        texts: texts of the columns that are Strings.
    """
    frame = polars.from_numpy(np.ascontiguousarray(rows), schema=list(names))
    schema = column_schema(names, types)
    return frame.with_columns(
        polars.Series(name, texts.decode(frame[name].to_numpy()), schema[name])
        if types[name].is_text
        else frame[name].cast(schema[name])
        for name in names
        if name in types
    )


def frame_rows(frame: polars.DataFrame) -> Vector:
    """Return a data frame as rows of doubles, with NaN for texts."""
    texts = polars.col(polars.String).is_null().cast(polars.Float64) * float("nan")
    return frame.with_columns(texts).cast(polars.Float64).to_numpy(order="c")
