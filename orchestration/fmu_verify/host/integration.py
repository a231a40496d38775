"""Integrate a Model Exchange FMU between communication points, with its events."""

import ctypes
from functools import cached_property
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.model_description import ModelDescription

from emla_cosim.base.arrays import Vector
from emla_cosim.fmu.cvode import IntegratorSettings, SolverError
from emla_cosim.fmu.instance import DISCARD
from emla_cosim.fmu.integrator import ContinuousModel, DiscardedCall, Integrator
from emla_cosim.fmu.version_3 import rename

from ..subject import Subject

# CVode gets a thousandth of it: it restarts at each communication point, and the errors add up
_SETTINGS = IntegratorSettings(tolerance=1e-6)


_DOUBLES = ctypes.POINTER(ctypes.c_double)


class RunEndedError(Exception):
    """The FMU asked to end the run."""


class IntegrationError(Exception):
    """The model cannot be integrated; the text says why."""


class EndlessEventError(IntegrationError):
    """The iteration of an event does not end."""


class _RefusedError(FMICallException, DiscardedCall):
    """A call that the FMU discarded."""


class HostedModel(ContinuousModel):
    """The model of fmpy's object `fmu`, which may have one instance after another; raises fmpy's errors."""

    settings = _SETTINGS

    def __init__(self, fmu: Any, subject: Subject) -> None:
        self.fmu, self._subject, self._functions = fmu, subject, dict[str, Any]()
        self.event_faults: list[str] = []
        """Changes at events that were not announced, and next events in the past, as messages."""

    @property
    def _description(self) -> ModelDescription:
        return self._subject.description

    @cached_property
    def needs_completed_step(self) -> bool:
        """Whether the FMU needs a call after each step of the integrator."""
        if self.is_3:
            return self._subject.has_flag("needsCompletedIntegratorStep", "ModelExchange")
        return not self._subject.find_kind_element("ModelExchange").completedIntegratorStepNotNeeded

    def start(self, time: float) -> None:
        """Forget all events; structural parameters of FMI 3.0 may have changed the states."""
        super().start(time)
        if self.is_3:
            self.state_count = self.fmu.getNumberOfContinuousStates()
            self.indicator_count = self.fmu.getNumberOfEventIndicators()

    def _call(self, name: str, *arguments: Any) -> None:
        if len(arguments) == 2:  # the address of doubles, and their number
            arguments = (ctypes.cast(arguments[0], _DOUBLES), arguments[1])
        try:
            self._find_function(name)(self.fmu.component, *arguments)
        except FMICallException as error:
            if error.status == DISCARD:
                raise _RefusedError(error.function, DISCARD) from error
            raise

    def _find_function(self, name: str) -> Any:
        if name not in self._functions:  # integrators call few of them, thousands of times
            function, prefix = (rename(name), "fmi3") if self.is_3 else (name, "fmi2")
            self._functions[name] = getattr(self.fmu, f"{prefix}{function[0].upper()}{function[1:]}")
        return self._functions[name]

    def _update(self, call: str) -> tuple[bool, bool, bool, bool, bool, float]:
        """Update the discrete states, and note changes and event times that the FMU does not announce."""
        before = self._read_states()
        answer = self.fmu.newDiscreteStates()
        if not answer[3] and (changed := before != self._read_states()).any():
            message = f"{call} changed continuous state {int(np.argmax(changed)) + 1}"
            self.event_faults.append(f"{message}, but valuesOfContinuousStatesChanged is false.")
        if answer[4] and answer[5] < self._time:
            at = f"t = {answer[5]:.9g} s"
            self.event_faults.append(f"{call} announced the next event for {at}, which is in the past.")
        return answer

    def _read_states(self) -> Vector:
        states = np.zeros(self.state_count)
        self.read_states(states.ctypes.data)
        return states

    def write_nominals(self, result: int) -> None:
        """Write the nominal values of the states to an address."""
        self._call("getNominalsOfContinuousStates", result, self.state_count)

    def _answer_error(self, call: str, answer: str) -> IntegrationError:
        return IntegrationError(f"{call} answered {answer}")

    def _end_error(self, call: str) -> RunEndedError:
        return RunEndedError()


class HostedIntegration(Integrator[HostedModel]):
    """Integrates a model. Between steps it is in event mode."""

    def __init__(self, fmu: Any, subject: Subject) -> None:
        """Prepare to integrate. This calls no function of the FMU."""
        self.members = [HostedModel(fmu, subject)]

    def begin(self, time: float) -> None:
        """Handle the events of the initialization, at a time in s; see `step`."""
        self.members[0].start(time)
        self._begin(time)
        self._iterate_events()

    def step(self, time: float, length: float) -> None:
        """Integrate from `time` by `length`, both in s.

        Raises:
            FMICallException: A call failed.
            RunEndedError: The FMU asked to end the run.
            IntegrationError: The integration cannot continue.
        """
        self._time = time
        self._finish_event()
        try:
            self._advance(time + length)
        except SolverError as error:
            raise self.refusal or IntegrationError(f"the solver gave up ({error})") from error
        self._enter_event_mode()
        self._iterate_events()

    def close(self) -> None:
        """Free the solver."""
        self._free_solver()

    def _finish_event(self) -> None:
        super()._finish_event()
        self._is_interrupted = True

    def _make_endless_iteration_error(self, reason: str) -> IntegrationError:
        return EndlessEventError(reason)

    def _make_integration_error(self, reason: str) -> IntegrationError:
        return IntegrationError(reason)
