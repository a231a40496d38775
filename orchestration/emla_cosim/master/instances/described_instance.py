"""The part of an FMU instance that comes from its description, and its start values."""

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from fmpy.model_description import ModelVariable
from numpy.typing import NDArray

from ...base.arrays import Vector
from ...fmu.cvode import IntegratorSettings
from ...fmu.elements import is_clocked, is_plain
from ...fmu.file import FmuFile
from ...fmu.instance import FINE
from ...fmu.interface import MODEL_EXCHANGE
from ...fmu.tables import find_span_references
from ...fmu.variables import TypedValue
from .fmu_instance import FmuInstance
from .typed_values import TypedValues

ROUNDING = 1e-14
"""Relative difference of two Reals that are equal, such as after a conversion of units within the FMU."""


class RejectedValue(NamedTuple):
    """A start value that the FMU does not have.

    Attributes:
        variable: The name of the variable.
        expected: The value that was set.
        present: The value of the FMU; None if it cannot be read.
    """

    variable: str
    expected: Any
    present: Any


class StartValues:
    """The start values of an instance.

    Only inputs, and variables that are `exact`, must keep them. Numbers are set one by one, because after an
    error no further call shows which one was rejected. They are read back with one call per type, except for
    clocked ones, which cannot be read then.

    Args:
        functions: The FMI functions by their short names, such as `setReal`.
        arrays: The memory of the arrays that are set; see `TypedValues`.
    """

    def __init__(
        self, functions: Mapping[str, Callable[..., int]], arrays: dict[int, NDArray[Any]] | None = None
    ) -> None:
        self._functions, self._arrays = functions, arrays
        self._variables: list[ModelVariable] | None = None
        self.update([])

    def update(self, values: Iterable[TypedValue]) -> None:
        """Replace the values. No connection drives their variables."""
        self.all = list(values)
        variables = [variable for variable, _ in self.all]
        if variables == self._variables:  # most runs differ in values alone
            return
        self._variables = variables
        self.texts = [i for i, v in enumerate(variables) if v.type == "String"]
        """Positions of the Strings."""
        self._setters = [
            (i, TypedValues("set", [v], self._functions, self._arrays).groups[0])
            for i, v in enumerate(variables)
            if v.type != "String"
        ]
        last = {
            v.name: i
            for i, v in enumerate(variables)
            if (v.causality == "input" or v.initial == "exact") and not v.clocks
        }
        self._exact_texts = [i for i in last.values() if variables[i].type == "String"]
        self._numbers = [i for i in last.values() if variables[i].type != "String"]
        self._getters = TypedValues("get", [variables[i] for i in self._numbers], self._functions)

    def set_numbers(self, component: Any) -> tuple[TypedValue, int] | None:
        """Set all values but Strings; return the first one that the FMU rejects, with its status."""
        for i, setter in self._setters:
            if getattr(self.all[i][0], "is_resized", False):  # its other elements have no start values
                setter.values[setter.slots] = self.all[i][1]
        for i, setter in self._setters:
            setter.values[setter.slots] = self.all[i][1]
            if (status := setter.function(component, *setter.arguments)) not in FINE:
                return self.all[i], status
        return None

    def read_numbers(self, component: Any) -> tuple[int, Vector]:
        """Return the worst status, and the present numbers."""
        present = np.empty(len(self._numbers))
        return self._getters.get(component, present), present

    def find_rejected(
        self, present: Vector | None, read: Callable[[ModelVariable], Any]
    ) -> list[RejectedValue]:
        """Return the values that the FMU does not have.

        Args:
            present: The numbers from `read_numbers`; None if they could not be read.
            read: Returns the present value of one variable; None if it cannot be read.
        """
        candidates = self._numbers
        if present is not None:
            expected = np.array([self.all[i][1] for i in self._numbers], dtype=np.float64)
            candidates = [self._numbers[k] for k in np.flatnonzero(expected != present)]
        values = [(*self.all[i], read(self.all[i][0])) for i in sorted([*candidates, *self._exact_texts])]
        return [RejectedValue(str(v.name), *pair) for v, *pair in values if not _is_equal(*pair)]


def _is_equal(expected: Any, present: Any) -> bool:
    if isinstance(present, float):
        return math.isclose(expected, present, rel_tol=ROUNDING)
    return present == expected


class DescribedInstance(FmuInstance):
    """An instance of an FMU with its model description. Subclasses call the FMU's functions.

    Args:
        name: Name of the component.
        file: The FMU.
        inputs: Variables of the input vector. For other types than Real, see `TypedValues`.
        outputs: Variables of the output vector.
    """

    def __init__(self, name: str, file: FmuFile, inputs: Sequence[str], outputs: Sequence[str]) -> None:
        self.name = name
        self.file = file
        self.read, self.written = ([file.variables[n] for n in names] for names in (inputs, outputs))
        """Variables of the input vector (`read`) and of the output vector (`written`)."""
        self.typed = not (is_plain(self.read) and is_plain(self.written))
        """Whether some of them have another type than Real (Float64), or are parts of arrays."""
        integrated = file.kind == MODEL_EXCHANGE  # then the integrator does what steps need
        self.varies_step = integrated or file.has_capability("canHandleVariableCommunicationStepSize")
        self.restarts_when_saved = integrated
        self.rolls_back = file.has_capability("canGetAndSetFMUstate")
        self.serializes = self.rolls_back and file.has_capability("canSerializeFMUstate")
        self.interpolates = (integrated or file.has_capability("canInterpolateInputs")) and not self.typed
        self.differentiates = file.has_capability("providesDirectionalDerivative") and not self.typed
        self.continuous_inputs = np.array([v.variability == "continuous" for v in self.read], dtype=bool)
        self.continuous_outputs = np.array([v.variability == "continuous" for v in self.written], dtype=bool)
        self.nominals = np.array([_read_nominal(v) for v in self.written])
        booleans = {"true": "1", "false": "0", None: "0"}
        self.input_starts = np.array([float(booleans.get(v.start, str(v.start))) for v in self.read])
        self.inputs, self.outputs = self.input_starts.copy(), np.zeros(len(self.written))
        self.tolerance: float | None = None
        """Relative tolerance of the FMU's solver in the next run; None leaves it to the FMU."""
        self.rejected_start_values: list[RejectedValue] = []
        """Start values that the FMU had changed at the end of its last initialization."""

    @property
    def clocked_inputs(self) -> NDArray[np.bool_]:
        """Which inputs change at the ticks of a clock only, shape (inputs,)."""
        return np.array([is_clocked(v) for v in self.read], dtype=bool)

    @cached_property
    def span_references(self) -> Sequence[NDArray[np.uint32]]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Value references of what its outputs did in the last step, if it is a table of Reals."""
        return find_span_references(self.file, [str(v.name) for v in self.written])

    @property
    def violations(self) -> list[str]:
        """Violations of the standard in this run that were accepted."""
        return []

    def wait_until_ready(self) -> None:
        """Wait until the FMU is instantiated; CommandError if its library cannot be loaded."""

    def use_integrator(self, settings: IntegratorSettings) -> None:
        """Integrate a Model Exchange FMU with these settings from the next initialization on."""

    @abstractmethod
    def set_start_values(self, values: Iterable[TypedValue]) -> None:
        """Set variables in each initialization from now on, after `fmi2SetupExperiment`."""

    @abstractmethod
    def set_value(self, variable: ModelVariable, value: Any) -> None:
        """Set one variable to a value of its type; InstanceError if the FMU rejects it."""

    @abstractmethod
    def value(self, variable: ModelVariable) -> Any:
        """Return the present value of a variable."""


def _read_nominal(variable: ModelVariable) -> float:
    """Return the nominal value of a variable; 1 if the declared one is not positive and finite."""
    declared = abs(float(variable.nominal or 1.0))
    return declared if 0.0 < declared < float("inf") else 1.0
