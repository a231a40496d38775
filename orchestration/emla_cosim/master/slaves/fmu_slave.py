"""An FMI 2.0 co-simulation FMU as a slave, called through preallocated vectors."""

import contextlib
import ctypes
import difflib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from fmpy import fmi2
from fmpy.fmi1 import FMICallException
from fmpy.model_description import ModelVariable

from ..errors import CommandError
from .fmu_file import FmuFile
from .fmu_log import FmuLog
from .slave import SlaveError, Vector

_STATUS = ("fmi2OK", "fmi2Warning", "fmi2Discard", "fmi2Error", "fmi2Fatal", "fmi2Pending")

# a prototype of its own per function, because fmpy's checks would cost as much as the call
_POINTER, _SIZE = ctypes.c_void_p, ctypes.c_size_t
_EXCHANGE = (_POINTER, _POINTER, _SIZE, _POINTER)
_DO_STEP = (_POINTER, ctypes.c_double, ctypes.c_double, ctypes.c_int)


class FmuSlave:
    """One instance of an FMU; see `Slave` for the protocol.

    `inputs` and `outputs` name the variables of the two vectors, all of them Real.
    """

    def __init__(
        self, name: str, file: FmuFile, inputs: Sequence[str], outputs: Sequence[str], log: FmuLog
    ) -> None:
        """Instantiate the FMU; raises CommandError where its library cannot be loaded."""
        self.name = name
        self.file = file
        self.inputs: Vector = np.zeros(len(inputs))
        self.outputs: Vector = np.zeros(len(outputs))
        self._input_names = inputs
        self._log = log
        self._stepping = False
        try:
            self._fmu = fmi2.FMU2Slave(
                guid=file.description.guid,
                unzipDirectory=str(file.folder),
                modelIdentifier=file.model_identifier,
                instanceName=name,
                libraryPath=str(file.library),
            )
            self._fmu.instantiate(callbacks=log.callbacks, loggingOn=True)
        except Exception as error:  # fmpy raises bare Exception
            reasons = " ".join([str(error), *log.lines(name)])
            raise CommandError(f"the FMU '{file.path}' of {name} cannot be started: {reasons}") from error
        self._input_references = self._references(inputs)
        self._output_references = self._references(outputs)
        self._do_step = self._function("fmi2DoStep", _DO_STEP)
        self._set_real = self._function("fmi2SetReal", _EXCHANGE)
        self._get_real = self._function("fmi2GetReal", _EXCHANGE)
        self.bind(self.outputs)

    def bind(self, outputs: Vector) -> None:
        """Write outputs to this vector from now on; the slave keeps its address."""
        self.outputs = outputs
        component = self._fmu.component
        self._set_arguments = _arguments(component, self._input_references, self.inputs)
        self._get_arguments = _arguments(component, self._output_references, self.outputs)
        for i, name in enumerate(self._input_names):
            start = self.file.variables[name].start
            self.inputs[i] = float(start) if start is not None else 0.0

    def set_start_values(self, values: Mapping[str, Any]) -> None:
        """Set variables by name before initialization.

        Raises CommandError for what cannot be set, SlaveError where the FMU itself refuses.
        """
        for name, value in values.items():
            variable = find_variable(self.name, self.file.variables, name)
            reference, start = [variable.valueReference], [_converted(self.name, variable, value)]
            match variable.type:
                case "Real":
                    call = self._fmu.setReal
                case "Boolean":
                    call = self._fmu.setBoolean
                case _:
                    call = self._fmu.setInteger
            self._checked(f"setting {name} = {value}", call, reference, start)

    def enter_initialization(self, start_time: float, stop_time: float) -> None:
        """Enter initialization mode; times in s."""
        self._checked("setupExperiment", self._fmu.setupExperiment, None, start_time, stop_time)
        self._checked("enterInitializationMode", self._fmu.enterInitializationMode)

    def exit_initialization(self) -> None:
        """Leave initialization mode."""
        self._checked("exitInitializationMode", self._fmu.exitInitializationMode)
        self._stepping = True

    def set_inputs(self) -> None:
        """Pass `inputs` on to the FMU."""
        if len(self.inputs) and (status := self._set_real(*self._set_arguments)) > fmi2.fmi2Warning:
            raise self._failed("setReal", status)

    def get_outputs(self) -> None:
        """Read the FMU's outputs into `outputs`."""
        if len(self.outputs) and (status := self._get_real(*self._get_arguments)) > fmi2.fmi2Warning:
            raise self._failed("getReal", status)

    def do_step(self, time: float, step: float) -> None:
        """Advance from `time` by `step`, both in s."""
        status = self._do_step(self._fmu.component, time, step, 1)
        if status > fmi2.fmi2Warning:
            raise self._failed(f"doStep at t = {time:.9g} s", status)

    def close(self) -> None:
        """Terminate the FMU where the standard allows it, and free the instance and its library."""
        with contextlib.suppress(Exception):
            if self._stepping:
                self._fmu.terminate()
        with contextlib.suppress(Exception):
            self._fmu.freeInstance()

    def _function(self, name: str, argument_types: tuple[Any, ...]) -> Any:
        function = self._fmu.dll[name]
        function.argtypes, function.restype = argument_types, ctypes.c_int
        return function

    def _references(self, names: Sequence[str]) -> Any:
        return np.array([self.file.variables[n].valueReference for n in names], dtype=np.uint32)

    def _checked(self, call: str, function: Any, *arguments: Any) -> None:
        try:
            function(*arguments)
        except FMICallException as error:
            raise self._failed(call, error.status) from error

    def _failed(self, call: str, status: int) -> SlaveError:
        self._stepping = False
        answer = _STATUS[status] if status < len(_STATUS) else f"status {status}"
        return SlaveError(self.name, call, answer, self._log.lines(self.name))


def find_variable(component: str, variables: Mapping[str, ModelVariable], name: str) -> ModelVariable:
    """The variable of this name; CommandError suggests what may have been meant."""
    if name in variables:
        return variables[name]
    near = difflib.get_close_matches(name, variables, n=3, cutoff=0.5)
    meant = f"; did you mean {' or '.join(near)}?" if near else "."
    raise CommandError(f"{component} has no variable '{name}'{meant}")


def _arguments(component: Any, references: Any, values: Vector) -> tuple[Any, ...]:
    return (component, references.ctypes.data_as(_POINTER), len(references), values.ctypes.data_as(_POINTER))


def _converted(component: str, variable: ModelVariable, value: Any) -> Any:
    """A start value as the variable's type, within its range; CommandError otherwise."""
    name = f"{component}.{variable.name}"
    if variable.causality not in ("parameter", "input") and variable.initial not in ("exact", "approx"):
        raise CommandError(f"{name} is computed by the FMU and cannot be set.")
    if variable.type == "Enumeration":
        return _enumeration(name, variable, value)
    if variable.type == "Boolean":
        booleans = {"true": True, "1": True, "false": False, "0": False}
        if str(value).lower() not in booleans:
            raise CommandError(f"{name} = {value} is not a Boolean; write true or false.")
        return booleans[str(value).lower()]
    try:
        number = float(value) if variable.type == "Real" else int(value)
    except ValueError as error:
        kind = "number" if variable.type == "Real" else "whole number"
        raise CommandError(f"{name} = {value} is not a {kind}.") from error
    unit = f" {variable.unit}" if variable.unit else ""
    widest = np.inf if variable.type == "Real" else 2**31 - 1
    low = float(variable.min) if variable.min is not None else -widest
    high = float(variable.max) if variable.max is not None else widest
    if not (low <= number <= high and np.isfinite(number)):
        limits = [f"at least {low:g}"] if low > -np.inf else []
        limits += [f"at most {high:g}"] if high < np.inf else []
        right = " and ".join(limits) or "a finite number"
        raise CommandError(f"{name} = {number:g}{unit} is out of range: it must be {right}{unit}.")
    return number


def _enumeration(name: str, variable: ModelVariable, value: Any) -> int:
    declared = variable.declaredType.items if variable.declaredType is not None else []
    items = {str(item.name): int(str(item.value)) for item in declared or []}
    if str(value) in items:
        return items[str(value)]
    if str(value) in {str(v) for v in items.values()}:
        return int(value)
    raise CommandError(f"{name} = {value} is not one of {', '.join(items)}.")
