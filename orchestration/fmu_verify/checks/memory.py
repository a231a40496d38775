"""Check that calls keep no memory, and that arrays are filled within their bounds."""

import ctypes
import gc
import time as clock
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from emla_cosim.fmu.instance import FINE, STATUS

from ..check import RETURNS, CheckOutcome, check, failed, noted, passed, skipped, warned
from ..host.experiment import make_experiment, read_span
from ..host.hosted_instance import CallError, EndlessIterationError, HostedInstance
from ..host.log import LOG
from ..host.other_values import list_settable, read_start
from ..host.process_state import can_read_memory, load_c_library, read_memory
from ..messages import judge_problems, list_left_out
from ..subject import Subject
from ..subprocess_run import EndedError, in_fresh_process
from .events import make_endless_outcome

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
            size = _measure_kept_bytes(call, _TIME_FRACTION * subject.settings.seconds)
        except CallError:  # another check reports it
            break
        if size:
            bytes_by_call[name] = size
    return bytes_by_call, count


def _list_calls(instance: HostedInstance) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield calls that can be repeated, by name. Saves a state for those that need one."""
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


def _measure_kept_bytes(call: Callable[[], object], seconds: float) -> float:
    """Return the bytes that a call keeps; 0 if it keeps none."""
    uses_mallinfo = read_allocated() is not None
    call()  # what is allocated once is not a leak
    used, numbers = [_read_used_bytes(uses_mallinfo)], list[int]()
    for _ in range(_BATCHES):
        until, number = clock.monotonic() + seconds, 0
        while number < _CALLS[uses_mallinfo] and (number < 2 or clock.monotonic() < until):
            call()
            number += 1
        LOG.lines.clear()
        used.append(_read_used_bytes(uses_mallinfo))
        numbers.append(number)
        if used[-1] - used[-2] <= _MIN_GROWTH[uses_mallinfo]:
            return 0.0
    size = float(np.median(np.diff(used) / np.array(numbers)))
    return size if size > _MIN_BYTES else 0.0


def _read_used_bytes(uses_mallinfo: bool) -> float:
    allocated = read_allocated() if uses_mallinfo else None
    return read_memory() if allocated is None else allocated


_GUARD = 64
_FILL = 0xA5
_TYPES_2 = {"Real": ctypes.c_double, "Integer": ctypes.c_int, "Boolean": ctypes.c_int}
_TYPES_3 = {
    "Float32": ctypes.c_float,
    "Float64": ctypes.c_double,
    "Boolean": ctypes.c_bool,
    **{
        f"{sign}Int{n}": getattr(ctypes, f"c_{sign.lower()}int{n}")
        for sign in ("", "U")
        for n in (8, 16, 32, 64)
    },
}


@check("calls.buffers", needs=("run.completes",))
def buffers(subject: Subject) -> CheckOutcome:
    """Look behind the arrays that functions fill: an FMU that writes there damages the memory of its host."""
    instance, problems = HostedInstance(subject), list[str]()
    instance.initialize(None, read_span(subject)[0])
    tried_count = 0
    for function, kind, references in _list_array_calls(subject):
        tried_count += 1
        block = _allocate_guarded(len(references) * ctypes.sizeof(kind))
        values = ctypes.cast(block, ctypes.POINTER(kind))
        count = (len(references),) if subject.version == 3 else ()
        array = (ctypes.c_uint * len(references))(*references)
        instance.status(function, array, len(references), values, *count)
        problems += _describe_overrun(block, f"{function} of {len(references)} values")
    instance.free()
    if "ModelExchange" in subject.run_kinds:
        instance = HostedInstance(subject, name="model", kind="ModelExchange")
        try:
            instance.initialize(None, read_span(subject)[0])
        except EndlessIterationError as error:
            return make_endless_outcome(error)
        model = instance.model
        assert model is not None
        listed = int(subject.description.numberOfEventIndicators or 0)
        if model.indicator_count != listed:
            message = f"It says that it has {model.indicator_count} event indicators; modelDescription.xml"
            problems.append(f"{message} lists {listed}.")
        for description, call, count in (
            ("states", model.read_states, model.state_count),
            ("derivatives", model.derive, model.state_count),
            ("event indicators", model.indicate, model.indicator_count),
        ):
            tried_count += 1
            block = _allocate_guarded(8 * count)
            with instance.calling():
                call(ctypes.addressof(block))
            function = f"The function for {description}, of which there are {count},"
            problems += _describe_overrun(block, function)
        instance.free()
    return judge_problems(problems, f"{tried_count} functions wrote only the values that they return.")


@check("calls.empty", needs=("run.completes",))
def empty(subject: Subject) -> CheckOutcome:
    """Call the functions that set and get numbers for 0 variables, with arrays and with NULL pointers.

    FMI 3.0 forbids NULL, so that a crash there only warns; hosts whose lists are empty pass it.
    """
    if not any(_list_array_calls(subject)):
        return skipped("It has no number that is not an element of an array.")
    refused = list[str]()
    for is_null, judge in ((False, partial(failed, clause=RETURNS)), (True, warned)):
        try:
            refused += in_fresh_process(_call_for_zero_variables, subject, is_null)
        except EndedError as error:
            return judge(str(error))
    if refused:
        return noted(refused[0], details=tuple(refused))
    return passed("Functions that set and get numbers do nothing for 0 variables.")


def _call_for_zero_variables(subject: Subject, is_null: bool) -> list[str]:
    """Return which functions refuse a call for 0 variables, in and after initialization mode."""
    instance, refused = HostedInstance(subject), dict[str, None]()
    how = " for 0 variables with NULL pointers" if is_null else " for 0 variables"
    count = (0,) if subject.version == 3 else ()
    for enter in (lambda: instance.begin_initialization(read_span(subject)[0]), instance.exit_initialization):
        instance.circumstance = ""
        enter()
        instance.circumstance = how
        for function, kind, references in _list_array_calls(subject):
            arrays = (None, None) if is_null else ((ctypes.c_uint * 1)(references[0]), (kind * 1)())
            for name in (function, function.replace("Get", "Set")):
                status = instance.status(name, arrays[0], 0, arrays[1], *count)
                if status not in FINE:
                    refused[f"{name}{how} answered {STATUS[status]}."] = None
    instance.free()
    return list(refused)


def _list_array_calls(subject: Subject) -> Iterator[tuple[str, Any, list[int]]]:
    """Yield a function for each type of scalars, the type of its values, and their value references."""
    references_by_type = defaultdict[str, list[int]](list)
    for v in subject.description.modelVariables:
        if not v.clocks and getattr(v, "size", 1) == 1:
            references_by_type[str(getattr(v, "data_type", v.type))].append(int(v.valueReference))
    number = "Int64" if subject.version == 3 else "Integer"
    references_by_type[number] += references_by_type.pop("Enumeration", [])
    types: dict[str, Any] = _TYPES_3 if subject.version == 3 else _TYPES_2
    for name, references in references_by_type.items():
        if name in types and references:
            yield f"fmi{subject.version}Get{name}", types[name], references


def _allocate_guarded(size: int) -> Any:
    """Return memory with a guard behind it."""
    return (ctypes.c_ubyte * (size + _GUARD))(*[_FILL] * (size + _GUARD))


def _describe_overrun(block: Any, description: str) -> Iterator[str]:
    """Yield a message if the guard changed."""
    changed = [k for k, byte in enumerate(block[len(block) - _GUARD :]) if byte != _FILL]
    if changed:
        yield f"{description} writes {changed[-1] + 1} bytes behind them."
