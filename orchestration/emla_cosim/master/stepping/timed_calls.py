"""FMI functions that measure the calls of an FMU's own: they read the clock before and after.

The loops call them like those of the FMU, with the address of a TIMED record as the component. So the loops
are the same with and without measurement. The module is imported only to be compiled.
"""

import os
import time
from typing import Any

from numba import cfunc, types

from .by_address import (
    OPTIONS,
    copy_state,
    derive,
    do_step,
    exchange,
    part,
    positions,
    read_clock,
    read_counter,
    timed_at,
)
from .record_layout import TimedCall

_COUNTS = os.name == "nt"
"""Whether the clock is a counter, as on Windows. Elsewhere it gives seconds and nanoseconds."""

_MONOTONIC = getattr(time, "CLOCK_MONOTONIC", 0)
_SECOND = 10**9


@part
def _now(timed):
    """Return the time in ticks of the clock."""
    now = positions(timed.now)
    if _COUNTS:
        read_counter(timed.clock, (timed.now,))
        return now[0]
    read_clock(timed.clock, (_MONOTONIC, timed.now))
    return now[0] * _SECOND + now[1]


@part
def _count(timed, call, began):
    """Add a call that began at a time and ends now."""
    positions(timed.ticks)[call] += _now(timed) - began
    positions(timed.calls)[call] += 1


def _exchange(call: int) -> Any:
    """Return a function that measures one with value references and values."""

    @cfunc(types.int32(types.intp, types.intp, types.uintp, types.intp), **OPTIONS)
    def timed_exchange(address, references, count, values):
        timed = timed_at(address, 0)
        began = _now(timed)
        status = exchange(positions(timed.functions)[call], (timed.component, references, count, values))
        _count(timed, call, began)
        return status

    return timed_exchange


def _copy_state(call: int) -> Any:
    """Return a function that measures one with a state."""

    @cfunc(types.int32(types.intp, types.intp), **OPTIONS)
    def timed_copy(address, state):
        timed = timed_at(address, 0)
        began = _now(timed)
        status = copy_state(positions(timed.functions)[call], (timed.component, state))
        _count(timed, call, began)
        return status

    return timed_copy


_DERIVATIVES, _STEP = int(TimedCall.DERIVATIVES), int(TimedCall.STEP)


@cfunc(types.int32(types.intp, types.intp, types.uintp, types.intp, types.intp), **OPTIONS)
def _timed_derive(address, references, count, orders, values):
    timed = timed_at(address, 0)
    began = _now(timed)
    function = positions(timed.functions)[_DERIVATIVES]
    status = derive(function, (timed.component, references, count, orders, values))
    _count(timed, _DERIVATIVES, began)
    return status


@cfunc(types.int32(types.intp, types.float64, types.float64, types.int32), **OPTIONS)
def _timed_step(address, begin, length, no_way_back):
    timed = timed_at(address, 0)
    began = _now(timed)
    status = do_step(positions(timed.functions)[_STEP], (timed.component, begin, length, no_way_back))
    _count(timed, _STEP, began)
    return status


@cfunc(types.int32(types.intp, types.intp), **OPTIONS)
def _do_nothing(component, state):
    return 0


@cfunc(types.int32(types.intp, types.intp, types.int64), **OPTIONS)
def _repeat(function, component, count):
    """Call a function with a component and no state many times."""
    status = 0
    for _ in range(count):
        status |= copy_state(function, (component, 0))
    return status


_FUNCTIONS = {
    "timed_inputs": _exchange(int(TimedCall.INPUTS)),
    "timed_derivatives": _timed_derive,
    "timed_step": _timed_step,
    "timed_outputs": _exchange(int(TimedCall.OUTPUTS)),
    "timed_save": _copy_state(int(TimedCall.SAVE)),
    "timed_restore": _copy_state(int(TimedCall.RESTORE)),
    "timed_observed": _exchange(int(TimedCall.OBSERVED)),
    "do_nothing": _do_nothing,
    "repeat": _repeat,
}


def text(name: str) -> str:
    """Return LLVM's text of a function, with this name."""
    function = _FUNCTIONS[name]
    return function.inspect_llvm().replace(function.native_name, name)
