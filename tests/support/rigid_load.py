"""A block that is a mass on a spring and a load that answers an acceleration, for a pair of one FMU."""

from typing import Any

import emla_cosim as ec
from fmublock import Block, Input, Output, Parameter, State


class Half(Block):
    """A mass on a spring and a damper under a force, and another one that is moved: half of each is used."""

    F = Input(unit="N", description="Force on the mass on the spring")
    a_load = Input(unit="m/s2", description="Acceleration of the other mass")
    m = Parameter(1.0, unit="kg", description="Mass on the spring")
    m_load = Parameter(1000.0, unit="kg", description="The other mass")
    k = Parameter(400.0, unit="N/m", description="Stiffness")
    d = Parameter(2.0, unit="N.s/m", description="Damping")
    x = State(0.1, unit="m", description="Position")
    v = State(0.0, unit="m/s", description="Speed")
    a = Output(unit="m/s2", description="Acceleration")
    F_load = Output(unit="N", description="Force that the other mass answers with")

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": v.v, "v": (v.F - v.k * v.x - v.d * v.v) / v.m}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"a": (v.F - v.k * v.x - v.d * v.v) / v.m, "F_load": -v.m_load * v.a_load}


def rigid_load() -> ec.System:
    """A mass of 1 kg on a spring with one of 1000 kg that is fixed to it."""
    return ec.System.of({"mass": Half, "load": Half}, ["mass.a -> load.a_load", "load.F_load -> mass.F"])
