"""Remarks on what limits the validity of a sizing."""

import math
from collections.abc import Iterator, Mapping

import numpy as np

from ...system.model import System
from .result import JointSizing
from .winding import Winding

MAX_ROWS = 200_000
"""Largest number of rows of a cycle."""

_RETURNS = 1e-3
"""Fraction of the stroke within which a cycle ends where it began."""


def describe_cycle(sizing: JointSizing, step: float) -> Iterator[str]:
    """Yield a remark for each property of a cycle that limits the validity of its figures.

    Args:
        sizing: The joint.
        step: Step of the run in s.
    """
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
    if (apart := float(np.diff(cycle.time).max())) > 1.5 * step:
        yield (
            f"{joint}: the cycle has more than {MAX_ROWS} steps; the figures are those of rows "
            f"{apart:.3g} s apart, and peaks between them are missed."
        )
    ends = abs(float(cycle.x[-1] - cycle.x[0]))
    if ends > _RETURNS * sizing.values["screw.stroke"]:
        yield f"{joint} ends {1e3 * ends:.4g} mm away from its start; the repeated cycle lacks the way back."
    if "inverter.C_DC" not in sizing.values and np.min(cycle.P_el) < 0.0:
        yield f"{joint}: without inverter.C_DC and U_brake, the brake resistor takes all regenerated energy."


def describe_coupling(joint: str, sizings: Mapping[str, JointSizing], system: System) -> Iterator[str]:
    """Yield a remark for each coupled joint that did not follow its motion.

    Args:
        joint: The joint whose load depends on the others.
        sizings: All joints.
        system: The system of the run.
    """
    import networkx  # slow to import

    graph = networkx.Graph((x.source, x.target) for x in system.connections)
    branch = {name: name.partition(".")[0] for name in graph}
    coupled = {
        branch[name]
        for part in networkx.connected_components(graph)
        if any(branch[name] == joint for name in part)
        for name in part
    }
    for other, sizing in sizings.items():
        if other != joint and other in coupled and sizing.reason is not None:
            yield (
                f"{joint} is coupled to {other}, which did not follow its motion; the load of {joint} is not "
                "that of the motion."
            )
