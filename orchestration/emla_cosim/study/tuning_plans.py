"""The tuning plans of the study: the gains of each controller and joint, with the same effort for all."""

import math
from collections.abc import Callable
from functools import partial
from importlib.resources import files
from string import Template
from typing import Any

from ..base.errors import CommandError
from .controllers import COMPLIANT, CONTROLLERS
from .joints.motions import resting_deflection
from .joints.schema import JointFile, has_tuning, list_joint_names, load_joint
from .systems import STUDY, joint_system

_RIGID = "damped"
"""The set of gains from which searches start for a rigid load; for one that is not, it is `COMPLIANT`."""

_BEHIND = {_RIGID: 0.010, COMPLIANT: 0.004}
"""Additional distance in m from its reference at which a joint starts in one case, by set of gains.

The planned approach of a load that is not rigid adds to the speed of the reference: with 0.010, tilt trips.
"""

_SOFT, _STIFF = 0.7, 1.3
"""Relative stiffnesses in the cases of tunings/load.toml."""


def list_tuning_plans() -> dict[str, Callable[[], str]]:
    """Return a function for the text of each plan, by controller and joint."""
    folder = files("emla_cosim.study") / "tunings"
    joints = [name for name in list_joint_names() if has_tuning(name)]
    controllers = [name for name in CONTROLLERS if (folder / f"{name}.toml").is_file()]
    rigid = {f"{c}-{joint}": partial(_text, c, joint, _RIGID) for c in controllers for joint in joints}
    return rigid | {
        f"{c}-{joint}-{COMPLIANT}": partial(_text, c, joint, COMPLIANT)
        for c in controllers
        for joint in joints
        if joint in STUDY
    }


def _text(controller: str, joint: str, gain_set: str) -> str:
    """Return a plan; `gain_set` is the set of gains from which its search starts."""
    folder, own = files("emla_cosim.study") / "tunings", load_joint(joint)
    is_compliant = gain_set == COMPLIANT
    names = ("effort", *(["load"] if is_compliant else []), controller)
    text = "\n".join((folder / f"{name}.toml").read_text(encoding="utf-8") for name in names)
    noisy = own.tuning.noisy if own.tuning is not None else {}
    gap = own.reference.q_S - own.start.x_L
    behind = math.copysign(_BEHIND[gain_set], own.reference.q_E - own.reference.q_S)
    return Template(text).substitute(
        _load_entries(own) if is_compliant else _rigid_entries(own, controller),
        joint=joint,
        controller=controller,
        gains=gain_set,
        observer="\n".join(
            f'"{joint}.observer.{n}" = "{rule}"' for n, rule in _observer(own, controller, gain_set)
        ),
        tau_max=own.emla.tau_max,
        inductance=own.emla.L_q,
        far=own.start.x_L - behind,
        distance=round(1e3 * abs(gap + behind)),
        middle=round(0.5 * own.reference.parameters()["duration"][0], 3),
        noisy="".join(f', "{joint}.{name}" = {value}' for name, value in noisy.items()),
    )


def _rigid_entries(own: JointFile, controller: str) -> dict[str, Any]:
    """Return the entries of a plan for a joint alone, with a realistic drive."""
    return {
        "load": "",
        "evaluations": 40,
        "scenario": own.name,
        "objective": f"{own.name}.position_error_m + 1e-3 * {own.name}.velocity_error_m_s",
        "convergence": f', "{own.name}.convergence_time_s < {_convergence(own)}"',
        "drive": _drive(own, controller),
    }


def _load_entries(own: JointFile) -> dict[str, Any]:
    """Return the entries of a plan for a joint of study-compliant; its approach is planned, so not judged."""
    load = own.compliant_load
    force = own.load.force_at_start(own.start.x_L, load)
    return {
        "load": " with a load that is not rigid",
        "evaluations": 28,  # margins in two cases take long
        "scenario": "study-compliant",
        "objective": f"{own.name}.load_position_error_m",
        "convergence": "",
        "drive": "",
        **{
            f"deflection_{name}": resting_deflection(force, factor * load.stiffness, load.backlash)
            for name, factor in (("soft", _SOFT), ("stiff", _STIFF))
        },
    }


def _drive(own: JointFile, controller: str) -> str:
    """Return what a realistic drive changes, as lines of TOML."""
    ideal, realistic = (joint_system(own, controller, _RIGID, drive=drive) for drive in (False, True))
    return "\n".join(
        f'"{component.name}.{name}" = {str(value).lower()}'
        for component in realistic.components
        for name, value in component.parameters.items()
        if ideal.component(component.name).parameters.get(name) != value
    )


def _observer(own: JointFile, controller: str, gain_set: str) -> list[tuple[str, str]]:
    """Return gains of the observer as expressions over alpha_1, so that all its poles are equal."""
    alpha_1 = f"{own.name}.observer.alpha_1"
    if own.gain_set(controller, gain_set).observer.gains.omega_r:
        return [
            ("alpha_2", f"0.375 * {alpha_1} ** 2"),
            ("omega_d", f"{alpha_1} / 6"),
            ("omega_r", f"{alpha_1} / 16"),
        ]
    return [("alpha_2", f"{alpha_1} ** 2 / 3"), ("omega_d", f"{alpha_1} / 9")]


def _convergence(joint: JointFile) -> float:
    """Return the convergence time in s to beat: that of the file, or what the paper prints for RSBA."""
    if joint.tuning is not None and joint.tuning.convergence_time is not None:
        return joint.tuning.convergence_time
    printed = joint.printed.get("study", {})
    if "rsba" not in printed:
        raise CommandError(
            f"{joint.label} lacks a convergence time to beat; write convergence_time = 0.085 (s) in [tuning]."
        )
    return printed["rsba"].convergence_time_s
