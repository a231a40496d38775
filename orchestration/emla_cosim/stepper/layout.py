"""The records of `native/stepper.h` and `native/event_tables.h` as types of NumPy and ctypes."""

import ctypes
from enum import IntEnum
from typing import Any

import numpy as np

_ADDRESS, _INT32, _CODE, _REAL = "intp", "int32", "int64", "float64"

TYPES = (
    *("float64", "float32", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"),
    "bool",
)
"""Types of values in memory, by their number in C."""

TRUTH_OF_FMI_2 = len(TYPES)
"""The number of C integers that are 0 or 1, the Booleans of FMI 2.0."""


class Call(IntEnum):
    """Operations of a program."""

    SET = 0
    STEP = 1
    GET = 2
    SOLVE = 3
    COMBINE = 4
    END = 5
    DIVIDE = 6
    END_DIVIDED = 7


class Failure(IntEnum):
    """Why a run of steps ended."""

    NONE = 0
    SET = 1
    DERIVATIVES = 2
    STEP = 3
    GET = 4
    NOT_FINITE = 5
    SAVE = 6
    RESTORE = 7
    NO_AGREEMENT = 8
    OBSERVE = 9
    LATE = 10
    INTERRUPTED = 11
    TOO_SHORT = 12


OUT_OF_RANGE = -(2**31)
"""A status: a value does not fit into the type of its input."""

SIGNALS, PREVIOUS, FIRST_STORE = 0, 1, 2
"""Positions of the vectors that operations read and combine."""


def list_fields(kind: Any, names: str) -> list[tuple[str, Any]]:
    """Return fields of one type; `names` are separated by blanks."""
    return [(name, kind) for name in names.split()]


def _make_record_type(*fields: tuple[str, str]) -> np.dtype:
    # aligned as a C compiler aligns a struct, so that the tables need no packing
    return np.dtype(list(fields), align=True)


CALL = _make_record_type(
    *list_fields(_ADDRESS, "function component references values"),
    ("code", _CODE),
    *list_fields(_INT32, "reference_count value_count is_version_3 item_count"),
    *list_fields(_ADDRESS, "items places"),
    *list_fields(_INT32, "type instance"),
)

INSTANCE = _make_record_type(
    *list_fields(_ADDRESS, "component do_step setters getters"),
    ("code", _CODE),
    *list_fields(_INT32, "code_step setter_count getter_count first_input input_count first_output"),
    *list_fields(_INT32, "output_count mode is_version_3 has_no_way_back is_rare is_held has_slopes"),
    *list_fields(_INT32, "code_derivatives code_save code_restore code_status"),
    *list_fields(_ADDRESS, "set_derivatives get_state set_state get_status end_step references orders end"),
    *list_fields(_ADDRESS, "state events effort"),
)

SAVED_STATE = _make_record_type(*list_fields(_ADDRESS, "state events"))

INPUT = _make_record_type(
    *list_fields(_REAL, "factor offset"), *list_fields(_INT32, "signal moves known unused")
)

SIGNAL = _make_record_type(("floor", _REAL), *list_fields(_INT32, "instance is_smooth"))

OPERATION = _make_record_type(("every", _CODE), *list_fields(_INT32, "call target store unused"))

COMBINATION = _make_record_type(*list_fields(_INT32, "instance into first_term term_count"))

TERM = _make_record_type(("factor", _REAL), *list_fields(_INT32, "store unused"))

GROUP = _make_record_type(
    *list_fields(_ADDRESS, "members coupling operations jacobian guess sizes direction earlier basis"),
    *list_fields(_ADDRESS, "residuals answers kept"),
    *list_fields(_INT32, "member_count coupling_count operation_count is_saved is_halved"),
)

# `unused` keeps the counters of two threads apart in their caches
EFFORT = np.dtype([("now", _ADDRESS), *((n, _CODE, 5) for n in ("counts", "nanoseconds", "unused"))])

DIVISION = _make_record_type(("steps", _CODE), ("shortest", _REAL))

WAIT = _make_record_type(*list_fields(_INT32, "lane tasks"))

TASK = _make_record_type(("waits", _ADDRESS), *list_fields(_INT32, "wait_count operation"))

LANE = _make_record_type(*list_fields(_ADDRESS, "tasks activity"), ("task_count", _CODE))

_POINTER, _INT, _LONG, _DOUBLE = ctypes.c_void_p, ctypes.c_int32, ctypes.c_int64, ctypes.c_double


class Stepper(ctypes.Structure):
    """The tables of a system, its memory, and what ended its last run."""

    _fields_ = (
        *list_fields(_POINTER, "instances inputs signals operations combinations terms groups read follows"),
        *list_fields(_POINTER, "observers"),
        ("coupling_tolerance", _DOUBLE),
        *list_fields(_INT, "signal_count operation_count group_count read_count observer_count"),
        *list_fields(_INT, "observed_count sweep_limit halving_limit first_span"),
        *list_fields(_POINTER, "stores at before input_values derivatives taken taken_at largest observed"),
        *list_fields(_POINTER, "divisions activity stop"),
        ("clock", 3 * _DOUBLE),
        ("last_point", _DOUBLE),
        *list_fields(_LONG, "reached recorded sweeps"),
        *list_fields(_DOUBLE, "time length"),
        *list_fields(_INT, "failure instance status group group_sweeps"),
    )


CONTROLLED = _make_record_type(*list_fields(_INT32, "signal is_unread is_instant"))


class Control(ctypes.Structure):
    """Error control: its tables, its memory, where to go, and what came out."""

    _fields_ = (
        ("controlled", _POINTER),
        *list_fields(_DOUBLE, "tolerance divisor start leap_limit short_limit shortest longest"),
        *list_fields(_INT, "controlled_count instance_count"),
        *list_fields(_POINTER, "states memory copy coarse next_coarse"),
        ("memory_count", _LONG),
        *list_fields(_POINTER, "whole errors judged total first_errors jumps jumped"),
        *list_fields(_DOUBLE, "time step last_error exponent first_rejected coarse_time"),
        *list_fields(_LONG, "accepted rejected"),
        *list_fields(_INT, "is_per_unit is_event"),
        *list_fields(_DOUBLE, "point enough"),
        ("tried", _LONG),
        ("end", _DOUBLE),
        *list_fields(_INT, "is_met worst"),
    )


class Halves(ctypes.Structure):
    """How steps are done in halves: see halves.c."""

    _fields_ = (
        *list_fields(_POINTER, "parts continuous states kept"),
        *list_fields(_INT, "continuous_count instance_count"),
    )


# compared when the library is loaded, because other sizes would corrupt memory
SIZES = (
    *(t.itemsize for t in (CALL, INSTANCE, INPUT, SIGNAL, OPERATION, COMBINATION, TERM, GROUP)),
    ctypes.sizeof(Stepper),
    CONTROLLED.itemsize,
    ctypes.sizeof(Control),
    SAVED_STATE.itemsize,
    EFFORT.itemsize,
    DIVISION.itemsize,
)
"""Sizes of the records, in the order of `stepper_sizes` in C."""

LANES_SIZES = tuple(t.itemsize for t in (WAIT, TASK, LANE))
"""Sizes of the records, in the order of `lanes_sizes` in C."""

HALVES_SIZE = (ctypes.sizeof(Halves),)
"""Size of `Halves`, as `halves_size` in C."""


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
        *list_fields(_POINTER, "clocks inputs discrete discrete_setters setters hand_setters getters needed"),
        *list_fields(_POINTER, "timed triggered listed"),
        *list_fields(_INT, "clock_count output_clock_count discrete_count discrete_setter_count"),
        *list_fields(_INT, "setter_count hand_setter_count getter_count timed_count triggered_count"),
        *list_fields(_INT, "memory_size has_event_mode may_return_early varies_step"),
        *list_fields(_POINTER, "memory passed schedule values counts marks active references"),
        *list_fields(_DOUBLE, "time first_return value"),
        *list_fields(_INT, "problem call status clock count unused"),
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
