"""The tuning plans of the study: the gains of each controller and joint, with the same effort for all."""

import math
from collections.abc import Callable
from functools import partial
from importlib.resources import files
from string import Template

from ..base.errors import CommandError
from .controllers import CONTROLLERS
from .joints.schema import JointFile, has_tuning, list_joint_names, load_joint
from .systems import joint_system

_SET = "damped"
"""The set of gains from which each search starts."""

_BEHIND = 0.010
"""Additional distance in m from its reference at which a joint starts in one case."""


def list_tuning_plans() -> dict[str, Callable[[], str]]:
    """Return a function for the text of each plan, by controller and joint."""
    folder = files("emla_cosim.study") / "tunings"
    joints = [name for name in list_joint_names() if has_tuning(name)]
    return {
        f"{controller}-{joint}": partial(_text, controller, joint)
        for controller in CONTROLLERS
        if (folder / f"{controller}.toml").is_file()
        for joint in joints
    }


def _text(controller: str, joint: str) -> str:
    folder, known = files("emla_cosim.study") / "tunings", load_joint(joint)
    text = "\n".join((folder / f"{name}.toml").read_text(encoding="utf-8") for name in ("effort", controller))
    noisy = known.tuning.noisy if known.tuning is not None else {}
    behind = math.copysign(_BEHIND, known.reference.q_E - known.reference.q_S)
    return Template(text).substitute(
        joint=joint,
        controller=controller,
        drive=_drive(known, controller),
        observer="\n".join(f'"{joint}.observer.{n}" = "{rule}"' for n, rule in _observer(known, controller)),
        tau_max=known.emla.tau_max,
        inductance=known.emla.L_q,
        paper_convergence=_convergence(known),
        far=known.start.x_L - behind,
        middle=round(0.5 * known.reference.parameters()["duration"][0], 3),
        noisy="".join(f', "{joint}.{name}" = {value}' for name, value in noisy.items()),
    )


def _drive(known: JointFile, controller: str) -> str:
    """Return what a realistic drive changes, as lines of TOML."""
    usual, realistic = (joint_system(known, controller, _SET, drive=drive) for drive in (False, True))
    return "\n".join(
        f'"{component.name}.{name}" = {str(value).lower()}'
        for component in realistic.components
        for name, value in component.parameters.items()
        if usual.component(component.name).parameters.get(name) != value
    )


def _observer(known: JointFile, controller: str) -> list[tuple[str, str]]:
    """Return gains of the observer as expressions over alpha_1, so that all its poles are equal."""
    alpha_1 = f"{known.name}.observer.alpha_1"
    if known.gain_set(controller, _SET).observer.gains.omega_r:
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
