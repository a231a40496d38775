"""Check that functions write only the values asked for, and do nothing for no variables."""

import ctypes
from collections import defaultdict
from collections.abc import Iterator
from functools import partial
from typing import Any

from emla_cosim.fmu.instance import FINE, STATUS

from ..check import RETURNS, CheckOutcome, check, failed, noted, passed, skipped, warned
from ..host.experiment import read_span
from ..host.fresh_process import EndedError, in_fresh_process
from ..host.hosted_instance import EndlessIterationError, HostedInstance
from ..messages import judge_problems
from ..subject import Subject
from .events import explain_endless

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
    for function, kind, references in _list_calls(subject):
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
            return explain_endless(error)
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
    if not any(_list_calls(subject)):
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
        for function, kind, references in _list_calls(subject):
            arrays = (None, None) if is_null else ((ctypes.c_uint * 1)(references[0]), (kind * 1)())
            for name in (function, function.replace("Get", "Set")):
                status = instance.status(name, arrays[0], 0, arrays[1], *count)
                if status not in FINE:
                    refused[f"{name}{how} answered {STATUS[status]}."] = None
    instance.free()
    return list(refused)


def _list_calls(subject: Subject) -> Iterator[tuple[str, Any, list[int]]]:
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
