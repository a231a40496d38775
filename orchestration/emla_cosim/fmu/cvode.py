"""CVode of SUNDIALS, from the libraries that fmpy has, for ordinary differential equations with events."""

import ctypes
import importlib
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ..base.arrays import Vector
from ..base.errors import CommandError

METHODS = {"bdf": 2, "adams": 1}
"""Multistep methods by name, with their numbers in CVode: for stiff models, and for others."""

RECOVERABLE, FAILED = 1, -1
"""What a function returns if a shorter step may succeed, and if nothing can."""

# CV_ONE_STEP, CV_ROOT_RETURN, CV_MEM_FAIL and the other return values of CVode
_ONE_STEP, _ROOT = 2, 2
_MEMORY_ERROR = -20
_REASONS = {
    -2: "the tolerance is too small for the precision of numbers",
    -3: "the error stays too large, or the step became too short",
    -4: "Newton's method does not converge, or the step became too short",
    -8: "the derivatives cannot be computed",
    -9: "the derivatives cannot be computed at the first point",
    -10: "the derivatives cannot be computed, even with shorter steps",
    -11: "the derivatives cannot be computed",
    -12: "the event indicators cannot be computed",
}
_POINTER, _REAL, _INT, _INDEX = ctypes.c_void_p, ctypes.c_double, ctypes.c_int, ctypes.c_int64
_RIGHT_SIDE = ctypes.CFUNCTYPE(_INT, _REAL, _POINTER, _POINTER, _POINTER)
_PROTOTYPES: dict[str, tuple[str, Any, tuple[Any, ...]]] = {
    "SUNContext_Create": ("core", _INT, (_INT, _POINTER)),
    "SUNContext_ClearErrHandlers": ("core", _INT, (_POINTER,)),
    "SUNContext_Free": ("core", _INT, (_POINTER,)),
    "N_VGetArrayPointer": ("core", _POINTER, (_POINTER,)),
    "N_VDestroy": ("core", None, (_POINTER,)),
    "SUNMatDestroy": ("core", None, (_POINTER,)),
    "SUNLinSolFree": ("core", _INT, (_POINTER,)),
    "N_VNew_Serial": ("nvecserial", _POINTER, (_INDEX, _POINTER)),
    "SUNDenseMatrix": ("sunmatrixdense", _POINTER, (_INDEX, _INDEX, _POINTER)),
    "SUNLinSol_Dense": ("sunlinsoldense", _POINTER, (_POINTER, _POINTER, _POINTER)),
    "CVodeCreate": ("cvode", _POINTER, (_INT, _POINTER)),
    "CVodeInit": ("cvode", _INT, (_POINTER, _RIGHT_SIDE, _REAL, _POINTER)),
    "CVodeReInit": ("cvode", _INT, (_POINTER, _REAL, _POINTER)),
    "CVodeSVtolerances": ("cvode", _INT, (_POINTER, _REAL, _POINTER)),
    "CVodeSetLinearSolver": ("cvode", _INT, (_POINTER, _POINTER, _POINTER)),
    "CVodeRootInit": ("cvode", _INT, (_POINTER, _INT, _RIGHT_SIDE)),
    "CVodeSetNoInactiveRootWarn": ("cvode", _INT, (_POINTER,)),
    "CVodeSetMaxStep": ("cvode", _INT, (_POINTER, _REAL)),
    "CVodeSetMaxHnilWarns": ("cvode", _INT, (_POINTER, _INT)),
    "CVodeSetStopTime": ("cvode", _INT, (_POINTER, _REAL)),
    "CVode": ("cvode", _INT, (_POINTER, _REAL, _POINTER, _POINTER, _INT)),
    "CVodeFree": ("cvode", None, (_POINTER,)),
}

Function = Callable[[float, int, int], int]
"""Writes its result for a time in s and the address of the states; the last argument is where to.

It returns 0, `RECOVERABLE` or `FAILED`. An exception ends the step, which raises it.
"""


class IntegratorSettings(NamedTuple):
    """How models are integrated.

    Attributes:
        tolerance: Relative tolerance. The absolute ones are its products with the states' nominal values.
        method: One of `METHODS`.
        largest: Largest step in s; None for no limit but the communication step.
    """

    tolerance: float = 1e-5
    method: str = "bdf"
    largest: float | None = None


class SolverError(Exception):
    """CVode cannot continue; the text says why."""


class CVode:
    """Solve dx/dt = f(t, x), and stop where an event indicator changes its sign.

    Call `restart` before the first `step`, and after every discontinuity.

    Attributes:
        states: present states x, shape (count,); changing them needs a `restart`.
        absolute: absolute tolerances, shape (count,), which the next `restart` uses.
    """

    def __init__(
        self, count: int, indicators: int, derive: Function, indicate: Function, method: str = "bdf"
    ) -> None:
        """Allocate the solver.

        Args:
            count: Number of states, at least one.
            indicators: Number of event indicators.
            derive: Computes the derivatives of the states, per s.
            indicate: Computes the event indicators.
            method: One of `METHODS`.

        Raises:
            CommandError: There is no CVode for this platform.
        """
        call = self._call = load_sundials()
        self._failure: BaseException | None = None
        # CVode has their addresses
        self._derive = _RIGHT_SIDE(self._guard(derive, True))
        self._indicate = _RIGHT_SIDE(self._guard(indicate, False))
        self._context, self._reached = _POINTER(), _REAL()
        call["SUNContext_Create"](0, ctypes.byref(self._context))
        call["SUNContext_ClearErrHandlers"](self._context)  # exceptions have the reason
        self._vectors = [call["N_VNew_Serial"](count, self._context) for _ in range(2)]
        self.states, self.absolute = (self._view_values(vector, count) for vector in self._vectors)
        self._matrix = call["SUNDenseMatrix"](count, count, self._context)
        self._linear = call["SUNLinSol_Dense"](self._vectors[0], self._matrix, self._context)
        self._solver = call["CVodeCreate"](METHODS[method], self._context)
        self.states[:], self.absolute[:] = 0.0, 1.0
        self._call_solver("CVodeInit", self._derive, 0.0, self._vectors[0])
        self._call_solver("CVodeSVtolerances", 1e-5, self._vectors[1])
        self._call_solver("CVodeSetLinearSolver", self._linear, self._matrix)
        # no warnings of steps that are lost in the rounding of the time
        self._call_solver("CVodeSetMaxHnilWarns", -1)
        if indicators:
            self._call_solver("CVodeRootInit", indicators, self._indicate)
            # an indicator may stay at 0
            self._call_solver("CVodeSetNoInactiveRootWarn")

    def restart(self, time: float, relative: float, largest: float = 0.0) -> None:
        """Start from the present `states` at a time, without regard to what was before.

        Args:
            time: In s.
            relative: Relative tolerance.
            largest: Largest step in s; 0 for no limit.
        """
        self._call_solver("CVodeSVtolerances", relative, self._vectors[1])
        self._call_solver("CVodeSetMaxStep", largest)
        self._call_solver("CVodeReInit", time, self._vectors[0])

    def step(self, until: float) -> tuple[float, bool]:
        """Do one step, as long as the tolerances allow, and update `states`.

        Args:
            until: Time in s that the step does not exceed.

        Returns:
            The time reached in s, and whether an event indicator changed its sign there.

        Raises:
            SolverError: No step is possible.
        """
        self._failure = None
        self._call_solver("CVodeSetStopTime", until)
        flag = self._call["CVode"](
            self._solver, until, self._vectors[0], ctypes.addressof(self._reached), _ONE_STEP
        )
        if self._failure is not None:
            raise self._failure
        if flag < 0:
            raise SolverError(_REASONS.get(flag, f"CVode returned {flag}"))
        return self._reached.value, flag == _ROOT

    def close(self) -> None:
        """Free the memory; `states` and `absolute` must not be used any more."""
        call = self._call
        if self._solver:
            call["CVodeFree"](ctypes.byref(_POINTER(self._solver)))
            call["SUNLinSolFree"](self._linear)
            call["SUNMatDestroy"](self._matrix)
            for vector in self._vectors:
                call["N_VDestroy"](vector)
            call["SUNContext_Free"](ctypes.byref(self._context))
            self._solver = None

    def _call_solver(self, name: str, *arguments: Any) -> None:
        """Call a function with the solver. Raise SolverError or MemoryError if it fails."""
        flag = self._call[name](self._solver, *arguments)
        if flag:
            raise MemoryError if flag == _MEMORY_ERROR else SolverError(f"{name} returned {flag}")

    def _view_values(self, vector: int, count: int) -> Vector:
        """Return an array that shares the memory of a vector of CVode."""
        address = self._call["N_VGetArrayPointer"](vector)
        return np.ctypeslib.as_array((_REAL * count).from_address(address))

    def _guard(self, function: Function, is_vector: bool) -> Callable[..., int]:
        """Return a function for CVode, which keeps exceptions for `step`."""
        get_address = self._call["N_VGetArrayPointer"]

        def call_guarded(time: float, states: int, result: int, _: Any) -> int:
            try:
                return function(time, get_address(states), get_address(result) if is_vector else result)
            except BaseException as error:
                self._failure = error
                return FAILED

        return call_guarded


@cache
def load_sundials() -> dict[str, Any]:
    """Return the functions of SUNDIALS by name; raise CommandError if fmpy has none for this platform."""
    try:
        libraries = importlib.import_module("fmpy.sundials.libraries")
    except (ImportError, OSError) as error:
        raise CommandError(
            "Model Exchange needs the solver CVode, and the package fmpy has no CVode for "
            f"{importlib.import_module('fmpy').platform_tuple}. Use an FMU with co-simulation."
        ) from error
    functions = {}
    for name, (library, result, arguments) in _PROTOTYPES.items():
        function = getattr(libraries, f"sundials_{library}")[name]  # fmpy's prototypes remain as they are
        function.restype, function.argtypes = result, arguments
        functions[name] = function
    return functions
