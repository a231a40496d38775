"""The functions of Model Exchange of one instance, as an `Integrator` needs them."""

import ctypes
import math
from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any

import numpy as np
from fmpy.model_description import ModelDescription

from ..base.arrays import Vector
from .cvode import IntegratorSettings
from .elements import is_version_3


class DiscardedCall(Exception):  # noqa: N818 - what an error is besides
    """Marks the error of a call that the FMU discarded; other states may succeed."""


class ContinuousModel(ABC):
    """An instance that runs as Model Exchange, without its integrator. Subclasses say how it is called.

    Attributes:
        settings: How to integrate it.
        next_event: Time in s of its next time event; infinite without one.
        has_new_nominals: Whether the nominal values of its states have changed.
    """

    settings = IntegratorSettings()
    next_event = math.inf
    has_new_nominals = True
    _time = math.nan
    _no_way_back = 0  # noSetFMUStatePriorToCurrentPoint

    @property
    @abstractmethod
    def _description(self) -> ModelDescription:
        """The model description."""

    @cached_property
    def state_count(self) -> int:
        """Number of continuous states."""
        return int(self._description.numberOfContinuousStates or 0)

    @cached_property
    def indicator_count(self) -> int:
        """Number of event indicators."""
        return int(self._description.numberOfEventIndicators or 0)

    @cached_property
    def is_3(self) -> bool:
        """Whether it is of FMI 3.0."""
        return is_version_3(self._description)

    @cached_property
    @abstractmethod
    def reports_steps(self) -> bool:
        """Whether the FMU needs a call when a step of the integrator is complete."""

    @abstractmethod
    def _call(self, name: str, *arguments: Any) -> None:
        """Call a function by its short name in FMI 2.0. `DiscardedCall` if the FMU discards it."""

    @abstractmethod
    def _update(self, call: str) -> tuple[bool, bool, bool, bool, bool, float]:
        """Update the discrete states, and return what the FMU says; `call` names this for messages."""

    @abstractmethod
    def _answer_error(self, call: str, answer: str) -> Exception:
        """Return the error for a wrong answer of a call."""

    @abstractmethod
    def _end_error(self, call: str) -> Exception:
        """Return what a call raises in which the FMU asks for the end of the run."""

    def start(self, time: float) -> None:
        """Forget all events; the next initialization begins at a time in s."""
        self._time, self.next_event, self.has_new_nominals = time, math.inf, True

    def enter_event_mode(self) -> None:
        """Enter event mode."""
        self._call("enterEventMode")

    def find_discrete_states(self) -> bool:
        """Compute new discrete states; return whether the FMU needs another iteration.

        A next event at NaN is an error, because it would compare as never.
        """
        call = self._at("updateDiscreteStates" if self.is_3 else "newDiscreteStates")
        needs_more, ends, has_new_nominals, _, has_next, following = self._update(call)
        if has_next and math.isnan(following):
            raise self._answer_error(call, "nextEventTime = NaN")
        if ends:
            raise self._end_error(call)
        self.has_new_nominals |= bool(has_new_nominals)
        self.next_event = following if has_next else math.inf
        return bool(needs_more)

    def enter_continuous_time_mode(self) -> None:
        """Enter continuous-time mode."""
        self._call("enterContinuousTimeMode")

    def complete_step(self) -> bool:
        """Tell the FMU that a step of the integrator is complete; return whether an event follows."""
        if not self.reports_steps:
            return False
        boolean = ctypes.c_bool if self.is_3 else ctypes.c_int
        enters, ends = boolean(), boolean()
        self._call("completedIntegratorStep", self._no_way_back, ctypes.byref(enters), ctypes.byref(ends))
        if ends.value:
            raise self._end_error(self._at("completedIntegratorStep"))
        return bool(enters.value)

    def set_time_and_states(self, time: float, states: int) -> None:
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
        nominals = np.ones(self.state_count)
        if self.state_count:
            self._call("getNominalsOfContinuousStates", nominals.ctypes.data, self.state_count)
        self.has_new_nominals = False
        return np.where(np.isfinite(nominals) & (nominals != 0.0), np.abs(nominals), 1.0)

    def derive(self, result: int) -> None:
        """Write the derivatives of the states, per s, to an address."""
        if self.state_count:
            self._call("getDerivatives", result, self.state_count)

    def indicate(self, result: int) -> None:
        """Write the event indicators to an address."""
        if self.indicator_count:
            self._call("getEventIndicators", result, self.indicator_count)

    def _at(self, call: str) -> str:
        """Return a call with its time."""
        return f"{call} at t = {self._time:.9g} s"
