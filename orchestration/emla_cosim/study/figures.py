"""The plots of joints, and of those that move a machine together."""

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
    """Find a variable as `find_variable` does; the commanded motion only if it is not the reference."""
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
    """Find a variable as `find_variable` does, if joints move a machine together."""
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
