"""Two masses between walls, coupled by a spring: a public benchmark of co-simulation, in closed form.

The left mass gets place and speed of the right one and gives the force of the spring between them, at once;
the right one gets that force.

Equations and values: González and others, Co-simulation benchmarks: Linear oscillator, Laboratorio de
Ingeniería Mecánica, Universidade da Coruña, https://github.com/fgonzalezLIM/cosim-benchmarks (MIT). Case 0
has no damping, case 1 has some.
"""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import expm

from emla_cosim import System
from fmublock import Block, Input, Output, Parameter, State
from tests.support.built_systems import built

MASSES, SPRINGS, COUPLING = (1.0, 1.0), (10.0, 1000.0), 100.0
"""kg, N/m, N/m."""

SPEEDS = (100.0, -100.0)
"""m/s at the start; both masses begin where all springs are loose."""

STOP = 10.0
"""s."""


class Left(Block):
    """The left mass, its spring to the wall, and the spring between the masses."""

    x_c = Input(unit="m", description="Place of the other mass")
    v_c = Input(unit="m/s", description="Speed of the other mass")
    m = Parameter(MASSES[0], unit="kg")
    k = Parameter(SPRINGS[0], unit="N/m", description="Spring to the wall")
    k_c = Parameter(COUPLING, unit="N/m", description="Spring between the masses")
    c = Parameter(0.0, unit="N.s/m", description="Damping of both springs")
    x = State(0.0, unit="m", description="Place")
    v = State(SPEEDS[0], unit="m/s", description="Speed")
    f = Output(unit="N", description="Force on the other mass")

    def derivatives(self, v: Any) -> dict[str, Any]:
        force = v.k_c * (v.x - v.x_c) + v.c * (v.v - v.v_c)
        return {"x": v.v, "v": (-v.k * v.x - v.c * v.v - force) / v.m}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"f": v.k_c * (v.x - v.x_c) + v.c * (v.v - v.v_c)}


class Right(Block):
    """The right mass and its spring to the wall."""

    f = Input(unit="N", description="Force of the other mass")
    m = Parameter(MASSES[1], unit="kg")
    k = Parameter(SPRINGS[1], unit="N/m", description="Spring to the wall")
    c = Parameter(0.0, unit="N.s/m", description="Damping of the spring")
    x = State(0.0, unit="m", description="Place")
    v = State(SPEEDS[1], unit="m/s", description="Speed")

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": v.v, "v": (v.f - v.k * v.x - v.c * v.v) / v.m}


def system(folder: Path) -> System:
    """Return the oscillator as a system of two FMUs, which are built in this folder."""
    return built(
        folder,
        {"oscillator.left": Left, "oscillator.right": Right},
        [
            "oscillator.left.f -> oscillator.right.f",
            "oscillator.right.x -> oscillator.left.x_c",
            "oscillator.right.v -> oscillator.left.v_c",
        ],
    )


def solution(times: np.ndarray, damping: float = 0.0) -> np.ndarray:
    """Return places in m and speeds in m/s of both masses, a row for each of equally spaced times in s."""
    (m_1, m_2), (k_1, k_2), k, c = MASSES, SPRINGS, COUPLING, damping
    A = np.array([
        [0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 1.0],
        [-(k_1 + k) / m_1, k / m_1, -2.0 * c / m_1, c / m_1],
        [k / m_2, -(k_2 + k) / m_2, c / m_2, -2.0 * c / m_2],
    ])  # fmt: skip
    return np.array([expm(A * t) @ [0.0, 0.0, *SPEEDS] for t in times])


def energy(states: np.ndarray) -> np.ndarray:
    """Return the energy in J of rows of places and speeds."""
    x, v = states[:, :2], states[:, 2:]
    springs = x**2 @ SPRINGS + COUPLING * (x[:, 0] - x[:, 1]) ** 2
    return 0.5 * (v**2 @ MASSES + springs)
