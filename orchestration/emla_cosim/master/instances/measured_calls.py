"""Measure the calls of FMU instances: how many, and how long."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

from .fmu_instance import FmuInstance

INPUTS, STEPS, OUTPUTS, STATES, RECORDED = "inputs", "steps", "outputs", "states", "recorded"
"""What calls do. States are saved and restored; recorded variables are those besides the outputs."""

KINDS = (INPUTS, STEPS, OUTPUTS, STATES, RECORDED)
"""These in the order of the numbers of `Effort` in `stepper.h`."""

_METHODS = {
    "set_inputs": INPUTS,
    "set_input_derivatives": INPUTS,
    "directional_derivative": OUTPUTS,
    "do_step": STEPS,
    "get_outputs": OUTPUTS,
    "get_observed": RECORDED,
    "save": STATES,
    "restore": STATES,
}
"""What methods of an instance do."""


class OwnCost(NamedTuple):
    """What the measurement of one call costs in s: within the time of the call, and outside of it."""

    within: float
    overhead: float


@dataclass
class Calls:
    """Number of calls, and the seconds in them."""

    count: int = 0
    seconds: float = 0.0


@dataclass
class Effort:
    """What an FMU took, by what its calls do.

    Args:
        calls: The calls.
        own_cost_s: The time that measuring them took, which is not in `calls`.
    """

    calls: dict[str, Calls] = field(default_factory=dict)
    own_cost_s: float = 0.0

    def add(self, name: str, count: int, seconds: float, cost: OwnCost) -> None:
        """Add measured calls, without the cost of their measurement."""
        if count:
            calls_so_far = self.calls.setdefault(name, Calls())
            calls_so_far.count += count
            calls_so_far.seconds += max(seconds - count * cost.within, 0.0)
            self.own_cost_s += min(seconds, count * cost.within) + count * cost.overhead

    @property
    def seconds(self) -> float:
        """Seconds in all calls."""
        return sum(calls.seconds for calls in self.calls.values())

    @property
    def count(self) -> int:
        """Number of all calls."""
        return sum(calls.count for calls in self.calls.values())


class MeasuredCalls:
    """The calls of an instance through its methods, measured until `close`.

    In another process it is the time that this process waits; see `IsolatedInstance.effort`.
    """

    def __init__(self, instance: FmuInstance) -> None:
        self._instance, self._calls = instance, dict[str, Calls]()
        self._methods = list[str]()
        # without values, these call no function
        unmeasured = {"set_inputs"} if not len(instance.inputs) else set[str]()
        unmeasured |= {"get_outputs"} if not len(instance.outputs) else set()
        if instance.steps_apart:  # its `do_step` consists of these two
            self._measure("begin_step", STEPS)
            # a step is one call
            self._measure("end_step", STEPS, counts=False)
            unmeasured |= {"do_step"}
        elif not instance.observed_groups():
            unmeasured |= {"get_observed"}
        for method, name in _METHODS.items():
            if method not in unmeasured:
                self._measure(method, name)

    def _measure(self, method: str, name: str, counts: bool = True) -> None:
        calls = self._calls.setdefault(name, Calls())
        vars(self._instance)[method] = _measure(getattr(self._instance, method), calls, int(counts))
        self._methods.append(method)

    def restart(self) -> None:
        """Forget all calls so far."""
        for calls in self._calls.values():
            calls.count, calls.seconds = 0, 0.0

    def add_to(self, effort: Effort) -> None:
        """Add the calls so far."""
        for name, calls in self._calls.items():
            effort.add(name, calls.count, calls.seconds, measure_own_cost())

    def close(self) -> None:
        """Stop the measurement."""
        for method in self._methods:
            vars(self._instance).pop(method, None)
        self._methods.clear()


def _measure(call: Callable[..., Any], calls: Calls, count: int) -> Callable[..., Any]:
    """Return a function that adds its calls and their time to `calls`."""
    clock = time.perf_counter

    def measured(*arguments: Any) -> Any:
        start = clock()
        try:
            return call(*arguments)
        finally:
            calls.seconds += clock() - start
            calls.count += count

    return measured


@cache
def measure_own_cost(calls: int = 2000, rounds: int = 5) -> OwnCost:
    """Return what the measurement of one call of a method costs in this process."""

    def do_nothing(time: float, step: float) -> None:
        pass

    def repeat(call: Callable[[float, float], None]) -> float:
        start = time.perf_counter()
        for _ in range(calls):
            call(0.0, 0.0)
        return (time.perf_counter() - start) / calls

    inner, totals, plain = [], [], []
    for _ in range(rounds):
        counted = Calls()
        totals.append(repeat(_measure(do_nothing, counted, 1)))
        plain.append(repeat(do_nothing))
        inner.append(counted.seconds / calls - plain[-1])
    return OwnCost(max(min(inner), 0.0), max(min(totals) - min(plain) - min(inner), 0.0))
