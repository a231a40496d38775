"""Which residuals count at a connection: its own, or those of all values that its loop agrees on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...base.arrays import Vector
from ...master.algorithms.continuous_connections import ContinuousConnection


@dataclass(frozen=True)
class Members:
    """The connections whose residuals make that of one connection, which is one of them."""

    connections: tuple[ContinuousConnection, ...]
    own: int

    def row(self, responses: Mapping[int, Vector]) -> Vector:
        """Return what their residuals count at this connection: source less used; see `loop_responses`."""
        own = self.connections[self.own]
        response = responses.get(own.group)
        if response is None:
            row = np.zeros(len(self.connections))
            row[self.own] = -1.0
            return row
        return response[own.place, [x.place for x in self.connections]]


def members(connection: ContinuousConnection, every: Sequence[ContinuousConnection]) -> Members:
    """Return those of one of the connections."""
    if connection.group < 0:
        return Members((connection,), 0)
    agreed = {x.place: x for x in reversed(every) if x.group == connection.group} | {
        connection.place: connection
    }
    found = tuple(agreed[place] for place in sorted(agreed))
    return Members(found, found.index(connection))
