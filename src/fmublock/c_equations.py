"""Generate C from a block's equations, in which each value is computed once and only when needed."""

from collections.abc import Iterator, Mapping, Sequence
from heapq import heappop, heappush

import casadi

from .block import Block
from .compiling import c_number
from .errors import BuildError
from .graph import CHOICE, CONST, INPUT, Graph, Rank, conditions
from .symbolic import SymbolicBlock

_TEXTS = {
    casadi.OP_ASSIGN: "{0}",
    casadi.OP_ADD: "{0} + {1}",
    casadi.OP_SUB: "{0} - {1}",
    casadi.OP_MUL: "{0} * {1}",
    casadi.OP_DIV: "{0} / {1}",
    casadi.OP_NEG: "-{0}",
    casadi.OP_POW: "pow({0}, {1})",
    casadi.OP_CONSTPOW: "pow({0}, {1})",
    casadi.OP_SQRT: "sqrt({0})",
    casadi.OP_SIN: "sin({0})",
    casadi.OP_COS: "cos({0})",
    casadi.OP_TAN: "tan({0})",
    casadi.OP_ASIN: "asin({0})",
    casadi.OP_ACOS: "acos({0})",
    casadi.OP_ATAN: "atan({0})",
    casadi.OP_ATAN2: "atan2({0}, {1})",
    casadi.OP_SINH: "sinh({0})",
    casadi.OP_COSH: "cosh({0})",
    casadi.OP_TANH: "tanh({0})",
    casadi.OP_EXP: "exp({0})",
    casadi.OP_LOG: "log({0})",
    casadi.OP_FLOOR: "floor({0})",
    casadi.OP_CEIL: "ceil({0})",
    casadi.OP_FMOD: "fmod({0}, {1})",
    casadi.OP_FABS: "fabs({0})",
    casadi.OP_SIGN: "sign({0})",
    casadi.OP_COPYSIGN: "copysign({0}, {1})",
    casadi.OP_FMIN: "minimum({0}, {1})",
    casadi.OP_FMAX: "maximum({0}, {1})",
    casadi.OP_LT: "{0} < {1}",
    casadi.OP_LE: "{0} <= {1}",
    casadi.OP_EQ: "{0} == {1}",
    casadi.OP_NE: "{0} != {1}",
    casadi.OP_NOT: "!{0}",
    casadi.OP_AND: "{0} && {1}",
    casadi.OP_OR: "{0} || {1}",
    CHOICE: "{0} != 0.0 ? {1} : 0.0",
}
"""C expression of each operation; comparisons give 0 or 1."""

_EXPENSIVE = {
    getattr(casadi, f"OP_{name}")
    for name in (
        *("DIV", "FMOD", "SQRT", "POW", "CONSTPOW", "EXP", "LOG", "SINH", "COSH", "TANH"),
        *("SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN", "ATAN2"),
    )
}
_BRANCH = 12
"""Least number of operations that is worth a branch; an expensive operation counts as many."""

HELPERS = {
    "minimum": "static inline double minimum(double x, double y) { return x <= y || y != y ? x : y; }",
    "maximum": "static inline double maximum(double x, double y) { return x >= y || y != y ? x : y; }",
    "sign": "static inline double sign(double x) { return x < 0.0 ? -1.0 : x > 0.0 ? 1.0 : x; }",
}
"""C functions that equations call, by name. They give the same bits as the functions in functions.py."""


def c_equations(block: Block, symbolic: SymbolicBlock) -> "CEquations":
    """Return the equations as readable C functions.

    `fixed_values` computes what depends on parameters only, `stepwise_values` what is constant while inputs
    and discrete states are. `derivatives` uses both, the other functions use the fixed values.
    `update_and_outputs` ends a step: its outputs belong to the new discrete states.

    Raises:
        BuildError: An operation does not exist in C.
    """
    layout = block.layout()
    moving = {*layout.references(layout.states)}
    stepwise = {*layout.references(layout.inputs), *layout.references(layout.discrete_states)}
    values = [
        Rank.MOVING if r in moving else Rank.STEPWISE if r in stepwise else Rank.FIXED
        for r in range(len(layout.scalars))
    ]
    return CEquations(symbolic, values, layout.references(layout.discrete_states))


class CEquations:
    """The equations of a block in C.

    Attributes:
        n_fixed: number of values that depend on parameters only.
        n_stepwise: number of values that are constant while inputs and discrete states are.
        functions: text of each function by name.

    Raises:
        BuildError: An operation does not exist in C.
    """

    def __init__(self, symbolic: SymbolicBlock, values: Sequence[Rank], discrete: Sequence[int]) -> None:
        self._graph = Graph([[Rank.MOVING], values, [Rank.MOVING], [Rank.MOVING] * len(values)])
        results = {f.name(): self._graph.results(f) for f in symbolic.functions()}
        # outputs belong to the end of a step: they see the new discrete states
        updated = {(1, r): number for r, number in zip(discrete, results["update"], strict=True)}
        outputs = self._graph.results(symbolic.outputs, updated)
        results["update_and_outputs"] = [*results.pop("update"), *outputs]
        result_numbers = [r for numbers in results.values() for r in numbers]
        fixed = {
            n: f"fixed[{i}]" for i, n in enumerate(self._graph.find_frontier(result_numbers, Rank.FIXED, {}))
        }
        moving = self._graph.find_frontier(results["derivatives"], Rank.STEPWISE, fixed)
        stepwise = {n: f"stepwise[{i}]" for i, n in enumerate(moving)}
        self.n_fixed, self.n_stepwise = len(fixed), len(stepwise)
        self.functions = {
            "fixed_values": self._format_function(
                "fixed_values(const double *v, double *fixed)",
                [(target, number) for number, target in fixed.items()],
                {},
            ),
            "stepwise_values": self._format_function(
                "stepwise_values(const double *v, const double *fixed, double *stepwise)",
                [(target, number) for number, target in stepwise.items()],
                fixed,
            ),
        }
        for name, numbers in results.items():
            expressions = fixed | stepwise if name == "derivatives" else fixed
            self.functions[name] = self._format_result_function(name, numbers, expressions, len(discrete))

    def _format_result_function(
        self, name: str, results: Sequence[int], expressions: Mapping[int, str], discrete: int
    ) -> str:
        """Return the C function of a block's method, which gives results."""
        further_arguments, targets = "", [f"result[{i}]" for i in range(len(results))]
        if name == "derivatives":
            further_arguments = ", const double *stepwise"
        elif name.endswith("_tangent"):
            further_arguments = ", double d_time, const double *d"
        elif name == "update_and_outputs":
            further_arguments = ", double *next"
            targets = [*(f"next[{i}]" for i in range(discrete)), *targets[: len(results) - discrete]]
        arguments = f"double time, const double *v, const double *fixed{further_arguments}, double *result"
        return self._format_function(
            f"{name}({arguments})", list(zip(targets, results, strict=True)), expressions
        )

    def text(self) -> str:
        """Return all functions, and how many values they share."""
        lines = [
            f"#define N_FIXED {self.n_fixed}",
            f"#define N_STEPWISE {self.n_stepwise}",
            "",
            "/* These give the same bits as the functions in fmublock/functions.py. */",
            *HELPERS.values(),
            "",
            *self.functions.values(),
        ]
        return "\n".join(lines)

    def _format_function(
        self, signature: str, targets: Sequence[tuple[str, int]], expressions: Mapping[int, str]
    ) -> str:
        """Return the C function that computes these values from the known ones."""
        target_numbers = [number for _, number in targets]
        numbers = self._graph.list_needed(target_numbers, expressions)
        arguments = [word.split("*")[-1].split(" ")[-1] for word in signature[:-1].split("(")[1].split(", ")]
        lines = [
            f"static void {signature} {{",
            f"    {', '.join(f'(void){a}' for a in arguments)};",
            *self._format_blocks(numbers, self._find_scopes(target_numbers, numbers), expressions),
            *(f"    {target} = {self._format_operand(number, expressions)};" for target, number in targets),
            "}",
            "",
        ]
        return "\n".join(lines)

    def _find_scopes(
        self, target_numbers: Sequence[int], numbers: Sequence[int]
    ) -> dict[int, tuple[int, ...]]:
        """Return the conditions under which each operation is computed, if they are worth a branch."""
        conditions_of = conditions(self._graph, target_numbers, numbers)
        saved = dict.fromkeys((c for scope in conditions_of.values() for c in scope), 0)
        for number in numbers:
            for condition in conditions_of[number]:
                saved[condition] += _BRANCH if self._graph.operations[number].code in _EXPENSIVE else 1
        return {n: tuple(sorted(c for c in conditions_of[n] if saved[c] >= _BRANCH)) for n in numbers}

    def _format_blocks(
        self, numbers: Sequence[int], scopes: Mapping[int, tuple[int, ...]], expressions: Mapping[int, str]
    ) -> Iterator[str]:
        """Return all operations; those under the same conditions share a branch if their order allows it."""
        blocks = list(self._group_by_scope(numbers, scopes))
        block_of = {number: k for k, (_, block) in enumerate(blocks) for number in block}
        # declared before the braces, because other blocks read them
        shared = {
            i
            for n in numbers
            for i in (*self._graph.operations[n].operands, *scopes[n])
            if block_of.get(i, block_of[n]) != block_of[n]
        }
        for scope, block in blocks:
            if not scope:
                yield from (
                    f"    const double a{n} = {self._format_expression(n, expressions)};" for n in block
                )
                continue
            yield from (f"    double a{n} = 0.0;" for n in block if n in shared)
            condition = " && ".join(f"{self._format_operand(c, expressions)} != 0.0" for c in scope)
            yield f"    if ({condition}) {{"
            for n in block:
                declaration = "" if n in shared else "const double "
                yield f"        {declaration}a{n} = {self._format_expression(n, expressions)};"
            yield "    }"

    def _group_by_scope(
        self, numbers: Sequence[int], scopes: Mapping[int, tuple[int, ...]]
    ) -> Iterator[tuple[tuple[int, ...], list[int]]]:
        """Return groups of operations under the same conditions, each as large as possible."""
        remaining, missing_operands, followers = set(numbers), dict[int, int](), dict[int, list[int]]()
        for number in numbers:
            predecessors = {*self._graph.operations[number].operands, *scopes[number]} & remaining
            missing_operands[number] = len(predecessors)
            for i in predecessors:
                followers.setdefault(i, []).append(number)
        ready: dict[tuple[int, ...], list[int]] = {}
        for number in (n for n in numbers if not missing_operands[n]):
            heappush(ready.setdefault(scopes[number], []), number)
        while ready:
            # unconditional operations first: more operations of a branch are ready then
            scope = () if () in ready else min(ready, key=lambda s: ready[s][0])
            block = []
            while ready.get(scope):
                block.append(heappop(ready[scope]))
                for follower in followers.get(block[-1], ()):
                    missing_operands[follower] -= 1
                    if not missing_operands[follower]:
                        heappush(ready.setdefault(scopes[follower], []), follower)
            del ready[scope]
            yield scope, block

    def _format_expression(self, number: int, expressions: Mapping[int, str]) -> str:
        operation = self._graph.operations[number]
        text = _TEXTS.get(operation.code)
        if text is None:
            raise BuildError(f"the operation {operation.code} of CasADi has no meaning in C.")
        return text.format(*(self._format_operand(i, expressions) for i in operation.operands))

    def _format_operand(self, number: int, expressions: Mapping[int, str]) -> str:
        operation = self._graph.operations[number]
        if operation.code == CONST:
            # in parentheses: a minus before -1.0 would be the operator `--`
            text = c_number(operation.value)
            return f"({text})" if text.startswith("-") else text
        if operation.code == INPUT:
            argument, position = operation.operands
            return ("time", f"v[{position}]", "d_time", f"d[{position}]")[argument]
        return expressions.get(number, f"a{number}")
