"""Start and run the threads of a stepper in C that share its steps; see `native/lanes.c`."""

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...base import crash_page
from ...base.errors import RunError
from ...stepper.layout import LANE, TASK, WAIT, Stepper
from ...stepper.library import StepperLibrary
from ..algorithms.program import StepTask


class LaneThreads:
    """Threads that share the steps of a stepper: one per lane, the first lane in the thread that calls `run`.

    Args:
        library: The functions in C.
        stepper: The record of the stepper. Its program has one operation per task.
        tasks: The tasks of a step.
        lanes: Places of the tasks of each lane. Each task is in one lane, after the tasks of this lane that
            it depends on.

    Raises:
        RunError: The system provides too few threads.
    """

    def __init__(
        self,
        library: StepperLibrary,
        stepper: Stepper,
        tasks: Sequence[StepTask],
        lanes: Sequence[Sequence[int]],
    ) -> None:
        self.lanes, self._library = [list(lane) for lane in lanes], library
        self._owners = list[Any]()  # owners of memory whose addresses are in the tables
        plans = self._make_plans(tasks)
        self._address = library.start_lanes(ctypes.addressof(stepper), plans.ctypes.data, len(plans))
        if not self._address:
            raise RunError(f"the system cannot start {len(lanes)} threads for FMUs. Set fewer threads.")

    def run(self, first: int, count: int, steps_per_row: int, rows: int) -> int:
        """Do steps in all lanes, as `StepperLibrary.run` does."""
        return self._library.run_lanes(self._address, first, count, steps_per_row, rows)

    def close(self) -> None:
        """End the threads."""
        self._library.end_lanes(self._address)

    def _make_plans(self, tasks: Sequence[StepTask]) -> Any:
        """Return the LANE records."""
        position = {
            task_number: (lane, number)
            for lane, task_numbers in enumerate(self.lanes)
            for number, task_number in enumerate(task_numbers, 1)
        }
        plans = np.zeros(len(self.lanes), LANE)
        for lane, task_numbers in enumerate(self.lanes):
            records = np.zeros(len(task_numbers), TASK)
            for record, task_number in zip(records, task_numbers, strict=True):
                awaited = dict[int, int]()  # a lane does its tasks in order: the last one is enough
                for other_lane, number in (position[p] for p in tasks[task_number].after):
                    if other_lane != lane:
                        awaited[other_lane] = max(number, awaited.get(other_lane, 0))
                waits = np.array(list(awaited.items()), dtype=WAIT)
                record["waits"], record["wait_count"] = self._keep(waits), len(waits)
                record["operation"] = task_number
            plans[lane]["tasks"], plans[lane]["task_count"] = self._keep(records), len(records)
            # each thread has its own record of the present call, so that a crash shows all of them
            self._owners.append(activity := crash_page.current_activity(lane))
            plans[lane]["activity"] = ctypes.addressof(activity)
        return plans

    def _keep(self, values: Any) -> int:
        self._owners.append(values)
        return int(values.ctypes.data)
