"""Number and measure the calls of FMU instances."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

from ...base.crash_page import Activity
from ...fmu.fmi_3_calls import NUMBER_TYPES
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
    """The calls of an instance through its methods, which are replaced and measured until `close`.

    In another process it is the time that this process waits; see `IsolatedInstance.read_effort`.
    """

    def __init__(self, instance: FmuInstance) -> None:
        self._instance, self._calls = instance, dict[str, Calls]()
        self._methods = list[str]()
        # without values, these call no function
        unmeasured = {"set_inputs"} if not len(instance.inputs) else set[str]()
        unmeasured |= {"get_outputs"} if not len(instance.outputs) else set()
        if instance.steps_apart:  # its `do_step` consists of these two
            self._replace_method("begin_step", STEPS)
            # a step is one call
            self._replace_method("end_step", STEPS, counts=False)
            unmeasured |= {"do_step"}
        elif not instance.observed_groups():
            unmeasured |= {"get_observed"}
        for method, name in _METHODS.items():
            if method not in unmeasured:
                self._replace_method(method, name)

    def _replace_method(self, method: str, name: str, counts: bool = True) -> None:
        """Replace a method of the instance by one that is measured under a name of `KINDS`."""
        calls = self._calls.setdefault(name, Calls())
        vars(self._instance)[method] = _count_calls(getattr(self._instance, method), calls, int(counts))
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


def _count_calls(call: Callable[..., Any], calls: Calls, count: int) -> Callable[..., Any]:
    """Return a function that does `call`, and adds `count` and the time to `calls`."""
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
        totals.append(repeat(_count_calls(do_nothing, counted, 1)))
        plain.append(repeat(do_nothing))
        inner.append(counted.seconds / calls - plain[-1])
    return OwnCost(max(min(inner), 0.0), max(min(totals) - min(plain) - min(inner), 0.0))


CALLS = (
    "",
    *("setReal", "setRealInputDerivatives", "doStep", "getReal"),
    "loading its library",
    *("instantiate", "setupExperiment", "enterInitializationMode", "exitInitializationMode"),
    *("setInteger", "setBoolean", "setString", "getInteger", "getBoolean"),
    *("getBooleanStatus", "getRealStatus", "getFMUstate", "setFMUstate", "freeFMUstate"),
    *("serializedFMUstateSize", "serializeFMUstate", "deSerializeFMUstate"),
    *("reset", "terminate", "freeInstance", "getDirectionalDerivative", "getString"),
    *("enterEventMode", "newDiscreteStates", "enterContinuousTimeMode", "completedIntegratorStep"),
    *("setTime", "setContinuousStates", "getContinuousStates", "getDerivatives"),
    *("getEventIndicators", "getNominalsOfContinuousStates"),
    # FMI 3.0: the functions that it adds, and those with another name or another case than in FMI 2.0
    *(f"{access}{kind}" for kind in NUMBER_TYPES for access in ("get", "set")),
    *("instantiateCoSimulation", "getFMUState", "setFMUState", "freeFMUState"),
    *("serializedFMUStateSize", "serializeFMUState", "deserializeFMUState"),
    *("enterStepMode", "updateDiscreteStates", "setClock", "getClock"),
    *("instantiateModelExchange", "getContinuousStateDerivatives"),
    *("getNumberOfContinuousStates", "getNumberOfEventIndicators"),
    *("getIntervalDecimal", "getShiftDecimal", "getBinary", "setBinary"),
    *("enterConfigurationMode", "exitConfigurationMode"),
    *("setting inputs", "getting outputs"),
)
"""Calls of an instance; the first entry means no call."""

_NUMBERS = {name: number for number, name in enumerate(CALLS)}


def code_of(instance: int, call: str) -> int:
    """Return the code of a call of the instance with this number; `call` is an entry of `CALLS`."""
    return instance * len(CALLS) + _NUMBERS[call]


def split_code(code: int) -> tuple[int, str]:
    """Return the number of the instance and the call of a code."""
    instance, call = divmod(code, len(CALLS))
    return instance, CALLS[call]


def decode_call(present: Activity) -> tuple[int | None, str]:
    """Return the number of the instance that is called (None without a call), and the call in words."""
    instance, call = split_code(present.code)
    if not call:
        return None, "no FMI call"
    return instance, f"{call} at t = {present.time:.9g} s" if call == "doStep" else call
