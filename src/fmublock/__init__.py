"""Write a block once, run it in process, and build it as an FMI 2.0 co-simulation FMU.

A block is a class: typed variables beside the equations that use them. What a block file
needs is imported from here; it needs nothing but the standard library, so that the same text
can run inside a PythonFMU FMU. The exporters (`fmublock.native`, `fmublock.python_flavour`)
are imported only by whoever builds.
"""

from .block import Block, DefaultExperiment
from .functions import (
    arctan,
    clamp,
    cos,
    exp,
    floor,
    limit_magnitude,
    log,
    logical_and,
    logical_not,
    logical_or,
    maximum,
    minimum,
    mod,
    sign,
    sin,
    sqrt,
    where,
)
from .variables import DiscreteState, Input, Output, Parameter, State

__all__ = [
    "Block",
    "DefaultExperiment",
    "DiscreteState",
    "Input",
    "Output",
    "Parameter",
    "State",
    "arctan",
    "clamp",
    "cos",
    "exp",
    "floor",
    "limit_magnitude",
    "log",
    "logical_and",
    "logical_not",
    "logical_or",
    "maximum",
    "minimum",
    "mod",
    "sign",
    "sin",
    "sqrt",
    "where",
]
