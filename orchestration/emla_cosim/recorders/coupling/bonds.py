"""Collect the energies of the power bonds of a run."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...base.arrays import Indices, Vector, read_stored_array
from ...master.algorithms.algorithm import Algorithm
from ...master.algorithms.continuous_connections import loop_responses
from ..recorder import Outline
from .bond_energy import BondEnergies, BondEnergy
from .steps import Steps


class EveryStep:
    """Keep all steps of rows (time in s first) with some columns, until `take`."""

    def __init__(self, columns: Indices, memory: Any = None) -> None:
        """Begin, or continue from a `memory`."""
        self._columns, count = columns, len(columns)
        before = np.empty((0, count)) if memory is None else read_stored_array(memory, (2, count), (0, count))
        self._rows = [before]
        self.waiting = 0
        """Number of steps that wait for `take`."""

    @property
    def time(self) -> float:
        """Time of the last row in s; minus infinity without one."""
        return float(self._rows[-1][-1, 0]) if len(self._rows[-1]) else -np.inf

    def show(self, rows: Vector) -> None:
        """Take the next rows."""
        if not len(self._rows[0]):
            self._rows = [rows[[0, 0]][:, self._columns]]  # there is no step before the first
            rows = rows[1:]
        if len(rows):
            self._rows.append(rows[:, self._columns])
        self.waiting += len(rows)

    def take(self) -> Steps:
        """Return the waiting steps."""
        rows = np.concatenate(self._rows)
        self._rows, self.waiting = [rows[-2:]], 0
        return Steps(rows[:-2], rows[1:-1], rows[2:])

    def memory(self) -> Any:
        """Return the state as plain data, from which another object can continue; call `take` before."""
        return self._rows[0].tolist()


COUPLING = "coupling"
"""Name of the part of metrics.json with the energies of bonds and the coupling errors of connections."""

_BLOCK, _BATCH = 256, 2000
"""Number of single rows that are collected to a block, and number of steps that are summed up at once."""


class Bonds:
    """Compute the energies of bonds from rows, time in s first."""

    def __init__(self, outline: Outline, memory: Any = None) -> None:
        """Begin, or continue from a `memory`; CommandError for bonds that do not exist."""
        self._watched, self._halved, self._seen = outline.watched, outline.halved, list[Vector]()
        self._bonds = [BondEnergy(name, bond, outline) for name, bond in outline.bonds.items()]
        self._responses: Mapping[int, Vector] = {}
        self._algorithm: Algorithm | None = None
        # the energy that noise creates and destroys cancels only over all steps
        self._energies = BondEnergies(self._bonds)
        columns = np.array(self._energies.columns, dtype=np.intp)
        self._steps = EveryStep(columns, None if memory is None else memory["steps"])
        if memory is not None:
            for bond in self._bonds:
                bond.remember(memory["bonds"][bond.name])

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
        if self._algorithm is not None and self._bonds:
            self._responses = loop_responses(self._algorithm)

    def _write_seen(self) -> None:
        rows, self._seen = np.array(self._seen), []
        if len(rows):
            self._write(rows[np.diff(rows[:, 0], prepend=self._steps.time) > 0.0])

    def _write(self, rows: Vector) -> None:
        if not self._bonds or not len(rows):
            return
        self._steps.show(rows)
        if self._steps.waiting >= _BATCH:
            self._take()

    def _take(self) -> None:
        """Sum up the waiting steps."""
        if self._steps.waiting:
            steps = self._steps.take()
            with np.errstate(all="ignore"):
                self._energies.take(steps.halved() if self._halved else steps)

    def learn(self, algorithm: Algorithm) -> None:
        """Use the loop responses of this algorithm, which does the steps."""
        self._algorithm = algorithm

    def figures(self) -> dict[str, dict[str, float]]:
        """Return the energies of all rows so far, by bond."""
        self._complete()
        with np.errstate(all="ignore"):
            return {bond.name: bond.figures(self._responses) for bond in self._bonds}

    def memory(self) -> dict[str, Any]:
        """Return the state as plain data, from which another object can continue."""
        self._complete()
        return {"steps": self._steps.memory(), "bonds": {bond.name: bond.memory() for bond in self._bonds}}
