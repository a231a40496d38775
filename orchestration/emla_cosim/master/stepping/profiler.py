"""Measure where the time of a run goes: each FMU, the master, and the recorders."""

import ctypes
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from ..instances.fmu_instance import EntryPoints, FmuInstance, ObservedGroup
from ..instances.isolated_instance import IsolatedInstance
from ..instances.measured_calls import (
    INPUTS,
    OUTPUTS,
    RECORDED,
    STATES,
    STEPS,
    Effort,
    MeasuredCalls,
    OwnCost,
    measure_own_cost,
)
from .forwarding import forward, forward_observed
from .record_layout import TIMED, TimedCall

_NAMES = {
    TimedCall.INPUTS: INPUTS,
    TimedCall.DERIVATIVES: INPUTS,
    TimedCall.STEP: STEPS,
    TimedCall.OUTPUTS: OUTPUTS,
    TimedCall.SAVE: STATES,
    TimedCall.RESTORE: STATES,
    TimedCall.OBSERVED: RECORDED,
}
_WIDTH = 16
"""Length of the arrays of an instance: two lines of a cache, so that threads do not wait for each other."""

PACING = "waiting for real time"
"""The activity of a run that is slower than it could be."""


class Profiler:
    """Measure the calls of all instances, and further activities, of one run.

    Without it nothing is measured: it replaces methods of the instances, and the functions that compiled code
    calls. `close` puts everything back.

    Args:
        instances: The instances of a network, before the algorithm's `setup`.
    """

    def __init__(self, instances: Sequence[FmuInstance]) -> None:
        self._instances = list(instances)
        count = len(self._instances)
        self._records = np.zeros(count, TIMED)
        self._calls, self._ticks, self._now, self._functions = (
            np.zeros((count, _WIDTH), dtype=np.int64) for _ in range(4)
        )
        self._further = list[Any]()  # memory of the records of recorded variables
        self._activities = dict[str, float]()
        self._inner = 0.0
        self._inside = dict[str, Effort | None]()
        self._replaced = list[tuple[Any, str]]()
        self._measured = [MeasuredCalls(instance) for instance in self._instances]
        for i, instance in enumerate(self._instances):
            if isinstance(instance, IsolatedInstance):
                instance.measure()
                continue
            points, groups = instance.entry_points, instance.observed_groups
            self._replace(instance, "entry_points", lambda i=i, own=points: self._timed_points(i, own()))
            self._replace(instance, "observed_groups", lambda i=i, own=groups: self._timed_groups(i, own()))

    def _replace(self, owner: Any, method: str, function: Callable[..., Any]) -> None:
        vars(owner)[method] = function
        self._replaced.append((owner, method))

    def watch(self, name: str, owner: Any, *methods: str) -> None:
        """Measure methods of an object as an activity, without what other activities take within them."""
        self._activities.setdefault(name, 0.0)
        for method in methods:
            self._replace(owner, method, self._watch(name, getattr(owner, method)))

    def _watch(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def watched(*arguments: Any) -> Any:
            outer, self._inner = self._inner, 0.0
            began = time.perf_counter()
            try:
                return call(*arguments)
            finally:
                took = time.perf_counter() - began
                self._activities[name] += took - self._inner
                self._inner = outer + took

        return watched

    def restart(self) -> None:
        """Forget everything measured so far."""
        self._calls[:], self._ticks[:] = 0, 0
        self._activities = dict.fromkeys(self._activities, 0.0)
        for measured in self._measured:
            measured.restart()
        for instance in self._instances:
            if isinstance(instance, IsolatedInstance):
                instance.measure()

    def close(self) -> None:
        """Stop all measurements. What was measured remains."""
        for owner, method in self._replaced:
            vars(owner).pop(method, None)
        self._replaced.clear()
        for measured in self._measured:
            measured.close()
        for instance in self._instances:
            if isinstance(instance, IsolatedInstance) and instance.name not in self._inside:
                self._inside[instance.name] = instance.effort()
                instance.measure(False)

    def report(self, wall_s: float, seconds_beside: float) -> dict[str, Any]:
        """Return where the time went, as plain data for run.json.

        Args:
            wall_s: Wall time of the run in s.
            seconds_beside: Wall time in s that further threads took for steps.
        """
        total, spent = wall_s + seconds_beside, [self._spent(i) for i in range(len(self._instances))]
        here = [i for i, x in enumerate(self._instances) if not isinstance(x, IsolatedInstance)]
        waited = sum(effort.seconds for i, effort in enumerate(spent) if i not in here)
        measured = sum(spent[i].seconds for i in here) + waited + sum(self._activities.values())
        # an estimate from other calls: on a busy machine it can exceed what is left of the run
        own = min(sum(effort.own_cost_s for effort in spent), max(total - measured, 0.0))

        def part(seconds: float) -> dict[str, float]:
            return {"seconds": seconds, "share": seconds / total if total > 0.0 else 0.0}

        rows = dict[str, Any]()
        for instance, effort in zip(self._instances, spent, strict=True):
            if isinstance(instance, IsolatedInstance):
                inside = self._inside[instance.name] if self._inside else instance.effort()
                more = {"separate_process": True, "waited_s": effort.seconds}
                effort = effort if inside is None else inside
            else:
                more = {"separate_process": False}
            calls = {name: {"count": c.count, "seconds": c.seconds} for name, c in effort.calls.items()}
            rows[instance.name] = {**part(effort.seconds), "calls": calls, **more}
        costs = {"per_call_in_python_s": sum(measure_own_cost())}
        if self._calls.any():
            costs["per_call_in_compiled_code_s"] = sum(_measure_compiled_cost())
        return {
            "total_s": total,
            "fmus": rows,
            "master": part(max(total - measured - own, 0.0)),
            **({} if len(here) == len(spent) else {"separate_processes": part(waited)}),
            "recorders": {name: part(seconds) for name, seconds in self._activities.items()},
            "profiler": {**part(own), **costs},
        }

    def _spent(self, i: int) -> Effort:
        effort = Effort()
        self._measured[i].add_to(effort)
        if self._calls[i].any():
            for call, name in _NAMES.items():
                seconds = float(self._ticks[i, call]) * _tick()
                effort.add(name, int(self._calls[i, call]), seconds, _measure_compiled_cost())
        return effort

    def _timed_points(self, i: int, own: EntryPoints | None) -> EntryPoints | None:
        """Return entry points that measure; None if there are none, or nothing can measure them."""
        if own is None or own.events or (own.setters is not None and own.step_end is None):
            return None
        try:
            own, timed = forward(own), _timed_addresses()
            self._further.append(own)  # whose memory the record points to
        except (ImportError, OSError):  # the loop cannot be compiled either, or is done in Python then
            return None
        of = {
            TimedCall.INPUTS: own.set_real,
            TimedCall.DERIVATIVES: own.set_real_input_derivatives,
            TimedCall.STEP: own.do_step,
            TimedCall.OUTPUTS: own.get_real,
            TimedCall.SAVE: own.get_state,
            TimedCall.RESTORE: own.set_state,
        }
        for call, address in of.items():
            self._functions[i, call] = address
        record = self._records[i : i + 1]
        record["component"] = own.component
        self._fill(record, i, self._functions[i])
        return replace(
            own,
            component=record.ctypes.data,
            get_status=0,
            set_real=timed[TimedCall.INPUTS],
            set_real_input_derivatives=timed[TimedCall.DERIVATIVES],
            do_step=timed[TimedCall.STEP],
            get_real=timed[TimedCall.OUTPUTS],
            get_state=timed[TimedCall.SAVE],
            set_state=timed[TimedCall.RESTORE],
        )

    def _timed_groups(self, i: int, own: list[ObservedGroup]) -> list[ObservedGroup]:
        """Return groups that measure."""
        found = []
        for n, group in enumerate(map(forward_observed, own)):
            record, functions, calls = np.zeros(1, TIMED), *np.zeros((2, _WIDTH), dtype=np.int64)
            functions[TimedCall.OBSERVED], record["component"] = group.function, group.component
            self._fill(record, i, functions)
            if n:  # all groups of an instance are one call of its method
                record["calls"] = calls.ctypes.data
            self._further += [record, functions, calls]
            function = _timed_addresses()[TimedCall.OBSERVED]
            found.append(replace(group, component=record.ctypes.data, function=function))
        return found

    def _fill(self, record: Any, i: int, functions: Any) -> None:
        record["clock"], record["now"] = _clock(), self._now[i].ctypes.data
        record["functions"] = functions.ctypes.data
        record["calls"], record["ticks"] = self._calls[i].ctypes.data, self._ticks[i].ctypes.data


_TIMED = {
    TimedCall.INPUTS: "timed_inputs",
    TimedCall.DERIVATIVES: "timed_derivatives",
    TimedCall.STEP: "timed_step",
    TimedCall.OUTPUTS: "timed_outputs",
    TimedCall.SAVE: "timed_save",
    TimedCall.RESTORE: "timed_restore",
    TimedCall.OBSERVED: "timed_observed",
}


def _compiled(name: str) -> int:
    from .kernel import compiled_address  # it loads LLVM

    return compiled_address(name, "timed_calls")


@cache
def _timed_addresses() -> dict[TimedCall, int]:
    """Return the addresses of the functions that measure; ImportError or OSError without a compiler."""
    return {call: _compiled(name) for call, name in _TIMED.items()}


@cache
def _clock() -> int:
    """Return the address of the C function that reads the clock."""
    from .kernel import c_address

    if os.name == "nt":
        return c_address("kernel32", "QueryPerformanceCounter")
    return c_address(None, "clock_gettime")


@cache
def _tick() -> float:
    """Return the length of a tick of the clock in s."""
    if os.name != "nt":
        return 1e-9
    frequency = ctypes.c_int64()
    ctypes.windll.kernel32.QueryPerformanceFrequency(ctypes.byref(frequency))  # type: ignore[attr-defined]
    return 1.0 / frequency.value


@cache
def _measure_compiled_cost(calls: int = 20_000, rounds: int = 5) -> OwnCost:
    """Return what the measurement of one call in compiled code costs."""
    prototype = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_ssize_t, ctypes.c_ssize_t, ctypes.c_int64)
    repeat, nothing = prototype(_compiled("repeat")), _compiled("do_nothing")
    record = np.zeros(1, TIMED)
    functions, count, ticks, now = (np.zeros(_WIDTH, dtype=np.int64) for _ in range(4))
    functions[TimedCall.SAVE] = nothing
    record["clock"], record["now"], record["functions"] = _clock(), now.ctypes.data, functions.ctypes.data
    record["calls"], record["ticks"] = count.ctypes.data, ticks.ctypes.data
    within, whole, plain = [], [], []
    for _ in range(rounds):
        ticks[:] = 0
        began = time.perf_counter()
        repeat(_timed_addresses()[TimedCall.SAVE], record.ctypes.data, calls)
        whole.append((time.perf_counter() - began) / calls)
        within.append(float(ticks[TimedCall.SAVE]) * _tick() / calls)
        began = time.perf_counter()
        repeat(nothing, 0, calls)
        plain.append((time.perf_counter() - began) / calls)
    inside = max(min(within) - min(plain), 0.0)
    return OwnCost(inside, max(min(whole) - min(plain) - inside, 0.0))
