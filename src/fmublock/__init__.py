"""Write a block once, run it in process, and build it as an FMI 2.0 co-simulation FMU.

A block is a class: typed variables beside the equations that use them. What a block file
needs is imported from here; it needs nothing but the standard library, so that the same text
can run inside a PythonFMU FMU. What builds FMUs is imported when it is first used.

    fmublock.Instance(Drive())           runs it in process
    fmublock.build(Drive, "Drive.fmu")   makes the FMU
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .block import Block, DefaultExperiment
from .functions import (
    arccos,
    arcsin,
    arctan,
    arctan2,
    clamp,
    cos,
    dot,
    exp,
    floor,
    limit_magnitude,
    log,
    logical_and,
    logical_not,
    logical_or,
    matvec,
    maximum,
    minimum,
    mod,
    sign,
    sin,
    sqrt,
    tan,
    tanh,
    where,
)
from .instance import BlockError, Instance, StepDiscardedError
from .variables import DiscreteState, Input, Output, Parameter, State

if TYPE_CHECKING:
    from .building import build as build
    from .errors import BuildError as BuildError
    from .loading import load_block as load_block
    from .recipe import Documents as Documents
    from .recipe import Producer as Producer

# what a block file needs, which `from fmublock import *` gives also inside an FMU
__all__ = [
    "Block",
    "BlockError",
    "DefaultExperiment",
    "DiscreteState",
    "Input",
    "Instance",
    "Output",
    "Parameter",
    "State",
    "StepDiscardedError",
    "arccos",
    "arcsin",
    "arctan",
    "arctan2",
    "clamp",
    "cos",
    "dot",
    "exp",
    "floor",
    "limit_magnitude",
    "log",
    "logical_and",
    "logical_not",
    "logical_or",
    "matvec",
    "maximum",
    "minimum",
    "mod",
    "sign",
    "sin",
    "sqrt",
    "tan",
    "tanh",
    "where",
]

_LATER = {
    "BuildError": "errors",
    "Documents": "recipe",
    "Producer": "recipe",
    "build": "building",
    "load_block": "loading",
}


def __getattr__(name: str) -> Any:
    """What builds FMUs, imported on first use; None inside an FMU, whose block may import it in vain."""
    if name not in _LATER:
        raise AttributeError(f"module 'fmublock' has no attribute '{name}'")
    module = f"{__name__}.{_LATER[name]}"
    try:
        return getattr(import_module(module), name)
    except ModuleNotFoundError as error:
        if error.name != module:
            raise
        return None
