"""The energies of power bonds: what the coupling of a run creates or destroys there.

Within a step of length h, with 0 <= x <= 1 for its time, every value is a + b x + c (x - x^2) with three
coefficients (a, b, c). A source's own value is the parabola through its present, next and previous values.
A consumer uses a constant or a line. Its residual is the value that it used minus that of the source. The
integral of a product over a step is exactly h u' P v, with the coefficients u and v and P = `PRODUCTS`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ..base.arrays import Vector, read_stored_array
from ..base.errors import CommandError, suggest_names
from ..base.units import SiUnit
from ..base.wording import select_names
from ..master.algorithms.algorithm import Algorithm
from ..master.algorithms.continuous_connections import (
    ContinuousConnection,
    list_continuous_connections,
    loop_responses,
)
from ..master.algorithms.extrapolation import Mode
from ..system.bond import Bond
from ..system.model import System
from .recorder import Recorder, RunLayout

COUPLING = "coupling"
"""Name of the part of metrics.json with the energies of bonds and the coupling errors of connections."""

FIGURES = ("energy_error", "energy_error_J", "energy_exchanged_J")
"""The energies of a bond: the created one relative to the exchanged one, and both in J."""

PRODUCTS = np.array([[1.0, 1 / 2, 1 / 6], [1 / 2, 1 / 3, 1 / 12], [1 / 6, 1 / 12, 1 / 30]])
"""Integrals of the products of 1, x and x - x^2 from 0 to 1."""


def make_bond_energies(
    requests: Mapping[str, str],
    required: Sequence[str],
    system: System,
    units: Mapping[str, SiUnit | None],
    algorithm: Algorithm,
    is_halved: bool,
) -> "BondEnergies":
    """Return the recorder of the energies of the bonds that a run needs, maybe of none.

    Args:
        requests: The option `bonds`: two signals by the name of a bond; with an empty text, the name or
            pattern is that of other requests or of bonds of the system.
        required: Names of required metrics; an energy selects its bond.
        system: The system with its bonds. Those without exchange in continuous time cannot be selected.
        units: The units of all signals by name.
        algorithm: The algorithm after `setup`.
        is_halved: Whether each step is done in two halves.

    Raises:
        CommandError: A request has no match, or its signals are not those of a bond.
    """
    signals = list(units)
    connections = list_continuous_connections(algorithm, [c.name for c in system.components if c.samples])
    used = {signals[x.signal] for x in connections}
    applicable = {
        name: bond
        for name, bond in system.bonds.items()
        if {bond.effort, bond.flow} <= set(signals) and used & {bond.effort, bond.flow}
    }
    declared = {name: Bond.read(name, text) for name, text in requests.items() if text}
    available = applicable | declared
    patterns = [name for name, text in requests.items() if not text]
    selected = select_names(patterns, available, "power bond of the system")
    selected += [n for n in applicable if any(metric.startswith(f"{n}.energy_") for metric in required)]
    bonds = {name: available[name] for name in [*selected, *declared]}
    return BondEnergies(bonds, units, connections, partial(loop_responses, algorithm), is_halved)


class BondEnergies(Recorder):
    """Sum up the energies of power bonds over all steps.

    Noise creates and destroys energy that cancels only over all of them, so that each step needs a row.
    """

    key = "bonds"

    def __init__(
        self,
        bonds: Mapping[str, Bond],
        units: Mapping[str, SiUnit | None],
        connections: Sequence[ContinuousConnection],
        responses: Callable[[], Mapping[int, Vector]],
        is_halved: bool = False,
    ) -> None:
        """Find the signals and connections of the bonds.

        Args:
            bonds: The bonds by name.
            units: The units of all signals by name.
            connections: The continuous connections.
            responses: Returns the responses of the loops at the end; see `loop_responses`.
            is_halved: Whether each step is done in two halves.

        Raises:
            CommandError: A signal does not exist, no component uses it, or a connection has the bond's name.
        """
        self.bonds, self._is_halved, self._responses = bonds, is_halved, responses
        self._bonds = {name: _Bond(name, bond, units, connections) for name, bond in bonds.items()}
        self._columns = [0, *sorted({column for bond in self._bonds.values() for column in bond.columns})]
        self._last = np.empty((0, len(self._columns)))  # the last two rows

    def begin(self, layout: RunLayout, state: Any = None) -> None:
        """Begin, or continue from a `state`."""
        if state is not None:
            count = len(self._columns)
            self._last = read_stored_array(state["rows"], (2, count), (0, count))
            for name, bond in self._bonds.items():
                bond.restore(state["bonds"][name])

    def write(self, rows: Vector) -> None:
        """Add the energies of the steps between rows, time in s first."""
        if not len(rows):
            return
        rows = rows[:, self._columns]
        before = self._last if len(self._last) else rows[:1]  # there is no step before the first
        rows = np.concatenate((before, rows))
        self._last = rows[-2:]
        with np.errstate(all="ignore"):
            steps = _Steps(self._columns, rows[:-2], rows[1:-1], rows[2:])
            for bond in self._bonds.values():
                bond.add(steps.split_into_halves() if self._is_halved else steps)

    def figures(self) -> dict[str, dict[str, float]]:
        """Return the energies of all rows so far, by bond."""
        responses = self._responses()
        with np.errstate(all="ignore"):
            return {name: bond.figures(responses) for name, bond in self._bonds.items()}

    def state_dict(self) -> dict[str, Any]:
        """Return the state as plain data, from which another object can continue."""
        return {
            "rows": self._last.tolist(),
            "bonds": {name: bond.state_dict() for name, bond in self._bonds.items()},
        }


class _Steps:
    """Steps with the values at the previous point, at their start and at their end; time in s first."""

    def __init__(self, columns: Sequence[int], before: Vector, start: Vector, end: Vector) -> None:
        self._columns, self._before, self._start, self._end = columns, before, start, end
        self.lengths: Vector = end[:, 0] - start[:, 0]
        previous = start[:, 0] - before[:, 0]
        self._ratio: Vector = np.where(previous > 0.0, self.lengths / previous, 0.0)[:, None]

    def values(self, columns: Sequence[int]) -> Vector:
        """Return the coefficients of the sources' own values, (steps, 3, columns)."""
        start, change, before = self._compute_differences(columns)
        # weight of the second difference for unequal steps; 0 without a previous step
        share = np.where(self._ratio > 0.0, self._ratio / (1.0 + self._ratio), 0.0)
        return np.stack((start, change, share * (before - change)), axis=1)

    def residuals(self, connections: Sequence[ContinuousConnection]) -> Vector:
        """Return the coefficients of the residuals, (steps, 3, connections)."""
        columns = [1 + x.signal for x in connections]
        values = self.values(columns)
        change, before = values[:, 1], self._compute_differences(columns)[2]
        offset, slope = np.zeros_like(change), np.zeros_like(change)
        for i, x in enumerate(connections):
            # a late consumer continues the change of the previous step; a held value has none
            progress = before[:, i] if x.is_late else change[:, i]
            if x.mode == Mode.LINE:
                slope[:, i] = progress
            elif x.mode == Mode.MIDDLE:
                offset[:, i] = 0.5 * progress
            elif not x.is_late:
                offset[:, i] = progress
        return np.stack((offset, slope - change, -values[:, 2]), axis=1)

    def split_into_halves(self) -> "_Steps":
        """Return the halves of all steps, with the sources' own values between."""
        values = self.values(self._columns)
        earlier, half = (np.einsum("a,kai->ki", (1.0, x, x - x**2), values) for x in (-0.5, 0.5))
        return _Steps(
            self._columns,
            np.concatenate((earlier, self._start)),
            np.concatenate((self._start, half)),
            np.concatenate((half, self._end)),
        )

    def integrate_absolute_power(self, effort: int, flow: int) -> float:
        """Return the integral of the absolute value of the power; `effort` and `flow` are columns."""
        pair = [self._columns.index(effort), self._columns.index(flow)]
        first, second = (np.abs(rows[:, pair].prod(axis=1)) for rows in (self._start, self._end))
        return float(0.5 * self.lengths @ (first + second))

    def integrate_residuals(self, connections: Sequence[ContinuousConnection], column: int) -> Vector:
        """Return the integral of each residual times the value of a column, (connections,)."""
        residuals, values = self.residuals(connections), self.values([column])[:, :, 0]
        return np.einsum("k,kai,ab,kb->i", self.lengths, residuals, PRODUCTS, values, optimize=True)

    def _compute_differences(self, columns: Sequence[int]) -> tuple[Vector, Vector, Vector]:
        """Return values at the start, their change, and the previous change scaled to this length."""
        indices = [self._columns.index(column) for column in columns]
        start = self._start[:, indices]
        return start, self._end[:, indices] - start, (start - self._before[:, indices]) * self._ratio


@dataclass(frozen=True)
class _Users:
    """The connections whose residuals act on one of them, at `position`, and their integrals so far."""

    connections: Sequence[ContinuousConnection]
    position: int
    missed: Vector

    def energy(self, responses: Mapping[int, Vector]) -> float:
        """Return the energy that the connection at `position` misses: source minus used value."""
        connection = self.connections[self.position]
        response = responses.get(connection.group)
        if response is None:
            return -float(self.missed[self.position])
        return float(response[connection.position, [x.position for x in self.connections]] @ self.missed)


class _Bond:
    """The energies of one bond so far."""

    def __init__(
        self,
        name: str,
        bond: Bond,
        units: Mapping[str, SiUnit | None],
        connections: Sequence[ContinuousConnection],
    ) -> None:
        names = list(units)
        for signal in (bond.effort, bond.flow):
            if signal not in units:
                suggestions = suggest_names(signal, names)
                raise CommandError(
                    f"there is no signal '{signal}' for the bond {name}; {suggestions}", name=signal
                )
        effort, flow = names.index(bond.effort), names.index(bond.flow)
        self._users = _find_users(effort, flow, connections), _find_users(flow, effort, connections)
        if not any(self._users):
            raise CommandError(
                f"the bond {name} needs an effort and a flow that components exchange, but no component "
                f"reads {bond.effort} or {bond.flow} in continuous time.",
                bond=name,
            )
        if name in {x.name for x in connections}:
            raise CommandError(f"'{name}' is the name of a connection. Rename the bond.", bond=name)
        self._effort, self._flow, self._exchanged = 1 + effort, 1 + flow, 0.0
        factors = [1.0 if unit is None else unit.factor for unit in (units[bond.effort], units[bond.flow])]
        self._factor = float(np.prod(factors))

    @property
    def columns(self) -> set[int]:
        """The columns of the needed signals, time first."""
        used = {1 + x.signal for users in self._users if users is not None for x in users.connections}
        return {self._effort, self._flow} | used

    def add(self, steps: _Steps) -> None:
        """Add the energies of steps."""
        self._exchanged += steps.integrate_absolute_power(self._effort, self._flow)
        for users, partner in zip(self._users, (self._flow, self._effort), strict=True):
            if users is not None:
                users.missed[:] += steps.integrate_residuals(users.connections, partner)

    def figures(self, responses: Mapping[int, Vector]) -> dict[str, float]:
        """Return the energies so far, by the names in `FIGURES`."""
        effort, flow = (0.0 if users is None else users.energy(responses) for users in self._users)
        error, exchanged = self._factor * abs(effort - flow), self._factor * self._exchanged
        relative = error / exchanged if exchanged > 0.0 else 0.0 if error == 0.0 else np.nan
        return dict(zip(FIGURES, (relative, error, exchanged), strict=True))

    def state_dict(self) -> dict[str, Any]:
        """Return the sums as plain data."""
        missed = [[] if users is None else users.missed.tolist() for users in self._users]
        return {"exchanged": self._exchanged, "missed": missed}

    def restore(self, state: Any) -> None:
        """Continue from `state`."""
        self._exchanged = float(state["exchanged"])
        for users, missed in zip(self._users, state["missed"], strict=True):
            if users is not None:
                users.missed[:] = read_stored_array(missed, users.missed.shape)


def _find_users(signal: int, partner: int, connections: Sequence[ContinuousConnection]) -> _Users | None:
    """Return the consumers of a signal on the side that produces the other one; None without any."""
    sides = {x.source for x in connections if x.signal == partner}
    users = [x for x in connections if x.signal == signal and (not sides or x.target in sides)]
    if not users:
        return None
    connection = users[0]
    if connection.group < 0:
        return _Users(users[:1], 0, np.zeros(1))
    members = {x.position: x for x in reversed(connections) if x.group == connection.group}
    members = dict(sorted((members | {connection.position: connection}).items()))
    return _Users([*members.values()], [*members].index(connection.position), np.zeros(len(members)))
