"""Fill the tables of error control in C; see `emla_cosim.stepper.layout`."""

from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...stepper.layout import CONTROLLED, Control
from ..algorithms.algorithm import Algorithm
from .saved_states import SavedStates
from .timing import CommunicationPoints

SMALLEST_STEP_FRACTION = 1e-12
"""Smallest step, as a fraction of the largest absolute time: shorter ones are lost in its rounding."""

EVENT_STEP_FRACTION = 1e-5
"""Length of the step that ends at an event, as a fraction of the first step."""

SHORT_STEP_FRACTION = 1e-6
"""Length of a very short step, as a fraction of the run's time.

Steps become shorter only if a single one is inaccurate: a million steps take as long as users
wait, and a jump at an unknown time causes errors in proportion to the step, as is the allowed error.
"""


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
        total: Absolute errors of all steps so far, per controlled signal: their sum, or the largest if
            they do not add up.
    """

    def __init__(
        self,
        algorithm: Algorithm,
        times: CommunicationPoints,
        tolerance: float,
        longest: float,
        states: SavedStates,
    ) -> None:
        step = times.step
        self.signals, self._read_count = find_controlled_signals(algorithm)
        count = len(self.signals)
        self._states = states
        size = len(algorithm.restored)
        self._copies = {name: np.zeros(size) for name in ("copy", "coarse", "next_coarse")}
        self._errors = {name: np.zeros(count) for name in ("total", "first_errors")}
        self._buffers = {name: np.zeros(count) for name in ("whole", "errors", "judged")}
        self._flags = {name: np.zeros(count, dtype=np.int32) for name in ("jumps", "jumped")}
        self.total = self._errors["total"]
        self.control = control = Control()
        control.controlled, control.controlled_count = self.signals.ctypes.data, count
        control.states, control.instance_count = states.records.ctypes.data, len(states.records)
        control.memory, control.memory_count = algorithm.restored.ctypes.data, size
        for name, values in {**self._copies, **self._errors, **self._buffers, **self._flags}.items():
            setattr(control, name, values.ctypes.data)
        # by Richardson: the difference of one step and two halves, per error of the halves
        control.tolerance, control.divisor = tolerance, 2.0**algorithm.accuracy - 1.0
        control.start, control.time = times.start, times.start
        control.leap_limit, control.short_limit = (
            2.0 * EVENT_STEP_FRACTION * step,
            SHORT_STEP_FRACTION * (times.stop - times.start),
        )
        control.shortest = SMALLEST_STEP_FRACTION * max(abs(times.start), abs(times.stop))
        control.longest, control.step, control.last_error = longest, min(step, longest), 1.0
        control.first_rejected = control.coarse_time = np.nan
        self.control_error(algorithm.accuracy, per_unit=True)

    def control_error(self, order: int, per_unit: bool) -> None:
        """Control the error per unit step of an algorithm of this order, or that of each step.

        In the latter case, unread signals, such as noise, are only controlled in instances without others.
        """
        # the error of a step of length h is in proportion to h^(order + 1), and that per unit step to h^order
        self.control.is_per_unit, self.control.exponent = per_unit, 1.0 / (order + (not per_unit))
        if not per_unit:
            self.control.controlled_count, self.control.short_limit = self._read_count, 0.0

    def state_dict(self) -> dict[str, Vector]:
        """Return what steps have changed, as arrays by name."""
        numbers = np.array([float(getattr(self.control, name)) for name in _NUMBERS + _COUNTS])
        return {"control": numbers} | {
            f"control/{x}": values.astype(float) for x, values in self._list_state_arrays().items()
        }

    def load_state_dict(self, state: Any) -> None:
        """Continue from what `state_dict` returned."""
        for name, number in zip(_NUMBERS + _COUNTS, state["control"], strict=True):
            setattr(self.control, name, int(number) if name in _COUNTS else float(number))
        for name, values in self._list_state_arrays().items():
            values[:] = state[f"control/{name}"]

    def _list_state_arrays(self) -> dict[str, Any]:
        """Return the arrays that later steps depend on."""
        return {**self._errors, "jumped": self._flags["jumped"], "coarse": self._copies["coarse"]}


_NUMBERS = ("time", "step", "last_error", "first_rejected", "coarse_time")
_COUNTS = ("accepted", "rejected")
"""Fields of `Control` that steps change: numbers, and whole numbers."""


def find_controlled_signals(algorithm: Algorithm) -> tuple[Any, int]:
    """Return the CONTROLLED records: all continuous signals, as unread ones also depend on states.

    Args:
        algorithm: An algorithm after `setup`.

    Returns:
        The records; unread signals of instances with others that are read come last. And the number of
        the others.
    """
    network, exchange = algorithm.network, algorithm.exchange
    is_unread = ~np.isin(np.arange(len(network.signals)), network.read)
    is_read = np.zeros(len(network.instances), dtype=bool)
    is_read[exchange.owners[network.read]] = True
    is_secondary = is_unread & is_read[exchange.owners]
    order = np.argsort(is_secondary, kind="stable")
    selected = order[exchange.smooth[order]]
    records = np.zeros(len(selected), CONTROLLED)
    records["signal"], records["is_unread"] = selected, is_unread[selected]
    records["is_instant"] = _depend_on_late_inputs(algorithm, is_unread)[selected]
    return records, int((~is_secondary[selected]).sum())


def _depend_on_late_inputs(algorithm: Algorithm, is_unread: Any) -> Any:
    """Return which signals depend directly on an input of another time, perhaps through others: booleans.

    For unread outputs the dependencies are not declared; all outputs of instances with such inputs count.
    """
    network, exchange = algorithm.network, algorithm.exchange
    late = {id(link) for link in algorithm.late_links()}
    is_late, count = np.zeros(len(network.signals), dtype=bool), -1
    while count < (count := int(is_late.sum())):
        for link in network.links:
            if id(link) in late or exchange.reads_middle_value(link) or is_late[network.signal(link)]:
                part = network.parts[link.target]
                is_late[part] |= is_unread[part]
                is_late[[part.start + k for k in link.through]] = True
    return is_late
