"""Convert a block's equations to CasADi functions, for C code, dependencies and derivatives."""

import math
from dataclasses import dataclass
from typing import Any

import casadi

from .block import Block, Values
from .errors import BuildError
from .faults import equation_fault, result_line
from .results import METHODS, Conditions, Results
from .symbol import RefusedError, Symbol, refuse_sum

_COMPARISONS = {
    casadi.OP_LT,
    casadi.OP_LE,
    casadi.OP_EQ,
    casadi.OP_NE,
    casadi.OP_NOT,
    casadi.OP_AND,
    casadi.OP_OR,
}


def tangent(function: casadi.Function) -> casadi.Function:
    """Return the directional derivative of function(time, values) as a function.

    Its arguments are (time, values, direction of time, direction of values). It gives one derivative per
    result. At a kink this lies between the derivatives of both sides.
    """
    point = casadi.SX.sym("time"), casadi.SX.sym("values", function.size1_in(1))
    direction = casadi.SX.sym("d_time"), casadi.SX.sym("d_values", function.size1_in(1))
    derivative = casadi.jtimes(function(*point), casadi.vertcat(*point), casadi.vertcat(*direction))
    name = f"{function.name()}_tangent"
    arguments = [*point, *direction]
    return casadi.Function(
        name, arguments, [_replace_products(casadi.Function(name, arguments, [derivative]))]
    )


def _replace_products(function: casadi.Function) -> casadi.SX:
    """Replace every product `comparison * x` in the function's result by a choice.

    The derivatives of minimum and maximum are such products. If the side not taken has no finite
    derivative (the square root at zero), 0 * inf would make the result NaN.
    """
    arguments = function.sx_in()
    result = casadi.SX(function.sparsity_out(0))
    work: dict[int, casadi.SX] = {}
    gates: set[int] = set()  # places in `work` that are zero if a comparison does not hold
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        inputs, outputs = function.instruction_input(k), function.instruction_output(k)
        if operation == casadi.OP_OUTPUT:
            result.nz[outputs[1]] = work[inputs[0]]
            continue
        position = outputs[0]
        is_gate = operation in _COMPARISONS or (operation == casadi.OP_DIV and inputs[0] in gates)
        if operation == casadi.OP_INPUT:
            value = arguments[inputs[0]].nz[inputs[1]]
        elif operation == casadi.OP_CONST:
            value = casadi.SX(function.instruction_constant(k))
        elif len(inputs) == 1:
            value = casadi.SX.unary(operation, work[inputs[0]])
        else:
            a, b = (work[i] for i in inputs)
            value = casadi.SX.binary(operation, a, b)
            for gate in [i for i in inputs if operation == casadi.OP_MUL and i in gates]:
                value = casadi.SX.binary(casadi.OP_IF_ELSE_ZERO, work[gate], value)
        work[position] = value
        gates.discard(position)
        if is_gate:
            gates.add(position)
    return result


_METHODS = (*METHODS, "conditions")


@dataclass(frozen=True)
class SymbolicBlock:
    """The functions of a block, each (time, values) -> vector.

    `values` holds all scalars in the order of their value references, so that generated code
    can work on an instance's memory directly. `references` are the value references of the
    results: those of the states for `derivatives`, and so on. `conditions` gives 0 for each condition
    that does not hold; `demands` has their messages.
    """

    derivatives: casadi.Function
    update: casadi.Function
    outputs: casadi.Function
    conditions: casadi.Function
    demands: tuple[str, ...]

    def functions(self) -> tuple[casadi.Function, ...]:
        """Return the functions of a step in its order, tangents of the continuous ones, and conditions."""
        tangents = tangent(self.derivatives), tangent(self.outputs)
        conditions = (self.conditions,) if self.demands else ()
        return self.derivatives, self.update, self.outputs, *tangents, *conditions


def evaluate_symbolically(block: Block) -> SymbolicBlock:
    """Run the block's equations on symbols.

    CasADi's simplifications are off: x + 0 or x / 3 stay as written, so that C code and Python give the
    same bits.

    Raises:
        BuildError: The equations fail, would give other results on floats, or differ when called again
            (random numbers, or values stored between calls). The message names block, method and line.
    """
    simplify = casadi.GlobalOptions.getSimplificationOnTheFly()
    casadi.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        with refuse_sum():
            # twice: a second call shows random numbers, and values stored in the first
            first_pass, second_pass = ([_convert_method(block, m) for m in _METHODS] for _ in range(2))
    finally:
        casadi.GlobalOptions.setSimplificationOnTheFly(simplify)
    functions = [function for function, _ in first_pass]
    for method, function, (repeated, _) in zip(_METHODS, functions, second_pass, strict=True):
        # a symbol stored in the first call is free in the second
        if repeated.has_free() or function.serialize() != repeated.serialize():
            raise BuildError(
                f"{type(block).__name__}.{method} gives different equations in a second call; "
                "declare what evolves as a state, and draw random numbers with fmublock.noise."
            )
    derivatives, update, outputs, conditions = functions
    _, demands = first_pass[-1]
    return SymbolicBlock(derivatives, update, outputs, conditions, tuple(demands))


class _SymbolicValues(Values):
    """A block's values as symbols, which equations cannot change."""

    def __setattr__(self, attribute: str, value: Any) -> None:
        raise RefusedError("changes a value of the block; declare what evolves as a state")


def _convert_method(block: Block, method: str) -> tuple[casadi.Function, list[str]]:
    """Convert a method of the block to a function of time and all values; return it and its attributes."""
    name, layout = f"{type(block).__name__}.{method}", block.layout()
    time = casadi.SX.sym("time")
    symbols = [casadi.SX.sym(scalar.name) for scalar in layout.scalars]
    v = _SymbolicValues()
    v.__dict__["time"] = Symbol(time)
    for variable in (*layout.inputs, *layout.parameters, *layout.states, *layout.discrete_states):
        variable_symbols = [Symbol(symbols[r]) for r in layout.references((variable,))]
        v.__dict__[variable.attribute] = variable.nested(variable_symbols)
    values_before, results = (
        repr(vars(v)),
        Conditions(block) if method == "conditions" else Results(block, method),
    )
    try:
        values = results.flat(getattr(block, method)(v))
    except Exception as error:
        raise equation_fault(block, method, error) from error
    if repr(vars(v)) != values_before:
        raise BuildError(f"{name} changes a value of the block; declare what evolves as a state.")
    for attribute, value in zip(results.attributes, values, strict=True):
        if isinstance(value, float) and math.isnan(value):
            line = result_line(block, method, attribute)
            raise BuildError(f"{name}: {attribute}{line} is the constant NaN.")
    expressions = [x.sx if isinstance(x, Symbol) else casadi.SX(x) for x in values]
    arguments = [time, casadi.vertcat(*symbols)]
    vector = casadi.vertcat(*expressions)
    # a free symbol is one of an earlier call, which the caller reports with the method
    function = casadi.Function(method, arguments, [vector], {"allow_free": True})
    return function, results.attributes


def find_dependencies(block: Block, symbolic: SymbolicBlock, time: int | None = None) -> dict[int, list[int]]:
    """Return the value references that each `Output` and each state's derivative depends on directly.

    The keys are the value references of outputs and states. `time` is that of the time; without one, a
    dependency on time is left out.
    """
    layout = block.layout()
    first_derivative = len(layout.scalars)
    derivatives = range(first_derivative, first_derivative + len(layout.derivatives))
    references_of: dict[int, list[int]] = {}
    for function, references in (
        (symbolic.outputs, layout.references(layout.outputs)),
        (symbolic.derivatives, derivatives),
    ):
        references_of |= {r: [] for r in references}
        rows, columns = function.jac_sparsity(0, 1).get_triplet()
        for row, column in zip(rows, columns, strict=True):
            references_of[references[row]].append(column)
        if time is not None:
            for row in function.jac_sparsity(0, 0).get_triplet()[0]:
                references_of[references[row]].append(time)
    return {r: sorted(d) for r, d in references_of.items()}
