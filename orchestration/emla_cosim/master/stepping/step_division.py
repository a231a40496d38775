"""Let instances do the steps that they discard in parts.

The state of an instance is saved before each step only after it has discarded one. For that first one, the
run goes back to a state from a moment ago, and repeats the steps since then. Other runs lose no time by it.
"""

import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.arrays import Vector
from ...base.errors import RunError, join_names
from ..algorithms.algorithm import Algorithm
from ..instances.fmu_instance import DiscardedStepError
from .checkpoint import Snapshot
from .timing import CommunicationPoints

if TYPE_CHECKING:
    from .native_loop import NativeLoop  # slow to import, and `emla list` needs only the controls

INTERVAL, SHARE = 0.05, 0.01
"""Shortest wall time in s between two saved states, and the share of a run that saving them may take."""


class StepDivision:
    """The state to go back to when an instance discards a step for the first time.

    Args:
        algorithm: The algorithm, after `setup`.
        loop: What does its steps.
        times: The communication points.
    """

    def __init__(self, algorithm: Algorithm, loop: "NativeLoop", times: CommunicationPoints) -> None:
        self._algorithm, self._loop, self._times = algorithm, loop, times
        instances = algorithm.network.instances
        self._divided = set[int]()
        self._first_failure: tuple[int, DiscardedStepError] | None = None
        self._irreversible = [s.name for s in instances if not s.rolls_back or s.restarts_when_saved]
        self._snapshot = Snapshot(algorithm, learned=True)
        self._divisions: Any = None
        self._due = 0.0
        ungrouped = {o.instance for o in algorithm.operations}  # groups divide their steps themselves
        self._is_possible = not self._irreversible and any(instances[i].varies_step for i in ungrouped)
        if self._is_possible:
            loop.allow_way_back()

    def save_if_due(self) -> None:
        """Save the present state if the last one is old; if an FMU fails in it, steps are not divided."""
        if not self._is_possible or (now := time.perf_counter()) < self._due:
            return
        try:
            self._snapshot.save()
        except RunError:  # an FMU that cannot do what it declares can run all the same
            self._is_possible = False
            return
        self._divisions = self._loop.divisions.copy()
        saved = time.perf_counter()
        # so that saving takes at most a hundredth of the run
        self._due = saved + max(INTERVAL, (saved - now) / SHARE)

    def require_new_state(self) -> None:
        """Let `save_if_due` save before the next step: something other than a step changes the system."""
        self._due = 0.0

    def divide(self, failure: DiscardedStepError, row: tuple[int, Vector] | None) -> None:
        """Let the failed instance do discarded steps in parts; repeat the steps since the saved state.

        Args:
            failure: The error of the present step.
            row: Number of a step since the saved state, and the row after it; None without one.

        Raises:
            DiscardedStepError: The step cannot be done in parts; with the reason and what would help.
            RunError: The way back failed.
        """
        i, step = self._loop.failed_instance, self._algorithm.steps
        if i in self._divided:
            if self._first_failure is not None and self._first_failure[0] == step:
                failure = self._first_failure[1]
            raise _append_to_message(
                failure, f"Parts of {self._loop.failed_length:.3g} s are discarded, too."
            )
        reason = self._find_obstacle(i)
        if not reason and self._loop.divide_steps(i):
            self._divided.add(i)
            self._first_failure = step, failure
            reason = self._repeat_steps(row)
            if not reason:
                return
        raise _append_to_message(failure, f"{reason} Set a smaller --step-size.".strip())

    def _find_obstacle(self, i: int) -> str:
        """Return why instance i cannot do a step in parts; empty if it can."""
        instance = self._algorithm.network.instances[i]
        if not instance.varies_step:
            return "It cannot do parts of the step: it has no canHandleVariableCommunicationStepSize."
        if self._irreversible:
            return (
                f"The step cannot be repeated in parts: {join_names(self._irreversible)} cannot return to an "
                "earlier state (canGetAndSetFMUstate)."
            )
        return "" if self._is_possible else "The step cannot be repeated in parts: a state cannot be saved."

    def _repeat_steps(self, row: tuple[int, Vector] | None) -> str:
        """Repeat the steps since the saved state. Return why this failed; empty if the state is as before."""
        steps, network = self._algorithm.steps, self._algorithm.network
        self._snapshot.restore()
        self._loop.divisions[:] = self._divisions
        if row is not None and row[0] > self._algorithm.steps:
            self._run_to(row[0])
            signals = row[1][1 : 1 + len(network.signals)]
            # outputs that nothing reads may be NaN
            if not np.array_equal(network.signals, signals, equal_nan=True):
                return "The step cannot be repeated in parts: restored states lead to other results."
        self._run_to(steps)
        return ""

    def _run_to(self, step: int) -> None:
        """Do the steps up to this one, and record none of them."""
        network, algorithm = self._algorithm.network, self._algorithm
        no_rows = np.empty((0, 1 + len(network.signals) + len(network.observer.values)))
        while (first := algorithm.steps) < step:
            _, failure = self._loop.run(first, step - first, self._times.clock, step + 1, no_rows)
            if failure is not None:
                raise failure

    def report(self) -> dict[str, Any]:
        """Return how many steps each instance did in parts, and the shortest part, for run.json."""
        counts = {
            name: {"steps": int(steps), "shortest_part_s": float(shortest)}
            for name, steps, shortest in self._list_divisions()
        }
        return {"divided_steps": counts} if counts else {}

    def remarks(self) -> list[str]:
        """Return a remark on each instance that did steps in parts."""
        return [
            f"{name} discarded {steps} step{'s' if steps > 1 else ''}, and did "
            f"{'them' if steps > 1 else 'it'} in parts; the shortest was {shortest:.3g} s"
            for name, steps, shortest in self._list_divisions()
        ]

    def _list_divisions(self) -> list[tuple[str, int, float]]:
        """Return name, number of divided steps, and shortest part in s, of instances that divided steps."""
        instances, divisions = self._algorithm.network.instances, self._loop.divisions
        return [
            (instance.name, steps, shortest)
            for instance, (steps, shortest) in zip(instances, divisions.tolist(), strict=True)
            if steps
        ]

    def state_dict(self) -> dict[str, Vector]:
        """Return the numbers of divided steps, and the shortest parts in s, shape (2, instances)."""
        divisions = self._loop.divisions
        return {"divisions": np.array([divisions["steps"], divisions["shortest"]], dtype=float)}

    def load_state_dict(self, state: Mapping[str, Vector]) -> None:
        """Continue from what `state_dict` of a division with the same algorithm returned."""
        self._loop.divisions["steps"], self._loop.divisions["shortest"] = state["divisions"]

    def close(self) -> None:
        """Free the saved state; never raises."""
        self._snapshot.close()


def _append_to_message(failure: DiscardedStepError, text: str) -> DiscardedStepError:
    """Add a text to the message of an error, and return the error."""
    message = str(failure)
    failure.args = (f"{message}{'' if message.endswith(('.', '!', '?')) else '.'} {text}",)
    return failure
