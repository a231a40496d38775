"""Passes over recorded rows in compiled code. The module is imported only to be compiled."""

from numba import cfunc, types

from .by_address import OPTIONS, doubles


@cfunc(
    types.int64(types.intp, types.int64, types.int64, types.intp, types.intp, types.intp),
    **OPTIONS,
)
def reduce_rows(rows, count, width, lowest, highest, squares):
    """Update the smallest and largest value and the sum of squares of every column, in one pass.

    Args:
        rows: Address of the doubles of rows without gaps between them.
        count: Number of rows.
        width: Number of columns.
        lowest: Address of the smallest values so far, which NaN does not change.
        highest: Address of the largest ones.
        squares: Address of the sums of squares.
    """
    values, low, high, total = doubles(rows), doubles(lowest), doubles(highest), doubles(squares)
    even = count // 4 * 4
    for r in range(0, even, 4):
        for c in range(width):
            v0, v1 = values[r * width + c], values[(r + 1) * width + c]
            v2, v3 = values[(r + 2) * width + c], values[(r + 3) * width + c]
            least, most = low[c], high[c]
            least = v0 if v0 < least else least
            most = v0 if v0 > most else most
            least = v1 if v1 < least else least
            most = v1 if v1 > most else most
            least = v2 if v2 < least else least
            most = v2 if v2 > most else most
            least = v3 if v3 < least else least
            most = v3 if v3 > most else most
            low[c], high[c] = least, most
            total[c] += (v0 * v0 + v1 * v1) + (v2 * v2 + v3 * v3)
    for r in range(even, count):
        for c in range(width):
            v = values[r * width + c]
            low[c] = v if v < low[c] else low[c]
            high[c] = v if v > high[c] else high[c]
            total[c] += v * v
    return count


def text(name: str) -> str:
    """Return LLVM's text of `reduce_rows`, with this name."""
    return reduce_rows.inspect_llvm().replace(reduce_rows.native_name, name)
