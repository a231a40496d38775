"""Find the residuals that act on a connection: its own, or those of all coupling variables of its loop."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...base.arrays import Vector
from ...master.algorithms.continuous_connections import ContinuousConnection


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
