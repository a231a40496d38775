"""Integrate a Model Exchange FMU between communication points, with its events."""

import ctypes
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.sundials import CVodeSolver

from ...fmu.instance import DISCARD
from ..subject import Subject

RELATIVE_TOLERANCE = 1e-9
"""Tight, since the solver restarts at each communication point and the errors add up."""

_MOST_STEPS = 50_000
"""Most solver steps between two communication points."""

_MOST_ITERATIONS = 1000
"""Most iterations of one event, and most events between two communication points."""


class _NoInput:
    """Inputs are held over a step."""

    def apply(self, time: float) -> None:
        """Do nothing."""


class _Solver(CVodeSolver):
    """fmpy's solver, extended for models that refuse a call."""

    refused: FMICallException | None = None

    def advance(self, time: float, until: float) -> tuple[bool, float]:
        """Return whether there was an event, and the time reached. Raise RuntimeError on failure."""
        self.refused = None
        try:
            found, _, reached = self.step(time, until)
        except (RuntimeError, TypeError) as error:  # TypeError if CVode has no message
            raise self.refused or RuntimeError(f"the solver gave up ({error})") from error
        return bool(found), float(reached)

    def f(self, *arguments: Any) -> int:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Compute derivatives, or ask the solver for a shorter step."""
        return self._call(super().f, arguments)

    def g(self, *arguments: Any) -> int:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Compute event indicators."""
        return self._call(super().g, arguments)

    def _call(self, call: Callable[..., int], arguments: tuple[Any, ...]) -> int:
        try:
            return call(*arguments)
        except FMICallException as error:
            self.refused = error
            return 1 if error.status == DISCARD else -1


class Integration:
    """Integrates a model with CVode. Between steps the model is in event mode.

    `fmu` is fmpy's object, which may have one instance after another. `terminated` is true after the
    model asked to end the run.
    """

    def __init__(self, fmu: Any, subject: Subject) -> None:
        """Prepare to integrate. This calls no function of the FMU."""
        self.terminated = False
        self._fmu = fmu
        self._states = int(subject.description.numberOfContinuousStates)
        self._indicators = int(subject.description.numberOfEventIndicators or 0)
        self._tells = not subject.find_kind_element("ModelExchange").completedIntegratorStepNotNeeded
        self._next_event = math.inf
        self._solver: Any = None

    def begin(self) -> None:
        """Handle the events of the initialization."""
        self.terminated = False
        self._do_events()

    def step(self, time: float, length: float) -> None:
        """Integrate from `time` by `length`, both in s. Raise RuntimeError if the solver fails."""
        end = time + length
        self._do_events()
        for _ in range(_MOST_ITERATIONS):
            self._fmu.enterContinuousTimeMode()
            time = self._to_event(time, end)
            self._fmu.enterEventMode()
            self._do_events()
            if time >= end or self.terminated:
                return
        raise RuntimeError(f"it has more than {_MOST_ITERATIONS} events up to t = {time:.9g} s")

    def _to_event(self, time: float, end: float) -> float:
        """Integrate until an event or the end, and return the time reached."""
        solver = self._restart_solver(time)
        close = 1e-12 * max(abs(end), end - time)
        while time < end:
            until = min(end, max(self._next_event, time))
            found = False
            if until > time:
                found, time = solver.advance(time, until)
            self._fmu.setTime(time)
            entered = self._tells and self._complete_step()
            if found or entered or self.terminated or time >= self._next_event - close:
                break
        return end if end - time <= close else time

    def _complete_step(self) -> bool:
        enter, terminate = self._fmu.completedIntegratorStep(noSetFMUStatePriorToCurrentPoint=0)
        self.terminated = self.terminated or terminate
        return enter

    def _do_events(self) -> None:
        for _ in range(_MOST_ITERATIONS):
            needed, terminate, _, _, defined, time = self._fmu.newDiscreteStates()
            self.terminated = self.terminated or terminate
            if not needed or terminate:
                break
        else:
            raise FMICallException("fmi2NewDiscreteStates, called repeatedly,", 3)
        self._next_event = time if defined else math.inf

    def _restart_solver(self, time: float) -> Any:
        """Restart the solver at `time`."""
        if self._solver is None:
            fmu = self._fmu
            self._solver = _Solver(
                nx=self._states,
                nz=self._indicators,
                get_x=fmu.getContinuousStates,
                set_x=fmu.setContinuousStates,
                get_dx=fmu.getDerivatives,
                get_z=fmu.getEventIndicators,
                get_nominals=self._nominals,
                set_time=fmu.setTime,
                input=_NoInput(),
                startTime=time,
                relativeTolerance=RELATIVE_TOLERANCE,
                maxNumSteps=_MOST_STEPS,
            )
        self._solver.reset(time)
        return self._solver

    def _nominals(self, values: Any, count: int) -> None:
        """Read the nominal values of the states; use 1 for those that are not finite and positive."""
        self._fmu.getNominalsOfContinuousStates(values, count)
        found = np.ctypeslib.as_array(ctypes.cast(values, ctypes.POINTER(ctypes.c_double)), (count,))
        found[~(np.isfinite(found) & (found > 0.0))] = 1.0
