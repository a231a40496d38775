"""Functions with the arguments of FMI 2.0 that call those of FMI 3.0; see `forwarding`.

Their component is the address of a FORWARDED record. The module is imported only to be compiled.
"""

import numpy as np
from numba import cfunc, types

from ...stepper.layout import OUT_OF_RANGE
from .by_address import (
    OPTIONS,
    copy_state,
    doubles,
    exchange_3,
    forwarded_at,
    numbers,
    part,
    positions,
    typed_at,
)
from .compiled_calls import whole_step
from .machine_code import inline
from .record_layout import KINDS

_DOUBLE, _SINGLE, _BOOLEAN = (KINDS.index(kind) for kind in ("float64", "float32", "bool"))
_INT8, _UINT8, _INT16, _UINT16, _INT32, _UINT32, _INT64 = (
    KINDS.index(kind) for kind in ("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64")
)
_singles, _int8s, _uint8s, _int16s, _uint16s, _int32s, _uint32s, _int64s, _uint64s = (
    numbers[getattr(types, kind)] for kind in KINDS[1:-1]
)
_EXCHANGE = types.int32(types.intp, types.intp, types.uintp, types.intp)
_COPY = types.int32(types.intp, types.intp)


@part
def _store(memory, kind, place, value):
    """Write a value that fits into its type."""
    if kind == _DOUBLE:
        doubles(memory)[place] = value
    elif kind == _SINGLE:
        _singles(memory)[place] = np.float32(value)
    elif kind == _INT8:
        _int8s(memory)[place] = np.int8(value)
    elif kind == _UINT8:
        _uint8s(memory)[place] = np.uint8(value)
    elif kind == _INT16:
        _int16s(memory)[place] = np.int16(value)
    elif kind == _UINT16:
        _uint16s(memory)[place] = np.uint16(value)
    elif kind == _INT32:
        _int32s(memory)[place] = np.int32(value)
    elif kind == _UINT32:
        _uint32s(memory)[place] = np.uint32(value)
    elif kind == _INT64:
        _int64s(memory)[place] = np.int64(value)
    elif kind == _BOOLEAN:
        _uint8s(memory)[place] = np.uint8(1 if value != 0.0 else 0)
    else:
        _uint64s(memory)[place] = np.uint64(value)


@part
def _load(memory, kind, place):
    """Return a value as a double."""
    if kind == _DOUBLE:
        return doubles(memory)[place]
    if kind == _SINGLE:
        return float(_singles(memory)[place])
    if kind == _INT8:
        return float(_int8s(memory)[place])
    if kind == _UINT8:
        return float(_uint8s(memory)[place])
    if kind == _INT16:
        return float(_int16s(memory)[place])
    if kind == _UINT16:
        return float(_uint16s(memory)[place])
    if kind == _INT32:
        return float(_int32s(memory)[place])
    if kind == _UINT32:
        return float(_uint32s(memory)[place])
    if kind == _INT64:
        return float(_int64s(memory)[place])
    if kind == _BOOLEAN:
        return 1.0 if _uint8s(memory)[place] != 0 else 0.0
    return float(_uint64s(memory)[place])


@part
def _call(forwarded, typed):
    arguments = typed.references, typed.reference_count, typed.memory, typed.memory_count
    return exchange_3(typed.function, (forwarded.component, *arguments))


@part
def _badness(status):
    """See `typed_values`."""
    return status if status >= 0 else 1 - status


@cfunc(_EXCHANGE, **OPTIONS)
def set_typed_values(address, references, count, values):
    """Set values of several types as `TypedValues.set` does. Return the worst status."""
    forwarded, vector, worst = forwarded_at(address, 0), doubles(values), 0
    for g in range(forwarded.setter_count):
        typed = typed_at(forwarded.setters, g)
        elements, places, kind = positions(typed.elements), positions(typed.places), typed.kind
        for e in range(typed.count):
            value = vector[elements[e]]
            if kind != _DOUBLE and kind != _SINGLE:
                value = np.rint(value)
                if kind != _BOOLEAN and not (typed.low <= value < typed.limit):
                    return OUT_OF_RANGE
            _store(typed.memory, kind, places[e], value)
        status = _call(forwarded, typed)
        if _badness(status) > _badness(worst):
            worst = status
    return worst


@cfunc(_EXCHANGE, **OPTIONS)
def get_typed_values(address, references, count, values):
    """Get values of several types as `TypedValues.get` does. Return the worst status."""
    forwarded, vector, worst = forwarded_at(address, 0), doubles(values), 0
    for g in range(forwarded.getter_count):
        typed = typed_at(forwarded.getters, g)
        elements, places = positions(typed.elements), positions(typed.places)
        status = _call(forwarded, typed)
        if _badness(status) > _badness(worst):
            worst = status
        for e in range(typed.count):
            vector[elements[e]] = _load(typed.memory, typed.kind, places[e])
    return worst


@cfunc(_EXCHANGE, **OPTIONS)
def _set_values(address, references, count, values):
    forwarded = forwarded_at(address, 0)
    return exchange_3(forwarded.set, (forwarded.component, references, forwarded.set_count, values, count))


@cfunc(_EXCHANGE, **OPTIONS)
def _get_values(address, references, count, values):
    forwarded = forwarded_at(address, 0)
    return exchange_3(forwarded.get, (forwarded.component, references, forwarded.get_count, values, count))


@cfunc(types.int32(types.intp, types.float64, types.float64, types.int32), **OPTIONS)
def _step(address, begin, length, no_way_back):
    forwarded = forwarded_at(address, 0)
    function, component, end = forwarded.do_step, forwarded.component, forwarded.step_end
    return whole_step(function, component, begin, length, no_way_back, end)


@cfunc(_COPY, **OPTIONS)
def _get_state(address, state):
    forwarded = forwarded_at(address, 0)
    return copy_state(forwarded.get_state, (forwarded.component, state))


@cfunc(_COPY, **OPTIONS)
def _set_state(address, state):
    forwarded = forwarded_at(address, 0)
    return copy_state(forwarded.set_state, (forwarded.component, state))


_FUNCTIONS = {
    "set_typed_values": set_typed_values,
    "get_typed_values": get_typed_values,
    "set_values": _set_values,
    "get_values": _get_values,
    "step": _step,
    "get_state": _get_state,
    "set_state": _set_state,
}


def text(name: str) -> str:
    """Return LLVM's text of a function, with this name."""
    function = _FUNCTIONS[name]
    return inline(function.inspect_llvm().replace(function.native_name, name))
