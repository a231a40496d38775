"""Memory and C functions by address, for compiled code."""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import from_dtype, njit, types
from numba.extending import intrinsic

from .layout import GROUP, INPUT, LOOP, OPERATION, PRESENT, SLAVE

OPTIONS = {"nogil": True, "error_model": "numpy"}
"""What all functions are compiled with."""

part = njit(forceinline=True, **OPTIONS)
"""Makes a function a part of those that call it."""


def _records(layout: np.dtype) -> Any:
    """A function that gives the record number i of those that begin at an address, in place."""
    kind = from_dtype(layout)

    @intrinsic
    def record(typing_context: Any, address: Any, i: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            first = builder.inttoptr(values[0], context.get_value_type(kind))
            return builder.gep(first, [values[1]])

        return kind(types.intp, types.intp), generate

    return record


def _numbers(kind: types.Type) -> Any:
    """A function that gives the numbers that begin at an address."""

    @intrinsic
    def numbers(typing_context: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.inttoptr(values[0], context.get_value_type(signature.return_type))

        return types.CPointer(kind)(types.intp), generate

    return numbers


def _caller(*argument_types: types.Type) -> Any:
    """A function that calls the address of a C function with these arguments and an int result."""

    @intrinsic
    def call(typing_context: Any, address: Any, arguments: Any) -> Any:
        signature = types.int32(types.intp, types.Tuple(argument_types))

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            function, packed = values
            prototype = ir.FunctionType(
                context.get_value_type(types.int32), [context.get_value_type(t) for t in argument_types]
            )
            given = [builder.extract_value(packed, i) for i in range(len(argument_types))]
            return builder.call(builder.inttoptr(function, prototype.as_pointer()), given)

        return signature, generate

    return call


loop_at, operation_at, slave_at, input_at, group_at, present_at = (
    _records(r) for r in (LOOP, OPERATION, SLAVE, INPUT, GROUP, PRESENT)
)
doubles, positions = _numbers(types.float64), _numbers(types.intp)
exchange = _caller(types.intp, types.intp, types.uintp, types.intp)
derive = _caller(types.intp, types.intp, types.uintp, types.intp, types.intp)
do_step = _caller(types.intp, types.float64, types.float64, types.int32)
copy_state = _caller(types.intp, types.intp)
