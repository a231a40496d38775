"""The part of an FMU instance that comes from its model description."""

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable
from numpy.typing import NDArray

from ...fmu.clocks import is_clocked
from ...fmu.cvode import IntegratorSettings
from ...fmu.elements import is_plain
from ...fmu.file import FmuFile, find_span_references
from ...fmu.interface import MODEL_EXCHANGE
from ...fmu.variables import TypedValue
from .fmu_instance import FmuInstance
from .start_values import RejectedValue


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
        self.nominals = np.array([_nominal(v) for v in self.written])
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

    def ready(self) -> None:
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


def _nominal(variable: ModelVariable) -> float:
    """Return the nominal value of a variable; 1 if the declared one is not positive and finite."""
    declared = abs(float(variable.nominal or 1.0))
    return declared if 0.0 < declared < float("inf") else 1.0
