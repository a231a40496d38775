"""Check that calls keep no memory."""

import ctypes
import gc
import time as clock
from collections import Counter
from collections.abc import Callable, Iterator

import numpy as np

from ..check import CheckOutcome, check, passed, skipped, warned
from ..host.experiment import make_experiment
from ..host.fresh_process import in_fresh_process
from ..host.hosted_instance import CallError, HostedInstance
from ..host.log import LOG
from ..host.other_values import list_settable, read_start
from ..host.process_state import can_read_memory, load_c_library, read_memory
from ..messages import list_left_out
from ..subject import Subject

# calls of a batch, unless they are slow: where the C library counts bytes, and where it does not
_CALLS = {True: 300, False: 1000}

_BATCHES = 4
_TIME_FRACTION = 0.01
"""Part of the time limit that a batch may take."""

_MOST_NAMES = 20
"""Variables in one call."""

_MIN_BYTES = 16.0
"""Bytes that each call must keep to count."""

_MIN_GROWTH = {True: 2.0**12, False: 2.0**15}
"""Bytes by which each batch must grow."""

_TYPES = ("Real", "Integer", "Boolean", "Enumeration", "String")


class _MemoryInfo(ctypes.Structure):
    """What glibc's `mallinfo2` returns."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in (
            *("arena", "ordblks", "smblks", "hblks", "hblkhd"),
            *("usmblks", "fsmblks", "uordblks", "fordblks", "keepcost"),
        )
    ]


def read_allocated() -> float | None:
    """Return the bytes that are allocated and not freed, used or not; None if the C library cannot say it."""
    try:
        count = load_c_library().mallinfo2
    except (AttributeError, OSError):
        return None
    count.restype = _MemoryInfo
    gc.collect()
    info = count()
    return float(info.uordblks + info.hblkhd)


@check("instance.memory", needs=("run.completes",), time_factor=2.0, advisory=True)
def calls(subject: Subject) -> CheckOutcome:
    """Check that the process does not grow while values are read and set, and states saved and freed."""
    if read_allocated() is None and not can_read_memory():
        message = "This system does not report how much memory a process uses."
        return skipped(message, gaps=(f"Memory that calls keep: {message}",))
    bytes_by_call, count = in_fresh_process(_measure_calls, subject)
    if bytes_by_call:
        lines = tuple(f"Each call of {call} keeps {size:.0f} bytes." for call, size in bytes_by_call.items())
        return warned(lines[0], details=lines if len(lines) > 1 else (), figures=bytes_by_call)
    numbers = Counter(v.type for v in subject.description.modelVariables if not v.clocks)
    gaps = tuple[str, ...]()
    for kind in _TYPES:
        first = min(numbers[kind], _MOST_NAMES)
        gaps += list_left_out(first, numbers[kind], f"{kind} variables were read.")
    return passed(f"{count} kinds of calls keep no memory.", gaps=gaps)


def _measure_calls(subject: Subject) -> tuple[dict[str, float], int]:
    """Return the bytes that each kind of call keeps, and how many kinds were called."""
    instance, course = HostedInstance(subject), make_experiment(subject, 1)
    instance.initialize(course.at(0), float(course.times[0]))
    bytes_by_call, count = {}, 0
    for name, call in _list_calls(instance):
        count += 1
        try:
            size = _measure(call, _TIME_FRACTION * subject.settings.seconds)
        except CallError:  # another check reports it
            break
        if size:
            bytes_by_call[name] = size
    return bytes_by_call, count


def _list_calls(instance: HostedInstance) -> Iterator[tuple[str, Callable[[], object]]]:
    subject = instance.subject
    variables = [v for v in subject.description.modelVariables if not v.clocks]
    for kind in _TYPES:
        if names := [v.name for v in variables if v.type == kind][:_MOST_NAMES]:
            yield f"fmi2Get{_choose_suffix(kind)}", lambda names=names: instance.get_together(names)
    for kind in _TYPES:
        inputs = [v for v in list_settable(subject, "input") if v.type == kind and not v.clocks][:_MOST_NAMES]
        if values := {v.name: read_start(v) for v in inputs}:
            yield f"fmi2Set{_choose_suffix(kind)}", lambda values=values: instance.set(values)
    if subject.has_capability("canGetAndSetFMUstate"):
        yield "fmi2GetFMUstate and fmi2FreeFMUstate", lambda: instance.free_state(instance.save_state())
        state = instance.save_state()
        yield "fmi2SetFMUstate", lambda: instance.restore_state(state)
        if subject.has_capability("canSerializeFMUstate"):
            yield "fmi2SerializeFMUstate", lambda: instance.serialize(state)


def _choose_suffix(kind: str) -> str:
    return "Integer" if kind == "Enumeration" else kind


def _measure(call: Callable[[], object], seconds: float) -> float:
    """Return the bytes that a call keeps; 0 if it keeps none."""
    counts = read_allocated() is not None
    call()  # what is allocated once is not a leak
    used, numbers = [_read_memory(counts)], list[int]()
    for _ in range(_BATCHES):
        until, number = clock.monotonic() + seconds, 0
        while number < _CALLS[counts] and (number < 2 or clock.monotonic() < until):
            call()
            number += 1
        LOG.lines.clear()
        used.append(_read_memory(counts))
        numbers.append(number)
        if used[-1] - used[-2] <= _MIN_GROWTH[counts]:
            return 0.0
    size = float(np.median(np.diff(used) / np.array(numbers)))
    return size if size > _MIN_BYTES else 0.0


def _read_memory(counts: bool) -> float:
    allocated = read_allocated() if counts else None
    return read_memory() if allocated is None else allocated
