"""The tunings of the study: for each controller and joint its gains, with the same effort for all."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from string import Template

from emla_fmu.parameters import EMLAS

from .controllers import CONTROLLERS

_BEHIND = 0.010
"""So much farther from its reference than in the study a joint starts in one case, in m."""


@dataclass(frozen=True)
class _Joint:
    """RSBA's convergence time in s (Table VI), a start from afar in m, and what noise is tried with."""

    convergence: float
    far: float
    noisy: str = ""


_JOINTS = {
    "lift": _Joint(0.083, 0.240 - _BEHIND),
    "tilt": _Joint(0.085, 0.385 - _BEHIND),
    # 0.20 m/s: the study's 0.21 m/s are the limit itself, which noise crosses
    "telescope": _Joint(0.086, 0.500 + _BEHIND, ', "telescope.reference.move.duration[1]" = 1.4156'),
}


def tuning_plans() -> dict[str, Callable[[], str]]:
    """What reads the text of each plan, by controller and joint; of controllers whose gains have a file."""
    folder = files("emla_cosim.study") / "tunings"
    return {
        f"{controller}-{joint}": partial(_text, controller, joint)
        for controller in CONTROLLERS
        if (folder / f"{controller}.toml").is_file()
        for joint in _JOINTS
    }


def _text(controller: str, joint: str) -> str:
    folder, known, tau_max = files("emla_cosim.study") / "tunings", _JOINTS[joint], EMLAS[joint].tau_max
    text = "\n".join((folder / f"{name}.toml").read_text(encoding="utf-8") for name in ("effort", controller))
    return Template(text).substitute(
        joint=joint,
        controller=controller,
        gains=CONTROLLERS[controller].recommended,
        tau_max=tau_max,
        inductance=EMLAS[joint].L_q,
        paper_convergence=known.convergence,
        far=known.far,
        noisy=known.noisy,
    )
