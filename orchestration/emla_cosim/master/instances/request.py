"""Requests to the process of an isolated instance."""

from typing import Any, NamedTuple


class Request(NamedTuple):
    """A call by name; inputs and their slopes are set before it."""

    call: str
    arguments: tuple[Any, ...]
    inputs: bytes | None = None
    slopes: bytes | None = None
