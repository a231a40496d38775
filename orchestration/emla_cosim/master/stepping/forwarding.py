"""Functions with the arguments of FMI 2.0 that forward to those of FMI 3.0, for compiled loops.

The loops call functions of FMI 3.0 themselves if these exchange doubles. For other types, and for the
profiler, they call functions that convert values and forward the call.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from ..instances.fmu_instance import EntryPoints, GroupCall, ObservedGroup
from .record_layout import FORWARDED, KINDS, TYPED


def forward_typed(points: EntryPoints) -> EntryPoints:
    """Return entry points that exchange doubles only; see `forward`."""
    return points if points.step_end is None or points.setters is None else forward(points)


def forward(points: EntryPoints) -> EntryPoints:
    """Return entry points with the arguments of FMI 2.0.

    Raises:
        ImportError: They must be compiled, and numba is missing.
        OSError: LLVM cannot be loaded.
    """
    if points.step_end is None:
        return points
    end, setters, getters = points.step_end, points.setters, points.getters
    kept = list[Any]()
    record = np.zeros(1, FORWARDED)
    record["component"], record["do_step"] = points.component, points.do_step
    record["set"], record["get"] = points.set_real, points.get_real
    record["get_state"], record["set_state"] = points.get_state, points.set_state
    record["set_count"], record["get_count"] = len(points.input_references), len(points.output_references)
    record["step_end"] = end.address
    for name, calls in (("setter", setters), ("getter", getters)):
        records = _typed_records(calls or (), kept)
        record[f"{name}s"], record[f"{name}_count"] = records.ctypes.data, len(records)
    typed = "" if setters is None else "typed_"
    return replace(
        points,
        component=record.ctypes.data,
        set_real=_compiled(f"set_{typed}values"),
        get_real=_compiled(f"get_{typed}values"),
        do_step=_compiled("step"),
        get_state=_compiled("get_state"),
        set_state=_compiled("set_state"),
        step_end=None,
        setters=None,
        getters=None,
        kept=(points, record, kept),
    )


def forward_observed(group: ObservedGroup) -> ObservedGroup:
    """Return observed variables as doubles that a function with the arguments of FMI 2.0 gets."""
    if group.group is None:
        return group
    kept, record = list[Any](), np.zeros(1, FORWARDED)
    typed, count = group.group.group, len(group.targets)
    own = GroupCall(group.function, replace(typed, elements=np.arange(count)))
    records = _typed_records([own], kept)
    record["component"], record["getters"], record["getter_count"] = group.component, records.ctypes.data, 1
    return replace(
        group,
        component=record.ctypes.data,
        function=_compiled("get_typed_values"),
        references=np.zeros(count, dtype=np.uint32),
        values=np.zeros(count),
        boolean=False,
        group=None,
        kept=(group, record, kept),
    )


def _typed_records(calls: Sequence[GroupCall], kept: list[Any]) -> Any:
    """Return the TYPED records of these calls, and keep what they point to."""
    records = np.zeros(len(calls), TYPED)
    for record, (function, group) in zip(records, calls, strict=True):
        memory = group.values
        places = np.arange(len(memory)) if isinstance(group.places, slice) else group.places
        elements, places = (np.ascontiguousarray(x, dtype=np.intp) for x in (group.elements, places))
        kept += [group, elements, places]
        record["function"], record["kind"] = function, KINDS.index(memory.dtype.name)
        record["references"], record["reference_count"] = group.references.ctypes.data, len(group.references)
        record["memory"], record["memory_count"] = memory.ctypes.data, len(memory)
        record["elements"], record["places"] = elements.ctypes.data, places.ctypes.data
        record["count"] = len(elements)
        if group.integers:
            record["low"], record["limit"] = group.limits
    kept.append(records)
    return records


@cache
def _compiled(name: str) -> int:
    from .compiled_functions import compiled_address  # it loads LLVM

    return compiled_address(name, "forwarded_calls")
