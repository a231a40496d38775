"""What the compiled loop works on: records in memory, one per operation, slave and connected input.

Addresses point to doubles unless said otherwise. `loop.py` reads these records, `kernel.py` fills them.
"""

from enum import IntEnum

import numpy as np

from ...black_box import Present


class Failure(IntEnum):
    """What ended the loop before its last step; an FMI function, or a signal that is not finite."""

    NONE = 0
    SET_REAL = 1
    SET_DERIVATIVES = 2
    DO_STEP = 3
    GET_REAL = 4
    NOT_FINITE = 5


_ADDRESS, _NUMBER = "intp", "int64"


def _record(**fields: str | np.dtype) -> np.dtype:
    return np.dtype(list(fields.items()), align=True)


CLOCK = _record(first="float64", per_step="float64", denominator="float64")
"""See `timing.Clock`."""

PRESENT = np.dtype(Present)
"""See `Present`."""

OPERATION = _record(call=_NUMBER, slave=_NUMBER, code=_NUMBER)
"""A `Call`, the position of the slave, and what `Present` says meanwhile."""

INPUT = _record(
    signal=_ADDRESS,  # that drives the input
    previous=_ADDRESS,  # the value of that signal one communication point earlier
    at=_ADDRESS,  # when the signal was new
    before=_ADDRESS,  # when the previous one was
    taken=_ADDRESS,  # what the slave took of the signal last, if it steps rarely
    taken_at=_ADDRESS,  # when that was new
    factor="float64",
    offset="float64",
    moves="bool",  # whether signal and input are continuous
)

SLAVE = _record(
    component=_ADDRESS,  # of the instance
    set_real=_ADDRESS,  # of this FMI function, as the next three
    set_real_input_derivatives=_ADDRESS,
    do_step=_ADDRESS,
    get_real=_ADDRESS,
    input_references=_ADDRESS,  # of value references, as FMI functions take them
    derivative_orders=_ADDRESS,  # of C ints
    output_references=_ADDRESS,
    input_count=_NUMBER,
    output_count=_NUMBER,
    sources=_ADDRESS,  # of the first of its INPUT records
    inputs=_ADDRESS,
    derivatives=_ADDRESS,
    outputs=_ADDRESS,
    previous=_ADDRESS,  # the outputs one communication point earlier
    at=_ADDRESS,  # when the outputs were new
    before=_ADDRESS,  # when the previous ones were
    multiple=_NUMBER,
    mode=_NUMBER,  # a `Mode`
)

LOOP = _record(
    operations=_ADDRESS,  # of OPERATION records
    operation_count=_NUMBER,
    slaves=_ADDRESS,  # of SLAVE records
    signals=_ADDRESS,
    signal_count=_NUMBER,
    read=_ADDRESS,  # of positions of the signals that have to be finite
    read_count=_NUMBER,
    present=_ADDRESS,  # of a PRESENT record
    clock=CLOCK,
    reached=_NUMBER,  # answer: the step that failed, or the one after the last
    recorded=_NUMBER,  # answer: how many rows were filled; others may write to the PRESENT record
    slave=_NUMBER,  # answer: the slave that failed
    status=_NUMBER,  # answer: what its FMI function returned
)
"""What the loop is called with, and its answers."""
