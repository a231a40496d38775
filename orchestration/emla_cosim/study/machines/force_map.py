"""Forces that hold a machine at rest, and how far its tip moves per stroke, over strokes of its actuators."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import Vector
from ..roles import find_values

if TYPE_CHECKING:
    from machine_fmu.model import MachineModel

_SIDES, _FEWER_SIDES = 41, 21
"""Strokes along each side of a map, and where Newton's method finds poses."""

_STEP = 1e-6
"""Change of a stroke in m for how far the tip moves."""

_DIGITS = 6
"""Decimals of levers that this change gives."""


@dataclass(frozen=True)
class ForceLimits:
    """Forces of an actuator in N: continuously, and at the most; None if unknown."""

    continuous: float | None = None
    largest: float | None = None


@dataclass(frozen=True)
class Extreme:
    """The range of an actuator's holding force over the box of strokes.

    Attributes:
        lowest: Lowest force in N.
        highest: Highest force in N.
        strokes: Strokes in m at which its size is largest.
    """

    lowest: float
    highest: float
    strokes: Vector

    @property
    def largest(self) -> float:
        """The largest size of the force in N."""
        return max(abs(self.lowest), abs(self.highest))


@dataclass(frozen=True)
class Map:
    """Values of an actuator over one or two strokes, with the others as at the start.

    Attributes:
        axes: Numbers of the actuators whose strokes vary.
        strokes: Strokes in m along each axis.
        forces: Holding forces in N, with an axis for each of these.
        levers: Motion of the tip in m per m of the actuator's stroke, likewise.
    """

    axes: tuple[int, ...]
    strokes: tuple[Vector, ...]
    forces: Vector
    levers: Vector


def read_limits(joint: str, values: Mapping[str, float], roles: Mapping[str, str]) -> ForceLimits:
    """Return the limits of the force of a joint's actuator at rest, from its motor and its controller.

    Args:
        joint: The joint.
        values: Values of parameters by full name.
        roles: Names by JOINT.ROLE.
    """
    N_p, Phi_PM, rho, lead, eta, *currents = find_values(
        joint, values, roles, "N_p", "Phi_PM", "rho", "lead", "eta_GB", "i_N", "i_limit"
    )
    force_per_current = 1.5 * N_p * Phi_PM * eta * 2.0 * math.pi / (rho * lead)
    forces = [current * force_per_current for current in currents]
    return ForceLimits(*(force if force > 0.0 else None for force in forces))


def find_extremes(machine: "MachineModel", strokes: Vector) -> list[Extreme]:
    """Return the range of each actuator's holding force, with the payload of the description.

    Args:
        machine: The machine.
        strokes: Strokes in m on a grid, as those of a `Workspace`; poses that do not close are left out.
    """
    rows = strokes.reshape(-1, strokes.shape[-1])
    forces = machine.holding_forces(rows)
    rows, forces = (x[np.isfinite(forces).all(axis=1)] for x in (rows, forces))
    largest = np.abs(forces).argmax(axis=0)
    return [
        Extreme(float(force.min()), float(force.max()), rows[row])
        for force, row in zip(forces.T, largest, strict=True)
    ]


def find_maps(machine: "MachineModel", strokes: Vector) -> list[Map]:
    """Return a map for each actuator, over the two strokes that change its force the most.

    Args:
        machine: The machine.
        strokes: Strokes in m on a grid, from which these two are chosen.
    """
    # about four strokes of each actuator are enough to see which two matter
    coarse = strokes[tuple(slice(None, None, max(1, n // 4)) for n in strokes.shape[:-1])]
    forces = machine.holding_forces(coarse.reshape(-1, coarse.shape[-1])).reshape(coarse.shape)
    count = coarse.shape[-1]
    changes = [
        np.nan_to_num(np.ptp(forces, axis=axis)).mean(axis=tuple(range(count - 1))) for axis in range(count)
    ]
    # a picture has two axes
    largest_first = np.argsort(changes, axis=0)[::-1][:2]
    return [_compute_map(machine, i, sorted(map(int, largest_first[:, i]))) for i in range(count)]


def find_levers(machine: "MachineModel", strokes: Vector, actuator: int) -> Vector:
    """Return how far the tip moves in m per m of an actuator's stroke, for each row of strokes in m."""
    step = np.zeros(strokes.shape[1])
    step[actuator] = _STEP
    ends = [machine.tip(q) for q in (strokes + step, strokes - step)]
    levers = np.linalg.norm(ends[0] - ends[1], axis=1) / (2.0 * _STEP)
    return np.round(levers, _DIGITS)  # contours of a constant would follow its rounding errors


def _compute_map(machine: "MachineModel", actuator: int, axes: Sequence[int]) -> Map:
    """Return forces and levers of an actuator over the strokes of these actuators."""
    # Newton's method takes much longer than a formula
    count = _FEWER_SIDES if machine.closure.iterated else _SIDES
    sides = [np.linspace(machine.q_LB[i], machine.q_UB[i], count) for i in axes]
    grid = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1)
    rows = np.tile(machine.start, (grid[..., 0].size, 1))
    rows[:, list(axes)] = grid.reshape(-1, len(axes))
    forces = machine.holding_forces(rows)[:, actuator].reshape(grid.shape[:-1])
    levers = find_levers(machine, rows, actuator).reshape(grid.shape[:-1])
    return Map(tuple(axes), tuple(sides), forces, levers)
