"""Integration of models by CVode between communication points, with the functions and events of FMUs."""

import ctypes
import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from functools import cached_property
from itertools import accumulate
from typing import Any, Generic, TypeVar

import numpy as np
from fmpy.model_description import ModelDescription

from ..base.arrays import Vector
from .cvode import RECOVERABLE, CVode, IntegratorSettings
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
    def needs_completed_step(self) -> bool:
        """Whether the FMU needs a call when a step of the integrator is complete."""

    @abstractmethod
    def _call(self, name: str, *arguments: Any) -> None:
        """Call a function by its short name in FMI 2.0. `DiscardedCall` if the FMU discards it."""

    @abstractmethod
    def _update(self, call: str) -> tuple[bool, bool, bool, bool, bool, float]:
        """Update the discrete states. Return the six answers of the FMI function; the last is the next time.

        `call` names this for messages.
        """

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
        if not self.needs_completed_step:
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
        """Return the magnitudes of the states' nominal values, 1 for those that are not finite or 0.

        They count as known from now on; see `has_new_nominals`.
        """
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


SAFETY = 0.02
"""The tolerance of CVode per tolerance of the results: the errors of its steps add up."""

RESTARTED = 1e-3
"""The same where the host makes the integrator start anew: each start adds an error, in each step."""

_SMALLEST = 1e-13
"""Smallest tolerance of CVode."""

CLOSE = 4.0 * float(np.finfo(float).eps)
"""Times that differ by less, relative to the larger one, are equal."""

MAX_ITERATIONS = 1000
"""Most iterations of an event, and most events at one time."""

_MOST_STEPS = 10**6
"""Most steps of the integrator in one communication step."""

_BYTES = ctypes.sizeof(ctypes.c_double)

Model = TypeVar("Model", bound=ContinuousModel)


class Integrator(ABC, Generic[Model]):
    """Integrates models with one solver, to a time and with all events on the way.

    The solver continues from step to step. It starts anew where a model had an event, and after other
    discontinuities.

    Attributes:
        members: The models.
        refusal: The error of the last call that a model discarded in the present step of the solver.
    """

    members: list[Model]
    refusal: Exception | None = None
    _solver: CVode | None = None

    @abstractmethod
    def _make_integration_error(self, reason: str) -> Exception:
        """Return the error if the integration cannot continue."""

    def _begin(self, time: float) -> None:
        """Forget everything about earlier runs; `time` in s."""
        self._state_offsets, self._count = _compute_offsets([m.state_count for m in self.members])
        self._indicator_offsets, self._indicators = _compute_offsets(
            [m.indicator_count for m in self.members]
        )
        self._time, self._next_event = time, math.inf
        self._is_discontinuous, self._is_interrupted = True, False
        self._tolerance = min(m.settings.tolerance for m in self.members)
        self._largest = self.members[0].settings.largest or 0.0
        self._method = self.members[0].settings.method
        self._free_solver()

    def read_states(self) -> Vector:
        """Return the present states of the FMUs."""
        states = np.empty(self._count)
        for member, offset in zip(self.members, self._state_offsets, strict=True):
            member.read_states(states.ctypes.data + offset)
        return states

    def _exchange_values(self) -> Collection[Model]:
        """Pass all values between the FMUs, which are in event mode; return those that got other inputs."""
        return ()

    def _set_following_inputs(self, time: float) -> None:
        """Set the inputs that follow the time in s and the states, which were set."""

    def _advance(self, end: float) -> None:
        """Integrate to a time in s, with all events up to it."""
        events, last_event = 0, -math.inf
        while not _has_reached(self._time, end):
            is_event, steps = False, 0
            while not is_event and not _has_reached(self._time, end):
                # the step ends at a time event
                target = self._next_event if _has_reached(end, self._next_event) else end
                is_event = self._integrate(max(target, self._time))
                is_event = is_event or self._time >= self._next_event
                steps += 1
                if steps > _MOST_STEPS:
                    raise self._make_integration_error(f"this takes more than {_MOST_STEPS} steps.")
            if is_event:
                self._enter_event_mode()
                self._finish_event()
                # an FMU that asks for one event after the other would stop the time
                events = events + 1 if _has_reached(last_event, self._time) else 0
                last_event = self._time
                if events > MAX_ITERATIONS:
                    raise self._make_integration_error(f"it has more than {MAX_ITERATIONS} events there.")

    def _integrate(self, target: float) -> bool:
        """Do one step of the integrator to at most `target`; return whether an event follows."""
        is_event, self.refusal = False, None
        if (self._count or self._indicators) and not _has_reached(self._time, target):
            solver = self._prepare_solver()
            self._time, is_event = solver.step(target)
            if not np.isfinite(solver.states).all():
                raise self._make_integration_error("a state became infinite or NaN.")
            states = solver.states
        else:
            self._time, states = target, self.read_states()
        self._set_states(self._time, states.ctypes.data)
        for member in self.members:
            is_event = member.complete_step() or is_event
        return is_event

    def _enter_event_mode(self) -> None:
        for member in self.members:
            member.enter_event_mode()

    def _iterate_events(self) -> None:
        """Iterate an event until the discrete states settle."""
        self._exchange_values()
        waiting: Collection[Model] = self.members
        for _ in range(MAX_ITERATIONS):
            unsettled = [m for m in waiting if m.find_discrete_states()]
            changed = self._exchange_values()
            waiting = [m for m in self.members if m in unsettled or m in changed]
            if not waiting:
                break
        else:
            raise self._make_endless_iteration_error(
                f"the discrete states do not settle in {MAX_ITERATIONS} iterations."
            )
        self._next_event = min(m.next_event for m in self.members)

    def _make_endless_iteration_error(self, reason: str) -> Exception:
        """Return the error for an event whose iteration does not end."""
        return self._make_integration_error(reason)

    def _finish_event(self) -> None:
        """Iterate an event until the discrete states settle, and enter continuous-time mode."""
        self._iterate_events()
        for member in self.members:
            member.enter_continuous_time_mode()
        self._is_discontinuous = True

    def _prepare_solver(self) -> CVode:
        """Return the solver, which starts anew from the FMUs' states after a discontinuity."""
        solver, is_new = self._solver, self._solver is None
        if solver is None:
            # without states, CVode looks for events along one that stays at 0
            solver = self._solver = CVode(
                max(self._count, 1), self._indicators, self._derive, self._compute_indicators, self._method
            )
        if self._is_discontinuous:
            share = RESTARTED if self._is_interrupted else SAFETY
            tolerance = max(share * self._tolerance, _SMALLEST)
            if self._count:
                solver.states[:] = self.read_states()
                if is_new or any(m.has_new_nominals for m in self.members):
                    self._nominals = np.concatenate([m.read_nominals() for m in self.members])
                solver.absolute[:] = tolerance * self._nominals
            solver.restart(self._time, tolerance, self._largest)
            self._is_discontinuous = self._is_interrupted = False
        return solver

    def _set_states(self, time: float, states: int) -> None:
        """Set the time in s, the states from an address, and the inputs that follow."""
        for member, offset in zip(self.members, self._state_offsets, strict=True):
            member.set_time_and_states(time, states + offset)
        self._set_following_inputs(time)

    def _derive(self, time: float, states: int, result: int) -> int:
        """Compute the derivatives of the states for CVode."""
        if not self._count:
            ctypes.memset(result, 0, _BYTES)
            return 0
        try:
            self._set_states(time, states)
            for member, offset in zip(self.members, self._state_offsets, strict=True):
                member.derive(result + offset)
        except DiscardedCall as error:
            self.refusal = error
            return RECOVERABLE
        return 0

    def _compute_indicators(self, time: float, states: int, result: int) -> int:
        """Compute the event indicators for CVode."""
        try:
            self._set_states(time, states)
            for member, offset in zip(self.members, self._indicator_offsets, strict=True):
                member.indicate(result + offset)
        except DiscardedCall as error:
            self.refusal = error
            return RECOVERABLE
        return 0

    def _free_solver(self) -> None:
        if self._solver is not None:
            self._solver.close()
            self._solver = None


def _has_reached(time: float, target: float) -> bool:
    """Whether a time is at or after another one, apart from rounding."""
    return time >= target or (target < math.inf and target - time <= CLOSE * max(abs(time), abs(target)))


def _compute_offsets(counts: Sequence[int]) -> tuple[list[int], int]:
    """Return where the doubles of each member begin, in bytes, and how many doubles there are."""
    ends = [0, *accumulate(counts)]
    return [_BYTES * end for end in ends[:-1]], ends[-1]
