"""FMI 3.0 libraries: functions of a step, and fmpy's object with the methods of FMI 2.0's instances."""

import ctypes
from collections.abc import Sequence
from typing import Any

from fmpy.fmi3 import FMU3Model, FMU3Slave

from .fmi_3_calls import NUMBER_TYPES, StepEnd
from .interface import CO_SIMULATION, MODEL_EXCHANGE
from .log import FmuLog

_POINTER, _SIZE, _BOOL, _DOUBLE = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_bool, ctypes.c_double
_VALUES = (_POINTER, _POINTER, _SIZE, _POINTER, _SIZE)
PROTOTYPES = {
    **{f"{access}{kind}": _VALUES for kind in (*NUMBER_TYPES, "Boolean") for access in ("get", "set")},
    "getFMUState": (_POINTER, _POINTER),
    "setFMUState": (_POINTER, _POINTER),
}
OF_KIND = {
    CO_SIMULATION: {
        "doStep": (_POINTER, _DOUBLE, _DOUBLE, _BOOL, _POINTER, _POINTER, _POINTER, _POINTER),
        "enterEventMode": (_POINTER,),
        "enterStepMode": (_POINTER,),
        "updateDiscreteStates": 7 * (_POINTER,),
        "setClock": (_POINTER, _POINTER, _SIZE, _POINTER),
        "getClock": (_POINTER, _POINTER, _SIZE, _POINTER),
        "getIntervalDecimal": (_POINTER, _POINTER, _SIZE, _POINTER, _POINTER),
        "getShiftDecimal": (_POINTER, _POINTER, _SIZE, _POINTER),
    },
    MODEL_EXCHANGE: {
        "completedIntegratorStep": (_POINTER, _BOOL, _POINTER, _POINTER),
        "getContinuousStateDerivatives": (_POINTER, _POINTER, _SIZE),
    },
}
DERIVATIVE_TYPES = (_POINTER, *4 * (_POINTER, _SIZE))

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


class Slave3(FMU3Slave):
    """fmpy's class for co-simulation, with the methods of FMI 2.0 that instances call."""

    instance: Any
    _experiment: dict[str, Any]

    def instantiate(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, callbacks: Any = None, loggingOn: bool = False
    ) -> None:
        """Instantiate the FMU as its instance wants; its messages go to the log."""
        # the logger of FMI 3.0 does not get the name of the instance
        name = self.instanceName.encode()

        def hear(environment: Any, status: int, category: bytes, message: bytes) -> None:
            FmuLog.hear(environment, name, status, category, message)

        super().instantiate(loggingOn=loggingOn, logMessage=hear, **self.instance.instantiation)
        if self.instance.configuration:
            self.enterConfigurationMode()
            self.instance.set_typed(self.instance.configuration)
            self.exitConfigurationMode()

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
        buffer = (ctypes.c_uint8 * len(content)).from_buffer_copy(content)
        self.fmi3DeserializeFMUState(self.component, buffer, len(content), ctypes.byref(state))
        return state

    def fmi2SetString(self, component: Any, references: Any, count: int, texts: Any) -> int:
        """Set Strings."""
        return self.fmi3SetString(component, references, count, texts, count)

    def getString(self, vr: Sequence[int], nValues: int | None = None) -> list[bytes | None]:
        """Return Strings as bytes, as in FMI 2.0; None for a NULL pointer, on which fmpy (0.3.32) fails."""
        references, count = (ctypes.c_uint32 * len(vr))(*vr), nValues or len(vr)
        texts = (ctypes.c_char_p * count)()
        self.fmi3GetString(self.component, references, len(vr), texts, count)
        return list(texts)

    def getBoolean(self, vr: Sequence[int], nValues: int | None = None) -> list[int]:
        """Return Booleans as numbers, which need not be 0 or 1."""
        references, count = (ctypes.c_uint32 * len(vr))(*vr), nValues or len(vr)
        values = (ctypes.c_uint8 * count)()
        pointer = ctypes.cast(values, ctypes.POINTER(ctypes.c_bool))
        self.fmi3GetBoolean(self.component, references, len(vr), pointer, count)
        return list(values)

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
            # without event mode, early return, intermediate variables and their callback
            return self.fmi3InstantiateModelExchange(*arguments[:5], *arguments[9:11])

        calls: Any = self
        calls.fmi3InstantiateCoSimulation = instantiate
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

    renamed = {fmi_2_name: functions[name] for fmi_2_name, name in _NAMES.items() if name in functions}
    return {**functions, **renamed, "doStep": do_step}
