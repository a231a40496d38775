"""The plots of joints, of those that move a machine together, and a map of many joints."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from ..pages.panels import Limit
from ..views.plots.pictures import Bound, Curve, Find, PanelSpec, Part, Picture, RangeLimit
from ..views.plots.style import BLUE, GREEN, GREY, ORANGE, PURPLE, RED
from .criteria import resolve_criteria
from .roles import RoleNames, find_variable

if TYPE_CHECKING:
    from ..run.result import Result
import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.arrays import Vector
from ..recorders.metrics import HELD, MetricDisplay
from ..run.result import Result
from ..views.formatting import format_headline
from ..views.plots.pictures import MOST_COLUMNS, Drawing
from ..views.plots.style import new_figure, tidy_axes
from .criteria import TOO_SHORT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STROKE = RangeLimit("stroke", ("q_UB",), ("q_LB",))
_SPEED = RangeLimit("speed limit", ("v_max",))
_CURRENT = RangeLimit("current limit of the controller", ("i_limit",))
_VOLTAGE = RangeLimit("voltage limit", ("u_max",))
_TORQUE = RangeLimit("torque limit of the controller", ("N_p", "Phi_PM", "i_limit"), scale=1.5)


@dataclass(frozen=True)
class PositionWindow(Bound):
    """The position window of a joint, times `scale`."""

    scale: float

    def resolve(self, result: "Result", column: str, find: Find) -> Limit:
        """Return the window, from the option `criteria`."""
        joints = result.metrics["joints"]
        settings = result.record.get("settings", {})
        window = self.scale * resolve_criteria(joints, settings.get("criteria", {}))[column].position_window
        return Limit("position window", -window, window)


WORST = "position_error_m"
"""The metric by which joints are chosen if there are many."""

_joint_picture = partial(Picture, of="joints", find=find_variable, index=RoleNames.fromkeys, worst=WORST)

_LOAD_SINCE = ("loads", "load_evaluated_from_s")
"""Kind and name of the metric from which on a load is evaluated."""


def _find_changed(joint: str, role: str, names: Collection[str], roles: Mapping[str, str]) -> str | None:
    """Return what `find_variable` does; None also for a commanded motion that is the reference."""
    variable = find_variable(joint, role, names, roles)
    is_same = role.endswith("_c") and variable == find_variable(joint, f"{role[:-1]}d", names, roles)
    return None if is_same else variable


_PARTS: tuple[tuple[str, float, Part], ...] = (("mm", 1e3, "settling"), ("µm", 1e6, "settled"))
"""Unit, number of units in a metre, and part of the time of panels with position errors."""

JOINT_FIGURES: dict[str, Picture] = {
    "tracking": _joint_picture(
        "Tracking",
        tuple(
            PanelSpec(
                label,
                (
                    Curve("load", f"{quantity}_load", GREEN),
                    Curve("screw", f"{quantity}_L"),
                    Curve("reference", f"{quantity}_d", ORANGE, dashed=True),
                    Curve("commanded screw", f"{quantity}_c", PURPLE, dashed=True),
                ),
                bound=bound,
            )
            for label, quantity, bound in (("position / m", "x", _STROKE), ("speed / (m/s)", "v", _SPEED))
        ),
        find=_find_changed,
    ),
    "errors": _joint_picture(
        "Tracking errors",
        (
            *(
                PanelSpec(
                    f"{subject} / {unit}, {part}",
                    (Curve("", signal, color, less=reference, scale=scale),),
                    part,
                    PositionWindow(scale) if part == "settled" else None,
                    since,
                )
                for subject, signal, reference, color, since in (
                    ("load position", "x_load", "x_s", GREEN, _LOAD_SINCE),
                    ("position", "x_L", "x_c", BLUE, None),
                )
                for unit, scale, part in _PARTS
            ),
            PanelSpec("speed / (mm/s), settled", (Curve("", "v_L", less="v_c", scale=1e3),), "settled"),
        ),
    ),
    "currents": _joint_picture(
        "Motor currents",
        (
            PanelSpec(
                "q axis / A",
                (
                    Curve("actual", "i_q"),
                    Curve("commanded", "i_q_ref", ORANGE, dashed=True),
                ),
                bound=_CURRENT,
            ),
            PanelSpec("d axis / A", (Curve("actual", "i_d"),), bound=_CURRENT),
        ),
    ),
    "voltages": _joint_picture(
        "Motor voltages after the inverter's limit",
        (
            PanelSpec("q axis / V", (Curve("", "u_q"),), bound=_VOLTAGE),
            PanelSpec("d axis / V", (Curve("", "u_d"),), bound=_VOLTAGE),
        ),
    ),
    "torque": _joint_picture(
        "Motor torque and load",
        (
            PanelSpec("motor torque / (N m)", (Curve("", "tau_m"),), bound=_TORQUE),
            PanelSpec("load force / kN", (Curve("", "F_L", GREY, scale=1e-3),)),
        ),
    ),
    "power": _joint_picture(
        "Power and energy",
        (
            PanelSpec(
                "power / kW",
                (
                    Curve("electrical", "P_el", scale=1e-3),
                    Curve("at the shaft", "tau_m", PURPLE, times="omega_m", scale=1e-3),
                    Curve("into the load", "P_L", GREEN, scale=1e-3),
                ),
            ),
            PanelSpec(
                "energy / kJ",
                (
                    Curve("electrical", "P_el", scale=1e-3, integrated=True),
                    Curve("into the load", "P_L", GREEN, scale=1e-3, integrated=True),
                    Curve("losses and motion", "P_el", RED, less="P_L", scale=1e-3, integrated=True),
                ),
            ),
        ),
    ),
    "adaptation": _joint_picture(
        "Adaptation of the controller",
        (
            PanelSpec(
                "theta of position and speed",
                (Curve("position", "theta_1"), Curve("speed", "theta_2", ORANGE)),
            ),
            PanelSpec(
                "theta of currents",
                (Curve("q axis", "theta_3"), Curve("d axis", "theta_4", ORANGE)),
            ),
        ),
    ),
    "observer": _joint_picture(
        "Observer errors",
        (
            PanelSpec("position / µm", (Curve("", "x_hat", less="x_L", scale=1e6),)),
            PanelSpec("speed / (mm/s)", (Curve("", "v_hat", less="v_L", scale=1e3),)),
        ),
    ),
}
"""The plots of a joint by file name; their signals are roles."""


def _find_in_machine(joint: str, role: str, names: Collection[str], roles: Mapping[str, str]) -> str | None:
    """Return what `find_variable` does; None also if the joints do not move a machine together."""
    has_machine = any(name.startswith("machine.") for name in names)
    return find_variable(joint, role, names, roles) if has_machine else None


MACHINE_FIGURES: dict[str, Picture] = {
    "forces": _joint_picture(
        "Forces and speeds of the pistons",
        (
            PanelSpec("load force / kN", (Curve("", "F_L", scale=1e-3),)),
            PanelSpec(
                "speed / (mm/s)",
                (
                    Curve("piston", "v_L", scale=1e3),
                    Curve("reference", "v_s", ORANGE, scale=1e3, dashed=True),
                ),
            ),
        ),
        find=_find_in_machine,
    ),
    "motion": _joint_picture(
        "Positions and accelerations of the pistons",
        (
            PanelSpec(
                "position / m", (Curve("piston", "x_L"), Curve("reference", "x_s", ORANGE, dashed=True))
            ),
            PanelSpec(
                "acceleration / (m/s²), settled",
                (Curve("piston", "a_L"), Curve("reference", "a_s", ORANGE, dashed=True)),
                part="settled",
            ),
        ),
        find=_find_in_machine,
    ),
}
"""The plots of a machine's joints by file name, as figures 8 and 9 of the paper."""


_KIND = "joints"
_DISPLAYS = (
    MetricDisplay("position_error_m", "position error", 1e6, "µm"),
    MetricDisplay("settling_time_s", "settling time", 1e3, "ms"),
    MetricDisplay("torque_peak_N_m", "torque peak", 1.0, "N m"),
)

_MOST_NAMES = 80
"""Most names on the axis; of more joints only every n-th has its name."""

_LOGARITHMIC_RATIO = 30.0
"""Ratio of the largest to the smallest value from which on the scale is logarithmic."""


class JointMap(Drawing):
    """The metrics of all joints, if these are more than the other plots show."""

    def signals(self, result: Result) -> Iterable[str]:
        """Return nothing: it shows metrics."""
        return ()

    def drawn(self, result: Result, data: Mapping[str, Vector]) -> "Figure | None":
        """Draw a panel for each metric with a point for each joint; None if other plots show all joints."""
        joints = result.metrics.get(_KIND, {})
        if len(joints) <= MOST_COLUMNS:
            return None
        names = list(joints)
        has_verdict = np.array([item["reason"] != f"{TOO_SHORT}." for item in joints.values()])
        is_not_held = has_verdict & np.array([not item[HELD] for item in joints.values()])
        # room for the mark of each joint
        width = float(np.clip(0.14 * len(names), 6.0, 12.0))
        figure, grid = new_figure(len(_DISPLAYS), 1, width, 1.7)
        for axes, metric in zip(grid[:, 0], _DISPLAYS, strict=True):
            values = np.array([metric.factor * item[metric.name] for item in joints.values()])
            _draw_metric(axes, metric, values, is_not_held)
        interval = math.ceil(len(names) / _MOST_NAMES)
        grid[-1, 0].set_xticks(range(0, len(names), interval), names[::interval], rotation=90, fontsize=7)
        for label in grid[-1, 0].get_xticklabels():
            label.set_parse_math(False)
        verdict = "all are held" if has_verdict.all() else "the run is too short to judge them"
        if is_not_held.any():
            verdict = f"{int(is_not_held.sum())} not held, in red"
        figure.suptitle(f"All {len(names)} joints: {verdict}", fontsize=12, fontweight="bold")
        grid[0, 0].set_title(format_headline(result), fontsize=9, parse_math=False)
        return figure


def _draw_metric(axes: "Axes", metric: MetricDisplay, values: Vector, is_not_held: Any) -> None:
    """Draw the values that exist, those of joints that are not held in red."""
    numbers = np.arange(len(values))
    for mask, color in ((~is_not_held, BLUE), (is_not_held, RED)):
        axes.plot(numbers[mask], values[mask], "o", color=color, markersize=4.0)
    positive = values[np.isfinite(values) & (values > 0.0)]
    if len(positive) and positive.max() > _LOGARITHMIC_RATIO * positive.min() and not (values <= 0.0).any():
        axes.set_yscale("log")
    axes.set_ylabel(f"{metric.label} / {metric.unit}".replace("N m", "(N m)"))
    tidy_axes(axes)
