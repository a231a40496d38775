"""FMUs that output data over time. One library for all reads the data from the FMU's resources."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .content import (
    ENDS,
    INTERPOLATIONS,
    MODEL,
    SPANS,
    TYPES,
    TableColumn,
    TableContent,
    TableOutput,
    span_name,
)

if TYPE_CHECKING:
    from .building import MOST_OUTPUTS, build_table

__all__ = [
    "ENDS",
    "INTERPOLATIONS",
    "MODEL",
    "MOST_OUTPUTS",
    "SPANS",
    "TYPES",
    "TableColumn",
    "TableContent",
    "TableOutput",
    "build_table",
    "span_name",
]


def __getattr__(name: str) -> Any:
    """Import the names that build the FMUs on first use."""
    if name not in ("MOST_OUTPUTS", "build_table"):
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return getattr(import_module(f"{__name__}.building"), name)
