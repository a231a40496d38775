"""Write table.bin: the numbers of a table in the format that data.h and resource.h read."""

import numpy as np

from ..errors import BuildError
from .content import ENDS, INTERPOLATIONS, Numbers, TableColumn, TableContent

_MAGIC = b"EMLATBL2"
_GUID_BYTES = 40
"""Bytes for the 38 letters of a GUID and zeros, in whole doubles."""


def pack_table(table: TableContent, guid: str) -> bytes:
    """Return the file: magic, count of numbers, the numbers (little-endian doubles), their checksum.

    The numbers begin with the GUID's letters; `guid` may be empty.

    Raises:
        BuildError: A column has no finite spline.
    """
    numbers = np.concatenate(
        [np.frombuffer(guid.encode().ljust(_GUID_BYTES, b"\0"), "<f8"), *_collect_parts(table)]
    )
    words = numbers.astype("<f8", copy=False).view("<u8")
    weights = 2 * np.arange(len(words), dtype=np.uint64) + np.uint64(1)
    total = np.sum(words * weights, dtype=np.uint64)  # modulo 2^64
    return _MAGIC + np.uint64(len(words)).tobytes() + words.tobytes() + total.tobytes()


def _collect_parts(table: TableContent) -> list[Numbers]:
    times = table.times
    head = [len(times), len(table.columns), len(table.outputs), ENDS.index(table.end), table.has_spans]
    kinds = [INTERPOLATIONS.index(c.interpolation) for c in table.columns]
    outputs = [x for o in table.outputs for x in (o.column, o.order, o.factor, o.offset or -0.0)]
    rows = np.empty((len(times), len(table.columns), 2))
    for i, column in enumerate(table.columns):
        rows[:, i, 0] = column.values
        rows[:, i, 1] = _compute_slopes(table, column)
    return [np.array([*head, *kinds, *outputs], dtype=float), times, rows.ravel(), _build_index(times)]


def _compute_slopes(table: TableContent, column: TableColumn) -> Numbers:
    """Return the slopes of the cubic spline of continuous curvature through a column.

    Its ends are "not a knot". If the table repeats and its last value equals the first, the spline is
    periodic. Rows with the same time divide the column into splines of their own.
    """
    slopes = np.zeros_like(column.values)
    if column.interpolation != "cubic":
        return slopes
    from scipy.interpolate import CubicSpline  # slow

    values, starts = column.values, np.flatnonzero(np.diff(table.times) == 0.0) + 1
    is_periodic = table.end == "repeat" and len(values) > 2 and values[0] == values[-1] and not starts.size
    try:
        with np.errstate(all="ignore"):
            for part in np.split(np.arange(len(values)), starts):
                if len(part) > 1:
                    spline = CubicSpline(
                        table.times[part], values[part], bc_type="periodic" if is_periodic else "not-a-knot"
                    )
                    slopes[part] = spline(table.times[part], 1)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        raise BuildError(f"cubic spline interpolation failed: {error}") from error
    if not np.isfinite(slopes).all():
        raise BuildError("cubic spline interpolation failed: non-finite slopes.")
    return slopes


def _build_index(times: Numbers) -> Numbers:
    """Divide the time into as many equal parts as there are rows, and return the row at each beginning."""
    starts = times[0] + np.arange(len(times)) * ((times[-1] - times[0]) / len(times))
    rows = np.searchsorted(times, starts, side="right") - 1
    return np.clip(rows, 0, len(times) - 2).astype(float)
