"""Instances of co-simulation FMUs in this process."""

import contextlib
import ctypes
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import fmi3Binary
from fmpy.model_description import ModelVariable
from numpy.typing import NDArray

from ...base import crash_page
from ...base.arrays import Vector
from ...base.errors import CommandError, RunError
from ...fmu.elements import BINARY, ElementVariable, position_in_array
from ...fmu.file import FmuFile
from ...fmu.fmi_3_calls import StepEnd
from ...fmu.instance import DISCARD, FATAL, FINE, STATUS, FmiInstance, kind_of
from ...fmu.load_diagnosis import explain_python_needs
from ...fmu.loaded_library import BOOLEAN_STATUS, DERIVATIVE, LoadedLibrary, plain_name
from ...fmu.log import FmuLog
from ...fmu.python_exceptions import (
    describe_left_exception,
    explain_earlier_exception,
    find_left_exception,
    uses_python,
)
from ...fmu.variables import TypedValue
from ...fmu.version_3 import rename, short_functions
from ...stepper.layout import OUT_OF_RANGE
from .described_instance import DescribedInstance, StartValues
from .fmu_instance import (
    CallNames,
    DiscardedStepError,
    EndRequestedError,
    EntryPoints,
    GroupCall,
    InstanceError,
    PythonExceptionError,
)
from .measured_calls import CALLS, code_of
from .typed_values import TypedValues, TypeGroup, ValueRangeError, allocate_array

_POINTER = ctypes.c_void_p
_REFERENCE, _REAL, _INTEGER, _TEXT = (
    kind * 1 for kind in (ctypes.c_uint32, ctypes.c_double, ctypes.c_int32, ctypes.c_char_p)
)
"""Memory for one value reference, or one value."""

_UNUSABLE_LIBRARIES: set[Path] = set()


def is_unusable(file: FmuFile) -> bool:
    """Return whether an FMU returned fmi2Fatal in this process. Then none of its functions may be called."""
    return file.library in _UNUSABLE_LIBRARIES


_LOADING = "loading its library"
"""The call that loads the library, as messages name it."""

SETTING, GETTING, RECORDING = "setting inputs", "getting outputs", "getting recorded variables"
"""Calls that consist of one for each type, as messages name them."""

_TYPED_CALLS = {"setReal": SETTING, "getReal": GETTING}
"""The same by the stepper's names."""

LARGEST_STATE = 2**32
"""Largest accepted size of a serialized state, in bytes."""


class InProcessInstance(FmiInstance, DescribedInstance):
    """One instance of an FMU in this process; see `FmuInstance` and `DescribedInstance`."""

    def __init__(
        self,
        name: str,
        file: FmuFile,
        inputs: Sequence[str],
        outputs: Sequence[str],
        log: FmuLog,
        number: int = 0,
    ) -> None:
        """Instantiate the FMU.

        Args:
            name: Name of the component.
            file: The FMU.
            inputs: Variables of the input vector.
            outputs: Variables of the output vector.
            log: Collects the FMU's messages.
            number: Number of the instance in `crash_page`, which records the present call.

        Raises:
            CommandError: The library of the FMU cannot be loaded.
            RunError: The FMU returned fmi2Fatal earlier in this process.
        """
        if is_unusable(file):
            raise RunError(
                f"the FMU '{file.path}' of {name} returned fmi2Fatal and cannot be used again. "
                "Prepare the run again to load a new copy."
            )
        super().__init__(name, file, inputs, outputs)
        self._log = log
        self._stepping = False
        self._no_way_back = 1  # noSetFMUStatePriorToCurrentPoint, until a state is saved
        self._present = crash_page.current_activity()
        self._codes = {call: code_of(number, call) for call in CALLS}
        with self._report_failed_start():
            self.announce(_LOADING)
            self._library = LoadedLibrary.acquire(file)
            try:
                self.fmu = self._library.calls_of(self)
                self.fmu.instantiate(callbacks=log.callbacks, loggingOn=True)
            except BaseException:
                self._library.release()
                raise
        self.arrays: dict[int, NDArray[Any]] = {}
        """The memory of arrays that are set; see `TypedValues`."""
        self._step_end = StepEnd()
        self._functions = {n: self._make_recorded(n, f) for n, f in self._library.functions.items()}
        if self._library.is_version_3:
            self._functions = short_functions(self._functions, self._step_end)
        self._component = self.fmu.component
        self._set_real, self._get_real = self._functions["setReal"], self._functions["getReal"]
        self._input_references, self._output_references = (
            np.array([v.valueReference for v in variables if not position_in_array(v)], dtype=np.uint32)
            for variables in (self.read, self.written)
        )
        self._derivative_orders = np.ones(len(self.read), dtype=np.int32)
        self._typed = None
        if self.typed:
            self._typed = (
                TypedValues("set", self.read, self._functions, self.arrays),
                TypedValues("get", self.written, self._functions),
            )
        self._prepare_events()
        self.bind(self.inputs.copy(), self.outputs)
        self.observe([], np.empty(0))
        self._start_values = StartValues(self._functions, self.arrays)

    @property
    def configuration(self) -> Sequence[TypedValue]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Return the values of structural parameters that it gets right after instantiation."""
        return [(self.file.variables[name], value) for name, value in self.file.interface.structure.items()]

    def _prepare_events(self) -> None:
        """Make what the events of the FMU need, after its instantiation; nothing without event mode."""

    @property
    def _setters(self) -> Sequence[TypedValues]:
        """Return what sets the inputs with one call per type; empty if a single call does."""
        return () if self._typed is None else self._typed[:1]

    @property
    def _address(self) -> int:
        """Return the address of the FMU's instance."""
        return ctypes.cast(self._component, _POINTER).value or 0

    @contextlib.contextmanager
    def _report_failed_start(self) -> Iterator[None]:
        """Convert any exception to CommandError, or to PythonExceptionError if the FMU left one of Python."""
        try:
            yield
        except PythonExceptionError:
            raise
        except Exception as error:
            if find_left_exception(error) is not None:
                raise self.python_error(_LOADING, error) from error
            reasons = [str(error), *self._log.last(self.name)]
            needs = explain_python_needs(self.file.folder, reasons)
            raise CommandError(
                f"the FMU '{self.file.path}' of {self.name} cannot be started: "
                + " ".join(filter(None, [*reasons, needs]))
            ) from error
        finally:
            self.returned()

    def bind(self, inputs: Vector, outputs: Vector) -> None:
        """Use this memory for inputs and outputs; the instance keeps its addresses."""
        super().bind(inputs, outputs)
        self._set_arguments = self._make_arguments(self._input_references, inputs)
        self._get_arguments = self._make_arguments(self._output_references, outputs)

    def set_start_values(self, values: Iterable[TypedValue]) -> None:
        """Set variables in each initialization from now on."""
        self._start_values.update(values)

    def _set_start_values(self) -> None:
        """Set start values; InstanceError if the FMU rejects one."""
        for reference, array_values in self.arrays.items():
            array_values[:] = allocate_array(self.array(reference))
        values = self._start_values
        if (rejected := values.set_numbers(self._component)) is not None:
            (variable, value), status = rejected
            raise self._make_rejection_error(variable, value, status)
        for i in values.texts:
            self.set_value(*values.all[i])

    def array(self, reference: int) -> ElementVariable:
        """Return the first element of an array by its value reference."""
        return self._first_elements[reference]

    @cached_property
    def _first_elements(self) -> dict[int, ElementVariable]:
        variables = self.file.variables.values()
        return {
            int(v.valueReference): v for v in variables if isinstance(v, ElementVariable) and not v.position
        }

    def set_value(self, variable: ModelVariable, value: Any) -> None:
        """Set one variable to a value of its type; InstanceError if the FMU rejects it."""
        reference = _REFERENCE(variable.valueReference)
        if variable.type == "String":
            status = self.status("fmi2SetString", reference, 1, _TEXT(str(value).encode()))
        elif variable.type == BINARY:
            status = self.status("fmi3SetBinary", reference, 1, *_make_binary_arguments(value), 1)
        elif isinstance(variable, ElementVariable):
            (group,) = TypedValues("set", [variable], self._functions, self.arrays).groups
            group.values[group.slots] = value
            status = group.function(self._component, *group.arguments)
        else:  # tables have thousands of values, and the calls of fmpy are slow
            kind = kind_of(variable)
            buffer = _REAL(value) if kind == "Real" else _INTEGER(value)
            status = self._functions[f"set{kind}"](self._component, reference, 1, buffer)
        if status not in FINE:
            raise self._make_rejection_error(variable, value, status)

    def _make_rejection_error(self, variable: ModelVariable, value: Any, status: int) -> RunError:
        return self.error(f"setting {variable.name} = {value}", status)

    def value(self, variable: ModelVariable) -> Any:
        """Return the present value of a variable."""
        with self.calling(f"getting {variable.name}"):
            (value,) = self.get_typed([variable])
        return _convert_to_python(variable, value)

    def reset(self) -> None:
        """Return to the state right after instantiation.

        FMUs of other tools get a new instance, because some (of 20-sim) keep their state in `fmi2Reset`.
        """
        if self.file.is_ours:
            super().reset()
        else:
            self._instantiate_again()
        self._stepping, self._no_way_back = False, 1
        self.inputs[:] = self.input_starts

    def _instantiate_again(self) -> None:
        """Free the FMU's instance and make a new one."""
        # an FMU that refuses to terminate is freed all the same
        with contextlib.suppress(FMICallException):
            if self._stepping:
                self.fmu.terminate()
        self.free()
        with self._report_failed_start():
            self.fmu.instantiate(callbacks=self._log.callbacks, loggingOn=True)
        self._component = self.fmu.component
        self.bind(self.inputs, self.outputs)

    def enter_initialization(self, start_time: float, stop_time: float | None = None) -> None:
        """Enter initialization mode; times in s, None without a fixed stop time."""
        self._present.time = start_time
        self.begin_initialization(start_time, stop_time, self.tolerance, self._set_start_values)

    def exit_initialization(self) -> None:
        """Leave initialization mode, and find the start values that the FMU changed.

        Raises:
            RunError: A structural parameter has another value than was set.
        """
        super().exit_initialization()
        self._stepping = True
        for variable, value in self.configuration:
            if (present := self.value(variable)) != value:
                raise RunError(
                    f"{self.name}.{variable.name} is {present}: the FMU did not accept the value {value}."
                )
        status, present = self._start_values.read_numbers(self._component)
        if status == FATAL:
            raise self.error("reading start values", status)
        reported = present if status in FINE else None
        self.rejected_start_values = self._start_values.find_rejected(reported, self._read_back)

    def _read_back(self, variable: ModelVariable) -> Any:
        """Return the value of a variable; None if it cannot be read, InstanceError after fmi2Fatal."""
        try:
            (value,) = self.get_typed([variable])
        except FMICallException as error:
            if error.status == FATAL:
                raise self.error(str(error.function), FATAL) from error
            return None
        return _convert_to_python(variable, value)

    def set_inputs(self) -> None:
        """Pass `inputs` to the FMU."""
        if not len(self.inputs):
            return
        if self._typed is not None:
            self._set_typed_inputs(self._typed[0])
        else:
            self._check_status("setReal", self._set_real(*self._set_arguments))

    def _set_typed_inputs(self, setter: TypedValues) -> None:
        """Set inputs with one call per type; RunError if a value does not fit into its type."""
        try:
            status = setter.set(self._component, self.inputs)
        except ValueRangeError as error:
            raise self._make_range_error(error) from error
        self._check_status(SETTING, status)

    def _make_range_error(self, error: ValueRangeError) -> RunError:
        return RunError(f"{self.name} got a value that it cannot accept: its input {error}.")

    def set_input_derivatives(self, derivatives: Vector) -> None:
        """Set the slopes of the inputs during the next step, per s."""
        if len(derivatives):
            references, count, orders = self._input_references, len(derivatives), self._derivative_orders
            addresses = (x.ctypes.data for x in (references, orders, derivatives))
            reference, order, value = addresses
            self._call("setRealInputDerivatives", reference, count, order, value)

    def get_outputs(self) -> None:
        """Read the FMU's outputs into `outputs`."""
        if not len(self.outputs):
            return
        if self._typed is not None:
            self._check_status(GETTING, self._typed[1].get(self._component, self.outputs))
        else:
            self._check_status("getReal", self._get_real(*self._get_arguments))

    def observe(self, names: Sequence[str], values: Vector) -> None:
        """Choose the numeric variables that `get_observed` reads, and where to."""
        variables = [self.file.variables[name] for name in names]
        self._observed = TypedValues("get", variables, self._functions), values

    def get_observed(self) -> None:
        """Read the observed variables."""
        typed, values = self._observed
        self._check_status(RECORDING, typed.get(self._component, values))

    def observed_groups(self) -> Sequence[GroupCall]:
        """Return what the stepper needs to read the observed variables."""
        return self._list_calls(self._observed_types)

    @property
    def _observed_types(self) -> Sequence[TypeGroup]:
        """Return what reads the observed variables, by type."""
        return self._observed[0].groups

    def do_step(self, time: float, step: float) -> None:
        """Advance from `time` by `step`, both in s."""
        self._present.time = time
        status = self._functions["doStep"](self._component, time, step, self._no_way_back)
        if status not in FINE:
            raise self.error(f"doStep at t = {time:.9g} s", status)

    def directional_derivative(self, direction: Vector) -> Vector | None:
        """Return the derivative of the outputs along a direction of the inputs; None if the FMU has none."""
        derivative = np.zeros(len(self.outputs))
        if not len(derivative) or not len(direction):
            return derivative
        if DERIVATIVE not in self._functions:
            return None
        output_references, input_references = self._output_references, self._input_references
        status = self._functions[DERIVATIVE](
            self._component,
            *(output_references.ctypes.data, len(output_references)),
            *(input_references.ctypes.data, len(input_references)),
            *(direction.ctypes.data, *self._list_count(direction)),
            *(derivative.ctypes.data, *self._list_count(derivative)),
        )
        if status == FATAL:
            raise self.error(DERIVATIVE, status)
        return derivative if status in FINE else None

    @property
    def runs_beside_others(self) -> bool:
        """Whether other threads may call other instances at the same time, as far as the FMU's files show.

        FMUs that use Python share the lock of one interpreter, and leave exceptions in the thread that
        calls them.
        """
        shared = ("canBeInstantiatedOnlyOncePerProcess", "needsExecutionTool")
        return not any(map(self.file.has_capability, shared)) and not uses_python(self.file.library)

    def save(self, state: Any = None) -> Any:
        """Return a copy of the FMU's state, in the memory of the earlier copy `state`."""
        self._no_way_back = 0
        return self._copy_state(state or ctypes.c_void_p())

    def restore(self, state: Any) -> None:
        """Restore a saved state."""
        self._call("setFMUstate", state)

    def forget(self, state: Any) -> None:
        """Free a saved state."""
        self._free_state(state)

    def serialize(self) -> bytes:
        """Return the FMU's state as bytes; InstanceError if they are more than `LARGEST_STATE`."""
        state, size = self._copy_state(ctypes.c_void_p()), ctypes.c_size_t()
        try:
            with self.calling():
                self.fmu.fmi2SerializedFMUstateSize(self._component, state, ctypes.byref(size))
                if size.value > LARGEST_STATE:
                    answer = f"{size.value} bytes, more than {LARGEST_STATE}"
                    raise InstanceError(self.name, "SerializedFMUstateSize", answer, [])
                content = ctypes.create_string_buffer(size.value)
                self.fmu.fmi2SerializeFMUstate(self._component, state, content, size.value)
            return content.raw
        finally:
            self._free_state(state)

    def deserialize(self, content: bytes) -> None:
        """Restore a state from the bytes of `serialize`."""
        with self.calling():
            state = self.fmu.deSerializeFMUstate(content)
        try:
            self._call("setFMUstate", state)
        finally:
            self._free_state(state)

    def close(self) -> None:
        """Terminate the FMU if the standard allows it, and free the instance and its library."""
        # the standard forbids all calls after fmi2Fatal
        if is_unusable(self.file):
            return
        with contextlib.suppress(Exception):
            if self._stepping:
                self.fmu.terminate()
        with contextlib.suppress(Exception):
            self.free()
            self._library.release()

    def entry_points(self) -> EntryPoints | None:
        """Return the addresses of the FMU's functions."""
        address, names = self._library.addresses, CallNames()
        setters, getters = None, None
        if self._typed is not None:
            setters, getters = (self._list_calls(typed.groups) for typed in self._typed)
        is_3 = self._library.is_version_3
        if is_3:
            set_, get = ("setFloat64", "getFloat64") if self._typed is None else _TYPED_CALLS.values()
            names = CallNames(set_, get, "getFMUState", "setFMUState")
        return EntryPoints(
            component=self._address,
            set_real=address["setFloat64" if is_3 else "setReal"],
            get_real=address["getFloat64" if is_3 else "getReal"],
            do_step=address["doStep"],
            set_real_input_derivatives=0 if is_3 else address["setRealInputDerivatives"],
            get_state=address[names.save],
            set_state=address[names.restore],
            input_references=self._input_references,
            output_references=self._output_references,
            derivative_orders=self._derivative_orders,
            names=names,
            step_end=self._step_end if is_3 else None,
            setters=setters,
            getters=getters,
            get_status=0 if is_3 else address[BOOLEAN_STATUS],
        )

    def announce(self, function: str, arguments: Sequence[Any] = ()) -> None:
        """Record the next call in the black box."""
        self._present.code = self._codes[plain_name(function)]

    def returned(self) -> None:
        """Record in the black box that no call is running."""
        self._present.code = 0

    def python_error(self, function: str, error: Exception) -> PythonExceptionError:
        """Return the error for a call that left an exception of Python; the FMU is not terminated then."""
        self._present.code = 0
        call = plain_name(function)
        if not (function == _LOADING or call.startswith("instantiate")):
            call += self._describe_time(call)
        self._stepping = False
        exception_text, messages = describe_left_exception(error), self.messages()
        needs = explain_python_needs(self.file.folder, [exception_text, *messages])
        return PythonExceptionError(self.name, call, exception_text, messages, needs)

    def _describe_time(self, call: str) -> str:
        """Return the present time as a phrase; only the start of the present step is known."""
        time = self._present.time
        if math.isnan(time):
            return ""
        return f" {'after' if self._stepping and call != 'doStep' else 'at'} t = {time:.9g} s"

    def error(self, call: str, status: int) -> RunError:
        """Return the error for a call that returned this status; after fmi2Fatal the FMU is unusable."""
        if self._setters:
            call = _TYPED_CALLS.get(call, call)
        if call == SETTING and status == OUT_OF_RANGE:
            try:
                for setter in self._setters:
                    setter.check(self.inputs)
            except ValueRangeError as error:
                return self._make_range_error(error)
        kind = self._choose_discard_error(call) if status == DISCARD else InstanceError
        self._stepping = self._stepping and status == DISCARD
        if status == FATAL:
            _UNUSABLE_LIBRARIES.add(self.file.library)
        answer = STATUS[status] if 0 <= status < len(STATUS) else f"status {status}"
        messages = self.messages()
        if self._library.is_version_3:
            answer = answer.replace("fmi2", "fmi3")
            call = rename(call)
            if call.startswith("doStep") and self._step_end.complaint:
                messages.append(self._step_end.complaint)
        error = kind(self.name, plain_name(call), answer, messages)
        if kind is DiscardedStepError and (reached := self._read_last_successful_time()) > self._present.time:
            error.args = (f"{error} It did this step until t = {reached:.9g} s.",)
        if hint := explain_earlier_exception(messages):
            error.args = (f"{error} {hint}",)
        return error

    def _choose_discard_error(self, call: str) -> type[InstanceError]:
        """Return the type of the error for a call that the FMU discarded."""
        if not call.startswith("doStep"):
            return InstanceError
        requests_end = self._step_end.terminates if self._library.is_version_3 else self.asks_to_end()
        return EndRequestedError if requests_end else DiscardedStepError

    def _read_last_successful_time(self) -> float:
        """Return the time in s that a discarded step has reached; NaN if it is not known, as in FMI 3.0."""
        return math.nan if self._library.is_version_3 else self.last_successful_time()

    def messages(self) -> list[str]:
        """Return the last warnings and errors of the FMU."""
        return self._log.last(self.name)

    def _copy_state(self, state: Any) -> Any:
        """Save the FMU's state in the memory of `state`, and return it."""
        self._call("getFMUstate", ctypes.byref(state))
        return state

    def _free_state(self, state: Any) -> None:
        if not is_unusable(self.file):
            with contextlib.suppress(FMICallException):
                self.fmu.freeFMUstate(state)

    def _make_recorded(self, name: str, function: Callable[..., int]) -> Callable[..., int]:
        """Return the function, with its calls recorded in the black box."""
        present, code = self._present, self._codes[name]

        def called(*arguments: Any) -> int:
            present.code = code
            try:
                status = function(*arguments)
            except SystemError as error:
                raise self.python_error(name, error) from error
            present.code = 0
            return status

        return called

    def _make_arguments(self, references: NDArray[np.uint32], values: Vector) -> tuple[Any, ...]:
        addresses = (x.ctypes.data_as(_POINTER) for x in (references, values))
        reference, value = addresses
        return (self._component, reference, len(references), value, *self._list_count(values))

    def _list_count(self, values: Vector) -> tuple[int, ...]:
        """Return the number of values, a further argument of functions of FMI 3.0."""
        return (len(values),) if self._library.is_version_3 else ()

    def _list_calls(self, groups: Iterable[TypeGroup]) -> list[GroupCall]:
        # groups without a call only copy numbers
        return [GroupCall(self._library.addresses.get(group.call, 0), group) for group in groups]

    def _call(self, name: str, *arguments: Any) -> None:
        self._check_status(name, self._functions[name](self._component, *arguments))

    def _check_status(self, call: str, status: int) -> None:
        """Raise the error of a call unless its status is a success."""
        if status not in FINE:
            raise self.error(call, status)


def _make_binary_arguments(value: bytes) -> tuple[Any, Any]:
    """Return size and address of a Binary value, as arguments of fmi3SetBinary."""
    # an empty value also needs an address
    buffer = (ctypes.c_uint8 * max(len(value), 1)).from_buffer_copy(value or b"\0")
    return (ctypes.c_size_t * 1)(len(value)), (fmi3Binary * 1)(ctypes.cast(buffer, fmi3Binary))


def _convert_to_python(variable: ModelVariable, value: Any) -> Any:
    """Return a value from an FMU in the type of its variable; no text is an empty one."""
    if variable.type == "String":
        return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value or "")
    if variable.type == BINARY:
        return bytes(value or b"")
    return bool(value) if variable.type == "Boolean" else value
