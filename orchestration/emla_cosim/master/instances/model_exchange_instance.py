"""Instances of FMUs that run as Model Exchange: CVode integrates them between communication points."""

import ctypes
import math
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from fmpy.fmi2 import fmi2EventInfo

from ...base.arrays import Vector
from ...fmu.cvode import RECOVERABLE, CVode, SolverError, load_sundials
from ...fmu.file import FmuFile
from ...fmu.instance import DISCARD, FINE
from ...fmu.log import FmuLog
from .fmu_instance import EndRequestedError, InstanceError
from .in_process_instance import InProcessInstance
from .integrator_settings import IntegratorSettings

SAFETY = 0.02
"""The tolerance of CVode per tolerance of the results: the errors of its steps add up."""

RESTARTED = 1e-3
"""The same where the master makes the integrator start anew: each start adds an error, in each step."""

_SMALLEST = 1e-13
"""Smallest tolerance of CVode."""

_CLOSE = 4.0 * float(np.finfo(float).eps)
"""Times that differ by less, relative to the larger one, are equal."""

_MOST_ITERATIONS = 1000
"""Most iterations of an event, and most events at one time."""

_MOST_STEPS = 10**6
"""Most steps of the integrator in one communication step."""

_TIMES = struct.Struct("<dd")


class IntegrationError(InstanceError):
    """The integrator cannot continue."""

    did = "cannot be integrated {call}: {status}"


class ModelExchangeInstance(InProcessInstance):
    """One instance of an FMU that runs as Model Exchange; see `FmuInstance` and `DescribedInstance`.

    Between two calls the FMU is in continuous-time mode. The integrator goes on from step to step, and
    starts anew where the FMU had an event or got other inputs, and where its state was saved or restored. So
    a repeated step has the same result as the first one.
    """

    def __init__(
        self,
        name: str,
        file: FmuFile,
        inputs: Sequence[str],
        outputs: Sequence[str],
        log: FmuLog,
        number: int = 0,
    ) -> None:
        """Instantiate the FMU; see `InProcessInstance`. CommandError without CVode on this platform."""
        load_sundials()
        self._solver: CVode | None = None
        super().__init__(name, file, inputs, outputs, log, number)
        self._count = int(file.description.numberOfContinuousStates or 0)
        self._indicators = int(file.description.numberOfEventIndicators or 0)
        self._reports_steps = not file.has_capability("completedIntegratorStepNotNeeded")
        self._settings = IntegratorSettings()
        self._raw = {n: f for n, f in self._library.functions.items() if n in self._codes}
        self._settable = self._input_references[self.continuous_inputs]
        self._begin()

    def _begin(self) -> None:
        """Forget everything about earlier runs."""
        self._is_integrating = self._restarts_always = False
        self._time, self._next_event = math.nan, math.inf
        self._passed = np.full(len(self.inputs), math.nan)
        self._slopes: Vector | None = None
        self._is_discontinuous = self._has_new_nominals = True
        self._is_interrupted = False

    def use_integrator(self, settings: IntegratorSettings) -> None:
        """Integrate with these settings from the next initialization on."""
        if self._solver is not None and settings.method != self._settings.method:
            self._solver.close()
            self._solver = None
        self._settings = settings

    def reset(self) -> None:
        """Return to the state right after instantiation."""
        super().reset()
        self._begin()

    def enter_initialization(self, start_time: float, stop_time: float | None = None) -> None:
        """Enter initialization mode; times in s, None without a fixed stop time."""
        self._time = start_time
        super().enter_initialization(start_time, stop_time)

    def exit_initialization(self) -> None:
        """Leave initialization mode, and handle its events."""
        super().exit_initialization()
        self._passed[:] = self.inputs
        self._finish_event()
        self._is_integrating = True

    def set_inputs(self) -> None:
        """Pass `inputs` to the FMU, with an event where they may cause one."""
        if not self._is_integrating:
            super().set_inputs()
            return
        self._slopes = None
        changed = self.inputs != self._passed
        if not changed.any():
            return
        if self._indicators or (changed & ~self.continuous_inputs).any():
            self._call("enterEventMode")
            super().set_inputs()
            self._finish_event()
        else:
            super().set_inputs()
        self._passed[:] = self.inputs
        self._is_discontinuous = self._is_interrupted = True

    def set_input_derivatives(self, derivatives: Vector) -> None:
        """Set the slopes of the inputs during the next step, per s."""
        self._slopes = derivatives[self.continuous_inputs].copy() if derivatives.any() else None

    def do_step(self, time: float, step: float) -> None:
        """Integrate from `time` by `step`, both in s."""
        self._present.time = time
        if self._restarts_always or self._slopes is not None:
            self._is_discontinuous = self._is_interrupted = True
        if not abs(self._time - time) <= _CLOSE * abs(time):
            self._time, self._is_discontinuous = time, True
        self._begun, self._held = self._time, self._passed[self.continuous_inputs]
        try:
            self._advance(time + step)
        except SolverError as error:
            raise self._integration_error(f"{error}.") from error
        if self._slopes is not None:
            self._set_moving_inputs(self._time)
            self._passed[self.continuous_inputs] = self._moving
            self._slopes, self._is_discontinuous, self._is_interrupted = None, True, True

    def save(self, state: Any = None) -> Any:
        """Return a copy of the state, in the memory of the earlier copy `state`."""
        self._is_discontinuous = self._is_interrupted = True  # a repeated step begins as this one
        held = super().save(None if state is None else state[0])
        return held, self._time, self._next_event, self._passed.copy()

    def restore(self, state: Any) -> None:
        """Restore a saved state."""
        held, self._time, self._next_event, passed = state
        self._passed[:], self._slopes = passed, None
        self._is_discontinuous = self._is_interrupted = self._has_new_nominals = True
        super().restore(held)

    def forget(self, state: Any) -> None:
        """Free a saved state."""
        super().forget(state[0])

    def prepare_checkpoints(self) -> None:
        """Start the integrator anew in each step, because a checkpoint does not have its memory."""
        self._restarts_always = True

    def serialize(self) -> bytes:
        """Return the state as bytes."""
        return _TIMES.pack(self._time, self._next_event) + self._passed.tobytes() + super().serialize()

    def deserialize(self, content: bytes) -> None:
        """Restore a state from the bytes of `serialize`."""
        end = _TIMES.size + self._passed.nbytes
        self._time, self._next_event = _TIMES.unpack(content[: _TIMES.size])
        self._passed[:] = np.frombuffer(content[_TIMES.size : end])
        self._restarts_always = self._has_new_nominals = True
        super().deserialize(content[end:])

    def close(self) -> None:
        """Terminate the FMU if the standard allows it, and free the instance, its library and the solver."""
        super().close()
        if self._solver is not None:
            self._solver.close()
            self._solver = None

    def entry_points(self) -> None:
        """Return None: compiled code cannot integrate."""

    def _advance(self, end: float) -> None:
        """Integrate to a time in s, with all events up to it."""
        events, last_event = 0, -math.inf
        while not _reaches(self._time, end):
            is_event, steps = False, 0
            while not is_event and not _reaches(self._time, end):
                target = self._next_event if _reaches(end, self._next_event) else end
                is_event = self._integrate(max(target, self._time))
                is_event = is_event or self._time >= self._next_event
                steps += 1
                if steps > _MOST_STEPS:
                    raise self._integration_error(f"this takes more than {_MOST_STEPS} steps.")
            if is_event:
                self._call("enterEventMode")
                self._finish_event()
                events = events + 1 if _reaches(last_event, self._time) else 0
                last_event = self._time
                if events > _MOST_ITERATIONS:
                    raise self._integration_error(f"it has more than {_MOST_ITERATIONS} events there.")

    def _integrate(self, target: float) -> bool:
        """Do one step of the integrator to at most `target`; return whether an event follows."""
        found = False
        if (self._count or self._indicators) and not _reaches(self._time, target):
            solver = self._ready_solver()
            self._time, found = solver.step(target)
            self._call("setTime", self._time)
            if self._count:
                if not np.isfinite(solver.states).all():
                    raise self._integration_error("a state became infinite or NaN.")
                self._call("setContinuousStates", solver.states.ctypes.data, self._count)
        else:
            self._time = target
            self._call("setTime", target)
        if self._slopes is not None:
            self._set_moving_inputs(self._time)
        if self._reports_steps:
            enters, ends = ctypes.c_int(), ctypes.c_int()
            self._call("completedIntegratorStep", self._no_way_back, ctypes.byref(enters), ctypes.byref(ends))
            self._check_end("completedIntegratorStep", bool(ends.value))
            found = found or bool(enters.value)
        return found

    def _finish_event(self) -> None:
        """Iterate an event until the discrete states settle, and enter continuous-time mode."""
        info = fmi2EventInfo()
        for _ in range(_MOST_ITERATIONS):
            self._call("newDiscreteStates", ctypes.byref(info))
            self._check_end("newDiscreteStates", bool(info.terminateSimulation))
            if info.nominalsOfContinuousStatesChanged:
                self._has_new_nominals = True
            if not info.newDiscreteStatesNeeded:
                break
        else:
            raise self._integration_error(
                f"the discrete states do not settle in {_MOST_ITERATIONS} iterations."
            )
        self._next_event = info.nextEventTime if info.nextEventTimeDefined else math.inf
        self._call("enterContinuousTimeMode")
        self._is_discontinuous = True

    def _check_end(self, call: str, ends: bool) -> None:
        if ends:
            at = f"{call} at t = {self._time:.9g} s"
            raise EndRequestedError(self.name, at, "terminateSimulation", self._log.last(self.name))

    def _ready_solver(self) -> CVode:
        """Return the solver, which starts anew from the FMU's states after a discontinuity."""
        solver = self._solver
        if solver is None:
            # without states, CVode looks for events along one that stays at 0
            solver = self._solver = CVode(
                max(self._count, 1), self._indicators, self._derive, self._indicate, self._settings.method
            )
            self._has_new_nominals = True
        if self._is_discontinuous:
            share = RESTARTED if self._is_interrupted else SAFETY
            tolerance = max(share * self._settings.tolerance, _SMALLEST)
            if self._count:
                self._call("getContinuousStates", solver.states.ctypes.data, self._count)
                if self._has_new_nominals:
                    self._nominals = self._read_nominals()
                solver.absolute[:] = tolerance * self._nominals
            solver.restart(self._time, tolerance, self._settings.largest or 0.0)
            self._is_discontinuous = self._is_interrupted = self._has_new_nominals = False
        return solver

    def _read_nominals(self) -> Vector:
        """Return the nominal values of the states; 1 for those that are not finite and positive."""
        found = np.ones(self._count)
        self._call("getNominalsOfContinuousStates", found.ctypes.data, self._count)
        return np.where(np.isfinite(found) & (found != 0.0), np.abs(found), 1.0)

    def _derive(self, time: float, states: int, result: int) -> int:
        """Compute the derivatives of the states for CVode."""
        if not self._count:
            ctypes.memset(result, 0, ctypes.sizeof(ctypes.c_double))
            return 0
        return self._evaluate("getDerivatives", time, states, result, self._count)

    def _indicate(self, time: float, states: int, result: int) -> int:
        """Compute the event indicators for CVode."""
        return self._evaluate("getEventIndicators", time, states, result, self._indicators)

    def _evaluate(self, call: str, time: float, states: int, result: int, count: int) -> int:
        raw, component = self._raw, self._component  # not recorded one by one, which takes as long
        self._present.code = self._codes[call]
        status = raw["setTime"](component, time)
        if self._count and status in FINE:
            status = raw["setContinuousStates"](component, states, self._count)
        if self._slopes is not None and status in FINE:
            self._set_moving_inputs(time)
        if status in FINE:
            status = raw[call](component, result, count)
        self._present.code = 0
        if status in FINE:
            return 0
        if status == DISCARD:
            return RECOVERABLE
        self._present.code = 0
        error = self.error(f"{call} at t = {time:.9g} s", status)
        raise error

    def _set_moving_inputs(self, time: float) -> None:
        """Set the inputs that change during a step to their values at a time in s."""
        assert self._slopes is not None
        self._moving = self._held + (time - self._begun) * self._slopes
        references = self._settable
        self._call("setReal", references.ctypes.data, len(references), self._moving.ctypes.data)

    def _integration_error(self, reason: str) -> IntegrationError:
        at = f"at t = {self._time:.9g} s"
        return IntegrationError(self.name, at, reason.rstrip("."), self._log.last(self.name))


def _reaches(time: float, other: float) -> bool:
    """Whether a time is at or after another one, apart from rounding."""
    return time >= other or (other < math.inf and other - time <= _CLOSE * max(abs(time), abs(other)))
