"""Integrate a Model Exchange FMU between communication points, with its events."""

import ctypes
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException

from emla_cosim.base.arrays import Vector
from emla_cosim.fmu.cvode import RECOVERABLE, CVode, SolverError
from emla_cosim.fmu.instance import DISCARD

from ..subject import Subject

RELATIVE_TOLERANCE = 1e-9
"""Tight, since the solver restarts at each communication point and the errors add up."""

_MOST_STEPS = 50_000
"""Most solver steps between two communication points."""

_MOST_ITERATIONS = 1000
"""Most iterations of one event, and most events between two communication points."""


class Integration:
    """Integrates a model with CVode. Between steps the model is in event mode.

    `fmu` is fmpy's object, which may have one instance after another. `terminated` is true after the
    model asked to end the run.
    """

    def __init__(self, fmu: Any, subject: Subject) -> None:
        """Prepare to integrate. This calls no function of the FMU."""
        self.terminated = False
        self._fmu = fmu
        self._is_3 = subject.version == 3
        self._states = int(subject.description.numberOfContinuousStates or 0)
        self._indicators = int(subject.description.numberOfEventIndicators or 0)
        if self._is_3:
            self._tells = subject.has_flag("needsCompletedIntegratorStep", "ModelExchange")
        else:
            self._tells = not subject.find_kind_element("ModelExchange").completedIntegratorStepNotNeeded
        self._next_event = math.inf
        self._solver: CVode | None = None

    def close(self) -> None:
        """Free the solver."""
        if self._solver is not None:
            self._solver.close()
            self._solver = None

    def begin(self) -> None:
        """Handle the events of the initialization."""
        self.terminated = False
        if self._is_3:  # structural parameters may change them
            self.close()
            self._states = self._fmu.getNumberOfContinuousStates()
            self._indicators = self._fmu.getNumberOfEventIndicators()
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
        for _ in range(_MOST_STEPS):
            until = min(end, max(self._next_event, time))
            found = False
            if until > time:
                time, found = self._advance(solver, until)
                if self._states:
                    self._fmu.setContinuousStates(_doubles(solver.states.ctypes.data), self._states)
            self._fmu.setTime(time)
            entered = self._tells and self._complete_step()
            if found or entered or self.terminated or time >= min(end, self._next_event) - close:
                return end if end - time <= close else time
        raise RuntimeError(f"it takes more than {_MOST_STEPS} steps of the solver")

    def _advance(self, solver: CVode, until: float) -> tuple[float, bool]:
        """Do one step of the solver. Raise RuntimeError on failure."""
        self._refused: FMICallException | None = None
        try:
            return solver.step(until)
        except SolverError as error:
            raise self._refused or RuntimeError(f"the solver gave up ({error})") from error

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

    def _restart_solver(self, time: float) -> CVode:
        """Restart the solver at `time`."""
        if self._solver is None:
            self._solver = CVode(max(self._states, 1), self._indicators, self._derive, self._indicate)
        solver = self._solver
        if self._states:
            solver.absolute[:] = RELATIVE_TOLERANCE * self._nominals()
            self._fmu.getContinuousStates(_doubles(solver.states.ctypes.data), self._states)
        solver.restart(time, RELATIVE_TOLERANCE)
        return solver

    def _derive(self, time: float, states: int, result: int) -> int:
        """Compute derivatives for the solver."""
        if not self._states:
            ctypes.memset(result, 0, ctypes.sizeof(ctypes.c_double))
            return 0
        return self._evaluate(self._fmu.getDerivatives, time, states, result, self._states)

    def _indicate(self, time: float, states: int, result: int) -> int:
        """Compute event indicators for the solver."""
        return self._evaluate(self._fmu.getEventIndicators, time, states, result, self._indicators)

    def _evaluate(self, call: Callable[..., Any], time: float, states: int, result: int, count: int) -> int:
        """Call a function at a time and states; a discarded call asks the solver for a shorter step."""
        try:
            self._fmu.setTime(time)
            if self._states:
                self._fmu.setContinuousStates(_doubles(states), self._states)
            call(_doubles(result), count)
        except FMICallException as error:
            if error.status != DISCARD:
                raise
            self._refused = error
            return RECOVERABLE
        return 0

    def _nominals(self) -> Vector:
        """Return the nominal values of the states; 1 for those that are not finite and positive."""
        found = np.ones(self._states)
        self._fmu.getNominalsOfContinuousStates(_doubles(found.ctypes.data), self._states)
        return np.where(np.isfinite(found) & (found > 0.0), found, 1.0)


def _doubles(address: int) -> Any:
    return ctypes.cast(address, ctypes.POINTER(ctypes.c_double))
