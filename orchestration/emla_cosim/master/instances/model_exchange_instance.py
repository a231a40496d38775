"""Instances of FMUs that run as Model Exchange: an `IntegratedInstance` steps them."""

import contextlib
import ctypes
import math
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from fmpy.fmi2 import fmi2EventInfo
from fmpy.model_description import ModelVariable

from ...base.arrays import Vector
from ...base.errors import RunError
from ...fmu.instance import DISCARD, STATUS
from ...fmu.loaded_library import plain_name
from .fmu_instance import EndRequestedError, InstanceError
from .in_process_instance import InProcessInstance
from .integrator_settings import IntegratorSettings


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
        return not self.file.has_capability("completedIntegratorStepNotNeeded")

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

    def set_value(self, variable: ModelVariable, value: Any) -> None:
        """Set one variable to a value of its type; InstanceError if the FMU rejects it."""
        with self.surround():
            super().set_value(variable, value)

    def enter_event_mode(self) -> None:
        """Enter event mode."""
        self._call("enterEventMode")

    def find_discrete_states(self) -> bool:
        """Compute new discrete states; return whether the FMU needs another iteration."""
        info = fmi2EventInfo()
        self._call("newDiscreteStates", ctypes.byref(info))
        self._check_end("newDiscreteStates", bool(info.terminateSimulation))
        self.has_new_nominals |= bool(info.nominalsOfContinuousStatesChanged)
        self.next_event = info.nextEventTime if info.nextEventTimeDefined else math.inf
        if math.isnan(self.next_event):  # it would compare as never
            at = f"newDiscreteStates at t = {self._time:.9g} s"
            raise InstanceError(self.name, at, "nextEventTime = NaN", self.messages())
        return bool(info.newDiscreteStatesNeeded)

    def enter_continuous_time_mode(self) -> None:
        """Enter continuous-time mode."""
        self._call("enterContinuousTimeMode")

    def complete_step(self) -> bool:
        """Tell the FMU that a step of the integrator is complete; return whether an event follows."""
        if not self._reports_steps:
            return False
        enters, ends = ctypes.c_int(), ctypes.c_int()
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

    def set_reals(self, references: int, count: int, values: int) -> None:
        """Set Real variables from addresses of value references and values."""
        self._call("setReal", references, count, values)

    def get_reals(self, references: int, count: int, values: int) -> None:
        """Read Real variables to an address."""
        self._call("getReal", references, count, values)

    def error(self, call: str, status: int) -> RunError:
        """Return the error for a call that returned this status."""
        at = call if math.isnan(self._time) else f"{call} at t = {self._time:.9g} s"
        if status == DISCARD:
            return DiscardedCallError(self.name, plain_name(at), STATUS[status], self.messages())
        return super().error(at, status)

    def messages(self) -> list[str]:
        """Return the last warnings and errors of the FMU."""
        return self._log.last(self.name)

    def _check_end(self, call: str, ends: bool) -> None:
        if ends:
            at = f"{call} at t = {self._time:.9g} s"
            raise EndRequestedError(self.name, at, "terminateSimulation", self.messages())
