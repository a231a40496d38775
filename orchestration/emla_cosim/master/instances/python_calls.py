"""Let the stepper in C call Python, for example for FMUs in other processes."""

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np

from ...fmu.instance import DISCARD, ERROR, OK
from .fmu_instance import DiscardedStepError, EntryPoints, FmuInstance

_ADDRESS, _COUNT, _STATUS, _TRUTH = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_int
_STATE = ctypes.POINTER(ctypes.c_void_p)
_Values = ctypes.CFUNCTYPE(_STATUS, _ADDRESS, _ADDRESS, _COUNT, _ADDRESS)
_Slopes = ctypes.CFUNCTYPE(_STATUS, _ADDRESS, _ADDRESS, _COUNT, _ADDRESS, _ADDRESS)
_Step = ctypes.CFUNCTYPE(_STATUS, _ADDRESS, ctypes.c_double, ctypes.c_double, _TRUTH)
_Wait = ctypes.CFUNCTYPE(_STATUS, _ADDRESS)
_Save = ctypes.CFUNCTYPE(_STATUS, _ADDRESS, _STATE)
_Restore = ctypes.CFUNCTYPE(_STATUS, _ADDRESS, _ADDRESS)

_NOTHING = np.empty(0, dtype=np.uint32)


class PythonCalls:
    """Functions with the arguments of FMI 2.0 that call Python.

    Values pass through the memory that stepper and instance share, so that the functions copy none.

    Attributes:
        error: the exception of the last call that failed; None without one.
    """

    def __init__(self) -> None:
        self.error: BaseException | None = None
        self._states = dict[int, Any]()
        self._functions = list[Any]()  # the functions, which C knows by address only

    def entry_points(self, instance: FmuInstance, splits: bool = False) -> EntryPoints:
        """Return the functions for an instance.

        Args:
            instance: The instance.
            splits: Whether `do_step` only begins a step, and `end_step` waits for its end.
        """

        def set_slopes(component: Any, references: Any, count: int, orders: Any, slopes: Any) -> None:
            values = (ctypes.c_double * count).from_address(slopes)
            instance.set_input_derivatives(np.ctypeslib.as_array(values))

        def begin(component: Any, time: float, step: float, no_way_back: int) -> None:
            instance.begin_step(time, step)

        def step(component: Any, time: float, step: float, no_way_back: int) -> None:
            instance.do_step(time, step)

        def save(component: Any, slot: Any) -> None:
            number = slot[0] or len(self._states) + 1
            self._states[number] = instance.save(self._states.get(number))
            slot[0] = number

        return EntryPoints(
            component=0,
            set_real=self.make_function(_Values, lambda *_: instance.set_inputs()),
            get_real=self.make_function(_Values, lambda *_: instance.get_outputs()),
            do_step=self.make_function(_Step, begin if splits else step),
            end_step=self.make_function(_Wait, lambda _: instance.end_step()) if splits else 0,
            set_real_input_derivatives=self.make_function(_Slopes, set_slopes),
            get_state=self.make_function(_Save, save),
            set_state=self.make_function(_Restore, lambda _, number: instance.restore(self._states[number])),
            input_references=_NOTHING,
            output_references=_NOTHING,
            derivative_orders=_NOTHING.astype(np.int32),
            calls=self,
        )

    def make_step(self, call: Callable[[], Any]) -> int:
        """Return the address of a `do_step` that calls this function."""
        return self.make_function(_Step, lambda *_: call())

    def make_getter(self, call: Callable[[], Any]) -> int:
        """Return the address of a `get_real` that calls this function."""
        return self.make_function(_Values, lambda *_: call())

    def close(self, instance: FmuInstance) -> None:
        """Free the saved states; never raises."""
        for state in self._states.values():
            instance.forget(state)
        self._states.clear()

    def make_function(self, kind: Any, call: Callable[..., None]) -> int:
        """Return the address of a C function that returns a status, and keeps what `call` raises."""

        def checked(*arguments: Any) -> int:
            try:
                call(*arguments)
            except BaseException as error:  # Ctrl-C, too: it is raised when the stepper has returned
                self.error = error
                return DISCARD if isinstance(error, DiscardedStepError) else ERROR
            return OK

        function = kind(checked)
        self._functions.append(function)
        return ctypes.cast(function, ctypes.c_void_p).value or 0
