"""Measure where the time of a run goes: each FMU, the master, and the recorders."""

import time
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ...stepper.layout import EFFORT
from ...stepper.library import address_of_clock, load_stepper
from ..instances.fmu_instance import FmuInstance
from ..instances.isolated_instance import IsolatedInstance
from ..instances.measured_calls import Calls, Effort, MeasuredCalls, OwnCost, measure_own_cost

if TYPE_CHECKING:
    from .native_loop import NativeLoop

PACING = "waiting for real time"
"""The activity of a run that waits for real time."""


class Profiler:
    """Measure the calls of all instances, and further activities, of one run.

    Without it nothing is measured: it replaces methods of the instances, and lets the stepping measure what
    is called in C. `close` puts the methods back.

    Args:
        instances: The instances of a network, before the algorithm's `setup`.
    """

    def __init__(self, instances: Sequence[FmuInstance]) -> None:
        self._instances = list(instances)
        self._loop: NativeLoop | None = None
        self._activities = dict[str, float]()
        self._inner = 0.0
        self._inner_efforts = dict[str, Effort | None]()
        self._replaced = list[tuple[Any, str]]()
        self._measured = [MeasuredCalls(instance) for instance in self._instances]
        self._isolated = [x for x in self._instances if isinstance(x, IsolatedInstance)]
        for instance in self._isolated:
            instance.measure()

    def _replace_method(self, owner: Any, method: str, function: Callable[..., Any]) -> None:
        vars(owner)[method] = function
        self._replaced.append((owner, method))

    def measure_methods(self, name: str, owner: Any, *methods: str) -> None:
        """Measure methods of an object as an activity, without what other activities take within them."""
        self._activities.setdefault(name, 0.0)
        for method in methods:
            self._replace_method(owner, method, self._make_measured(name, getattr(owner, method)))

    def _make_measured(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that does `call`, and adds its time to an activity without that of inner ones."""

        def watched(*arguments: Any) -> Any:
            outer, self._inner = self._inner, 0.0
            start_time = time.perf_counter()
            try:
                return call(*arguments)
            finally:
                elapsed = time.perf_counter() - start_time
                self._activities[name] += elapsed - self._inner
                # the outer activity leaves out what this one took
                self._inner = outer + elapsed

        return watched

    def restart(self, loop: "NativeLoop | None") -> None:
        """Forget everything measured so far, and measure the calls that this loop makes in C, too."""
        self._loop = loop
        if loop is not None:
            loop.start_profile()
        self._activities = dict.fromkeys(self._activities, 0.0)
        for measured in self._measured:
            measured.restart()
        for instance in self._isolated:
            instance.measure()

    def close(self) -> None:
        """Stop all measurements. What was measured remains."""
        for owner, method in self._replaced:
            vars(owner).pop(method, None)
        self._replaced.clear()
        for measured in self._measured:
            measured.close()
        for instance in self._isolated:
            if instance.name not in self._inner_efforts:
                self._inner_efforts[instance.name] = instance.read_effort()
                instance.measure(False)

    def report(self, wall_s: float) -> dict[str, Any]:
        """Return where the time went, as plain data for run.json.

        Args:
            wall_s: Wall time of the run in s.
        """
        total = wall_s + (0.0 if self._loop is None else self._loop.extra_thread_seconds)
        in_c = [{}] * len(self._instances) if self._loop is None else self._loop.profile()
        spent = list(map(_add_up, self._measured, in_c))
        efforts = list(zip(self._instances, spent, strict=True))
        waited = sum(effort.seconds for x, effort in efforts if x in self._isolated)
        in_process = sum(effort.seconds for x, effort in efforts if x not in self._isolated)
        measured = in_process + waited + sum(self._activities.values())
        # an estimate from other calls: on a busy machine it can exceed what is left of the run
        own_cost = min(sum(effort.own_cost_s for effort in spent), max(total - measured, 0.0))

        def part(seconds: float) -> dict[str, float]:
            return {"seconds": seconds, "share": seconds / total if total > 0.0 else 0.0}

        rows = dict[str, Any]()
        for instance, effort in efforts:
            if isinstance(instance, IsolatedInstance):
                inner = self._inner_efforts[instance.name] if self._inner_efforts else instance.read_effort()
                process_entries = {"separate_process": True, "waited_s": effort.seconds}
                effort = effort if inner is None else inner
            else:
                process_entries = {"separate_process": False}
            calls = {name: {"count": c.count, "seconds": c.seconds} for name, c in effort.calls.items()}
            rows[instance.name] = {**part(effort.seconds), "calls": calls, **process_entries}
        costs = {"per_call_in_python_s": sum(measure_own_cost())}
        if any(in_c):
            costs["per_call_in_c_s"] = sum(_measure_cost_in_c())
        return {
            "total_s": total,
            "fmus": rows,
            "master": part(max(total - measured - own_cost, 0.0)),
            **({"separate_processes": part(waited)} if self._isolated else {}),
            "recorders": {name: part(seconds) for name, seconds in self._activities.items()},
            "profiler": {**part(own_cost), **costs},
        }


def _add_up(in_python: MeasuredCalls, in_c: Mapping[str, Calls]) -> Effort:
    """Return what an instance took, in calls of its methods and in those that C made."""
    effort = Effort()
    in_python.add_to(effort)
    for name, calls in in_c.items():
        effort.add(name, calls.count, calls.seconds, _measure_cost_in_c())
    return effort


@cache
def _measure_cost_in_c(calls: int = 20_000, rounds: int = 5) -> OwnCost:
    """Return what the measurement of one call in C costs."""
    library, efforts = load_stepper(), np.zeros(rounds, EFFORT)
    efforts["now"] = address_of_clock(library)
    total_times = [library.measure_cost(efforts[n : n + 1].ctypes.data, calls) for n in range(rounds)]
    inner_cost = 1e-9 * float(efforts["nanoseconds"].sum(axis=1).min()) / calls
    return OwnCost(inner_cost, max(1e-9 * min(total_times) / calls - inner_cost, 0.0))
