"""Figures of loads that are not rigid, from their true positions at every communication point.

docs/metrics.md has their definitions.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..base.arrays import Vector, read_stored_array
from ..recorders.metrics import Figures, MetricDisplay, Metrics
from ..recorders.recorder import Outline
from ..run.requirements import NamedFigures
from .criteria import criteria_of
from .metrics import EVALUATED_AFTER
from .roles import RoleNames, find_all_joints, find_variable
from .settling import Settling

_ROUNDING = 1e-9
"""Tolerance in s for equal times."""

_ROLES = ("x_load", "x_L", "x_d")
"""Roles of the watched signals, in the order of the gathered rows."""


@dataclass
class LoadFigures:
    """One load's part of metrics.json; docs/metrics.md defines each figure. NaN marks one without value."""

    position_error_m: float
    swing_m: float
    deflection_m: float


def load_metrics(outline: Outline) -> "LoadMetrics | None":
    """Return the metrics of all loads of a run that are not rigid; None if it has none."""
    column = RoleNames((name, i + 1) for i, name in enumerate(outline.names))
    tracked, columns = list[str](), list[list[int]]()
    joints = find_all_joints(outline.names, outline.roles)
    for joint in joints:
        names = [find_variable(joint, role, column, outline.roles) for role in _ROLES]
        found = [column[name] for name in names if name is not None]
        if len(found) == len(_ROLES):
            tracked.append(joint)
            columns.append(found)
    if not tracked:
        return None
    given = {
        place: value
        for place, value in outline.criteria.items()
        if place.rpartition(".")[0] in ("*", *tracked)
    }
    return LoadMetrics(tracked, columns, given)


class LoadMetrics(Metrics):
    """Figures by joint; they count from the time from which those of the joint count."""

    shown = (
        MetricDisplay("position_error_m", "load position error", 1e6, "µm", "m"),
        MetricDisplay("swing_m", "load swing, peak to peak", 1e6, "µm", "m"),
        MetricDisplay("deflection_m", "deflection", 1e6, "µm", "m"),
    )

    def __init__(
        self, joints: Sequence[str], columns: Sequence[Sequence[int]], criteria: Mapping[str, float | str]
    ) -> None:
        """Take the columns of `_ROLES` in the rows, by joint."""
        self._joints = list(joints)
        self._columns = np.array(columns).T
        each = criteria_of(self._joints, criteria)
        self._settling = Settling([each[joint] for joint in self._joints])
        self._start = np.nan
        self._evaluated_from = np.full(len(self._joints), np.nan)
        self._highest, self._lowest, self._deflection = np.full((3, len(self._joints)), np.nan)
        """Largest and smallest position error, and largest deflection, in m."""

    def write(self, rows: Vector) -> None:
        """Take the next rows."""
        time = rows[:, 0].copy()
        x_load, x_L, x_d = rows.T[self._columns]
        if math.isnan(self._start):
            self._start = float(time[0])
        with np.errstate(invalid="ignore", over="ignore"):
            error, deflection = x_load - x_d, np.abs(x_L - x_load)
            self._settling.write(time, np.abs(x_L - x_d))
        earliest = self._start + EVALUATED_AFTER
        for joint in range(len(self._joints)):
            settled = self._settling.settled_at(joint)
            since = earliest if math.isnan(settled) else max(earliest, settled)
            if math.isnan(self._evaluated_from[joint]) and not math.isnan(settled):
                self._evaluated_from[joint] = since
                for counted in (self._highest, self._lowest, self._deflection):
                    counted[joint] = np.nan
            begin = int(np.searchsorted(time, since - _ROUNDING))
            if begin < len(time):
                of = error[joint, begin:]
                self._highest[joint] = np.fmax(self._highest[joint], of.max())
                self._lowest[joint] = np.fmin(self._lowest[joint], of.min())
                self._deflection[joint] = np.fmax(self._deflection[joint], deflection[joint, begin:].max())

    def figures(self) -> Figures:
        """Return the figures by joint for the recorded rows."""
        return {joint: NamedFigures(asdict(self._figures(i))) for i, joint in enumerate(self._joints)}

    def _figures(self, joint: int) -> LoadFigures:
        highest, lowest = float(self._highest[joint]), float(self._lowest[joint])
        return LoadFigures(max(abs(highest), abs(lowest)), highest - lowest, float(self._deflection[joint]))

    def memory(self) -> Any:
        """Return the state as plain data."""
        own = {name: np.asarray(getattr(self, name)).tolist() for name in _STATE}
        return {"own": own, "settling": self._settling.memory()}

    def remember(self, memory: Any) -> None:
        """Continue from `memory`; raise ValueError or KeyError if it belongs to another run."""
        for name in _STATE:
            value = read_stored_array(memory["own"][name], np.shape(getattr(self, name)))
            setattr(self, name, value if value.ndim else float(value))
        self._settling.remember(memory["settling"])


_STATE = ("_start", "_evaluated_from", "_highest", "_lowest", "_deflection")
