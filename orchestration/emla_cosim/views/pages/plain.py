"""Values as JSON has them."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def to_plain(value: Any) -> Any:
    """The same as nothing but dictionaries, lists, texts, numbers that are finite, booleans and None.

    Of what JSON has not, a number is None, anything else text.
    """
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {_text(str(name)): to_plain(inner) for name, inner in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [to_plain(inner) for inner in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if value is None or isinstance(value, (bool, int)):
        return value
    return _text(str(value))


def _text(text: str) -> str:
    """Without halves of characters, as names of files may have them, which are not Unicode."""
    return text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")
