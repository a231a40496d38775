"""Data over time as FMUs: one library for all of them, which reads the data from the FMU's resources."""

from .building import MODEL, MOST_OUTPUTS, build_table
from .content import ENDS, INTERPOLATIONS, Column, DataUnit, Shown, Table

__all__ = [
    "ENDS",
    "INTERPOLATIONS",
    "MODEL",
    "MOST_OUTPUTS",
    "Column",
    "DataUnit",
    "Shown",
    "Table",
    "build_table",
]
