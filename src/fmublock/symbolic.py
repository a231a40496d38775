"""A block's equations as CasADi functions: for C code, and for what depends on what."""

import math
from dataclasses import dataclass
from typing import Any

import casadi

from .block import Block, Values
from .errors import BuildError
from .faults import equation_fault, result_line
from .results import METHODS, Conditions, Results
from .symbol import RefusedError, Symbol, refusing_sum
from .tangents import tangent

_METHODS = (*METHODS, "conditions")


@dataclass(frozen=True)
class SymbolicBlock:
    """The functions of a block, each (time, values) -> vector.

    `values` holds all scalars in the order of their value references, so that generated code
    can work on an instance's memory directly. `references` are the value references of the
    results: those of the states for `derivatives`, and so on. `conditions` gives 0 for each of the
    sentences in `demands` that does not hold.
    """

    derivatives: casadi.Function
    update: casadi.Function
    outputs: casadi.Function
    conditions: casadi.Function
    demands: tuple[str, ...]

    def functions(self) -> tuple[casadi.Function, ...]:
        """Those of a step in its order, the tangents of the continuous ones, and any conditions."""
        tangents = tangent(self.derivatives), tangent(self.outputs)
        conditions = (self.conditions,) if self.demands else ()
        return self.derivatives, self.update, self.outputs, *tangents, *conditions


def evaluate_symbolically(block: Block) -> SymbolicBlock:
    """Run the block's equations on symbols.

    CasADi's simplifications are switched off meanwhile: x + 0 or x / 3 stay as the block writes
    them, so that C code and Python give the same bits.

    Raises BuildError, naming block, method and line, for equations that fail, that would mean
    something else on floats, or that are other equations when asked again (random numbers, or
    something kept between calls).
    """
    simplify = casadi.GlobalOptions.getSimplificationOnTheFly()
    casadi.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        with refusing_sum():
            found, again = ([_function(block, m) for m in _METHODS] for _ in range(2))
    finally:
        casadi.GlobalOptions.setSimplificationOnTheFly(simplify)
    functions = [function for function, _ in found]
    for method, function, (other, _) in zip(_METHODS, functions, again, strict=True):
        # a symbol kept from the first time is free in the second
        if other.has_free() or function.serialize() != other.serialize():
            raise BuildError(
                f"{type(block).__name__}.{method} gives other equations when asked again; "
                "what evolves must be a declared state, and randomness come from fmublock.noise."
            )
    derivatives, update, outputs, conditions = functions
    _, demands = found[-1]
    return SymbolicBlock(derivatives, update, outputs, conditions, tuple(demands))


class _SymbolicValues(Values):
    """A block's values as symbols, which equations cannot change."""

    def __setattr__(self, attribute: str, value: Any) -> None:
        raise RefusedError("changes a value of the block; what evolves must be a declared state")


def _function(block: Block, method: str) -> tuple[casadi.Function, list[str]]:
    """One method of the block as a function of time and all values, and what its results belong to."""
    name, layout = f"{type(block).__name__}.{method}", block.layout()
    time = casadi.SX.sym("time")
    symbols = [casadi.SX.sym(scalar.name) for scalar in layout.scalars]
    v = _SymbolicValues()
    v.__dict__["time"] = Symbol(time)
    for variable in (*layout.inputs, *layout.parameters, *layout.states, *layout.discrete_states):
        own = [Symbol(symbols[r]) for r in layout.references((variable,))]
        v.__dict__[variable.attribute] = variable.nested(own)
    given, results = repr(vars(v)), Conditions(block) if method == "conditions" else Results(block, method)
    try:
        values = results.flat(getattr(block, method)(v))
    except Exception as error:
        raise equation_fault(block, method, error) from error
    if repr(vars(v)) != given:
        raise BuildError(f"{name} changes a value of the block; what evolves must be a declared state.")
    for attribute, value in zip(results.attributes, values, strict=True):
        if isinstance(value, float) and math.isnan(value):
            line = result_line(block, method, attribute)
            raise BuildError(f"{name}: {attribute}{line} is the constant NaN.")
    expressions = [x.sx if isinstance(x, Symbol) else casadi.SX(x) for x in values]
    arguments = [time, casadi.vertcat(*symbols)]
    vector = casadi.vertcat(*expressions)
    function = casadi.Function(method, arguments, [vector], {"allow_free": True})
    return function, results.attributes


def find_dependencies(block: Block, symbolic: SymbolicBlock) -> dict[int, list[int]]:
    """Value references that each `Output` and each state's derivative depends on directly.

    The keys are value references, too.
    """
    layout = block.layout()
    first_derivative = len(layout.scalars)
    derivatives = range(first_derivative, first_derivative + len(layout.derivatives))
    found: dict[int, list[int]] = {}
    for function, references in (
        (symbolic.outputs, layout.references(layout.outputs)),
        (symbolic.derivatives, derivatives),
    ):
        found |= {r: [] for r in references}
        rows, columns = function.jac_sparsity(0, 1).get_triplet()
        for row, column in zip(rows, columns, strict=True):
            found[references[row]].append(column)
    return {r: sorted(d) for r, d in found.items()}
