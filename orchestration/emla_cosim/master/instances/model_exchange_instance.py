"""Instances of FMUs that run as Model Exchange: an `IntegratedInstance` steps them."""

import contextlib
import ctypes
import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable

from ...base.arrays import Vector
from ...base.errors import RunError
from ...fmu.elements import is_plain, is_version_3, place_in_array
from ...fmu.instance import FINE
from .discrete_states import name_update, update_discrete_states
from .fmu_instance import EndRequestedError, InstanceError
from .in_process_instance import InProcessInstance
from .integrator_settings import IntegratorSettings
from .typed_values import TypedValues


class DiscardedCallError(InstanceError):
    """The FMU discarded a call; other states may succeed."""


class ModelExchangeInstance(InProcessInstance):
    """One instance of an FMU that runs as Model Exchange, without its integrator.

    Attributes:
        settings: how to integrate it.
        next_event: time in s of its next time event; infinite without one.
        has_new_nominals: whether the nominal values of its states have changed.
        surround: returns what surrounds a change of a variable from outside. The integrator sets it.
    """

    settings = IntegratorSettings()
    next_event = math.inf
    has_new_nominals = True
    surround: Callable[[], contextlib.AbstractContextManager[None]] = contextlib.nullcontext
    _time = math.nan

    @cached_property
    def state_count(self) -> int:
        """Number of continuous states."""
        return int(self.file.description.numberOfContinuousStates or 0)

    @cached_property
    def indicator_count(self) -> int:
        """Number of event indicators."""
        return int(self.file.description.numberOfEventIndicators or 0)

    @cached_property
    def _reports_steps(self) -> bool:
        return self.file.has_capability("needsCompletedIntegratorStep")

    def use_integrator(self, settings: IntegratorSettings) -> None:
        """Integrate with these settings from the next initialization on."""
        self.settings = settings

    def reset(self) -> None:
        """Return to the state right after instantiation."""
        super().reset()
        self.surround = contextlib.nullcontext

    def enter_initialization(self, start_time: float, stop_time: float | None = None) -> None:
        """Enter initialization mode; times in s, None without a fixed stop time."""
        self._time, self.next_event, self.has_new_nominals = start_time, math.inf, True
        super().enter_initialization(start_time, stop_time)

    def exit_initialization(self) -> None:
        """Leave initialization mode; the FMU is in event mode then."""
        super().exit_initialization()
        if is_version_3(self.file.description):
            self._check_count("getNumberOfContinuousStates", self.state_count)
            self._check_count("getNumberOfEventIndicators", self.indicator_count)

    def _check_count(self, call: str, declared: int) -> None:
        """Raise InstanceError if the FMU has another number of values than it declares."""
        with self.calling():
            found = getattr(self.fmu, call)()
        if found != declared:
            answer = f"{found}, and its model description has {declared}"
            raise InstanceError(self.name, call, answer, self.messages())

    def set_value(self, variable: ModelVariable, value: Any) -> None:
        """Set one variable to a value of its type; InstanceError if the FMU rejects it."""
        with self.surround():
            super().set_value(variable, value)

    def enter_event_mode(self) -> None:
        """Enter event mode."""
        self._call("enterEventMode")

    def find_discrete_states(self) -> bool:
        """Compute new discrete states; return whether the FMU needs another iteration."""
        update = update_discrete_states(self, self._time)
        self._check_end(name_update(self), update.ends)
        self.has_new_nominals |= update.has_new_nominals
        self.next_event = update.next_event
        return update.needs_more

    def enter_continuous_time_mode(self) -> None:
        """Enter continuous-time mode."""
        self._call("enterContinuousTimeMode")

    def complete_step(self) -> bool:
        """Tell the FMU that a step of the integrator is complete; return whether an event follows."""
        if not self._reports_steps:
            return False
        boolean = ctypes.c_bool if is_version_3(self.file.description) else ctypes.c_int
        enters, ends = boolean(), boolean()
        self._call("completedIntegratorStep", self._no_way_back, ctypes.byref(enters), ctypes.byref(ends))
        self._check_end("completedIntegratorStep", bool(ends.value))
        return bool(enters.value)

    def place(self, time: float, states: int) -> None:
        """Set the time in s, and the continuous states from an address."""
        self._time = time
        self._call("setTime", time)
        if self.state_count:
            self._call("setContinuousStates", states, self.state_count)

    def read_states(self, result: int) -> None:
        """Write the continuous states to an address."""
        if self.state_count:
            self._call("getContinuousStates", result, self.state_count)

    def read_nominals(self) -> Vector:
        """Return the nominal values of the states; 1 for those that are not finite and positive."""
        found = np.ones(self.state_count)
        if self.state_count:
            self._call("getNominalsOfContinuousStates", found.ctypes.data, self.state_count)
        self.has_new_nominals = False
        return np.where(np.isfinite(found) & (found != 0.0), np.abs(found), 1.0)

    def derive(self, result: int) -> None:
        """Write the derivatives of the states, per s, to an address."""
        if self.state_count:
            self._call("getDerivatives", result, self.state_count)

    def indicate(self, result: int) -> None:
        """Write the event indicators to an address."""
        if self.indicator_count:
            self._call("getEventIndicators", result, self.indicator_count)

    def reader(self, variables: Sequence[ModelVariable], values: Vector) -> Callable[[], None]:
        """Return a function that reads Real variables into `values`, in their order."""
        if is_plain(variables):
            return self._plain_call("getReal", variables, values)
        typed = TypedValues("get", variables, self._functions)

        def read() -> None:
            self._check("getReal", typed.get(self._component, values))

        return read

    def writer(self, variables: Sequence[ModelVariable], values: Vector) -> Callable[[], None]:
        """Return a function that sets Real variables to `values`, in their order.

        The other elements of their arrays keep the values of the FMU.
        """
        if is_plain(variables):
            return self._plain_call("setReal", variables, values)
        typed = TypedValues("set", variables, self._functions)
        getters = [self._functions[f"get{group.call.removeprefix('set')}"] for group in typed.groups]

        def write() -> None:
            for group, get in zip(typed.groups, getters, strict=True):
                self._check("getReal", get(self._component, *group.arguments))
            self._check("setReal", typed.set(self._component, values))

        return write

    def _plain_call(
        self, name: str, variables: Sequence[ModelVariable], values: Vector
    ) -> Callable[[], None]:
        """Return a function that gets or sets variables whose values are the memory of one FMI call."""
        references = [v.valueReference for v in variables if not place_in_array(v)]
        arguments = self._arguments(np.array(references, dtype=np.uint32), values)[1:]
        return lambda: self._call(name, *arguments)

    def _check(self, call: str, status: int) -> None:
        if status not in FINE:
            raise self.error(call, status)

    def error(self, call: str, status: int) -> RunError:
        """Return the error for a call that returned this status."""
        is_placed = math.isnan(self._time) or " at t = " in call
        return super().error(call if is_placed else f"{call} at t = {self._time:.9g} s", status)

    def _describe_time(self, call: str) -> str:
        return "" if math.isnan(self._time) else f" at t = {self._time:.9g} s"

    def _discard_error(self, call: str) -> type[InstanceError]:
        return DiscardedCallError

    def _check_end(self, call: str, ends: bool) -> None:
        if ends:
            at = f"{call} at t = {self._time:.9g} s"
            raise EndRequestedError(self.name, at, "terminateSimulation", self.messages())
