"""Blocks in process, past initialization."""

from collections.abc import Mapping
from typing import Any

from fmublock import Block, Instance


def started(
    block: type[Block], values: Mapping[str, Any] | None = None, time: float = 0.0, name: str = ""
) -> Instance:
    """Return an instance with these start values, by FMI name, that has been initialized."""
    instance = Instance(block(), name)
    for variable, value in (values or {}).items():
        instance[variable] = value
    instance.setup_experiment(time)
    instance.enter_initialization()
    instance.exit_initialization()
    return instance
