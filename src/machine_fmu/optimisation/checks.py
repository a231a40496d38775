"""Checks of numbers in a problem."""

import math
from collections.abc import Sequence

from ..spline import TrajectoryError

_COUNTS = (
    "",
    "a finite number",
    *(f"{word} finite numbers" for word in ("two", "three", "four", "five", "six")),
)

_LARGEST = 1e9
"""Numbers must be smaller than this, in SI units."""


def is_number(x: object) -> bool:
    """Return whether this is a finite number that is not too large."""
    return isinstance(x, (int, float)) and not isinstance(x, bool) and math.isfinite(x) and abs(x) < _LARGEST


def is_position(x: object) -> bool:
    """Return whether these are two or three numbers."""
    return isinstance(x, (tuple, list)) and len(x) in (2, 3) and all(map(is_number, x))


def check_numbers(name: str, value: object, labels: Sequence[str], can_be_off: bool) -> None:
    """Check a value of a problem.

    Args:
        name: Its name.
        value: Numbers as many as labels; a single one without labels.
        labels: What the numbers are of, such as joints.
        can_be_off: Whether the value can be None.

    Raises:
        TrajectoryError: The value has another form.
    """
    if value is None and can_be_off:
        return
    is_list = isinstance(value, (tuple, list))
    values: Sequence[object] = value if is_list and labels else [value]  # type: ignore[assignment]
    count = max(len(labels), 1)
    if len(values) == count and all(map(is_number, values)) and is_list == bool(labels):
        return
    expected = _COUNTS[count] if count < len(_COUNTS) else f"{count} finite numbers"
    labels_text = f": {', '.join(labels)}" if labels else ""
    raise TrajectoryError(
        f"{name} is {value!r}; it must be {expected}{labels_text}{', or off' if can_be_off else ''}."
    )
