"""A crane on a hydraulic cylinder: a public benchmark of co-simulation, as two blocks and as one equation.

A rod hangs on a joint and is lifted by a cylinder; a second, massless rod with a load hangs on its end. The
mechanics get the force of the cylinder and give its length and speed; the hydraulics answer at once,
because the piston has viscous friction. The valve moves at 2 s and at 6 s, within milliseconds.

Equations and values: González and others, Co-simulation benchmarks: 2-d.o.f. hydraulic manipulator,
Laboratorio de Ingeniería Mecánica, Universidade da Coruña, https://github.com/fgonzalezLIM/cosim-benchmarks
(MIT). The mass matrix there counts a third of all masses; here the points have all of theirs, as statics
and the published curves ask.
"""

import math
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from emla_cosim import System
from fmublock import Block, Input, Output, Parameter, State, cos, sin, sqrt, where
from tests.support.built_systems import built

L, L_H, M, M_P, M_H, GRAVITY = 1.0, 0.5, 200.0, 250.0, 100.0, 9.81
AREA, STROKE, FRICTION, DISCHARGE, DENSITY = 65e-4, 0.442, 1e5, 0.67, 850.0
PUMP, TANK, VALVE = 7.6e6, 0.1e6, 5e-4
BULK_A, BULK_B = 6.53e-10, -1.19e-18
"""1/Pa and 1/Pa^2."""

THETA_1, THETA_2 = math.pi / 6.0, -math.pi / 2.0
ROOT_3 = math.sqrt(3.0)
S_0 = L * math.sqrt(1.0 - 0.5 * ROOT_3 * math.cos(THETA_1))
STOP = 10.0
"""s."""


def length(theta: Any) -> Any:
    """Return the length of the cylinder in m."""
    return L * sqrt(1.0 - 0.5 * ROOT_3 * cos(theta))


def lever(theta: Any) -> Any:
    """Return the derivative of the cylinder's length by the angle of the rod, in m."""
    return 0.25 * ROOT_3 * L * L * sin(theta) / length(theta)


def accelerations(theta: Any, omega: Any, force: Any) -> tuple[Any, Any]:
    """Return the accelerations of both rods in rad/s2, from angles, rates, and the cylinder's force in N."""
    couple = L * L_H * M_H
    a, b, c = L * L * (M / 3.0 + M_P + M_H), couple * cos(theta[0] - theta[1]), L_H * L_H * M_H
    coriolis = couple * sin(theta[0] - theta[1])
    weight = -L * GRAVITY * (0.5 * M + M_P + M_H) * cos(theta[0])
    first = weight + lever(theta[0]) * force - coriolis * omega[1] * omega[1]
    second = -M_H * L_H * GRAVITY * cos(theta[1]) + coriolis * omega[0] * omega[0]
    det = a * c - b * b
    return (c * first - b * second) / det, (a * second - b * first) / det


def flow(drop: Any) -> Any:
    """Return the speed in m/s of oil under a drop of pressure in Pa, 0 where it is negative."""
    return DISCHARGE * sqrt(2.0 * where(drop > 0.0, drop, 0.0) / DENSITY)


def bulk(pressure: Any) -> Any:
    """Return the bulk modulus in Pa at a pressure in Pa."""
    return (1.0 + BULK_A * pressure + BULK_B * pressure * pressure) / (BULK_A + 2.0 * BULK_B * pressure)


def pressure_rates(p_1: Any, p_2: Any, s: Any, speed: Any, kappa: Any) -> tuple[Any, Any]:
    """Return how fast both pressures rise in Pa/s, from pressures, length, speed and valve."""
    opened, closed = VALVE * kappa, VALVE * (1.0 - kappa)
    gain = AREA * speed + opened * flow(PUMP - p_1) - closed * flow(p_1 - TANK)
    loss = -AREA * speed + closed * flow(PUMP - p_2) - opened * flow(p_2 - TANK)
    return (
        bulk(p_1) / (AREA * (0.5 * STROKE + S_0 - s)) * gain,
        bulk(p_2) / (AREA * (0.5 * STROKE + s - S_0)) * loss,
    )


CORNERS = (2.0, 2.001, 6.0, 6.002)
"""Times in s at which the valve begins or ends to move."""


def valve(kappa_0: Any, time: Any) -> Any:
    """Return how far the valve is open: less from 2 s on, and more from 6 s on."""
    first = where(time < 2.0, 0.0, where(time < 2.001, (time - 2.0) / 0.001, 1.0))
    second = where(time < 6.0, 0.0, where(time < 6.002, (time - 6.0) / 0.002, 1.0))
    return kappa_0 - 0.01 * first + 0.03 * second


@cache
def equilibrium() -> tuple[float, float, float]:
    """Return the pressures in Pa and the valve's position at which the crane rests."""
    force = L * GRAVITY * (0.5 * M + M_P + M_H) * math.cos(THETA_1) / lever(THETA_1)

    def unbalanced(z: Any) -> list[float]:
        p_1, p_2, kappa = 1e6 * float(z[0]), 1e6 * float(z[1]), float(z[2])
        rates = pressure_rates(p_1, p_2, S_0, 0.0, kappa)
        return [1e-4 * ((p_2 - p_1) * AREA - force), 1e-9 * rates[0], 1e-9 * rates[1]]

    p_1, p_2, kappa = root(unbalanced, [3.0, 4.5, 0.45], tol=1e-13).x.tolist()
    return 1e6 * p_1, 1e6 * p_2, kappa


class Mechanics(Block):
    """Two rods and their masses, lifted by a cylinder."""

    f = Input(unit="N", description="Force of the cylinder")
    theta = State((THETA_1, THETA_2), shape=2, unit="rad", description="Angles of the rods")
    omega = State((0.0, 0.0), shape=2, unit="rad/s", description="Rates of the rods")
    s = Output(unit="m", description="Length of the cylinder")
    v = Output(unit="m/s", description="Speed of the cylinder")

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"theta": v.omega, "omega": list(accelerations(v.theta, v.omega, v.f))}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"s": length(v.theta[0]), "v": lever(v.theta[0]) * v.omega[0]}


class Hydraulics(Block):
    """A cylinder of two chambers behind a valve that is moved as time says."""

    s = Input(S_0, unit="m", description="Length of the cylinder")
    v = Input(unit="m/s", description="Speed of the cylinder")
    kappa_0 = Parameter(equilibrium()[2], description="Valve at rest")
    p = State(equilibrium()[:2], shape=2, unit="Pa", description="Pressures in the chambers")
    f = Output(unit="N", description="Force of the cylinder")

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"p": list(pressure_rates(v.p[0], v.p[1], v.s, v.v, valve(v.kappa_0, v.time)))}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"f": (v.p[1] - v.p[0]) * AREA - FRICTION * v.v}


def system(folder: Path) -> System:
    """Return the crane as a system of two FMUs, which are built in this folder."""
    return built(
        folder,
        {"crane.mechanics": Mechanics, "crane.hydraulics": Hydraulics},
        [
            "crane.mechanics.s -> crane.hydraulics.s",
            "crane.mechanics.v -> crane.hydraulics.v",
            "crane.hydraulics.f -> crane.mechanics.f",
        ],
    )


@cache
def solution(stop: float = STOP, interval: float = 0.01) -> np.ndarray:
    """Return the crane as one equation: rows of time, length, speed and both pressures, all in SI units.

    SciPy's LSODA to 1e-11; it begins anew where the valve begins and ends to move.
    """
    p_1, p_2, kappa_0 = equilibrium()

    def rates(t: float, state: np.ndarray) -> list[float]:
        z = state.tolist()
        s, speed = length(z[0]), lever(z[0]) * z[2]
        force = (z[5] - z[4]) * AREA - FRICTION * speed
        turned = accelerations(z[:2], z[2:4], force)
        return [*z[2:4], *turned, *pressure_rates(z[4], z[5], s, speed, valve(kappa_0, t))]

    times = np.arange(round(stop / interval) + 1) * interval
    corners = [0.0, *(c for c in CORNERS if c < stop), stop]
    state, rows = np.array([THETA_1, THETA_2, 0.0, 0.0, p_1, p_2]), []
    for begin, end in pairwise(corners):
        inside = times[(times > begin - 1e-9) & (times < end - 1e-9)].clip(begin)
        at, tolerances = [*inside, end], [1e-13] * 4 + [1e-5] * 2
        run = solve_ivp(rates, (begin, end), state, "LSODA", t_eval=at, rtol=1e-11, atol=tolerances)
        rows.append(run.y[:, :-1])
        state = run.y[:, -1]
    z = np.hstack([*rows, state[:, None]])
    cylinder = [(length(x), lever(x) * w) for x, w in zip(z[0].tolist(), z[2].tolist(), strict=True)]
    return np.column_stack([times, cylinder, z[4], z[5]])
