"""What an isolated instance is asked."""

from typing import Any, NamedTuple


class Request(NamedTuple):
    """What an isolated instance is asked to do: first to set inputs and their slopes, then a call by name."""

    call: str
    arguments: tuple[Any, ...]
    inputs: bytes | None = None
    slopes: bytes | None = None
