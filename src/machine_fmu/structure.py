"""The order in which lengths of struts and closed loops determine the coordinates of joints."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Step:
    """Equations that together determine as many coordinates, once those of earlier steps are known."""

    equations: tuple[int, ...]
    unknowns: tuple[int, ...]


class StructureError(ValueError):
    """Equations do not determine the unknowns.

    Attributes:
        equations: Equations that are too many, or empty.
        unknowns: Unknowns that no equation is left for, or empty.
    """

    def __init__(self, equations: Sequence[int], unknowns: Sequence[int]) -> None:
        super().__init__(f"equations {list(equations)} are too many; {list(unknowns)} are not determined")
        self.equations, self.unknowns = tuple(equations), tuple(unknowns)


def order_steps(equations: Sequence[Collection[int]], unknowns: Collection[int]) -> list[Step]:
    """Return the smallest steps that determine the unknowns, in an order in which each follows its inputs.

    Each equation gets an unknown of its own (a matching). The strongly connected components of the graph
    equation -> equation that determines one of its unknowns are the steps.

    Args:
        equations: The unknowns in each equation.
        unknowns: All of them.

    Raises:
        StructureError: Equations and unknowns do not match.
    """
    owner = _match(equations)
    free = [u for u in sorted(unknowns) if u not in owner]
    extra = [e for e in range(len(equations)) if e not in owner.values()]
    if free or extra:
        raise StructureError(extra, free)
    unknown_of = {e: u for u, e in owner.items()}
    groups = _components([sorted({owner[u] for u in unknowns_of}) for unknowns_of in equations])
    return [Step(tuple(group), tuple(unknown_of[e] for e in group)) for group in groups]


def _match(equations: Sequence[Collection[int]]) -> dict[int, int]:
    """Return an equation for each unknown, for as many of both as possible (augmenting paths)."""
    owner = dict[int, int]()

    def assign(equation: int, tried: set[int]) -> bool:
        for unknown in sorted(equations[equation]):
            if unknown in tried:
                continue
            tried.add(unknown)
            if unknown not in owner or assign(owner[unknown], tried):
                owner[unknown] = equation
                return True
        return False

    for equation in range(len(equations)):
        assign(equation, set())
    return owner


def _components(successors: Sequence[Sequence[int]]) -> list[list[int]]:
    """Return the strongly connected components of a graph; each follows those it leads to (Tarjan)."""
    index, low = dict[int, int](), dict[int, int]()
    stack, components = list[int](), list[list[int]]()

    def visit(node: int) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in successors[node]:
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            first = stack.index(node)
            components.append(sorted(stack[first:]))
            del stack[first:]

    for node in range(len(successors)):
        if node not in index:
            visit(node)
    return components
