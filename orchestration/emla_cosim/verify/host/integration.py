"""A model for Model Exchange, integrated from one communication point to the next, events included."""

import ctypes
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.sundials import CVodeSolver

from ..subject import Subject

RELATIVE_TOLERANCE = 1e-7
"""Of the integration, well below what a comparison with co-simulation asks for."""

_MOST_STEPS = 50_000
"""Of the solver, from one communication point to the next."""

_MOST_ITERATIONS = 1000
"""Of one event."""


class _NoInput:
    """Inputs are held over a step."""

    def apply(self, time: float) -> None:
        """Nothing changes."""


class Integration:
    """Takes a model on with CVode. Between steps the model is in event mode.

    `fmu` is fmpy's object, which may have one instance after another. `terminated` tells that the
    model asked to end the run.
    """

    def __init__(self, fmu: Any, subject: Subject) -> None:
        """Prepare to integrate; nothing is called before `begin`."""
        self.terminated = False
        self._fmu = fmu
        self._states = int(subject.description.numberOfContinuousStates)
        self._indicators = int(subject.description.numberOfEventIndicators or 0)
        self._tells = not subject.means("ModelExchange").completedIntegratorStepNotNeeded
        self._next_event = math.inf
        self._solver: Any = None
        self._error: Exception | None = None

    def begin(self) -> None:
        """Do the events of the initialization, which has just ended."""
        self.terminated, self._error = False, None
        self._do_events()

    def step(self, time: float, length: float) -> None:
        """Integrate from `time` by `length`, both in s."""
        end = time + length
        self._do_events()
        while time < end and not self.terminated:
            self._fmu.enterContinuousTimeMode()
            time = self._to_event(time, end)
            self._fmu.enterEventMode()
            self._do_events()

    def _to_event(self, time: float, end: float) -> float:
        """Integrate until an event or the end; when that is."""
        solver = self._restarted(time)
        close = 1e-12 * max(abs(end), end - time)
        while time < end:
            until = min(end, max(self._next_event, time))
            found = False
            if until > time:
                found, _, time = solver.step(time, until)
                self._check()
            self._fmu.setTime(time)
            entered = self._tells and self._completed()
            if found or entered or self.terminated or time >= self._next_event - close:
                break
        return end if end - time <= close else time

    def _completed(self) -> bool:
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
            raise FMICallException("fmi2NewDiscreteStates, asked for again and again,", 3)
        self._next_event = time if defined else math.inf

    def _restarted(self, time: float) -> Any:
        """The solver, without memory of what was before `time`."""
        if self._solver is None:
            fmu = self._fmu
            self._solver = CVodeSolver(
                nx=self._states,
                nz=self._indicators,
                get_x=fmu.getContinuousStates,
                set_x=self._guarded(fmu.setContinuousStates),
                get_dx=self._guarded(fmu.getDerivatives),
                get_z=self._guarded(fmu.getEventIndicators),
                get_nominals=self._nominals,
                set_time=self._guarded(fmu.setTime),
                input=_NoInput(),
                startTime=time,
                relativeTolerance=RELATIVE_TOLERANCE,
                maxNumSteps=_MOST_STEPS,
            )
        self._solver.reset(time)
        return self._solver

    def _nominals(self, values: Any, count: int) -> None:
        """Nominal values of the states, 1 where the model gives none that a tolerance can be made of."""
        self._fmu.getNominalsOfContinuousStates(values, count)
        found = np.ctypeslib.as_array(ctypes.cast(values, ctypes.POINTER(ctypes.c_double)), (count,))
        found[~(np.isfinite(found) & (found > 0.0))] = 1.0

    def _guarded(self, call: Callable[..., Any]) -> Callable[..., Any]:
        """A call that the solver makes, through which no exception comes."""

        def guarded(*arguments: Any) -> None:
            try:
                call(*arguments)
            except Exception as error:
                self._error = self._error or error

        return guarded

    def _check(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise error
