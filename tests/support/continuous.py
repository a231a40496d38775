"""Blocks as right-hand sides of one differential equation, without steps, samples or FMUs."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from emla_cosim.study.joint import start_values
from fmublock import Block


class Continuous:
    """A block's equations at any values; states as one vector, in the layout's order."""

    def __init__(self, block: type[Block], *sources: Any) -> None:
        self.block, self.parts = block(), block.layout()
        given = start_values(block, *sources)
        self.v: Any = SimpleNamespace(time=0.0)
        p = self.parts
        for x in (*p.inputs, *p.parameters, *p.states, *p.discrete_states):
            elements = [float(given.get(s.name, s.start)) for s in x.scalars()]
            setattr(self.v, x.attribute, x.nested(elements))

    def start(self) -> list[float]:
        return [e for x in self.parts.states for e in x.flat(getattr(self.v, x.attribute))]

    def outputs(self, t: float, states: Any, inputs: Mapping[str, float]) -> dict[str, float]:
        """Outputs by attribute; the inputs stay for `rates`."""
        self.v.time, rest = t, [float(e) for e in states]
        for x in self.parts.states:
            count = len(x.scalars())
            setattr(self.v, x.attribute, x.nested(rest[:count]))
            rest = rest[count:]
        for name, value in inputs.items():
            setattr(self.v, name, value)
        return self.block.outputs(self.v)

    def rates(self) -> Any:
        found = self.block.derivatives(self.v)
        return np.array([e for x in self.parts.states for e in x.flat(found[x.attribute])])
