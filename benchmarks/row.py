"""A system of any number of FMUs of one model: masses in a ring, each between two others on springs."""

from typing import Any

from emla_cosim.system.model import Component, Connection, System
from fmublock import Block, Input, Output, Parameter, State


class RowMass(Block):
    """A mass on springs to the masses before and behind it."""

    x_before = Input(0.0, unit="m", description="Position of the mass before")
    x_behind = Input(0.0, unit="m", description="Position of the mass behind")
    m = Parameter(1.0, unit="kg", minimum=0.01, description="Mass")
    k = Parameter(100.0, unit="N/m", minimum=0.0, description="Stiffness of each spring")
    x_0 = Parameter(0.0, unit="m", name="start.x", description="Position at the start")
    x = State(x_0, unit="m", description="Position, out of rest")
    v = State(0.0, unit="m/s", description="Speed")
    F = Output(unit="N", description="Force of both springs")

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Newton's law."""
        return {"x": v.v, "v": self.force(v) / v.m}

    def outputs(self, v: Any) -> dict[str, Any]:
        """The force."""
        return {"F": self.force(v)}

    @staticmethod
    def force(v: Any) -> Any:
        """The force of both springs in N."""
        return v.k * (v.x_before + v.x_behind - 2.0 * v.x)


def ring(count: int) -> System:
    """So many masses; the first one begins out of rest, and each weighs a little more than the one before."""
    names = [f"row.mass_{i}" for i in range(count)]
    components = [Component(n, RowMass, {"m": 1.0 + 1e-3 * i}) for i, n in enumerate(names)]
    components[0] = Component(names[0], RowMass, {"m": 1.0, "start.x": 0.1})
    behind = [*names[1:], names[0]]
    forward = (Connection(a, "x", b, "x_before") for a, b in zip(names, behind, strict=True))
    back = (Connection(b, "x", a, "x_behind") for a, b in zip(names, behind, strict=True))
    return System(tuple(components), (*forward, *back))
