"""Directional derivatives of a block's equations, from CasADi's automatic differentiation."""

import casadi

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
