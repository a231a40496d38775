"""The tuning plans of the study: the gains of each controller and joint, with the same effort for all."""

import math
from collections.abc import Callable
from functools import partial
from string import Template
from typing import Any

from ..base.errors import CommandError
from .controllers import COMPLIANT, CONTROLLERS
from .joints.motions import resting_deflection
from .joints.schema import JointFile, has_tuning, list_joint_names, load_joint
from .packaged_files import list_packaged_names, read_packaged_text
from .systems import STUDY, joint_system

_RIGID = "damped"
"""The set of gains from which searches start for a rigid load; for one that is not, it is `COMPLIANT`."""

_START_DISTANCE = {_RIGID: 0.010, COMPLIANT: 0.004}
"""Additional distance in m from its reference at which a joint starts in one case, by set of gains.

The planned approach of a load that is not rigid adds to the speed of the reference: with 0.010, tilt trips.
"""

_SOFT, _STIFF = 0.7, 1.3
"""Relative stiffnesses in the cases of tunings/load.toml."""


def list_tuning_plans() -> dict[str, Callable[[], str]]:
    """Return a function for the text of each plan, by controller and joint."""
    joints = [name for name in list_joint_names() if has_tuning(name)]
    controllers = [name for name in CONTROLLERS if name in list_packaged_names("tunings")]
    rigid = {f"{c}-{joint}": partial(_build_plan, c, joint, _RIGID) for c in controllers for joint in joints}
    return rigid | {
        f"{c}-{joint}-{COMPLIANT}": partial(_build_plan, c, joint, COMPLIANT)
        for c in controllers
        for joint in joints
        if joint in STUDY
    }


def _build_plan(controller: str, joint: str, gain_set: str) -> str:
    """Return the text of a plan; `gain_set` is the set of gains from which its search starts."""
    joint_file = load_joint(joint)
    is_compliant = gain_set == COMPLIANT
    names = ("effort", *(["load"] if is_compliant else []), controller)
    text = "\n".join(read_packaged_text("tunings", name) for name in names)
    noise = joint_file.tuning.noisy if joint_file.tuning is not None else {}
    gap = joint_file.reference.q_S - joint_file.start.x_L
    distance = math.copysign(_START_DISTANCE[gain_set], joint_file.reference.q_E - joint_file.reference.q_S)
    return Template(text).substitute(
        _build_load_entries(joint_file) if is_compliant else _build_rigid_entries(joint_file, controller),
        joint=joint,
        controller=controller,
        gains=gain_set,
        observer="\n".join(
            f'"{joint}.observer.{n}" = "{rule}"'
            for n, rule in _list_observer_rules(joint_file, controller, gain_set)
        ),
        tau_max=joint_file.emla.tau_max,
        inductance=joint_file.emla.L_q,
        far=joint_file.start.x_L - distance,
        distance=round(1e3 * abs(gap + distance)),
        middle=round(0.5 * joint_file.reference.parameters()["duration"][0], 3),
        noisy="".join(f', "{joint}.{name}" = {value}' for name, value in noise.items()),
    )


def _build_rigid_entries(joint_file: JointFile, controller: str) -> dict[str, Any]:
    """Return the entries of a plan for a joint alone, with a realistic drive."""
    return {
        "load": "",
        "evaluations": 40,
        "scenario": joint_file.name,
        "objective": f"{joint_file.name}.position_error_m + 1e-3 * {joint_file.name}.velocity_error_m_s",
        "convergence": f', "{joint_file.name}.convergence_time_s < {_get_convergence_time(joint_file)}"',
        "drive": _format_drive_changes(joint_file, controller),
    }


def _build_load_entries(joint_file: JointFile) -> dict[str, Any]:
    """Return the entries of a plan for a joint of study-compliant; its approach is planned, so not judged."""
    load = joint_file.compliant_load
    force = joint_file.load.force_at_start(joint_file.start.x_L, load)
    return {
        "load": " with a load that is not rigid",
        "evaluations": 28,  # margins in two cases take long
        "scenario": "study-compliant",
        "objective": f"{joint_file.name}.load_position_error_m",
        "convergence": "",
        "drive": "",
        **{
            f"deflection_{name}": resting_deflection(force, factor * load.stiffness, load.backlash)
            for name, factor in (("soft", _SOFT), ("stiff", _STIFF))
        },
    }


def _format_drive_changes(joint_file: JointFile, controller: str) -> str:
    """Return what a realistic drive changes, as lines of TOML."""
    ideal, realistic = (joint_system(joint_file, controller, _RIGID, drive=drive) for drive in (False, True))
    return "\n".join(
        f'"{component.name}.{name}" = {str(value).lower()}'
        for component in realistic.components
        for name, value in component.parameters.items()
        if ideal.component(component.name).parameters.get(name) != value
    )


def _list_observer_rules(joint_file: JointFile, controller: str, gain_set: str) -> list[tuple[str, str]]:
    """Return gains of the observer as expressions over alpha_1, so that all its poles are equal."""
    alpha_1 = f"{joint_file.name}.observer.alpha_1"
    if joint_file.gain_set(controller, gain_set).observer.gains.omega_r:
        return [
            ("alpha_2", f"0.375 * {alpha_1} ** 2"),
            ("omega_d", f"{alpha_1} / 6"),
            ("omega_r", f"{alpha_1} / 16"),
        ]
    return [("alpha_2", f"{alpha_1} ** 2 / 3"), ("omega_d", f"{alpha_1} / 9")]


def _get_convergence_time(joint: JointFile) -> float:
    """Return the convergence time in s to beat: that of the file, or what the paper prints for RSBA."""
    if joint.tuning is not None and joint.tuning.convergence_time is not None:
        return joint.tuning.convergence_time
    printed = joint.printed.get("study", {})
    if "rsba" not in printed:
        raise CommandError(
            f"{joint.label} lacks a convergence time to beat; write convergence_time = 0.085 (s) in [tuning]."
        )
    return printed["rsba"].convergence_time_s
