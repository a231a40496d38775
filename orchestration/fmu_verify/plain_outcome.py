"""Outcomes as text: the process of an FMU sends them, so that reading them must not execute anything."""

import dataclasses
import json
from typing import Any, get_origin

import msgspec
import numpy as np

from .verdict import CheckOutcome


def write_outcome(outcome: CheckOutcome) -> bytes:
    """Return an outcome as one line of JSON, without its end."""
    return json.dumps(outcome, default=_to_plain).encode("ascii")


def read_outcome(text: bytes) -> CheckOutcome:
    """Return the outcome of `write_outcome`.

    Raises:
        ValueError: It is something else.
    """
    try:
        return msgspec.convert(json.loads(text), CheckOutcome, dec_hook=_to_array)
    except (RecursionError, TypeError) as error:
        raise ValueError(str(error)) from None


def _to_plain(content: Any) -> Any:
    if dataclasses.is_dataclass(content):
        return {f.name: getattr(content, f.name) for f in dataclasses.fields(content)}
    if isinstance(content, (np.ndarray, np.generic)):
        return content.tolist()
    raise TypeError(f"{type(content).__name__} is not plain data")


def _to_array(kind: Any, content: Any) -> Any:
    if get_origin(kind) is np.ndarray and isinstance(content, list):
        return np.array(content, dtype=np.float64)
    raise ValueError(f"{kind} is not plain data")
