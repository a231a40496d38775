"""The base class of blocks: typed variables, states and equations."""

import re
import sys
import time
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, ClassVar, TypeVar

from .variables import Derivative, DiscreteState, Input, Output, Parameter, ScalarVariable, State, Variable

_Kind = TypeVar("_Kind", bound=Variable)
_NAME = r"[A-Za-z_]\w*(\[\d+(,\d+)*\])?"
_STRUCTURED_NAME = re.compile(rf"{_NAME}(\.{_NAME})*", re.ASCII)


@dataclass(frozen=True)
class DefaultExperiment:
    """Default experiment in the model description of a block.

    Args:
        stop_time: in s.
        step_size: communication step size in s.
        tolerance: relative tolerance for integration by Model Exchange.
    """

    stop_time: float = 1.0
    step_size: float = 1e-3
    tolerance: float = 1e-6


class Values:
    """One value per variable of a block, by attribute name, and `time` in s.

    Values are floats when the block runs and symbols when it is exported. Vectors are lists, matrices
    are lists of rows.
    """

    time: Any

    def __getattr__(self, attribute: str) -> Any:
        raise AttributeError(f"the block's equations have no variable '{attribute}'")


@dataclass(frozen=True)
class Layout:
    """The scalar variables of a block; a value reference is the index in `scalars`.

    The order is inputs, parameters, continuous states, discrete states, outputs.
    """

    inputs: tuple[Variable, ...]
    parameters: tuple[Parameter, ...]
    states: tuple[Variable, ...]
    discrete_states: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    scalars: tuple[ScalarVariable, ...]

    def references(self, variables: tuple[Variable, ...]) -> range:
        """Return the value references of one of these groups; each group is contiguous."""
        chosen = [i for i, s in enumerate(self.scalars) if s.variable in variables]
        return range(chosen[0], chosen[-1] + 1) if chosen else range(0)

    def reference(self, name: str) -> int:
        """Return the value reference of a scalar variable by FMI name; KeyError if there is none."""
        return self._references[name]

    @cached_property
    def _references(self) -> dict[str, int]:
        return {scalar.name: r for r, scalar in enumerate(self.scalars)}

    @cached_property
    def arrays(self) -> "dict[str, Variable]":
        """Vectors and matrices by FMI name."""
        return {str(s.variable.name): s.variable for s in self.scalars if s.index}

    @property
    def derivatives(self) -> tuple[ScalarVariable, ...]:
        """Time derivatives of the continuous states; their value references follow those of `scalars`."""
        return tuple(Derivative.of(self.scalars[r]) for r in self.references(self.states))

    def start_reference(self, reference: int) -> int:
        """Return the value reference of a variable's start value: a parameter's element, or the variable."""
        variable = self.scalars[reference].variable
        parameter = variable.start_parameter
        if parameter is None:
            return reference
        element = reference - self.references((variable,))[0] if parameter.shape else 0
        return self.references((parameter,))[element]

    def limit_references(self, reference: int) -> tuple[int, int] | None:
        """Return the value references of the lower and upper limit of a variable, if it has limits."""
        limits = self.scalars[reference].variable.limit_parameters
        if limits is None:
            return None
        element = reference - self.references((self.scalars[reference].variable,))[0]
        low, high = (self.references((p,))[element if p.shape else 0] for p in limits)
        return low, high


@dataclass(frozen=True)
class Origin:
    """Where a block was defined: its module's name, its file if there is one, and when (s since 1970)."""

    module: str
    file: str | None
    time: float


class Block:
    """Base class of blocks. A subclass declares variables as attributes and defines the equations.

    `derivatives`, `update` and `outputs` get the values of all variables and return values by attribute name:
    a list for a vector, a list of rows for a matrix. They can call helper methods, but must not keep
    anything: what evolves is a declared state. Use + - * /, abs, comparisons and the functions of `fmublock`
    only, which work on floats and on symbols. Use `where`, not `if`, for what depends on a value. The export
    fails if symbols and floats give different results.

    In a PythonFMU FMU, a division by zero discards the step also in the branch that `where` does not choose.
    Keep divisors away from zero there.

    Attributes:
        default_experiment: stop time and step size for the model description.
        internal_step: longest internal integration step, in s (a parameter of each block with states).
        has_model_exchange: whether the FMU may offer Model Exchange, in which discrete states keep their
            start values. False for a block that is wrong without communication steps.
        is_restricted: whether `Disclosure` changed its parameters.

    Examples:
        >>> from fmublock import Block, Input, Instance, State
        >>> class Mass(Block):
        ...     F = Input(unit="N")
        ...     v = State(unit="m/s")
        ...
        ...     def derivatives(self, v):
        ...         return {"v": v.F / 2.0}
        >>> mass = Instance(Mass())
        >>> mass["F"] = 4.0
        >>> mass.enter_initialization()
        >>> mass.exit_initialization()
        >>> mass.do_step(0.0, 0.5)
        >>> round(mass["v"], 9)
        1.0
    """

    default_experiment: ClassVar[DefaultExperiment] = DefaultExperiment()
    origin: ClassVar[Origin] = Origin(__name__, __file__, time.time())
    has_model_exchange: ClassVar[bool] = True
    is_restricted: ClassVar[bool] = False

    internal_step = Parameter(
        5e-5,
        unit="s",
        minimum=1e-9,
        name="solver.internal_step",
        description="Longest internal integration step (classical Runge-Kutta)",
    )

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        file = getattr(sys.modules.get(cls.__module__), "__file__", None)
        cls.origin = Origin(cls.__module__, file, time.time())

    def derivatives(self, v: Values) -> dict[str, Any]:
        """Return the time derivatives of the continuous states, per s, by attribute name.

        Args:
            v: values of all variables by attribute name, and `time` in s.
        """
        return {}

    def update(self, v: Values) -> dict[str, Any]:
        """Return the values of the discrete states after a communication step, by attribute name.

        Args:
            v: values of all variables by attribute name, and `time` in s.
        """
        return {}

    def outputs(self, v: Values) -> dict[str, Any]:
        """Return the values of the `Output` variables by attribute name.

        Args:
            v: values of all variables by attribute name, and `time` in s.
        """
        return {}

    def conditions(self, v: Values) -> dict[str, Any]:
        """Return what must hold at the end of initialization, beside the ranges of single values.

        Args:
            v: values of all variables by attribute name, and `time` in s.

        Returns:
            Comparisons by error message, without a full stop. If one does not hold, the instance does not
            start and reports the message, which therefore names the variables.
        """
        return {}

    @classmethod
    def layout(cls) -> Layout:
        """Return all variables of the block in the order of their value references."""
        return _layout(cls)


def _variables(owner: type[Block]) -> dict[str, Variable]:
    """Return the variables that a class declares itself, without those of its bases."""
    return {attribute: x for attribute, x in vars(owner).items() if isinstance(x, Variable)}


@cache
def _layout(block: type[Block]) -> Layout:
    declared: dict[str, Variable] = {}
    for base in reversed(block.__mro__[:-2]):
        declared.update(_variables(base))
    for attribute, setting in _variables(
        Block
    ).items():  # the solver's parameters come last, also if a block redeclares them
        declared[attribute] = declared.pop(attribute, setting)

    def group(kind: type[_Kind]) -> tuple[_Kind, ...]:
        return tuple(x for x in declared.values() if isinstance(x, kind))

    states = group(State)
    parameters = tuple(p for p in group(Parameter) if states or p.attribute != "internal_step")
    groups = (group(Input), parameters, states, group(DiscreteState), group(Output))
    scalars = tuple(s for variables in groups for variable in variables for s in variable.scalars())
    names = [s.name for s in scalars]
    if twice := {n for n in names if names.count(n) > 1}:
        raise TypeError(f"{block.__name__} declares these names twice: {', '.join(sorted(twice))}")
    if wrong := [n for n in names if not _STRUCTURED_NAME.fullmatch(n)]:
        raise TypeError(
            f"{block.__name__} has the name '{wrong[0]}'; write names like speed, motor.R_s or M[1,2]"
        )
    for scalar in scalars:
        if (fault := scalar.range_fault) is not None:
            raise TypeError(f"{block.__name__}.{scalar.name} {fault}")
    return Layout(*groups, scalars)
