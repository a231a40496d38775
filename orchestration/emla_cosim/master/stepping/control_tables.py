"""Fill the tables of error control in C; see `emla_cosim.stepper.layout`."""

from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...stepper.layout import CONTROLLED, Control
from ..algorithms.algorithm import Algorithm
from .saved_states import SavedStates
from .timing import CommunicationPoints

SMALLEST = 1e-6
"""Smallest step, as a fraction of the first step."""

JUST_BEFORE = 1e-5
"""Length of the step that ends at an event, as a fraction of the first step."""

SHORT = 1e-5
"""Steps shorter than this fraction of the first one may have an error of a tenth of the tolerance.

Inputs that jump at an unknown time cause errors in proportion to the step, as is what a step is allowed.
No step would be short enough.
"""

UNREAD = 1e-2
"""Unread outputs shorten no step below this fraction of the first one, if others of the FMU are read."""

CRAWLING = 1e-2
"""Step length, as a fraction of the first step. Many shorter ones show a jump at every point."""

WATCHED = 500
"""Largest number of steps in a call if `Stepping.watch` gets each of them."""


class ControlTables:
    """The tables of error control, and the arrays that they point to.

    Args:
        algorithm: An algorithm after `setup`.
        times: Start time, stop time and first trial step.
        tolerance: Allowed error, as a fraction of each signal's size.
        longest: Longest step in s.
        states: Places for the states of all instances at the start of a trial.

    Attributes:
        control: The record that the functions in C get.
        signals: The records of the controlled signals.
        total: Sum of the errors of all steps so far, per controlled signal.
        watched: Room for time and signals of watched steps.
    """

    def __init__(
        self,
        algorithm: Algorithm,
        times: CommunicationPoints,
        tolerance: float,
        longest: float,
        states: SavedStates,
    ) -> None:
        network, step = algorithm.network, times.step
        self.signals = find_controlled_signals(algorithm)
        count = len(self.signals)
        self._states = states
        self.watched = np.zeros((0, 1 + len(network.signals)))
        self._copy = algorithm.restored.copy()
        self._errors = {name: np.zeros(count) for name in ("total", "first_errors")}
        self._rooms = {name: np.zeros(count) for name in ("whole", "errors", "judged")}
        self._flags = {name: np.zeros(count, dtype=np.int32) for name in ("jumps", "jumped")}
        self.total = self._errors["total"]
        self.control = control = Control()
        control.controlled, control.controlled_count = self.signals.ctypes.data, count
        control.states, control.instance_count = states.records.ctypes.data, len(states.records)
        control.memory, control.copy = algorithm.restored.ctypes.data, self._copy.ctypes.data
        control.memory_count = len(self._copy)
        for name, values in {**self._errors, **self._rooms, **self._flags}.items():
            setattr(control, name, values.ctypes.data)
        control.tolerance, control.divisor = tolerance, 2.0**algorithm.accuracy - 1.0
        control.start, control.first_step, control.time = times.start, step, times.start
        control.leap_limit, control.unread_limit = 2.0 * JUST_BEFORE * step, UNREAD * step
        control.short_limit, control.crawling_limit = SHORT * step, CRAWLING * step
        control.shortest, control.longest = SMALLEST * step, longest
        control.step, control.last_error = min(step, longest), 1.0
        control.first_rejected = np.nan

    def leave_out_unread_signals(self) -> None:
        """Control unread signals, such as noise, only in instances without any signal that is read."""
        self.control.controlled_count = int((self.signals["is_beside"] == 0).sum())

    def watch(self, most: int) -> None:
        """Keep time and signals of at most so many steps in a call."""
        if len(self.watched) < most:
            self.watched = np.zeros((most, self.watched.shape[1]))
        self.control.watched_rows, self.control.watch_room = self.watched.ctypes.data, most

    def memory(self) -> dict[str, Vector]:
        """Return what steps have changed, as arrays by name."""
        numbers = np.array([float(getattr(self.control, name)) for name in _NUMBERS + _COUNTS])
        arrays = {**self._errors, "jumped": self._flags["jumped"].astype(float)}
        return {"control": numbers} | {f"control/{name}": values for name, values in arrays.items()}

    def remember(self, memory: Any) -> None:
        """Continue from what `memory` returned."""
        for name, number in zip(_NUMBERS + _COUNTS, memory["control"], strict=True):
            setattr(self.control, name, int(number) if name in _COUNTS else float(number))
        for name, values in {**self._errors, "jumped": self._flags["jumped"]}.items():
            values[:] = memory[f"control/{name}"]


_NUMBERS = ("time", "step", "last_error", "exponent", "first_rejected")
_COUNTS = ("accepted", "rejected", "short_steps", "is_per_unit")
"""Fields of `Control` that steps change: numbers, and whole numbers."""


def find_controlled_signals(algorithm: Algorithm) -> Any:
    """Return the CONTROLLED records: all continuous signals, as unread ones also depend on states.

    Args:
        algorithm: An algorithm after `setup`.

    Returns:
        The records; unread signals of instances with others that are read come last.
    """
    network, exchange = algorithm.network, algorithm.exchange
    found = np.flatnonzero(exchange.smooth)
    is_unread = ~np.isin(found, network.read)
    is_read = np.zeros(len(network.instances), dtype=bool)
    is_read[exchange.owners[network.read]] = True
    is_beside = is_unread & is_read[exchange.owners[found]]
    late = {link.target for link in algorithm.late_links() if link.direct}
    order = np.argsort(is_beside, kind="stable")
    found, is_unread, is_beside = found[order], is_unread[order], is_beside[order]
    records = np.zeros(len(found), CONTROLLED)
    records["signal"], records["is_unread"], records["is_beside"] = found, is_unread, is_beside
    records["is_instant"] = np.isin(exchange.owners[found], list(late))
    return records
