"""The records of `native/stepper.h`, which explains them, as types of NumPy and ctypes."""

import ctypes
from enum import IntEnum

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


def _record(**fields: str) -> np.dtype:
    return np.dtype(list(fields.items()), align=True)


CALL = _record(
    function=_ADDRESS,
    component=_ADDRESS,
    references=_ADDRESS,
    values=_ADDRESS,
    code=_CODE,
    reference_count=_INT32,
    value_count=_INT32,
    is_version_3=_INT32,
    item_count=_INT32,
    items=_ADDRESS,
    places=_ADDRESS,
    type=_INT32,
    instance=_INT32,
)

INSTANCE = _record(
    component=_ADDRESS,
    do_step=_ADDRESS,
    setters=_ADDRESS,
    getters=_ADDRESS,
    code=_CODE,
    code_step=_INT32,
    setter_count=_INT32,
    getter_count=_INT32,
    first_input=_INT32,
    input_count=_INT32,
    first_output=_INT32,
    output_count=_INT32,
    mode=_INT32,
    is_version_3=_INT32,
    has_no_way_back=_INT32,
    is_rare=_INT32,
    is_held=_INT32,
    has_slopes=_INT32,
    code_derivatives=_INT32,
    code_save=_INT32,
    code_restore=_INT32,
    code_status=_INT32,
    set_derivatives=_ADDRESS,
    get_state=_ADDRESS,
    set_state=_ADDRESS,
    get_status=_ADDRESS,
    end_step=_ADDRESS,
    references=_ADDRESS,
    orders=_ADDRESS,
    end=_ADDRESS,
    state=_ADDRESS,
    events=_ADDRESS,
    effort=_ADDRESS,
)

SAVED_STATE = _record(state=_ADDRESS, events=_ADDRESS)

INPUT = _record(factor=_REAL, offset=_REAL, signal=_INT32, moves=_INT32, known=_INT32, unused=_INT32)

SIGNAL = _record(floor=_REAL, instance=_INT32, is_smooth=_INT32)

OPERATION = _record(every=_CODE, call=_INT32, target=_INT32, store=_INT32, unused=_INT32)

COMBINATION = _record(instance=_INT32, into=_INT32, first_term=_INT32, term_count=_INT32)

TERM = _record(factor=_REAL, store=_INT32, unused=_INT32)

GROUP = _record(
    members=_ADDRESS,
    coupling=_ADDRESS,
    operations=_ADDRESS,
    jacobian=_ADDRESS,
    guess=_ADDRESS,
    sizes=_ADDRESS,
    direction=_ADDRESS,
    earlier=_ADDRESS,
    basis=_ADDRESS,
    residuals=_ADDRESS,
    answers=_ADDRESS,
    kept=_ADDRESS,
    member_count=_INT32,
    coupling_count=_INT32,
    operation_count=_INT32,
    is_saved=_INT32,
    is_halved=_INT32,
)

EFFORT = np.dtype([("now", _ADDRESS), *((n, _CODE, 5) for n in ("counts", "nanoseconds", "unused"))])

DIVISION = _record(steps=_CODE, shortest=_REAL)

WAIT = _record(lane=_INT32, tasks=_INT32)

TASK = _record(waits=_ADDRESS, wait_count=_INT32, operation=_INT32)

LANE = _record(tasks=_ADDRESS, activity=_ADDRESS, task_count=_CODE)

_POINTER, _INT, _LONG, _DOUBLE = ctypes.c_void_p, ctypes.c_int32, ctypes.c_int64, ctypes.c_double


class Stepper(ctypes.Structure):
    """The tables of a system, its memory, and what ended its last run."""

    _fields_ = (
        ("instances", _POINTER),
        ("inputs", _POINTER),
        ("signals", _POINTER),
        ("operations", _POINTER),
        ("combinations", _POINTER),
        ("terms", _POINTER),
        ("groups", _POINTER),
        ("read", _POINTER),
        ("follows", _POINTER),
        ("observers", _POINTER),
        ("coupling_tolerance", _DOUBLE),
        ("signal_count", _INT),
        ("operation_count", _INT),
        ("group_count", _INT),
        ("read_count", _INT),
        ("observer_count", _INT),
        ("observed_count", _INT),
        ("sweep_limit", _INT),
        ("halving_limit", _INT),
        ("first_span", _INT),
        ("stores", _POINTER),
        ("at", _POINTER),
        ("before", _POINTER),
        ("input_values", _POINTER),
        ("derivatives", _POINTER),
        ("taken", _POINTER),
        ("taken_at", _POINTER),
        ("largest", _POINTER),
        ("observed", _POINTER),
        ("divisions", _POINTER),
        ("activity", _POINTER),
        ("stop", _POINTER),
        ("clock", 3 * _DOUBLE),
        ("last_point", _DOUBLE),
        ("reached", _LONG),
        ("recorded", _LONG),
        ("sweeps", _LONG),
        ("time", _DOUBLE),
        ("length", _DOUBLE),
        ("failure", _INT),
        ("instance", _INT),
        ("status", _INT),
        ("group", _INT),
        ("group_sweeps", _INT),
    )


CONTROLLED = _record(signal=_INT32, is_unread=_INT32, is_instant=_INT32)


class Control(ctypes.Structure):
    """Error control: its tables, its memory, where to go, and what came out."""

    _fields_ = (
        ("controlled", _POINTER),
        ("tolerance", _DOUBLE),
        ("divisor", _DOUBLE),
        ("start", _DOUBLE),
        ("leap_limit", _DOUBLE),
        ("short_limit", _DOUBLE),
        ("shortest", _DOUBLE),
        ("longest", _DOUBLE),
        ("controlled_count", _INT),
        ("instance_count", _INT),
        ("states", _POINTER),
        ("memory", _POINTER),
        ("copy", _POINTER),
        ("coarse", _POINTER),
        ("next_coarse", _POINTER),
        ("memory_count", _LONG),
        ("whole", _POINTER),
        ("errors", _POINTER),
        ("judged", _POINTER),
        ("total", _POINTER),
        ("first_errors", _POINTER),
        ("jumps", _POINTER),
        ("jumped", _POINTER),
        ("time", _DOUBLE),
        ("step", _DOUBLE),
        ("last_error", _DOUBLE),
        ("exponent", _DOUBLE),
        ("first_rejected", _DOUBLE),
        ("coarse_time", _DOUBLE),
        ("accepted", _LONG),
        ("rejected", _LONG),
        ("is_per_unit", _INT),
        ("is_event", _INT),
        ("point", _DOUBLE),
        ("enough", _DOUBLE),
        ("tried", _LONG),
        ("end", _DOUBLE),
        ("is_met", _INT),
        ("worst", _INT),
    )


class Halves(ctypes.Structure):
    """How steps are done in halves: see halves.c."""

    _fields_ = (
        ("parts", _POINTER),
        ("continuous", _POINTER),
        ("states", _POINTER),
        ("kept", _POINTER),
        ("continuous_count", _INT),
        ("instance_count", _INT),
    )


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
