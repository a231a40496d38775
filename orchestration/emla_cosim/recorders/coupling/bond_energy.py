"""Compute the energy through a power bond, and the energy that the coupling creates or destroys there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.arrays import Vector, read_stored_array
from ...base.errors import CommandError, suggest_names
from ...master.algorithms.continuous_connections import ContinuousConnection
from ...system.bond import Bond
from ..recorder import Outline
from .steps import Steps, Use, integral


@dataclass(frozen=True)
class Members:
    """The connections whose residuals act on one of them, at position `own`."""

    connections: tuple[ContinuousConnection, ...]
    own: int

    def row(self, responses: Mapping[int, Vector]) -> Vector:
        """Return the weights of their residuals at this connection, with the sign of source minus used value.

        Args:
            responses: See `loop_responses`.
        """
        own = self.connections[self.own]
        response = responses.get(own.group)
        if response is None:
            row = np.zeros(len(self.connections))
            row[self.own] = -1.0
            return row
        return response[own.place, [x.place for x in self.connections]]


def members(connection: ContinuousConnection, every: Sequence[ContinuousConnection]) -> Members:
    """Return the members of a connection, which is one of `every`."""
    if connection.group < 0:
        return Members((connection,), 0)
    agreed = {x.place: x for x in reversed(every) if x.group == connection.group} | {
        connection.place: connection
    }
    found = tuple(agreed[place] for place in sorted(agreed))
    return Members(found, found.index(connection))


@dataclass(frozen=True)
class _BondEnd:
    """One signal of a bond: its column in rows (time first), and its consumers on the other side."""

    column: int
    users: Members | None


class BondEnergy:
    """Sum up the energies of one bond in J, step by step."""

    def __init__(self, name: str, bond: Bond, outline: Outline) -> None:
        """Find the signals and connections of a bond; CommandError if they do not exist."""
        effort, flow = (_position(name, signal, outline) for signal in (bond.effort, bond.flow))
        self.name, self.bond = name, bond
        users = _users(effort, flow, outline), _users(flow, effort, outline)
        if not any(users):
            raise CommandError(
                f"the bond {name} needs an effort and a flow that components exchange, but no component "
                f"reads {bond.effort} or {bond.flow} in continuous time.",
                bond=name,
            )
        self._ends = _BondEnd(1 + effort, users[0]), _BondEnd(1 + flow, users[1])
        if name in {x.name for x in outline.exchanged}:
            raise CommandError(f"'{name}' is the name of a connection. Rename the bond.", bond=name)
        units = [outline.units[signal] for signal in (effort, flow)]
        self._factor = float(np.prod([1.0 if unit is None else unit.factor for unit in units]))
        self._exchanged = 0.0
        self._missed = [np.zeros(len(end.users.connections) if end.users else 0) for end in self._ends]

    @property
    def uses(self) -> set[Use]:
        """How consumers use the connections of the bond."""
        return {_use(x) for end in self._ends if end.users is not None for x in end.users.connections}

    @property
    def columns(self) -> tuple[int, int]:
        """Columns of effort and flow in rows, time first."""
        effort, flow = self._ends
        return effort.column, flow.column

    def take(self, exchanged: float, missed: Mapping[tuple[Use, int], float]) -> None:
        """Add energies.

        Args:
            exchanged: Integral of the power, in the units of the signals.
            missed: Integrals of a residual times a signal, by use and column.
        """
        self._exchanged += exchanged
        for end, other, sums in zip(self._ends, reversed(self.columns), self._missed, strict=True):
            if end.users is not None:
                sums += [missed[_use(x), other] for x in end.users.connections]

    def figures(self, responses: Mapping[int, Vector]) -> dict[str, float]:
        """Return the energies so far; see `loop_responses`."""
        effort, flow = (
            float(end.users.row(responses) @ missed) if end.users is not None else 0.0
            for end, missed in zip(self._ends, self._missed, strict=True)
        )
        error, exchanged = self._factor * abs(effort - flow), self._factor * self._exchanged
        relative = error / exchanged if exchanged > 0.0 else 0.0 if error == 0.0 else np.nan
        return {"energy_error": relative, "energy_error_J": error, "energy_exchanged_J": exchanged}

    def memory(self) -> dict[str, Any]:
        """Return the state as plain data, from which another object can continue."""
        return {"exchanged": self._exchanged, "missed": [missed.tolist() for missed in self._missed]}

    def remember(self, memory: Any) -> None:
        """Restore the state from `memory`."""
        self._exchanged = float(memory["exchanged"])
        for missed, before in zip(self._missed, memory["missed"], strict=True):
            missed[:] = read_stored_array(before, missed.shape)


def select_applicable(
    bonds: Mapping[str, Bond], names: Sequence[str], exchanged: Sequence[ContinuousConnection]
) -> dict[str, Bond]:
    """Return the bonds whose signals exist, with at least one of them used in continuous time."""
    used = {names[x.signal] for x in exchanged}
    return {
        name: bond
        for name, bond in bonds.items()
        if {bond.effort, bond.flow} <= set(names) and used & {bond.effort, bond.flow}
    }


class BondEnergies:
    """Sum up the energies of all bonds, and compute shared quantities once."""

    def __init__(self, bonds: Sequence[BondEnergy]) -> None:
        self._bonds = bonds
        signals = sorted({column for bond in bonds for column in bond.columns})
        uses = sorted({use for bond in bonds for use in bond.uses}, key=lambda use: (use.column, use.is_late))
        self.columns = sorted({0, *signals, *(use.column for use in uses)})
        """Required columns of rows, time first."""
        place = {column: i for i, column in enumerate(self.columns)}
        self._keys = [[(use, column) for column in signals] for use in uses]
        self._uses = [Use(place[use.column], use.is_late, use.mode) for use in uses]
        self._signals = [place[column] for column in signals]
        self._efforts, self._flows = ([place[bond.columns[i]] for bond in bonds] for i in range(2))

    def take(self, steps: Steps) -> None:
        """Take the next steps, with only the required `columns`."""
        powers = [np.abs(x[:, self._efforts] * x[:, self._flows]) for x in (steps.begin, steps.end)]
        exchanged = 0.5 * steps.lengths @ (powers[0] + powers[1])
        products = integral(steps.lengths, steps.residuals(self._uses), steps.values(self._signals))
        missed = {
            key: value
            for keys, row in zip(self._keys, products.tolist(), strict=True)
            for key, value in zip(keys, row, strict=True)
        }
        for bond, energy in zip(self._bonds, exchanged.tolist(), strict=True):
            bond.take(energy, missed)


def _use(x: ContinuousConnection) -> Use:
    return Use(1 + x.signal, x.is_late, x.mode)


def _position(name: str, signal: str, outline: Outline) -> int:
    if signal not in outline.names:
        meant = suggest_names(signal, outline.names)
        raise CommandError(f"there is no signal '{signal}' for the bond {name}; {meant}", name=signal)
    return list(outline.names).index(signal)


def _users(signal: int, other: int, outline: Outline) -> Members | None:
    """Return the consumers of a signal on the side of the bond that produces the other signal."""
    sides = {x.source for x in outline.exchanged if x.signal == other}
    found = [x for x in outline.exchanged if x.signal == signal and (not sides or x.target in sides)]
    return members(found[0], outline.exchanged) if found else None
