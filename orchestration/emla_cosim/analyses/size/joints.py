"""Size the joints of a run: cycles, figures, limits, and remarks on what limits their validity."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ...run.result import Result
from ...study.actuator.actuator import Actuator
from ...study.criteria import Criteria
from ...study.limits import WINDING_TEMPERATURE
from ...system.model import System
from .cycle import find_plant, follow_reference, read_cycle
from .figures import compute_figures, describe_losses
from .limits import Requirements, Unexamined, Utilisation, examine, link_capacity
from .motor import Winding, find_winding, warm_up
from .result import JointSizing

MAX_ROWS = 200_000
"""Largest number of rows of a cycle."""

_MAX_OFFSET = 1e-3
"""Fraction of the stroke within which a cycle ends where it began."""


@dataclass(frozen=True)
class Examination:
    """What to examine in a run.

    Attributes:
        sheets: Data sheets by joint.
        criteria: When each joint counts as held.
        starts: Begin of each cycle in s.
        stop: End of all cycles in s.
        needed: What the application requires.
    """

    sheets: Mapping[str, Actuator]
    criteria: Mapping[str, Criteria]
    starts: Mapping[str, float]
    stop: float
    needed: Requirements

    def size(self, result: Result) -> dict[str, JointSizing]:
        """Return the sizing of each joint in a run with a table.

        Raises:
            CommandError: The run has fewer than two rows in a cycle.
        """
        return {joint: _size_joint(result, joint, self) for joint in self.sheets}


def _size_joint(result: Result, joint: str, examination: Examination) -> JointSizing:
    """Return the sizing of a joint; of one that did not follow its motion, what the motion requires."""
    sheet, criteria = examination.sheets[joint], examination.criteria[joint]
    values, plant = sheet.values, find_plant(joint, result.parameters, sheet.emla, result.roles)
    cycle = read_cycle(result, plant, examination.starts[joint], examination.stop)
    verdict = result.metrics.get("joints", {}).get(joint, {"held": True})
    trip = verdict.get("trip") or {}
    reason = None if verdict.get("held") else str(verdict.get("reason"))
    is_hot = trip.get("what") == WINDING_TEMPERATURE and not verdict.get("oscillation")
    if is_hot and np.abs(cycle.error).max() <= criteria.position_window:
        reason = None  # it follows its motion; that it is too hot is said by its limits
    required = reason is not None and cycle.has_required
    if required:
        cycle = follow_reference(cycle, plant, result)
    winding, rise = find_winding(plant, values, criteria.over_temperature), None
    if isinstance(winding, Winding):  # the run is too short to warm up: the repeated cycle decides
        rise = winding.rise(cycle)
        cycle = warm_up(cycle, plant, rise)
    figures = compute_figures(cycle, values, link_capacity(values), winding, rise)
    # the winding and its resistance first: voltage and power depend on its temperature
    examined = list(examine(cycle, values, figures, examination.needed, winding))
    limits = [x for x in examined if isinstance(x, Utilisation)]
    return JointSizing(
        joint,
        sheet.title or (sheet.file.name if sheet.file else "its own actuator"),
        values,
        cycle,
        figures,
        sorted(limits, key=lambda limit: -limit.fraction),
        [x for x in examined if isinstance(x, Unexamined)],
        describe_losses(cycle, plant),
        winding,
        rise,
        required,
        reason,
        overloaded=reason is not None and bool(trip.get("cause")),
    )


def describe_overload(result: Result | None) -> str | None:
    """Return which joints of a failed run had a load that their motors cannot hold; None without one."""
    joints = {} if result is None else result.metrics.get("joints", {})
    tripped = [str(verdict["reason"]) for verdict in joints.values() if (verdict["trip"] or {}).get("cause")]
    return " ".join(tripped) or None


def describe_cycle(sizing: JointSizing, step: float) -> Iterator[str]:
    """Yield a remark for each property of a cycle that limits its figures; `step` is that of the run in s."""
    joint, cycle, winding, trip = sizing.joint, sizing.cycle, sizing.winding, sizing.figures.trip_time_s
    if isinstance(winding, Winding) and trip is not None and math.isfinite(trip):
        yield (
            f"{joint}: from cold, the repeated cycle trips after {trip:.4g} s: the winding gets hotter than "
            f"{winding.trip_rise:.4g} K above the ambient."
        )
    if sizing.required:
        yield (
            f"{joint} did not follow its motion; its figures are those that the motion requires of a motor "
            "without limits."
        )
    elif sizing.reason is not None:
        yield f"{joint} did not follow its motion; its figures are those of the run, not of the motion."
    if (spacing := float(np.diff(cycle.time).max())) > 1.5 * step:
        yield (
            f"{joint}: the cycle has more than {MAX_ROWS} steps; the figures are those of rows "
            f"{spacing:.3g} s apart, and peaks between them are missed."
        )
    offset = abs(float(cycle.x[-1] - cycle.x[0]))
    if offset > _MAX_OFFSET * sizing.values["screw.stroke"]:
        yield f"{joint} ends {1e3 * offset:.4g} mm from its start; the repeated cycle lacks the way back."
    if "inverter.C_DC" not in sizing.values and np.min(cycle.P_el) < 0.0:
        yield f"{joint}: without inverter.C_DC and U_brake, the brake resistor takes all regenerated energy."


def describe_coupling(joint: str, sizings: Mapping[str, JointSizing], system: System) -> Iterator[str]:
    """Yield a remark for each joint that is coupled to this one, and did not follow its motion."""
    import networkx  # slow to import

    graph = networkx.Graph((x.source, x.target) for x in system.connections)
    parts = [{name.partition(".")[0] for name in part} for part in networkx.connected_components(graph)]
    coupled = set[str]().union(*(part for part in parts if joint in part))
    for other_joint, sizing in sizings.items():
        if other_joint != joint and other_joint in coupled and sizing.reason is not None:
            yield (
                f"{joint} is coupled to {other_joint}, which did not follow its motion; the load of {joint} "
                "is not that of the motion."
            )
