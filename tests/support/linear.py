"""Linear slaves that integrate without error, and the same systems solved as one equation."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag, expm

from emla_cosim.master.network import Link, Network
from tests.support.slaves import FakeSlave

Wire = tuple[int, int, int, int]
"""Source, output, target, input: positions as in `Link`."""


class LinearSlave(FakeSlave):
    """x' = A x + B u, y = C x + D u with u on a straight line during a step, integrated exactly.

    After a step y is that of its end. `steps` counts calls of `do_step`.
    """

    interpolates = True

    def __init__(
        self, name: str, A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike, x: ArrayLike
    ) -> None:
        self.x_0, self.D = np.array(x, dtype=float), np.atleast_2d(np.array(D, dtype=float))
        (outputs, inputs), n = self.D.shape, len(self.x_0)
        self.A = np.array(A, dtype=float).reshape(n, n)
        self.B = np.array(B, dtype=float).reshape(n, inputs)
        self.C = np.array(C, dtype=float).reshape(outputs, n)
        super().__init__(name, inputs, self.x_0, self._advance_exactly, lambda u, x: self.C @ x + self.D @ u)
        self.slopes = np.zeros(inputs)
        self.steps = 0
        self._responses: dict[float, np.ndarray] = {}

    def response(self, step: float) -> np.ndarray:
        """What (x, u, u') at the beginning of a step makes of x at its end."""
        if step not in self._responses:
            n, m = self.B.shape
            joint = np.zeros((n + 2 * m, n + 2 * m))
            joint[:n, :n], joint[:n, n : n + m], joint[n : n + m, n + m :] = self.A, self.B, np.eye(m)
            self._responses[step] = expm(joint * step)[:n]
        return self._responses[step]

    def _advance_exactly(self, u: np.ndarray, x: np.ndarray, time: float, step: float) -> np.ndarray:
        new_state = self.response(step) @ np.concatenate([x, u, self.slopes])
        self.held += step * self.slopes
        self.steps += 1
        return new_state

    def set_inputs(self) -> None:
        super().set_inputs()
        self.slopes[:] = 0.0

    def set_input_derivatives(self, derivatives: np.ndarray) -> None:
        self.slopes[:] = derivatives

    def save(self, state: Any = None) -> Any:
        return *super().save(), self.slopes.copy()

    def restore(self, state: Any) -> None:
        *rest, self.slopes[:] = state
        super().restore(rest)


def connected(slaves: Sequence[LinearSlave], wires: Sequence[Wire]) -> Network:
    """The slaves wired together; an input is direct where a connected output shows it at once."""
    used = [sorted({w[1] for w in wires if w[0] == i}) for i in range(len(slaves))]
    feedthrough = [tuple(k for k in used[target] if slaves[target].D[k, i]) for _, _, target, i in wires]
    links = [Link(*wire, bool(k), bool(k), through=k) for wire, k in zip(wires, feedthrough, strict=True)]
    return Network(slaves, links)


class Whole:
    """The same slaves and wires as one equation x' = M x, y = N x."""

    def __init__(self, slaves: Sequence[LinearSlave], wires: Sequence[Wire]) -> None:
        self.slaves = slaves
        first_input = np.cumsum([0, *(s.B.shape[1] for s in slaves)])
        first_output = np.cumsum([0, *(len(s.C) for s in slaves)])
        self.L = np.zeros((first_input[-1], first_output[-1]))
        for source, output, target, i in wires:
            self.L[first_input[target] + i, first_output[source] + output] = 1.0
        self.A, self.B, self.C, self.D = (block_diag(*(getattr(s, m) for s in slaves)) for m in "ABCD")
        self.x_0 = np.concatenate([s.x_0 for s in slaves])
        self.N = np.linalg.solve(np.eye(len(self.C)) - self.D @ self.L, self.C)
        self.M = self.A + self.B @ self.L @ self.N

    def outputs(self, time: float) -> np.ndarray:
        """All outputs at a time in s, in closed form."""
        return self.N @ expm(self.M * time) @ self.x_0
