"""FMI 3.0 libraries: functions of a step, and fmpy's object with the methods of FMI 2.0's instances."""

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
from fmpy.fmi3 import FMU3Model, FMU3Slave

from ..base.arrays import Vector
from .interface import CO_SIMULATION, MODEL_EXCHANGE
from .log import FmuLog

_POINTER, _SIZE, _BOOL, _DOUBLE = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_bool, ctypes.c_double
_VALUES = (_POINTER, _POINTER, _SIZE, _POINTER, _SIZE)
NUMBER_TYPES = (
    "Float64",
    "Float32",
    "Int8",
    "UInt8",
    "Int16",
    "UInt16",
    "Int32",
    "UInt32",
    "Int64",
    "UInt64",
)
PROTOTYPES = {
    **{f"{access}{kind}": _VALUES for kind in (*NUMBER_TYPES, "Boolean") for access in ("get", "set")},
    "getFMUState": (_POINTER, _POINTER),
    "setFMUState": (_POINTER, _POINTER),
}
OF_KIND = {
    CO_SIMULATION: {"doStep": (_POINTER, _DOUBLE, _DOUBLE, _BOOL, _POINTER, _POINTER, _POINTER, _POINTER)},
    MODEL_EXCHANGE: {
        "completedIntegratorStep": (_POINTER, _BOOL, _POINTER, _POINTER),
        "getContinuousStateDerivatives": (_POINTER, _POINTER, _SIZE),
    },
}
DERIVATIVE_TYPES = (_POINTER, *4 * (_POINTER, _SIZE))
DISCARD, ERROR = 2, 3

_NAMES = {
    "setReal": "setFloat64",
    "getReal": "getFloat64",
    "getFMUstate": "getFMUState",
    "setFMUstate": "setFMUState",
    "getDerivatives": "getContinuousStateDerivatives",
}
"""Functions that have another name than in FMI 2.0, but the same arguments or a count more."""


def rename(call: str) -> str:
    """Return a call, which begins with a function of FMI 2.0, with the name of FMI 3.0."""
    function, space, rest = call.partition(" ")
    return f"{_NAMES.get(function, function)}{space}{rest}"


def judge_step(status: int, needs_event: bool, terminates: bool, is_early: bool) -> int:
    """Return the status of a step: DISCARD if the FMU wants the end, ERROR if the step is not whole.

    Compiled code uses it, too.
    """
    if status > 1 or status < 0:
        return status
    if terminates:
        return DISCARD
    return ERROR if needs_event or is_early else status


class StepEnd:
    """What `fmi3DoStep` says beside its status about the last step: three flags and a time.

    `address` is that of the flags; the time is `TIME` bytes later.
    """

    TIME = 8

    def __init__(self) -> None:
        self.use(np.zeros(2))

    def use(self, memory: Vector) -> int:
        """Use this memory of two doubles, and return its address."""
        self._flags, self._time = memory.view(np.bool_)[:3], memory[1:]
        self.address = at = memory.ctypes.data
        self._arguments = (at, at + 1, at + 2, at + self.TIME)
        return at

    @property
    def terminates(self) -> bool:
        """Whether the FMU wants the run to end."""
        return bool(self._flags[1])

    def call(self, function: Callable[..., int], component: Any, *step: Any) -> int:
        """Do a step and return its status as `judge_step` does."""
        self._flags[:] = False
        return judge_step(function(component, *step, *self._arguments), *self._flags.tolist())

    @property
    def complaint(self) -> str:
        """Return what an instance without event mode and early return must not do, and did."""
        if self._flags[2]:
            return f"fmi3DoStep returned early at t = {self._time[0]:.9g} s, which was not allowed."
        return "fmi3DoStep asked for event mode, which is not used." if self._flags[0] else ""


class Slave3(FMU3Slave):
    """fmpy's class for co-simulation, with the methods of FMI 2.0 that instances call."""

    instance: Any
    _experiment: dict[str, Any]

    def instantiate(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, callbacks: Any = None, loggingOn: bool = False
    ) -> None:
        """Instantiate the FMU as its instance wants; its messages go to the log."""
        name = self.instanceName.encode()

        def hear(environment: Any, status: int, category: bytes, message: bytes) -> None:
            FmuLog.hear(environment, name, status, category, message)

        super().instantiate(loggingOn=loggingOn, logMessage=hear, **self.instance.instantiation)

    def setupExperiment(self, **experiment: Any) -> None:
        """Keep tolerance and times for `enterInitializationMode`."""
        self._experiment = experiment

    def enterInitializationMode(  # pyright: ignore[reportIncompatibleMethodOverride]
        self,
    ) -> None:
        """Enter initialization mode with the values of `setupExperiment`."""
        super().enterInitializationMode(**self._experiment)

    def fmi2FreeInstance(self, component: Any) -> None:
        """Free an instance."""
        self.fmi3FreeInstance(component)

    def freeFMUstate(self, state: Any) -> None:
        """Free a saved state."""
        self.freeFMUState(state)

    def fmi2SerializedFMUstateSize(self, component: Any, state: Any, size: Any) -> None:
        """Write the size of a serialized state."""
        self.fmi3SerializedFMUStateSize(component, state, size)

    def fmi2SerializeFMUstate(self, component: Any, state: Any, content: Any, size: int) -> None:
        """Serialize a state."""
        self.fmi3SerializeFMUState(
            component, state, ctypes.cast(content, ctypes.POINTER(ctypes.c_uint8)), size
        )

    def deSerializeFMUstate(self, content: bytes) -> Any:
        """Return a state from its bytes."""
        state = ctypes.c_void_p()
        memory = (ctypes.c_uint8 * len(content)).from_buffer_copy(content)
        self.fmi3DeserializeFMUState(self.component, memory, len(content), ctypes.byref(state))
        return state

    def fmi2SetString(self, component: Any, references: Any, count: int, texts: Any) -> int:
        """Set Strings."""
        return self.fmi3SetString(component, references, count, texts, count)

    def newDiscreteStates(self) -> Any:
        """Update the discrete states."""
        return self.updateDiscreteStates()


class Model3(Slave3, FMU3Model):  # pyright: ignore[reportIncompatibleMethodOverride]
    """fmpy's class for Model Exchange, with the methods of FMI 2.0 that an integration calls."""

    def instantiate(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, callbacks: Any = None, loggingOn: bool = False
    ) -> None:
        """Instantiate the FMU for Model Exchange, which takes fewer arguments."""

        def instantiate(*arguments: Any) -> Any:
            return self.fmi3InstantiateModelExchange(*arguments[:5], *arguments[9:11])

        made: Any = self
        made.fmi3InstantiateCoSimulation = instantiate
        super().instantiate(callbacks, loggingOn)

    def getDerivatives(self, derivatives: Any, count: int) -> int:
        """Write the derivatives of the continuous states."""
        return self.getContinuousStateDerivatives(derivatives, count)


def short_functions(functions: dict[str, Any], end: StepEnd) -> dict[str, Any]:
    """Return the functions of a step by the names that they have in FMI 2.0, with its arguments.

    Args:
        functions: The functions of FMI 3.0 by their short names.
        end: Takes what a step says.
    """

    def do_step(component: Any, *step: Any) -> int:
        return end.call(functions["doStep"], component, *step)

    renamed = {short: functions[name] for short, name in _NAMES.items() if name in functions}
    return {**functions, **renamed, "doStep": do_step}
