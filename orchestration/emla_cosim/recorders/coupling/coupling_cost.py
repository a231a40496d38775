"""Collect the coupling errors of bonds and connections, and remarks on them."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...master.algorithms.algorithm import Algorithm
from ...master.algorithms.continuous_connections import ContinuousConnection, loop_responses
from ..recorder import Outline
from .bond_energy import BondEnergies, BondEnergy
from .remarks import remarks
from .residual import Residual, Residuals
from .window import EveryStep, Window

COUPLING = "coupling"
"""Name of the part of metrics.json with the coupling errors."""

_BLOCK, _BATCH = 256, 2000
"""Number of single rows that are collected to a block, and number of steps that are summed up at once."""


class Coupling:
    """Compute the coupling errors from rows, time in s first."""

    def __init__(self, outline: Outline, memory: Any = None) -> None:
        """Begin, or continue from a `memory`; CommandError for bonds that do not exist."""
        self._watched, self._halved, self._seen = outline.watched, outline.halved, list[Vector]()
        self._bonds = [BondEnergy(name, bond, outline) for name, bond in outline.bonds.items()]
        self._exchanged = bool(outline.exchanged)
        self._residuals = Residuals(outline.exchanged)
        self._bonded = {name for bond in self._bonds for name in bond.connections}
        self._judged = _connections_to_judge(outline.exchanged, self._bonded)
        self._responses: Mapping[int, Vector] = {}
        self._algorithm: Algorithm | None = None
        needed = sorted({0, *self._residuals.columns})
        self._needed = {column: place for place, column in enumerate(needed)}
        self._window = Window(np.array(needed, dtype=np.intp), None if memory is None else memory["window"])
        # the energy that noise creates and destroys cancels only over all steps
        self._energies = BondEnergies(self._bonds)
        remembered = None if memory is None else memory["bond_window"]
        self._bond_window = EveryStep(np.array(self._energies.columns, dtype=np.intp), remembered)
        if memory is not None:
            self._remember(memory)

    def write(self, rows: Vector) -> None:
        """Take the next rows, unless `see` gets each step."""
        if not self._watched:
            self._write(rows)

    def see(self, row: Vector) -> None:
        """Take the row of one step of variable length."""
        self._seen.append(row)
        if len(self._seen) == _BLOCK:
            self._write_seen()

    def _complete(self) -> None:
        """Sum up the waiting steps, and update the responses of the loops."""
        self._write_seen()
        self._take()
        if self._algorithm is not None and self._exchanged:
            self._responses = loop_responses(self._algorithm)

    def _write_seen(self) -> None:
        rows, self._seen = np.array(self._seen), []
        if len(rows):
            self._write(rows[np.diff(rows[:, 0], prepend=self._window.time) > 0.0])

    def _write(self, rows: Vector) -> None:
        if not (self._exchanged or self._bonds) or not len(rows):
            return
        self._window.show(rows)
        if self._bonds:
            self._bond_window.show(rows)
        if max(self._window.waiting, self._bond_window.waiting) >= _BATCH:
            self._take()

    def _take(self) -> None:
        """Sum up the waiting steps."""
        with np.errstate(all="ignore"):
            if self._bond_window.waiting:
                steps = self._bond_window.take()
                self._energies.take(steps.halved() if self._halved else steps)
            if not self._window.waiting:
                return
            lately = self._window.take()
            if self._watched:
                lately = [steps.halved() for steps in lately]
            if self._exchanged:
                self._residuals.take(lately, self._needed)

    def learn(self, algorithm: Algorithm) -> None:
        """Use the loop responses of this algorithm, which does the steps."""
        self._algorithm = algorithm

    def figures(self) -> dict[str, dict[str, float]]:
        """Return the figures of all rows so far: energies by bond, residuals by connection."""
        self._complete()
        with np.errstate(all="ignore"):
            residuals = self._residuals.figures(self._responses)
        found = {name: _figures(residual) for name, residual in residuals.items()}
        return found | {bond.name: bond.figures(self._responses) for bond in self._bonds}

    def remarks(self) -> list[str]:
        """Return remarks for users to read before the figures; see `remarks`."""
        self._complete()
        with np.errstate(all="ignore"):
            energies = {f"{bond.name} ({bond.bond})": bond.figures(self._responses) for bond in self._bonds}
            residuals = self._residuals.figures(self._responses)
        free = [x.name for x in self._judged if x.name not in self._bonded]
        return remarks(energies, residuals, [x.name for x in self._judged], free)

    def memory(self) -> dict[str, Any]:
        """Return the state as plain data, from which another object can continue."""
        self._complete()
        return {
            "window": self._window.memory(),
            "bond_window": self._bond_window.memory(),
            "bonds": {bond.name: bond.memory() for bond in self._bonds},
            "residuals": self._residuals.memory(),
        }

    def _remember(self, memory: Any) -> None:
        for bond in self._bonds:
            bond.remember(memory["bonds"][bond.name])
        self._residuals.remember(memory["residuals"])


def _connections_to_judge(
    connections: Sequence[ContinuousConnection], bonded: Collection[str]
) -> list[ContinuousConnection]:
    """Return the connections in loops, without those that run parallel to a bond."""
    pairs = {frozenset((x.source, x.target)) for x in connections if x.name in bonded}
    return [
        x
        for x in connections
        if x.is_in_loop and (x.name in bonded or frozenset((x.source, x.target)) not in pairs)
    ]


def _figures(residual: Residual) -> dict[str, float]:
    return {"residual": residual.relative, "accumulated_residual": residual.accumulated}
