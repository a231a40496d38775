"""A block whose vectors and matrices start in every way there is."""

from typing import Any

from fmublock import Block, DiscreteState, Output, Parameter, State, matvec


class Arm(Block):
    """Reads a matrix and a vector that does not change."""

    q_0 = Parameter([0.1, 0.2, 0.3], shape=3)
    level = Parameter(2.0)
    M = Parameter([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], shape=(2, 3))
    same = Parameter(7.0, shape=(2, 1))
    q = State(q_0, shape=3)
    w = DiscreteState(level, shape=2)
    y = Output(shape=2)

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"q": [0.0, 0.0, 0.0]}

    def update(self, v: Any) -> dict[str, Any]:
        return {"w": v.w}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"y": matvec(v.M, v.q)}
