"""Access memory and C functions by address in compiled code."""

import platform
from typing import Any

import numpy as np
from llvmlite import ir
from numba import from_dtype, njit, types
from numba.extending import intrinsic

from .record_layout import (
    BLOCK,
    CONTROL,
    FORWARDED,
    GROUP,
    INPUT,
    INSTANCE,
    LANE,
    LOOP,
    OBSERVED,
    OPERATION,
    PRESENT,
    TASK,
    TIMED,
    TYPED,
)

OPTIONS = {"nogil": True, "error_model": "numpy"}
"""Options of numba for all functions."""

part = njit(forceinline=True, **OPTIONS)
"""Decorator for functions that are inlined into their callers."""


def _records(layout: np.dtype) -> Any:
    """Return a function that accesses record i of an array of records at an address, in place."""
    kind = from_dtype(layout)

    @intrinsic
    def record(typing_context: Any, address: Any, i: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            first = builder.inttoptr(values[0], context.get_value_type(kind))
            return builder.gep(first, [values[1]])

        return kind(types.intp, types.intp), generate

    return record


def _numbers(kind: types.Type) -> Any:
    """Return a function that accesses the array of numbers at an address."""

    @intrinsic
    def numbers(typing_context: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.inttoptr(values[0], context.get_value_type(signature.return_type))

        return types.CPointer(kind)(types.intp), generate

    return numbers


def _caller(*argument_types: types.Type, result: types.Type = types.int32) -> Any:
    """Return a function that calls a C function by address, with these types of arguments and result."""

    @intrinsic
    def call(typing_context: Any, address: Any, arguments: Any) -> Any:
        signature = result(types.intp, types.Tuple(argument_types))

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            function, packed = values
            prototype = ir.FunctionType(
                context.get_value_type(result), [context.get_value_type(t) for t in argument_types]
            )
            given = [builder.extract_value(packed, i) for i in range(len(argument_types))]
            return builder.call(builder.inttoptr(function, prototype.as_pointer()), given)

        return signature, generate

    return call


def _counter(order: str) -> Any:
    """Return a function that loads a number atomically, with the other threads' earlier writes."""

    @intrinsic
    def load(typing_context: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.load_atomic(builder.inttoptr(values[0], _COUNTER), order, _SIZE)

        return types.int64(types.intp), generate

    return load


def _count(order: str) -> Any:
    """Return a function that stores a number atomically, after all earlier writes of this thread."""

    @intrinsic
    def store(typing_context: Any, address: Any, number: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            builder.store_atomic(values[1], builder.inttoptr(values[0], _COUNTER), order, _SIZE)
            return context.get_dummy_value()

        return types.void(types.intp, types.int64), generate

    return store


def _lower() -> Any:
    """Return a function that replaces a number atomically by its minimum with another."""

    @intrinsic
    def lower(typing_context: Any, address: Any, number: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.atomic_rmw("min", builder.inttoptr(values[0], _COUNTER), values[1], "acq_rel")

        return types.int64(types.intp, types.int64), generate

    return lower


def _pause() -> Any:
    """Return a function that hints to the processor that this thread waits, if it has such a hint."""

    @intrinsic
    def pause(typing_context: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            if platform.machine().lower() in ("x86_64", "amd64"):
                builder.call(builder.module.declare_intrinsic("llvm.x86.sse2.pause", (), _NOTHING), ())
            return context.get_dummy_value()

        return types.void(), generate

    return pause


_SIZE, _COUNTER = 8, ir.IntType(64).as_pointer()
_NOTHING = ir.FunctionType(ir.VoidType(), ())

loop_at, operation_at, instance_at, input_at, group_at, present_at, lane_at, task_at, observed_at = (
    _records(r) for r in (LOOP, OPERATION, INSTANCE, INPUT, GROUP, PRESENT, LANE, TASK, OBSERVED)
)
timed_at, control_at, block_at = (_records(r) for r in (TIMED, CONTROL, BLOCK))
forwarded_at, typed_at = (_records(r) for r in (FORWARDED, TYPED))
numbers = {kind: _numbers(kind) for kind in (types.float64, types.float32, *types.integer_domain)}
doubles, positions, integers = numbers[types.float64], numbers[types.intp], numbers[types.int32]
flags = numbers[types.uint8]
exchange = _caller(types.intp, types.intp, types.uintp, types.intp)
exchange_3 = _caller(types.intp, types.intp, types.uintp, types.intp, types.uintp)
derive = _caller(types.intp, types.intp, types.uintp, types.intp, types.intp)
do_step = _caller(types.intp, types.float64, types.float64, types.int32)
do_step_3 = _caller(types.intp, types.float64, types.float64, types.int32, *[types.intp] * 4)
copy_state = _caller(types.intp, types.intp)
give_way = _caller()
read_clock = _caller(types.int32, types.intp)
read_counter = _caller(types.intp)
seconds = _caller(types.intp)
power = _caller(types.float64, types.float64, result=types.float64)
counted, count_to, lower, pause = _counter("acquire"), _count("release"), _lower(), _pause()
