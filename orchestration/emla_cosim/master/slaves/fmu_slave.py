"""An FMI 2.0 co-simulation FMU as a slave, called through preallocated vectors."""

import contextlib
import ctypes
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
from fmpy.model_description import ModelVariable

from ...base.arrays import Vector
from ...base.errors import CommandError, RunError
from ...fmu.file import FmuFile
from ...sandbox import black_box
from .calls import CALLS, code_of
from .described_slave import DescribedSlave
from .fmu_log import FmuLog
from .loaded_library import DERIVATIVE, LoadedLibrary
from .slave import EndRequestedError, EntryPoints, SlaveError, StepDiscardedError
from .typed_values import CONNECTABLE, TypedValues

_STATUS = ("fmi2OK", "fmi2Warning", "fmi2Discard", "fmi2Error", "fmi2Fatal", "fmi2Pending")
_FINE, _DISCARD, _FATAL = (0, 1), 2, 4
_TERMINATED = 3  # fmi2StatusKind

_POINTER = ctypes.c_void_p
_DEAD_LIBRARIES: set[Path] = set()

_INTERPRETED = "slavemodule.txt"
"""What an FMU of PythonFMU has among its resources: all of these share the lock of one interpreter."""

LARGEST_STATE = 2**32
"""Bytes that a serialized state may have; an FMU that answers more is not believed."""


class FmuSlave(DescribedSlave):
    """One instance of an FMU in this process; see `Slave` and `DescribedSlave`."""

    def __init__(
        self,
        name: str,
        file: FmuFile,
        inputs: Sequence[str],
        outputs: Sequence[str],
        log: FmuLog,
        number: int = 0,
    ) -> None:
        """Instantiate the FMU; raises CommandError where its library cannot be loaded.

        `number` is what this slave is called by where the present call is told.
        """
        if file.library in _DEAD_LIBRARIES:
            raise RunError(f"the FMU '{file.path}' of {name} answered fmi2Fatal; load it anew.")
        super().__init__(name, file, inputs, outputs)
        self.runs_beside_others = _runs_beside_others(file)
        self._log = log
        self._stepping = False
        self._no_way_back = 1  # until a state is saved, a step may forget the past
        self._present = black_box.present()
        self._codes = {call: code_of(number, call) for call in CALLS}
        try:
            with self._doing("loading its library"):
                self._library = LoadedLibrary.entered(file)
            self._fmu = self._instantiated()
        except Exception as error:  # fmpy raises bare Exception
            reasons = " ".join([str(error), *log.lines(name)])
            raise CommandError(f"the FMU '{file.path}' of {name} cannot be started: {reasons}") from error
        self._functions = {n: self._told(n, f) for n, f in self._library.functions.items()}
        self._component = self._fmu.component
        self._do_step = self._functions["fmi2DoStep"]
        self._set_real, self._get_real = self._functions["fmi2SetReal"], self._functions["fmi2GetReal"]
        self._one_reference, self._one_real, self._one_integer = (
            ctypes.c_uint32(),
            ctypes.c_double(),
            ctypes.c_int32(),
        )
        self._this_one = ctypes.byref(self._one_reference)
        self._input_references, self._output_references = (
            np.array([v.valueReference for v in variables], dtype=np.uint32)
            for variables in (self.read, self.written)
        )
        self._derivative_orders = np.ones(len(self.read), dtype=np.int32)
        self._typed = None
        if self.typed:
            self._typed = (
                TypedValues("Set", self.read, self._functions),
                TypedValues("Get", self.written, self._functions),
            )
        self.bind(self.inputs.copy(), self.outputs)

    def _instantiated(self) -> FMU2Slave:
        """The instance; where there is none the library is left."""
        made = self._library.instance(self.name)
        try:
            with self._doing("instantiate"):
                made.instantiate(callbacks=self._log.callbacks, loggingOn=True)
        except BaseException:
            self._library.leave()
            raise
        return made

    def bind(self, inputs: Vector, outputs: Vector) -> None:
        """Use this memory from now on; the slave keeps its addresses."""
        super().bind(inputs, outputs)
        self._set_arguments = _arguments(self._component, self._input_references, inputs)
        self._get_arguments = _arguments(self._component, self._output_references, outputs)

    def set_value(self, variable: ModelVariable, value: Any) -> None:
        """Set one variable to a value of its type; SlaveError where the FMU refuses."""
        self._one_reference.value = variable.valueReference
        if variable.type == "String":
            given = (ctypes.c_char_p * 1)(str(value).encode())
            status = self._functions["fmi2SetString"](self._component, self._this_one, 1, given)
        elif variable.type == "Real":
            self._one_real.value = value
            status = self._set_real(self._component, self._this_one, 1, ctypes.byref(self._one_real))
        else:
            self._one_integer.value = value
            call = self._functions[f"fmi2Set{CONNECTABLE[variable.type]}"]
            status = call(self._component, self._this_one, 1, ctypes.byref(self._one_integer))
        if status not in _FINE:
            raise self.error(f"setting {variable.name} = {value}", status)

    def value(self, variable: ModelVariable) -> Any:
        """The present value of a variable that is no String: a number, or true or false."""
        self._one_reference.value = variable.valueReference
        real = variable.type == "Real"
        place = self._one_real if real else self._one_integer
        call = self._functions[f"fmi2Get{CONNECTABLE[variable.type]}"]
        status = call(self._component, self._this_one, 1, ctypes.byref(place))
        if status not in _FINE:
            raise self.error(f"getting {variable.name}", status)
        return bool(place.value) if variable.type == "Boolean" else place.value

    def reset(self) -> None:
        """Become as it was when it was new."""
        self._call("fmi2Reset")
        self._stepping, self._no_way_back = False, 1
        self.inputs[:] = self._input_starts

    def enter_initialization(self, start_time: float, stop_time: float | None) -> None:
        """Enter initialization mode; times in s, no stop time where none is known yet."""
        self._present.time = start_time
        self._checked("setupExperiment", self._fmu.setupExperiment, None, start_time, stop_time)
        self._checked("enterInitializationMode", self._fmu.enterInitializationMode)

    def exit_initialization(self) -> None:
        """Leave initialization mode."""
        self._checked("exitInitializationMode", self._fmu.exitInitializationMode)
        self._stepping = True

    def set_inputs(self) -> None:
        """Pass `inputs` on to the FMU."""
        if not len(self.inputs):
            return
        if self._typed is not None:
            call, status = "setting inputs", self._typed[0].set(self._component, self.inputs)
        else:
            call, status = "setReal", self._set_real(*self._set_arguments)
        if status not in _FINE:
            raise self.error(call, status)

    def set_input_derivatives(self, derivatives: Vector) -> None:
        """Say how fast the inputs change during the next step, per s."""
        if len(derivatives):
            references, count, orders = self._input_references, len(derivatives), self._derivative_orders
            addresses = (x.ctypes.data for x in (references, orders, derivatives))
            reference, order, value = addresses
            self._call("fmi2SetRealInputDerivatives", reference, count, order, value)

    def get_outputs(self) -> None:
        """Read the FMU's outputs into `outputs`."""
        if not len(self.outputs):
            return
        if self._typed is not None:
            call, status = "getting outputs", self._typed[1].get(self._component, self.outputs)
        else:
            call, status = "getReal", self._get_real(*self._get_arguments)
        if status not in _FINE:
            raise self.error(call, status)

    def do_step(self, time: float, step: float) -> None:
        """Advance from `time` by `step`, both in s."""
        self._present.time = time
        status = self._do_step(self._component, time, step, self._no_way_back)
        if status not in _FINE:
            raise self.error(f"doStep at t = {time:.9g} s", status)

    def directional_derivative(self, direction: Vector) -> Vector | None:
        """How fast the outputs change at once when the inputs move in a direction."""
        found = np.zeros(len(self.outputs))
        if not len(found) or not len(direction):
            return found
        if DERIVATIVE not in self._functions:
            return None
        unknown, known = self._output_references, self._input_references
        status = self._functions[DERIVATIVE](
            self._component,
            *(unknown.ctypes.data, len(unknown)),
            *(known.ctypes.data, len(known)),
            *(direction.ctypes.data, found.ctypes.data),
        )
        if status == _FATAL:
            raise self.error(_plain(DERIVATIVE), status)
        return found if status in _FINE else None

    def save(self, state: Any = None) -> Any:
        """A copy of the FMU's state, in the memory of an earlier one if given."""
        self._no_way_back = 0
        return self._copied(state or ctypes.c_void_p())

    def restore(self, state: Any) -> None:
        """Go back to a saved state."""
        self._call("fmi2SetFMUstate", state)

    def forget(self, state: Any) -> None:
        """Free a saved state."""
        if not self._dead():
            self._functions["fmi2FreeFMUstate"](self._component, ctypes.byref(state))

    def serialize(self) -> bytes:
        """The FMU's state as bytes."""
        state, size = self._copied(ctypes.c_void_p()), ctypes.c_size_t()
        try:
            self._call("fmi2SerializedFMUstateSize", state, ctypes.byref(size))
            if size.value > LARGEST_STATE:
                answer = f"{size.value} bytes, more than {LARGEST_STATE}"
                raise SlaveError(self.name, "SerializedFMUstateSize", answer, [])
            content = ctypes.create_string_buffer(size.value)
            self._call("fmi2SerializeFMUstate", state, content, size.value)
            return content.raw
        finally:
            self.forget(state)

    def deserialize(self, content: bytes) -> None:
        """Go to a state that was written by `serialize`."""
        state = ctypes.c_void_p()
        self._call("fmi2DeSerializeFMUstate", content, len(content), ctypes.byref(state))
        try:
            self.restore(state)
        finally:
            self.forget(state)

    def close(self) -> None:
        """Terminate the FMU where the standard allows it, and free the instance and its library."""
        if self._dead():
            return
        with contextlib.suppress(Exception):
            if self._stepping:
                with self._doing("terminate"):
                    self._fmu.terminate()
        with contextlib.suppress(Exception), self._doing("freeInstance"):
            self._fmu.fmi2FreeInstance(self._component)
            self._library.leave()

    def entry_points(self) -> EntryPoints | None:
        """Addresses of the FMU's functions for compiled code, which knows Reals only."""
        if self._typed is not None:
            return None
        address = self._library.addresses
        return EntryPoints(
            component=ctypes.cast(self._component, _POINTER).value or 0,
            set_real=address["fmi2SetReal"],
            get_real=address["fmi2GetReal"],
            do_step=address["fmi2DoStep"],
            set_real_input_derivatives=address["fmi2SetRealInputDerivatives"],
            get_state=address["fmi2GetFMUstate"],
            set_state=address["fmi2SetFMUstate"],
            input_references=self._input_references,
            output_references=self._output_references,
            derivative_orders=self._derivative_orders,
        )

    def error(self, call: str, status: int) -> SlaveError:
        """The error of a call that returned this status."""
        kind = SlaveError
        if status == _DISCARD and call.startswith("doStep"):
            kind = EndRequestedError if self._asks_to_end() else StepDiscardedError
        self._stepping = self._stepping and status == _DISCARD
        if status == _FATAL:
            _DEAD_LIBRARIES.add(self.file.library)
        answer = _STATUS[status] if 0 <= status < len(_STATUS) else f"status {status}"
        return kind(self.name, call, answer, self._log.lines(self.name))

    def _dead(self) -> bool:
        """Whether an instance of this FMU answered fmi2Fatal: then none of them may be called again."""
        return self.file.library in _DEAD_LIBRARIES

    def _asks_to_end(self) -> bool:
        terminated = ctypes.c_int()
        call = self._functions["fmi2GetBooleanStatus"]
        return call(self._component, _TERMINATED, ctypes.byref(terminated)) == 0 and terminated.value == 1

    def _copied(self, state: Any) -> Any:
        self._call("fmi2GetFMUstate", ctypes.byref(state))
        return state

    def _told(self, name: str, function: Callable[..., int]) -> Callable[..., int]:
        """A function that says that it is called."""
        present, code = self._present, self._codes[_plain(name)]

        def called(*arguments: Any) -> int:
            present.code = code
            status = function(*arguments)
            present.code = 0
            return status

        return called

    @contextlib.contextmanager
    def _doing(self, call: str) -> Iterator[None]:
        self._present.code = self._codes[call]
        try:
            yield
        finally:
            self._present.code = 0

    def _call(self, name: str, *arguments: Any) -> None:
        status = self._functions[name](self._component, *arguments)
        if status not in _FINE:
            raise self.error(_plain(name), status)

    def _checked(self, call: str, function: Any, *arguments: Any) -> None:
        try:
            with self._doing(call):
                function(*arguments)
        except FMICallException as error:
            raise self.error(call, error.status) from error


def _plain(name: str) -> str:
    """The name of an FMI function as sentences have it: doStep."""
    stem = name.removeprefix("fmi2")
    return f"{stem[0].lower()}{stem[1:]}"


def _arguments(component: Any, references: Any, values: Vector) -> tuple[Any, ...]:
    return (component, references.ctypes.data_as(_POINTER), len(references), values.ctypes.data_as(_POINTER))


def _runs_beside_others(file: FmuFile) -> bool:
    """Whether nothing is known of the FMU that only one thread of a process may have to do with."""
    shares = file.can("canBeInstantiatedOnlyOncePerProcess") or file.can("needsExecutionTool")
    return not shares and not (file.folder / "resources" / _INTERPRETED).exists()
