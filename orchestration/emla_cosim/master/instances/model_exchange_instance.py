"""Instances of FMUs that run as Model Exchange: an `IntegratedInstance` steps them."""

import contextlib
import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from fmpy.model_description import ModelDescription, ModelVariable

from ...base.arrays import Vector
from ...base.errors import RunError
from ...fmu.cvode import IntegratorSettings
from ...fmu.elements import is_plain, position_in_array
from ...fmu.integrator import ContinuousModel, DiscardedCall
from .fmu_instance import EndRequestedError, InstanceError
from .in_process_instance import InProcessInstance
from .typed_values import TypedValues


class DiscardedCallError(InstanceError, DiscardedCall):
    """The FMU discarded a call; other states may succeed."""


class ModelExchangeInstance(InProcessInstance, ContinuousModel):
    """One instance of an FMU that runs as Model Exchange, without its integrator.

    Attributes:
        surround: returns what surrounds a change of a variable from outside. The integrator sets it.
    """

    surround: Callable[[], contextlib.AbstractContextManager[None]] = contextlib.nullcontext

    @property
    def _description(self) -> ModelDescription:
        return self.file.description

    @cached_property
    def reports_steps(self) -> bool:
        """Whether the FMU needs a call when a step of the integrator is complete."""
        return self.file.has_capability("needsCompletedIntegratorStep")

    def use_integrator(self, settings: IntegratorSettings) -> None:
        """Integrate with these settings from the next initialization on."""
        self.settings = settings

    def reset(self) -> None:
        """Return to the state right after instantiation."""
        super().reset()
        self.surround = contextlib.nullcontext

    def enter_initialization(self, start_time: float, stop_time: float | None = None) -> None:
        """Enter initialization mode; times in s, None without a fixed stop time."""
        self.start(start_time)
        super().enter_initialization(start_time, stop_time)

    def exit_initialization(self) -> None:
        """Leave initialization mode; the FMU is in event mode then."""
        super().exit_initialization()
        if self.is_3:
            self._check_count("getNumberOfContinuousStates", self.state_count)
            self._check_count("getNumberOfEventIndicators", self.indicator_count)

    def _check_count(self, call: str, declared: int) -> None:
        """Raise InstanceError if the FMU has another number of values than it declares."""
        with self.calling():
            count = getattr(self.fmu, call)()
        if count != declared:
            raise self._answer_error(call, f"{count}, and its model description has {declared}")

    def set_value(self, variable: ModelVariable, value: Any) -> None:
        """Set one variable to a value of its type; InstanceError if the FMU rejects it."""
        with self.surround():
            super().set_value(variable, value)

    def make_reader(self, variables: Sequence[ModelVariable], values: Vector) -> Callable[[], None]:
        """Return a function that reads Real variables into `values`, in their order."""
        if is_plain(variables):
            return self._make_plain_call("getReal", variables, values)
        typed = TypedValues("get", variables, self._functions)

        def read() -> None:
            self._check("getReal", typed.get(self._component, values))

        return read

    def make_writer(self, variables: Sequence[ModelVariable], values: Vector) -> Callable[[], None]:
        """Return a function that sets Real variables to `values`, in their order.

        The other elements of their arrays keep the values of the FMU.
        """
        if is_plain(variables):
            return self._make_plain_call("setReal", variables, values)
        typed = TypedValues("set", variables, self._functions)
        getters = [self._functions[f"get{group.call.removeprefix('set')}"] for group in typed.groups]

        def write() -> None:
            for group, get in zip(typed.groups, getters, strict=True):
                self._check("getReal", get(self._component, *group.arguments))
            self._check("setReal", typed.set(self._component, values))

        return write

    def _make_plain_call(
        self, name: str, variables: Sequence[ModelVariable], values: Vector
    ) -> Callable[[], None]:
        """Return a function that gets or sets variables whose values are the memory of one FMI call."""
        references = [v.valueReference for v in variables if not position_in_array(v)]
        arguments = self._make_arguments(np.array(references, dtype=np.uint32), values)[1:]
        return lambda: self._call(name, *arguments)

    def error(self, call: str, status: int) -> RunError:
        """Return the error for a call that returned this status."""
        is_placed = math.isnan(self._time) or " at t = " in call
        return super().error(call if is_placed else self._at(call), status)

    def _describe_time(self, call: str) -> str:
        return "" if math.isnan(self._time) else f" at t = {self._time:.9g} s"

    def _choose_discard_error(self, call: str) -> type[InstanceError]:
        return DiscardedCallError

    def _update(self, call: str) -> tuple[bool, bool, bool, bool, bool, float]:
        with self.calling(call):
            return self.fmu.newDiscreteStates()

    def _answer_error(self, call: str, answer: str) -> InstanceError:
        return InstanceError(self.name, call, answer, self.messages())

    def _end_error(self, call: str) -> EndRequestedError:
        return EndRequestedError(self.name, call, "terminateSimulation", self.messages())
