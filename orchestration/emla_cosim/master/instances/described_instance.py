"""What is known of an FMU as an instance before any of its functions is called."""

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable

from ...fmu.file import FmuFile
from ...fmu.variables import TypedValue
from .fmu_instance import FmuInstance


class DescribedInstance(FmuInstance):
    """An instance that its FMU's model description describes; its functions are called elsewhere.

    `inputs` and `outputs` name the variables of the two vectors; see `TypedValues` for other types
    than Real.
    """

    def __init__(self, name: str, file: FmuFile, inputs: Sequence[str], outputs: Sequence[str]) -> None:
        self.name = name
        self.file = file
        self.read, self.written = ([file.variables[n] for n in names] for names in (inputs, outputs))
        """Variables of the two vectors."""
        self.typed = any(v.type != "Real" for v in (*self.read, *self.written))
        """Whether some of them are no Reals."""
        self.varies_step = file.has_capability("canHandleVariableCommunicationStepSize")
        self.rolls_back = file.has_capability("canGetAndSetFMUstate")
        self.serializes = self.rolls_back and file.has_capability("canSerializeFMUstate")
        self.interpolates = file.has_capability("canInterpolateInputs") and not self.typed
        self.differentiates = file.has_capability("providesDirectionalDerivative") and not self.typed
        self.continuous_inputs = np.array([v.variability == "continuous" for v in self.read], dtype=bool)
        self.continuous_outputs = np.array([v.variability == "continuous" for v in self.written], dtype=bool)
        self.nominals = np.array([_nominal(v) for v in self.written])
        self._input_starts = np.array([_start(v) for v in self.read])
        self.inputs, self.outputs = self._input_starts.copy(), np.zeros(len(self.written))

    def ready(self) -> None:
        """Wait until the FMU is instantiated; CommandError where its library cannot be loaded."""

    def set_start_values(self, values: Iterable[TypedValue]) -> None:
        """Set variables before initialization; InstanceError where the FMU refuses."""
        for variable, value in values:
            self.set_value(variable, value)

    @abstractmethod
    def set_value(self, variable: ModelVariable, value: Any) -> None:
        """Set one variable to a value of its type; InstanceError where the FMU refuses."""

    @abstractmethod
    def value(self, variable: ModelVariable) -> Any:
        """The present value of a variable that is no String: a number, or true or false."""


def _start(variable: ModelVariable) -> float:
    return float({"true": "1", "false": "0", None: "0"}.get(variable.start, str(variable.start)))


def _nominal(variable: ModelVariable) -> float:
    """The usual size of a variable: what is declared if that is a positive number, as it must be, else 1."""
    declared = abs(float(variable.nominal or 1.0))
    return declared if 0.0 < declared < float("inf") else 1.0
