"""Systems of two to five FMUs with the equations of the whole, to compare coupling errors with the truth."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import emla_cosim as ec
from fmublock import Block, DiscreteState, Input, Output, Parameter, State, sin

Rates = Callable[[float, np.ndarray], Sequence[float] | np.ndarray]


class Mass(Block):
    """A mass on a spring and a damper to the wall, under two forces."""

    f_1 = Input(unit="N", description="Force")
    f_2 = Input(unit="N", description="Force against it")
    k = Parameter(10.0, unit="N/m", description="Stiffness")
    d = Parameter(0.0, unit="N.s/m", description="Damping")
    x_0 = Parameter(0.0, unit="m", description="Position at the start")
    x = State(x_0, unit="m", description="Position")
    v = State(0.0, unit="m/s", description="Speed")

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": v.v, "v": v.f_1 - v.f_2 - v.k * v.x - v.d * v.v}


class Spring(Block):
    """A spring of 100 N/m between two masses."""

    x_1 = Input(unit="m", description="Position of its begin")
    x_2 = Input(unit="m", description="Position of its end")
    f = Output(unit="N", description="Force")

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"f": 100.0 * (v.x_1 - v.x_2)}


class Motor(Block):
    """The winding of a motor: 1 Ohm, 10 mH, 0.1 V s."""

    u = Input(unit="V", description="Voltage")
    w = Input(unit="rad/s", description="Speed")
    i = State(0.0, unit="A", description="Current")
    tau = Output(unit="N.m", description="Torque")

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"i": (v.u - v.i - 0.1 * v.w) / 0.01}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"tau": 0.1 * v.i}


class Rotor(Block):
    """A rotor of 1e-3 kg m2 with friction."""

    tau = Input(unit="N.m", description="Torque")
    w = State(0.0, unit="rad/s", description="Speed")

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"w": (v.tau - 1e-3 * v.w) / 1e-3}


class Controller(Block):
    """A PI controller in continuous time with the set point 10 rad/s."""

    w = Input(unit="rad/s", description="Speed")
    z = State(0.0, unit="rad", description="Integral of the error")
    u = Output(unit="V", description="Voltage")

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"z": 10.0 - v.w}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"u": 0.5 * (10.0 - v.w) + 5.0 * v.z}


class DigitalController(Block):
    """A PI controller that samples, with the set point 10 rad/s."""

    w = Input(unit="rad/s", description="Speed")
    z = DiscreteState(0.0, unit="rad", description="Sum of the errors")
    u = Output(unit="V", description="Voltage")

    def update(self, v: Any) -> dict[str, Any]:
        return {"z": v.z + 10.0 - v.w}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"u": 0.5 * (10.0 - v.w) + 0.05 * v.z}


class Heat(Block):
    """A heat capacity that gets two flows."""

    q_1 = Input(unit="W", description="Heat flow")
    q_2 = Input(unit="W", description="Heat flow")
    C = Parameter(1.0, unit="J/K", description="Heat capacity")
    T_0 = Parameter(0.0, unit="K", description="Temperature at the start")
    T = State(T_0, unit="K", description="Temperature")

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"T": (v.q_1 + v.q_2) / v.C}


class Wall(Block):
    """A wall that conducts 1 W/K."""

    T_1 = Input(unit="K", description="Temperature of one side")
    T_2 = Input(unit="K", description="Temperature of the other side")
    q_1 = Output(unit="W", description="Heat flow to the first side")
    q_2 = Output(unit="W", description="Heat flow to the second side")

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"q_1": v.T_2 - v.T_1, "q_2": v.T_1 - v.T_2}


class Driven(Block):
    """A mass of 1 kg on a spring under a force of its own, and that of a load."""

    F = Input(unit="N", description="Force of the load")
    x = State(0.1, unit="m", description="Position")
    v = State(0.0, unit="m/s", description="Speed")
    a = Output(unit="m/s2", description="Acceleration")

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": v.v, "v": v.F - 100.0 * v.x - 2.0 * v.v + 50.0 * sin(3.0 * v.time)}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"a": v.F - 100.0 * v.x - 2.0 * v.v + 50.0 * sin(3.0 * v.time)}


class Load(Block):
    """A rigid load with drag and a lagging force."""

    a = Input(unit="m/s2", description="Acceleration")
    v = Input(unit="m/s", description="Speed")
    m = Parameter(300.0, unit="kg", description="Mass")
    z = State(0.0, unit="N", description="Lagging force")
    F = Output(unit="N", description="Force")

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"z": 40.0 * (30.0 * v.v - v.z)}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"F": -v.m * v.a - 5.0 * v.v - v.z}


@dataclass(frozen=True)
class CoupledSystem:
    """A system, and the equations of the whole: its states are those of the components, by full name."""

    components: Mapping[str, type[Block]]
    wires: Sequence[str]
    rates: Rates
    starts: Mapping[str, float]
    stop: float
    values: Mapping[str, float] = field(default_factory=dict)

    @property
    def system(self) -> ec.System:
        """The system of FMUs."""
        return ec.System.of(self.components, self.wires, set=dict(self.values))

    def error(self, result: ec.Result) -> float:
        """Return the largest error of the states of a result, relative to their ranges."""
        times = np.asarray(result.time)
        exact = solve_ivp(
            self.rates, (0.0, times[-1]), list(self.starts.values()), "DOP853", times, rtol=1e-10, atol=1e-12
        ).y
        pairs = zip(self.starts, exact, strict=True)
        return max(float(np.abs(result[n] - x).max() / np.ptp(x)) for n, x in pairs if n in result.names)


def chain(count: int, damping: float, stiffness: float = 0.0) -> CoupledSystem:
    """Return masses in a row with springs between them; the first one begins out of rest.

    Args:
        count: Number of masses.
        damping: Damping of each mass to the wall, in N s/m.
        stiffness: Stiffness of the spring to the wall in N/m, but for the first mass, which has 10 N/m.
    """
    walls, damped = np.full(count, stiffness), np.full(count, damping)
    walls[0] = 10.0
    components: dict[str, type[Block]] = {"m0": Mass}
    wires, values = list[str](), {"m0.x_0": 1.0, **{f"m{i}.d": damping for i in range(count)}}
    values |= {f"m{i}.k": float(walls[i]) for i in range(count)}
    for i in range(1, count):
        components |= {f"s{i}": Spring, f"m{i}": Mass}
        wires += [f"m{i - 1}.x -> s{i}.x_1", f"m{i}.x -> s{i}.x_2"]
        wires += [f"s{i}.f -> m{i - 1}.f_2", f"s{i}.f -> m{i}.f_1"]

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        x, v = y[:count], y[count:]
        force = np.concatenate([[0.0], 100.0 * (x[:-1] - x[1:]), [0.0]])
        return np.concatenate([v, force[:-1] - force[1:] - walls * x - damped * v])

    starts = {f"m{i}.x": float(i == 0) for i in range(count)} | {f"m{i}.v": 0.0 for i in range(count)}
    return CoupledSystem(components, wires, rates, starts, 10.0, values)


def _drive(t: float, y: np.ndarray) -> list[float]:
    i, w, z = y
    return [(0.5 * (10.0 - w) + 5.0 * z - i - 0.1 * w) / 0.01, (0.1 * i - 1e-3 * w) / 1e-3, 10.0 - w]


DRIVE_WIRES = [
    "rotor.w -> controller.w",
    "controller.u -> motor.u",
    "rotor.w -> motor.w",
    "motor.tau -> rotor.tau",
]


def drive() -> CoupledSystem:
    """Return a motor that a controller in continuous time keeps at a speed."""
    parts = {"controller": Controller, "motor": Motor, "rotor": Rotor}
    starts = {"motor.i": 0.0, "rotor.w": 0.0, "controller.z": 0.0}
    return CoupledSystem(parts, DRIVE_WIRES, _drive, starts, 5.0)


def heat() -> CoupledSystem:
    """Return three heat capacities in a row, with walls between them; the first one begins hot."""
    parts: dict[str, type[Block]] = {"a": Heat, "ab": Wall, "b": Heat, "bc": Wall, "c": Heat}
    wires = ["a.T -> ab.T_1", "b.T -> ab.T_2", "ab.q_1 -> a.q_1", "ab.q_2 -> b.q_1"]
    wires += ["b.T -> bc.T_1", "c.T -> bc.T_2", "bc.q_1 -> b.q_2", "bc.q_2 -> c.q_1"]

    def rates(t: float, y: np.ndarray) -> list[float]:
        return [y[1] - y[0], y[0] - 2.0 * y[1] + y[2], (y[1] - y[2]) / 5.0]

    starts = {"a.T": 100.0, "b.T": 0.0, "c.T": 0.0}
    return CoupledSystem(parts, wires, rates, starts, 20.0, {"a.T_0": 100.0, "c.C": 5.0})


def rigid_load(ratio: float) -> CoupledSystem:
    """Return a mass with a load that is fixed to it and has so many times its mass."""

    def rates(t: float, y: np.ndarray) -> list[float]:
        x, v, z = y
        force = 50.0 * np.sin(3.0 * t) - 100.0 * x - 7.0 * v - z
        return [v, force / (1.0 + ratio), 40.0 * (30.0 * v - z)]

    parts = {"mass": Driven, "load": Load}
    wires = ["mass.a -> load.a", "mass.v -> load.v", "load.F -> mass.F"]
    return CoupledSystem(
        parts, wires, rates, {"mass.x": 0.1, "mass.v": 0.0, "load.z": 0.0}, 5.0, {"load.m": ratio}
    )


@cache
def systems() -> Mapping[str, CoupledSystem]:
    """Return the systems by name."""
    return {
        "undamped pair": chain(2, 0.0, 1000.0),
        "lightly damped pair": chain(2, 0.3, 1000.0),
        "damped pair": chain(2, 5.0, 1000.0),
        "chain of three": chain(3, 0.1),
        "drive": drive(),
        "heat": heat(),
        "rigid load": rigid_load(300.0),
        "heavy load": rigid_load(3000.0),
    }
