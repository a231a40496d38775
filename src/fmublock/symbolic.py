"""A block's equations as CasADi functions: for C code, and for what depends on what."""

from dataclasses import dataclass
from typing import Any

import casadi

from .block import Block, Values
from .instance import flatten
from .tangents import tangent


@dataclass(frozen=True)
class SymbolicBlock:
    """The three functions of a block, each (time, values) -> vector.

    `values` holds all scalars in the order of their value references, so that generated code
    can work on an instance's memory directly. `references` are the value references of the
    results: those of the states for `derivatives`, and so on.
    """

    derivatives: casadi.Function
    update: casadi.Function
    outputs: casadi.Function

    def functions(self) -> tuple[casadi.Function, ...]:
        """All three, in the order in which a step uses them, and the tangents of the continuous ones."""
        tangents = tangent(self.derivatives), tangent(self.outputs)
        return self.derivatives, self.update, self.outputs, *tangents


def evaluate_symbolically(block: Block) -> SymbolicBlock:
    """Run the block's equations once on symbols.

    CasADi's simplifications are switched off meanwhile: x + 0 or x / 3 stay as the block writes
    them, so that C code and Python give the same bits.
    """
    simplify = casadi.GlobalOptions.getSimplificationOnTheFly()
    casadi.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        return _evaluate(block)
    finally:
        casadi.GlobalOptions.setSimplificationOnTheFly(simplify)


def _evaluate(block: Block) -> SymbolicBlock:
    layout = block.layout()
    time = casadi.SX.sym("time")
    symbols = [casadi.SX.sym(scalar.name) for scalar in layout.scalars]
    v: Any = Values()
    v.time = time
    for variables in (layout.inputs, layout.parameters, layout.states, layout.discrete_states):
        for variable in variables:
            own = [x for x, s in zip(symbols, layout.scalars, strict=True) if s.variable is variable]
            setattr(v, variable.attribute, own[0] if variable.size is None else own)

    def function(name: str, variables: tuple[Any, ...], results: dict[str, Any]) -> casadi.Function:
        declared = {variable.attribute for variable in variables}
        if unknown := set(results) - declared:
            raise TypeError(
                f"{type(block).__name__}.{name} returns {', '.join(sorted(unknown))}, not declared as such"
            )
        if missing := declared - set(results):
            raise TypeError(f"{type(block).__name__}.{name} gives no value for {', '.join(sorted(missing))}")
        expressions = [casadi.SX(x) for x in flatten(variables, results)]
        return casadi.Function(name, [time, casadi.vertcat(*symbols)], [casadi.vertcat(*expressions)])

    return SymbolicBlock(
        derivatives=function("derivatives", layout.states, block.derivatives(v)),
        update=function("update", layout.discrete_states, block.update(v)),
        outputs=function("outputs", layout.outputs, block.outputs(v)),
    )


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
