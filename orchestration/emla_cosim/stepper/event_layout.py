"""The records of `native/event_tables.h`, which explains them, as types of NumPy and ctypes."""

import ctypes
from enum import IntEnum

import numpy as np

from .layout import _DOUBLE, _INT, _POINTER, CALL, of_kind

DO_STEP, UPDATE, SET_CLOCK, GET_CLOCK = "doStep", "updateDiscreteStates", "setClock", "getClock"

FUNCTIONS = (
    DO_STEP,
    "enterEventMode",
    "enterStepMode",
    UPDATE,
    SET_CLOCK,
    GET_CLOCK,
    "getIntervalDecimal",
    "getShiftDecimal",
)
"""FMI functions that events call, by their number in C."""

EVENT_CALLS = (*FUNCTIONS, "setting inputs", "getting clocked variables", "setting by hand")
"""All that events call, by its number in C."""

MOST_UPDATES = 1000
"""The number of ticks of a triggered clock in a step that is too large; `events.h` has it."""


class Problem(IntEnum):
    """What went wrong in events."""

    NONE = 0
    CALL = 1
    END = 2
    EARLY_RETURN = 3
    EVENT = 4
    WRONG_TIME = 5
    NO_EVENT_TIME = 6
    ENDLESS_UPDATES = 7
    ENDLESS_RETURNS = 8
    ENDLESS_TICKS = 9
    TICK_WITHIN_STEP = 10
    TICK_ALONE = 11
    TOO_MANY_TICKS = 12
    WRONG_INTERVAL = 13
    WRONG_SHIFT = 14


class ClockKind(IntEnum):
    """Kinds of clocks that tick at times; the FMU declares the interval of a periodic one, or tells it."""

    DECLARED = 0
    REPORTED = 1
    CHANGING = 2
    COUNTDOWN = 3


# 2 is the present time, which only C reads
NEXT_EVENT, END_REQUEST, FIRST_PASSED = 0, 1, 3
"""Positions in the memory: two times in s, and the first discrete input that the FMU has."""

TICKS_SIZE = 4
"""The numbers in the memory for each clock that ticks at times."""

CLOCK_SET = np.dtype([("first", "int32"), ("count", "int32")], align=True)
CLOCKED_CALL = np.dtype([("call", CALL), ("clocks", CLOCK_SET)], align=True)
TIMED_CLOCK = np.dtype(
    [("interval", "float64"), ("shift", "float64"), ("clock", "int32"), ("kind", "int32")], align=True
)
TRIGGERED_CLOCK = np.dtype([("clock", "int32"), ("input", "int32")], align=True)


class Events(ctypes.Structure):
    """The tables of an instance with events, its memory, and what went wrong in the last call."""

    _fields_ = (
        ("component", _POINTER),
        ("functions", len(FUNCTIONS) * _POINTER),
        ("codes", len(FUNCTIONS) * ctypes.c_int64),
        *of_kind(_POINTER, "clocks inputs discrete discrete_setters setters hand_setters getters needed"),
        *of_kind(_POINTER, "timed triggered listed"),
        *of_kind(_INT, "clock_count output_clock_count discrete_count discrete_setter_count"),
        *of_kind(_INT, "setter_count hand_setter_count getter_count timed_count triggered_count"),
        *of_kind(_INT, "memory_size has_event_mode may_return_early varies_step"),
        *of_kind(_POINTER, "memory passed schedule values counts marks active references"),
        *of_kind(_DOUBLE, "time first_return value"),
        *of_kind(_INT, "problem call status clock count unused"),
    )
    time: float
    first_return: float
    value: float
    problem: int
    call: int
    status: int
    clock: int
    count: int
    memory_size: int


EVENT_SIZES = (
    *(t.itemsize for t in (CLOCKED_CALL, CLOCK_SET, TIMED_CLOCK, TRIGGERED_CLOCK)),
    ctypes.sizeof(Events),
)
"""Sizes of the records, in the order of `events_sizes` in C."""
