"""A block: typed variables, states and equations, written once."""

from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

from .variables import Derivative, DiscreteState, Input, Output, Parameter, ScalarVariable, State, Variable


@dataclass(frozen=True)
class DefaultExperiment:
    """Stop time and communication step in s that suit a block, for its model description.

    `tolerance` is the relative tolerance for whoever integrates the block through Model Exchange.
    """

    stop_time: float = 1.0
    step_size: float = 1e-3
    tolerance: float = 1e-6


class Values:
    """One value per variable of a block, by attribute name, and `time` in s.

    Values are floats when the block runs, CasADi symbols when it is exported; arrays are lists.
    """

    time: Any

    def __getattr__(self, attribute: str) -> Any:
        raise AttributeError(f"the block's equations have no variable '{attribute}'")


@dataclass(frozen=True)
class Layout:
    """Where every scalar variable of a block lives: its value reference is its place in `scalars`.

    The order is inputs, parameters, continuous states, discrete states, outputs.
    """

    inputs: tuple[Variable, ...]
    parameters: tuple[Variable, ...]
    states: tuple[Variable, ...]
    discrete_states: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    scalars: tuple[ScalarVariable, ...]

    def references(self, variables: tuple[Variable, ...]) -> range:
        """Value references of one of the groups above; groups are contiguous."""
        chosen = [i for i, s in enumerate(self.scalars) if s.variable in variables]
        return range(chosen[0], chosen[-1] + 1) if chosen else range(0)

    def reference(self, name: str) -> int:
        """Value reference of the scalar variable with this FMI name; KeyError if there is none."""
        for i, scalar in enumerate(self.scalars):
            if scalar.name == name:
                return i
        raise KeyError(name)

    @property
    def derivatives(self) -> tuple[ScalarVariable, ...]:
        """Time derivatives of the continuous states; their value references follow those of `scalars`."""
        return tuple(Derivative.of(self.scalars[r]) for r in self.references(self.states))

    def start_reference(self, reference: int) -> int:
        """Value reference of what a variable starts from: a parameter, or the variable itself."""
        parameter = self.scalars[reference].variable.start_parameter
        return reference if parameter is None else self.references((parameter,))[0]


class Block:
    """Base of all blocks; subclasses declare variables and define the equations.

    `derivatives`, `update` and `outputs` take a `Values` and return a dict from attribute name
    to value (a list for an array). They may call helper methods but keep nothing: everything
    that evolves is a declared state. They use + - * /, comparisons and `fmublock`'s functions
    only, so that they run on floats and on CasADi symbols alike.
    """

    default_experiment: ClassVar[DefaultExperiment] = DefaultExperiment()

    internal_step = Parameter(
        5e-5,
        unit="s",
        minimum=1e-9,
        name="solver.internal_step",
        description="Longest internal integration step (classical Runge-Kutta)",
    )

    def derivatives(self, v: Values) -> dict[str, Any]:
        """Time derivatives of the continuous states, per s."""
        return {}

    def update(self, v: Values) -> dict[str, Any]:
        """Next values of the discrete states, evaluated at the end of a communication step."""
        return {}

    def outputs(self, v: Values) -> dict[str, Any]:
        """Values of the declared `Output` variables (states are outputs by themselves)."""
        return {}

    @classmethod
    def layout(cls) -> Layout:
        """All variables of the block in the order of their value references."""
        return _layout(cls)


@cache
def _layout(block: type[Block]) -> Layout:
    declared: dict[str, Variable] = {}
    for base in (*reversed(block.__mro__[:-2]), Block):  # the solver's settings come last
        declared.update({k: x for k, x in vars(base).items() if isinstance(x, Variable)})

    def group(kind: type[Variable]) -> tuple[Variable, ...]:
        return tuple(x for x in declared.values() if isinstance(x, kind))

    states = group(State)
    parameters = tuple(p for p in group(Parameter) if states or p.attribute != "internal_step")
    groups = (group(Input), parameters, states, group(DiscreteState), group(Output))
    scalars = tuple(s for variables in groups for variable in variables for s in variable.scalars())
    names = [s.name for s in scalars]
    if twice := {n for n in names if names.count(n) > 1}:
        raise TypeError(f"{block.__name__} declares these names twice: {', '.join(sorted(twice))}")
    return Layout(*groups, scalars)
