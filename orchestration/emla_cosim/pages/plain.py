"""Convert values for JSON."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def to_plain(value: Any) -> Any:
    """Convert a value to dictionaries, lists, texts, finite numbers, Booleans and None.

    Numbers that JSON does not have become None; other objects become text.
    """
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {_text(str(name)): to_plain(inner) for name, inner in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [to_plain(inner) for inner in value]
    if isinstance(value, float):
        # JSON has neither NaN nor infinity
        return float(value) if math.isfinite(value) else None
    if value is None or isinstance(value, (bool, int)):
        return value
    return _text(str(value))


def _text(text: str) -> str:
    """Remove unpaired surrogates, which file names may contain."""
    return text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")
