"""The graph of the operations in a block's equations, each stored once."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

import casadi

CONST, INPUT = casadi.OP_CONST, casadi.OP_INPUT
CHOICE = casadi.OP_IF_ELSE_ZERO
"""The second argument if the first is true, else zero."""


class Rank(IntEnum):
    """What a value depends on, and so how often it is computed."""

    FIXED = 0
    """Parameters only: once per run."""
    STEPWISE = 1
    """Inputs and discrete states: once per step, unless inputs change within it."""
    MOVING = 2
    """Time and continuous states: at every evaluation."""


class GraphOperation(NamedTuple):
    """A function of earlier values, which are given by number.

    An input's operands are the argument and the position in it. A constant has its `value`.
    """

    code: int
    operands: tuple[int, ...]
    value: float = 0.0


@dataclass
class Graph:
    """Operations in an order in which each follows its operands; equal ones are stored once.

    `ranks` has the rank of each operation. Nothing is rearranged, so that all values keep their bits.
    """

    leaf_ranks: Sequence[Sequence[Rank]]
    """The rank of each element of each argument."""
    operations: list[GraphOperation] = field(default_factory=list)
    ranks: list[Rank] = field(default_factory=list)
    _numbers: dict[tuple, int] = field(default_factory=dict, repr=False)

    def results(
        self, function: casadi.Function, replacements: Mapping[tuple[int, int], int] | None = None
    ) -> list[int]:
        """Add the operations of a function.

        Args:
            function: A function of the arguments that `leaf_ranks` describes.
            replacements: Numbers of the values that replace elements of arguments, by argument and position.

        Returns:
            The numbers of the function's results.
        """
        results = [0] * function.nnz_out(0)
        work: dict[int, int] = {}
        for k in range(function.n_instructions()):
            code, operands = function.instruction_id(k), function.instruction_input(k)
            target = function.instruction_output(k)
            if code == casadi.OP_OUTPUT:
                results[target[1]] = work[operands[0]]
            elif code == CONST:
                work[target[0]] = self._add_constant(function.instruction_constant(k))
            elif code == INPUT:
                element = operands[0], operands[1]
                replacement = None if replacements is None else replacements.get(element)
                work[target[0]] = (
                    self._add_operation(GraphOperation(code, element)) if replacement is None else replacement
                )
            else:
                work[target[0]] = self._add_operation(self._expand(code, [work[i] for i in operands]))
        zero = self._add_constant(0.0)
        dense = [zero] * function.numel_out(0)  # structural zeros are not results of an operation
        for position, number in zip(function.sparsity_out(0).find(), results, strict=True):
            dense[position] = number
        return dense

    def _expand(self, code: int, operands: Sequence[int]) -> GraphOperation:
        """Replace CasADi's abbreviations by the operations that give the same bits."""
        if code == casadi.OP_SQ:
            return GraphOperation(casadi.OP_MUL, (operands[0], operands[0]))
        if code == casadi.OP_TWICE:
            return GraphOperation(casadi.OP_MUL, (self._add_constant(2.0), operands[0]))
        if code == casadi.OP_INV:
            return GraphOperation(casadi.OP_DIV, (self._add_constant(1.0), operands[0]))
        return GraphOperation(code, tuple(operands))

    def _add_constant(self, value: float) -> int:
        return self._add_operation(GraphOperation(CONST, (), value))

    def _add_operation(self, operation: GraphOperation) -> int:
        key = (operation.code, operation.operands, operation.value.hex())  # tells 0.0 from -0.0
        if key not in self._numbers:
            self._numbers[key] = len(self.operations)
            self.operations.append(operation)
            self.ranks.append(self._find_rank(operation))
        return self._numbers[key]

    def _find_rank(self, operation: GraphOperation) -> Rank:
        if operation.code == CONST:
            return Rank.FIXED
        if operation.code == INPUT:
            argument, position = operation.operands
            return self.leaf_ranks[argument][position]
        return max(self.ranks[i] for i in operation.operands)

    def is_leaf(self, number: int) -> bool:
        """Return whether a value is a constant or an argument's element, which is not computed."""
        return self.operations[number].code in (CONST, INPUT)

    def list_needed(self, results: Sequence[int], available: Mapping[int, object]) -> list[int]:
        """Return the operations that these results need, in order, when the known values are available."""
        needed_numbers, waiting = set[int](), [r for r in results if r not in available]
        while waiting:
            number = waiting.pop()
            if number in needed_numbers or self.is_leaf(number):
                continue
            needed_numbers.add(number)
            waiting += [i for i in self.operations[number].operands if i not in available]
        return sorted(needed_numbers)

    def find_frontier(self, results: Sequence[int], rank: Rank, available: Mapping[int, object]) -> list[int]:
        """Return the computed values of this rank that results or operations of higher rank use directly."""
        used = set(results)
        for number in self.list_needed(results, available):
            if self.ranks[number] > rank:
                used |= set(self.operations[number].operands)
        numbers = (i for i in used if self.ranks[i] == rank and not self.is_leaf(i) and i not in available)
        return sorted(numbers)


def conditions(graph: Graph, results: Sequence[int], numbers: Sequence[int]) -> dict[int, frozenset[int]]:
    """Return for each of these operations the conditions without which no result needs it, by number.

    A choice needs its second operand only if the first one, its condition, holds.
    """
    members = set(numbers)
    conditions_of = dict.fromkeys(results, frozenset[int]())
    for number in reversed(numbers):
        code, operands = graph.operations[number].code, graph.operations[number].operands
        for k, operand in enumerate(operands):
            use = (
                conditions_of[number] | {operands[0]} if code == CHOICE and k == 1 else conditions_of[number]
            )
            if operand in members:
                conditions_of[operand] = conditions_of[operand] & use if operand in conditions_of else use
    return conditions_of
