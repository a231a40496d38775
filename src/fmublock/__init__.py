"""Write a block once, run it in process, and build it as an FMU for FMI 2.0 or 3.0.

A block is a class that declares typed variables and the equations that use them. A block file
imports its functions from here. They need the standard library only, so that the same file can
run inside a PythonFMU FMU. The functions that build FMUs are imported when they are first used.

    fmublock.Instance(Drive())           # run the block in this process
    fmublock.build(Drive, "Drive.fmu")   # build the FMU
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
from .variables import DiscreteState, Input, Output, Parameter, StartTime, State

if TYPE_CHECKING:
    from .building import build as build
    from .disclosure import Disclosure as Disclosure
    from .errors import BuildError as BuildError
    from .loading import load_block as load_block
    from .recipe import Documents as Documents
    from .recipe import Producer as Producer

# the names that a block file needs; `from fmublock import *` also works inside an FMU
__all__ = [
    "Block",
    "BlockError",
    "DefaultExperiment",
    "DiscreteState",
    "Input",
    "Instance",
    "Output",
    "Parameter",
    "StartTime",
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
    "Disclosure": "disclosure",
    "Documents": "recipe",
    "Producer": "recipe",
    "build": "building",
    "load_block": "loading",
}


def __getattr__(name: str) -> Any:
    """Import the names that build FMUs on first use.

    Inside an FMU they are None, so that a block file that imports them still runs there.
    """
    if name not in _LATER:
        raise AttributeError(f"module 'fmublock' has no attribute '{name}'")
    module = f"{__name__}.{_LATER[name]}"
    try:
        return getattr(import_module(module), name)
    except ModuleNotFoundError as error:
        if error.name != module:
            raise
        return None
