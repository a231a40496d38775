"""Figures of loads that are not rigid, from their true positions at every communication point.

docs/metrics.md has their definitions.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..base.arrays import Vector, read_stored_array
from ..recorders.metrics import Figures, MetricDisplay
from ..recorders.recorder import RunLayout
from .criteria import EVALUATED_AFTER, TOO_SHORT, format_length, resolve_criteria
from .roles import RoleNames, describe_error, find_all_joints, find_values, find_variable
from .tracking import Settling, VerdictMetrics

_ROUNDING = 1e-9
"""Tolerance in s for equal times."""

_ROLES = ("x_load", "x_L", "x_s", "x_c")
"""Roles of the watched signals, in the order of the gathered rows."""


@dataclass(frozen=True)
class WatchedLoad:
    """A load to watch.

    Attributes:
        joint: Its joint.
        columns: Those of `_ROLES` in the rows.
        error: How messages call its position error.
        correction: Column of the correction by the feedback of the load's position; None without one.
        limit: Its limit in m.
    """

    joint: str
    columns: Sequence[int]
    error: str = "position error"
    correction: int | None = None
    limit: float = math.inf


@dataclass
class LoadFigures:
    """One load's part of metrics.json; docs/metrics.md defines each figure. NaN marks one without value.

    `load_within_window` tells whether joint and load have settled, and the load's position error has stayed
    within the position window of the joint since. `load_reason` says why not. The others count from
    `load_evaluated_from_s` on.
    """

    load_within_window: bool
    load_reason: str | None
    load_settling_time_s: float
    load_evaluated_from_s: float
    load_position_error_m: float
    load_swing_m: float
    load_deflection_m: float


_DISPLAYS = (
    MetricDisplay("load_position_error_m", "load position error", 1e6, "µm", "m"),
    MetricDisplay("load_swing_m", "load swing, peak to peak", 1e6, "µm", "m"),
    MetricDisplay("load_deflection_m", "deflection", 1e6, "µm", "m"),
    MetricDisplay("load_settling_time_s", "load settling time", 1e3, "ms"),
)


def create_load_metrics(layout: RunLayout) -> "LoadMetrics | None":
    """Return the metrics of all loads of a run that are not rigid; None if it has none."""
    column = RoleNames((name, i + 1) for i, name in enumerate(layout.names))
    parameters, loads = RoleNames(layout.parameters), list[WatchedLoad]()
    for joint in find_all_joints(layout.names, layout.roles):
        names = [find_variable(joint, role, column, layout.roles) for role in _ROLES]
        columns = [column[name] for name in names if name is not None]
        if len(columns) < len(_ROLES):
            continue
        # only a sensor at the load has a feedback, and so a correction
        correction = find_variable(joint, "z", column, layout.roles)
        loads.append(
            WatchedLoad(
                joint,
                columns,
                describe_error(joint, str(names[_ROLES.index("x_s")])),
                None if correction is None else column[correction],
                *find_values(joint, parameters, layout.roles, "z_max"),
            )
        )
    if not loads:
        return None
    joints = [load.joint for load in loads]
    criteria = {
        joint_criterion: value
        for joint_criterion, value in layout.criteria.items()
        if joint_criterion.rpartition(".")[0] in ("*", *joints)
    }
    return LoadMetrics(loads, criteria)


class LoadMetrics(VerdictMetrics):
    """Figures by joint; they count from when joint and load have settled, or from 0.3 s."""

    displays = (MetricDisplay("load_within_window", "load within window"), *_DISPLAYS)

    def __init__(self, loads: Sequence[WatchedLoad], criteria: Mapping[str, float | str]) -> None:
        """Take the loads to watch, and values of the option `criteria`."""
        super().__init__([load.joint for load in loads])
        self._loads = loads
        self._columns = np.array([load.columns for load in loads]).T
        criteria_by_joint = resolve_criteria(self._joints, criteria)
        self._windows = [criteria_by_joint[joint].position_window for joint in self._joints]
        self._settling = Settling([criteria_by_joint[joint] for joint in self._joints])
        self._load_settling = Settling([criteria_by_joint[joint] for joint in self._joints])
        self._largest_at = np.full(len(self._joints), np.nan)
        """When the position error was largest, in s."""
        self._limited_at = np.full(len(self._joints), np.nan)
        """When the correction by the feedback was first at its limit, in s."""
        self._evaluated_from = np.full(len(self._joints), np.nan)
        self._highest, self._lowest, self._deflection = np.full((3, len(self._joints)), np.nan)
        """Largest and smallest position error, and largest deflection, in m."""

    def write(self, rows: Vector) -> None:
        """Take the next rows."""
        time = rows[:, 0].copy()
        x_load, x_L, x_s, x_c = rows.T[self._columns]
        if math.isnan(self._start):
            self._start = float(time[0])
            self._first = np.abs(x_load[:, 0] - x_s[:, 0])
        with np.errstate(invalid="ignore", over="ignore"):
            error, deflection = x_load - x_s, np.abs(x_L - x_load)
            size = np.abs(error)
            self._settling.write(time, np.abs(x_L - x_c))
            self._load_settling.write(time, size)
        self._record_not_finite(time, error)
        for number, load in enumerate(self._loads):
            if load.correction is not None and load.limit > 0.0 and math.isnan(self._limited_at[number]):
                at_limit = np.abs(rows[:, load.correction]) >= load.limit
                if at_limit.any():
                    self._limited_at[number] = float(time[at_limit.argmax()])
        self._last, self._final = float(time[-1]), size[:, -1]
        self.displays = _DISPLAYS if self._is_short else type(self).displays
        earliest = self._start + EVALUATED_AFTER
        for joint in range(len(self._joints)):
            settled = max(self._settling.settled_at(joint), self._load_settling.settled_at(joint))
            is_settled = self._settling.is_settled(joint) and self._load_settling.is_settled(joint)
            since = max(earliest, settled) if is_settled else earliest
            if math.isnan(self._evaluated_from[joint]) and is_settled:
                self._evaluated_from[joint] = since
                # what counted from 0.3 s on was not settled
                for figure in (self._highest, self._lowest, self._deflection, self._largest_at):
                    figure[joint] = np.nan
            start = int(np.searchsorted(time, since - _ROUNDING))
            if start < len(time):
                # also if there is none before, which is NaN
                if not size[joint, start:].max() <= self._get_largest_error(joint):
                    self._largest_at[joint] = time[start + int(np.argmax(size[joint, start:]))]
                part = error[joint, start:]
                self._highest[joint] = np.fmax(self._highest[joint], part.max())
                self._lowest[joint] = np.fmin(self._lowest[joint], part.min())
                self._deflection[joint] = np.fmax(self._deflection[joint], deflection[joint, start:].max())

    def remarks(self) -> Sequence[str]:
        """Return which feedbacks of loads were at their limits."""
        return [
            f"The feedback of {load.joint}'s load reached its limit of {format_length(load.limit)} at "
            f"t = {at:.6g} s; it does not correct more. The limit is {load.joint}.command.feedback.limit."
            for load, at in zip(self._loads, self._limited_at.tolist(), strict=True)
            if not math.isnan(at)
        ]

    def _get_largest_error(self, joint: int) -> float:
        """Return the largest position error in m."""
        return max(abs(float(self._highest[joint])), abs(float(self._lowest[joint])))

    def figures(self) -> Figures:
        """Return the figures by joint for the recorded rows."""
        return {joint: asdict(self._compute_figures(i)) for i, joint in enumerate(self._joints)}

    def _compute_figures(self, joint: int) -> LoadFigures:
        highest, lowest = float(self._highest[joint]), float(self._lowest[joint])
        reason = self._describe_problem(joint)
        if reason is None and self._is_short:
            reason = f"{TOO_SHORT}."
        settled = self._load_settling.entered(joint) if self._load_settling.is_settled(joint) else np.nan
        return LoadFigures(
            load_within_window=(reason or self._end_problem) is None,
            load_reason=reason or self._end_problem,
            load_settling_time_s=settled - self._start,
            load_evaluated_from_s=float(self._evaluated_from[joint]),
            load_position_error_m=self._get_largest_error(joint),
            load_swing_m=highest - lowest,
            load_deflection_m=float(self._deflection[joint]),
        )

    def _describe_problem(self, joint: int) -> str | None:
        """Return why a load is not within its window; None if it is, or if the run is too short."""
        name, window, error = self._joints[joint], self._windows[joint], self._loads[joint].error
        if not math.isnan(time := self._not_finite[joint]):
            return f"The load of {name} has no finite {error} from t = {time:.6g} s on."
        if self._is_short:
            return None
        if not self._settling.is_settled(joint):
            return f"{name} has not settled."
        if not self._load_settling.is_settled(joint):
            first, final = format_length(self._first[joint]), format_length(self._final[joint])
            return (
                f"The load of {name} has not settled: its {error} was {first} at the start and is {final} at "
                f"the end; its window is {format_length(window)}."
            )
        if (largest := self._get_largest_error(joint)) <= (1.0 + _ROUNDING) * window:
            return None
        return (
            f"The load of {name} left the position window of {format_length(window)}: its {error} was "
            f"largest at t = {self._largest_at[joint]:.6g} s, {format_length(largest)}."
        )

    def reason(self, joint: str) -> str | None:
        """Return why the load of a joint is not within its window.

        None if it is, if the joint has no load, or if the screw has not settled and has its own reason.
        """
        if joint not in self._joints:
            return None
        number = self._joints.index(joint)
        # the screw has a reason of its own until it has settled
        has_verdict = self._settling.is_settled(number) or not math.isnan(self._not_finite[number])
        return self._describe_problem(number) if has_verdict else None

    def state_dict(self) -> Any:
        """Return the state as plain data."""
        state = {name: np.asarray(getattr(self, name)).tolist() for name in _STATE}
        return {
            "own": state,
            "settling": self._settling.state_dict(),
            "load": self._load_settling.state_dict(),
        }

    def load_state_dict(self, state: Any) -> None:
        """Continue from `state`; raise ValueError or KeyError if it belongs to another run."""
        for name in _STATE:
            value = read_stored_array(state["own"][name], np.shape(getattr(self, name)))
            setattr(self, name, value if value.ndim else float(value))
        self._settling.load_state_dict(state["settling"])
        self._load_settling.load_state_dict(state["load"])


_STATE = (
    "_start",
    "_last",
    "_evaluated_from",
    "_highest",
    "_lowest",
    "_deflection",
    "_first",
    "_final",
    "_largest_at",
    "_not_finite",
    "_limited_at",
)


_LEVEL = re.compile(r"(?P<component>.+)\.load\.start\[\d+\]")
_SAG = re.compile(r"(?P<component>.+)\.supply\.start")


def scheduled_times(parameters: Mapping[str, float]) -> Iterator[float]:
    """Yield the times in s at which a load level begins or is reached, and the supply sags or recovers.

    Args:
        parameters: All parameters by full name.
    """
    for name, start in parameters.items():
        if match := _LEVEL.fullmatch(name):
            yield start
            yield start + parameters.get(f"{match['component']}.load.ramp", 0.0)
        elif match := _SAG.fullmatch(name):
            yield start
            yield start + parameters.get(f"{match['component']}.supply.duration", 0.0)
