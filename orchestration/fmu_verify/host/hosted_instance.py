"""One instance of an FMU. Every call is noted before and checked after."""

import time as clock
from collections.abc import Callable, Iterable, Mapping, Sequence
from ctypes import byref, c_bool, c_double, c_int, c_size_t, c_uint
from typing import Any

from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import fmi2DoStepStatus
from fmpy.model_description import ModelVariable

from emla_cosim.base.crash_page import read_note
from emla_cosim.base.errors import CommandError
from emla_cosim.fmu.elements import ElementLayout
from emla_cosim.fmu.instance import DISCARD, ERROR, FINE, OK, PENDING, STATUS, WARNING, FmiInstance, load
from emla_cosim.fmu.log import LogLine
from emla_cosim.fmu.python_exceptions import find_left_exception

from ..check import LEAVES_EXCEPTION, Clause, NotRunError, describe_exception
from ..subject import Subject
from ..subprocess_run import note
from .arrays import Arrays, ElementDependency, set_elements
from .event_mode import NO_EARLY_RETURN, EventState, HostedEvents
from .integration import EndlessEventError, HostedIntegration, HostedModel, IntegrationError, RunEndedError
from .log import LOG, format_message

RETURNS_EARLY = "mightReturnEarlyFromDoStep"
"""The flag of FMUs whose steps can end before their end."""

_LARGEST_STATE = 2**28
"""Largest plausible size of a state in bytes."""


class CallError(Exception):
    """A call that failed. Message: `fmi2DoStep at t = 1 s answered fmi2Error: ...`."""

    def __init__(
        self,
        call: str,
        status: int,
        lines: Iterable[LogLine] = (),
        sentence: str = "",
        clause: Clause | None = None,
    ) -> None:
        """Say what a call answered, and the last lines of the log; or a message on what is wrong."""
        self.call, self.status, self.clause = call, status, clause
        answer = STATUS[status] if self.has_status else f"{status}, which is not a valid status"
        super().__init__(sentence or f"{call} answered {answer}{_quote_log(lines)}")

    @property
    def has_status(self) -> bool:
        """Whether the answer is one of the statuses of the standard."""
        return 0 <= self.status < (PENDING if self.call.startswith("fmi3") else len(STATUS))

    def __reduce__(self) -> Any:
        """Pickle the message instead of the log lines."""
        return type(self), (self.call, self.status, (), str(self), self.clause)


class EndlessIterationError(CallError):
    """Updates of discrete states that ask for another one, without end."""


def _quote_log(lines: Iterable[LogLine]) -> str:
    """Return the end of a message, with the last log messages."""
    text = " ".join(line.text for line in list(lines)[-2:])
    return f": {format_message(text)}" if text else "."


class SerializedState(bytes):
    """The bytes of a state, with what is known of the instance beside it."""

    events: EventState | None = None
    writable: Sequence[tuple[int, int]] = ()
    """Spans of addresses of the process that saved it, which may change."""


class HostedInstance(FmiInstance):
    """An instance, from its instantiation until `close`. Its name must be unique in the process.

    FMUs with Clocks use event mode: clocked variables are set at the next tick of their Clocks, and have the
    values of the last one.

    `kind` is `CoSimulation` or `ModelExchange`; default: the first kind of the FMU. `terminated` is true
    after the FMU asked to end the run. `unexpected_event` is what a step said that no host without event
    mode expects, and `reached` the time in s that it said it reached. `step_began` is when the last step
    began, in s; None before the first one. `circumstance` is added to the note of every call:
    ` with u = nan`.
    """

    circumstance = ""
    unexpected_event = ""
    reached: float | None = None
    step_began: float | None = None

    def __init__(
        self,
        subject: Subject,
        name: str = "examined",
        kind: str | None = None,
        logging: bool = False,
        guid: str | None = None,
        events: bool | None = None,
        allows_early_return: bool | None = None,
    ) -> None:
        """Load the library and instantiate. Raise CallError on failure.

        `events` and `allows_early_return` let an FMU of FMI 3.0 use event mode, and return early from steps.
        By default, one with Clocks does as it declares.
        """
        self.subject, self.name = subject, name
        self.kind = kind or subject.kinds[0]
        ticks = self.kind == "CoSimulation" and subject.has_clocks
        uses_events = ticks if events is None else events
        if allows_early_return is None:
            allows_early_return = ticks and subject.has_flag(RETURNS_EARLY, self.kind)
        self.instantiation = {"eventModeUsed": uses_events, "earlyReturnAllowed": allows_early_return}
        library = subject.library(self.kind)
        LOG.listen()  # other code of this process may have a log of its own
        note("loading its library")
        try:
            assert library is not None, "There is no library for this machine."
            self.fmu = load(
                self.kind,
                library,
                subject.folder,
                subject.find_kind_element(self.kind).modelIdentifier,
                subject.description.guid if guid is None else guid,
                f"{subject.version}.0",
            )
        except Exception as error:  # fmpy raises bare ones
            if find_left_exception(error) is not None:
                raise self.python_error("dlopen", error) from error
            sentence = f"Its library cannot be loaded: {format_message(str(error))}"
            raise CallError("dlopen", ERROR, sentence=sentence) from error
        self.fmu.instance, self.fmu.instanceName = self, name
        self._is_3, self._arrays = subject.version == 3, Arrays()
        self._variable_lists: dict[tuple[str, ...], list[ModelVariable]] = {}
        self._element_layouts: dict[tuple[str, ...], ElementLayout] = {}
        self._integration = HostedIntegration(self.fmu, subject) if self.kind == "ModelExchange" else None
        self.events: HostedEvents | None = None
        """What steps the instance with event mode or early returns, if it does."""
        if uses_events or allows_early_return:
            self.events = HostedEvents(self, uses_events, allows_early_return)
        self.instantiate(logging)

    @property
    def model(self) -> HostedModel | None:
        """What integrators call, of an instance for Model Exchange."""
        return None if self._integration is None else self._integration.members[0]

    def instantiate(self, logging: bool = False) -> None:
        """Instantiate, at first or after `free`, with the loaded library. Raise CallError on failure."""
        self._forget()
        try:
            self.fmu.instantiate(callbacks=LOG.callbacks, loggingOn=logging)
        except CallError:
            raise
        except Exception as error:  # fmpy raises a bare one for NULL
            sentence = f"fmi2Instantiate answered NULL{_quote_log(LOG.of(self.name))}"
            raise CallError("fmi2Instantiate", ERROR, sentence=sentence) from error

    def announce(self, function: str, arguments: Sequence[Any] = ()) -> None:
        """Note the next call."""
        at = f" at t = {arguments[1]:.9g} s" if function in ("fmi2DoStep", "fmi3DoStep") else ""
        note(f"{function}{at}{self.circumstance}")

    def status(self, name: str, *arguments: Any) -> int:
        """Call a function, named as in FMI 2.0, with the component and these arguments; return its status."""
        return super().status(name.replace("fmi2", "fmi3", 1) if self._is_3 else name, *arguments)

    def step_status(self, time: float, length: float) -> int:
        """Call the function that steps, whatever the phase; return its status."""
        if not self._is_3:
            return self.status("fmi2DoStep", time, length, 0)
        flags, reached = [c_bool() for _ in range(3)], c_double()
        message = "fmi3DoStep"
        return self.status(message, time, length, False, *(byref(flag) for flag in flags), byref(reached))

    def plain_step(self) -> tuple[Callable[..., int], tuple[Any, ...]]:
        """Return the function that steps as the library has it, and what follows time and length.

        Its calls are not noted, and what it says beside its status is not read.
        """
        note(f"fmi{3 if self._is_3 else 2}DoStep, again and again")
        if not self._is_3:
            return self.fmu.dll.fmi2DoStep, (0,)
        flags = [byref(c_bool()) for _ in range(3)]
        return self.fmu.dll.fmi3DoStep, (False, *flags, byref(c_double()))

    def enter_initialization_status(self, start: float) -> int:
        """Call the function that enters initialization mode, whatever the phase; return its status."""
        arguments = (False, 0.0, start, False, 0.0) if self._is_3 else ()
        return self.status("fmi2EnterInitializationMode", *arguments)

    def set_status(self, values: Mapping[str, Any]) -> int:
        """Set variables by name, whatever the phase; return the status."""
        try:
            self.set(values)
        except CallError as error:
            return error.status
        return OK

    def error(self, call: str, status: int) -> CallError:
        """Return the error for a call with this status."""
        return CallError(call, status, LOG.of(self.name, WARNING))

    def python_error(self, function: str, error: Exception) -> CallError:
        """Return the error for a call that left an exception of Python."""
        return CallError(function, ERROR, (), describe_exception(read_note(), error), LEAVES_EXCEPTION)

    def violation(self, sentence: str, clause: Clause | None, is_endless: bool = False) -> CallError:
        """Return the error for what a function said against a clause, or for an iteration without end."""
        kind = EndlessIterationError if is_endless else CallError
        return kind(sentence.split()[0], ERROR, (), sentence, clause)

    def save_state(self) -> Any:
        """Return a new copy of the state."""
        with self.calling():
            state = self.fmu.getFMUState()
        self._attach_events(state)
        return state

    def save_state_again(self, state: Any) -> None:
        """Save the state in the memory of an earlier one."""
        name = "fmi3GetFMUState" if self._is_3 else "fmi2GetFMUstate"
        with self.calling():
            getattr(self.fmu, name)(self.fmu.component, byref(state))
        self._attach_events(state)

    def _attach_events(self, state: Any) -> None:
        state.events = None if self.events is None else self.events.save()

    def restore_state(self, state: Any) -> None:
        """Continue from a saved state."""
        with self.calling():
            self.fmu.setFMUState(state)
        self.terminated = False
        if self.events is not None and (saved_events := getattr(state, "events", None)) is not None:
            self.events.restore(saved_events)

    def free_state(self, state: Any) -> None:
        """Free a saved state."""
        with self.calling():
            self.fmu.freeFMUstate(state)

    def serialize(self, state: Any) -> bytes | int:
        """Return the bytes of a state, or the size that the FMU reports if it is not plausible."""
        size = c_size_t()
        with self.calling():
            self.fmu.fmi2SerializedFMUstateSize(self.fmu.component, state, byref(size))
            # a wrong size would make this process allocate what it has not
            if not 0 < size.value <= _LARGEST_STATE:
                return size.value
            content = self.fmu.serializeFMUState(state) if self._is_3 else self.fmu.serializeFMUstate(state)
        serialized = SerializedState(content)
        serialized.events = getattr(state, "events", None)
        return serialized

    def deserialize(self, data: bytes) -> Any:
        """Return a state from its bytes."""
        with self.calling():
            state = self.fmu.deSerializeFMUstate(data)
        state.events = getattr(data, "events", None)
        return state

    def set_debug_logging(self, logging: bool, categories: Sequence[str]) -> None:
        """Enable or disable the log messages of some categories, or of all."""
        with self.calling():
            if self._is_3 and not categories:  # fmpy (0.3.32) does not pass NULL
                self.fmu.fmi3SetDebugLogging(self.fmu.component, logging, 0, None)
                return
            if self._is_3:
                self.fmu.fmi3SetDebugLogging(self.fmu.component, not logging, 0, None)
            self.fmu.setDebugLogging(logging, categories)

    def directional(
        self, unknowns: Sequence[str], knowns: Sequence[str], seed: Sequence[float]
    ) -> list[float]:
        """Return the derivatives of unknowns along a direction in the knowns, all by name."""
        rows, source = self._lay_out(unknowns), self._lay_out(knowns)
        count = (rows.size,) if self._is_3 else ()
        with self.calling():
            call: Any = self.fmu.getDirectionalDerivative
            return rows.pick(call(rows.references, source.references, source.spread(seed), *count))

    def adjoint(self, unknowns: Sequence[str], knowns: Sequence[str], seed: Sequence[float]) -> list[float]:
        """Return the products of the seed and the derivatives of the unknowns, for each of the knowns."""
        source, rows = self._lay_out(unknowns), self._lay_out(knowns)
        with self.calling():
            call: Any = self.fmu.getAdjointDerivative
            return rows.pick(call(source.references, rows.references, source.spread(seed), rows.size))

    def _lay_out(self, names: Sequence[str]) -> ElementLayout:
        key = tuple(names)
        if key not in self._element_layouts:
            self._element_layouts[key] = ElementLayout(self._find_variables(key))
        return self._element_layouts[key]

    def dependencies(self, reference: int) -> list[ElementDependency]:
        """Return the dependencies of the elements of a variable."""
        count = c_size_t()
        with self.calling():
            self.fmu.fmi3GetNumberOfVariableDependencies(self.fmu.component, reference, byref(count))
            size = count.value
            elements, of_independents = (c_size_t * size)(), (c_size_t * size)()
            independents, kinds = (c_uint * size)(), (c_int * size)()
            self.fmu.fmi3GetVariableDependencies(
                self.fmu.component, reference, elements, independents, of_independents, kinds, size
            )
        return list(map(ElementDependency, elements, independents, of_independents))

    def output_derivatives(self, names: Sequence[str], order: int) -> list[float]:
        """Return the derivatives of outputs of an order, by name."""
        layout, name = self._lay_out(names), "fmi3GetOutputDerivatives"
        count, size = len(layout.references), (layout.size,)
        if not self._is_3:
            name, size = "fmi2GetRealOutputDerivatives", ()
        references, orders = (c_uint * count)(*layout.references), (c_int * count)(*[order] * count)
        values = (c_double * layout.size)()
        with self.calling():  # fmpy's own method takes scalars only (0.3.32)
            getattr(self.fmu, name)(self.fmu.component, references, count, orders, values, *size)
        return layout.pick(list(values))

    def terminate(self) -> None:
        """End the run."""
        with self.calling():
            self.fmu.terminate()

    def initialize(
        self, values: Mapping[str, Any] | None = None, start: float = 0.0, stop: float | None = None
    ) -> None:
        """Set up the experiment, set values by name, and go through initialization mode."""
        tolerance = self.subject.interface.tolerance
        self.begin_initialization(start, stop, tolerance, lambda: self.set(values or {}))
        self.exit_initialization()

    def exit_initialization(self) -> None:
        """Leave initialization mode. For Model Exchange, handle the first events and stay in event mode."""
        if self.events is not None:
            self.events.start_clocks(self.start_time)
        super().exit_initialization()
        if self.events is not None:
            self.events.begin()
        if self._integration is not None:
            self._integrate(self._integration.begin, self.start_time)

    def set(self, values: Mapping[str, Any]) -> None:
        """Set variables by name, in this order, with one call for each type.

        In step mode, discrete inputs wait for the events at the start of the next step, and clocked variables
        for their Clocks, if the instance uses event mode.
        """
        if self.events is not None and self.events.is_stepping:
            values = self.events.store_waiting(values)
        self.set_now(values)

    def set_now(self, values: Mapping[str, Any]) -> None:
        """Set variables by name, without waiting for events."""
        typed = list(zip(self._find_variables(values), values.values(), strict=True))
        with self.calling():
            if self._is_3:
                set_elements(self.fmu, typed, self._arrays)
            else:
                self.set_typed(typed)

    def get(self, names: Iterable[str]) -> list[Any]:
        """Return the values of variables by name, with one call for each type, and for each String.

        If all Strings of a call are in one buffer, only the check of Strings fails.
        """
        variables = self._find_variables(names)
        with self.calling():
            if not any(v.type == "String" for v in variables):
                return self._get(variables)
            numbers = iter(self._get([v for v in variables if v.type != "String"]))
            return [self._get([v])[0] if v.type == "String" else next(numbers) for v in variables]

    def get_together(self, names: Iterable[str]) -> list[Any]:
        """Return the values of variables by name, with one call for each type."""
        with self.calling():
            return self._get(self._find_variables(names))

    def _find_variables(self, names: Iterable[str]) -> list[ModelVariable]:
        """Return variables by name. Runs ask for the same ones in each step."""
        key = tuple(names)
        if key not in self._variable_lists:
            self._variable_lists[key] = [self.subject.variables[name] for name in key]
        return self._variable_lists[key]

    def _get(self, variables: Sequence[ModelVariable]) -> list[Any]:
        if self.events is not None and self.events.is_stepping:
            return self.events.get(variables)
        return self.read(variables)

    def read(self, variables: Sequence[ModelVariable]) -> list[Any]:
        """Return the values that the FMU has now, with one call for each type."""
        with self.calling():
            return self.get_typed(variables)

    def step(self, time: float, length: float) -> None:
        """Step from `time` by `length`, both in s; for Model Exchange, integrate between event modes.

        Raise CallError also for a discarded step, except if the FMU asks to end: then `terminated` is set.
        """
        self.step_began = time
        if self.events is not None:
            try:
                self.events.step(time, length)
            except RunEndedError:
                self.terminated = True
            return
        if self._integration is not None:
            self._integrate(self._integration.step, time, length)
            return
        with self.calling():
            if self._is_3:
                self._step_3(time, length)
                return
            try:
                self.fmu.doStep(time, length, noSetFMUStatePriorToCurrentPoint=0)
            except FMICallException as error:
                if error.status == PENDING and self.subject.has_capability("canRunAsynchronuously"):
                    self._wait_for_step()
                elif error.status == DISCARD and self.asks_to_end():
                    self.terminated = True
                else:
                    raise self.error(f"fmi2DoStep at t = {time:.9g} s", error.status) from error

    def _step_3(self, time: float, length: float) -> None:
        """Step an FMU of FMI 3.0, without event mode and early return."""
        event, terminates, returned_early, reached = self.fmu.doStep(
            time, length, noSetFMUStatePriorToCurrentPoint=False
        )
        self.terminated, self.reached = bool(terminates), float(reached)
        at = f"fmi3DoStep at t = {time:.9g} s"
        if returned_early and not terminates:
            message = f"{at} returned early at t = {reached:.9g} s, which was not allowed."
            raise self.violation(message, NO_EARLY_RETURN)
        if event and not self.unexpected_event:
            self.unexpected_event = f"{at} asked for event mode, which is not used."

    def _integrate(self, do: Callable[..., None], time: float, *length: float) -> None:
        """Do a part of the integration, from a time in s on."""
        try:
            with self.calling():
                do(time, *length)
        except RunEndedError:
            self.terminated = True
        except CommandError as error:  # there is no solver for this platform
            raise NotRunError(str(error)) from error
        except IntegrationError as error:
            reason = format_message(str(error))
            sentence = f"The model cannot be integrated from t = {time:.9g} s on: {reason}"
            kind = EndlessIterationError if isinstance(error, EndlessEventError) else CallError
            raise kind("the solver", ERROR, sentence=sentence) from error

    def _wait_for_step(self) -> None:
        """Wait until a pending step is completed."""
        answer = c_int(PENDING)
        while answer.value == PENDING:
            clock.sleep(0.001)
            self.fmu.fmi2GetStatus(self.fmu.component, fmi2DoStepStatus, byref(answer))
        if answer.value not in FINE:
            raise FMICallException("fmi2DoStep", answer.value)

    def reset(self) -> None:
        """Reset the instance to its initial state, and forget the run."""
        super().reset()
        self._forget()

    def _forget(self) -> None:
        """Forget the run."""
        self.terminated, self.step_began = False, None
        self._arrays.clear()
        if self.events is not None:
            self.events.reset()

    def close(self) -> None:
        """Terminate and free the instance. The library stays loaded."""
        self.terminate()
        self.free()
        if self._integration is not None:
            self._integration.close()

    def reference(self, name: str) -> int:
        """Return the value reference of a variable."""
        return self.subject.variables[name].valueReference
