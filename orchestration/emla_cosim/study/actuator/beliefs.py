"""What observer and controller believe of a plant, and whether somebody changed one of both alone."""

from collections.abc import Iterator

from ...errors import listed
from ...options import Options
from ...patterns import fits
from ...system.model import System
from ..roles import JOINTS

_BOTH, _CONTROLLER = ("controller", "observer"), ("controller",)

_INERTIA = (("model.A_eq", _BOTH),)
_GEAR = (("model.alpha_RL", _CONTROLLER), *_INERTIA, ("model.B_eq", _BOTH))

_BELIEFS: dict[str, tuple[tuple[str, tuple[str, ...]], ...]] = {
    "motor.R_s": (("model.R_s", _CONTROLLER),),
    "motor.L_d": (("model.L_d", _CONTROLLER),),
    "motor.L_q": (("model.L_q", _CONTROLLER),),
    "motor.Phi_PM": (("model.Phi_PM", _BOTH),),
    "motor.N_p": (("model.N_p", _BOTH),),
    "motor.B_m": (("model.B_eq", _BOTH),),
    "screw.B_BS": (("model.B_eq", _BOTH),),
    "screw.C_eq": (("model.C_eq", _CONTROLLER),),
    "inverter.u_max": (("limit.u_max", _CONTROLLER),),
    "screw.v_max": (("limit.v_max", _CONTROLLER),),
    **dict.fromkeys(("motor.J_m", "coupling.J_c", "gearbox.J_GB", "screw.M_BS"), _INERTIA),
    **dict.fromkeys(("gearbox.rho", "screw.lead"), _GEAR),
}
"""Parameters of a plant, and what of the models as known follows from each."""


def one_sided(system: System, options: Options) -> Iterator[str]:
    """Sentences, without their stops, on values set in a plant while what is believed of it stays."""
    present = {c.name: c.parameters for c in system.components if c.name not in options.replace}
    for joint in dict.fromkeys(name.partition(".")[0] for name in present):
        changed, stale = list[str](), dict[str, None]()
        for parameter, beliefs in _BELIEFS.items():
            names = [n for n in _names(joint, parameter) if any(fits(n, key) for key in options.set)]
            believed = [
                f"{joint}.{who}.{belief}"
                for belief, whose in beliefs
                for who in whose
                if belief in present.get(f"{joint}.{who}", {})
            ]
            left = [name for name in believed if not any(fits(name, key) for key in options.set)]
            if names and left and any(_is_there(name, system) for name in names):
                changed += [name for name in names if _is_there(name, system)]
                stale |= dict.fromkeys(left)
        if changed:
            yield (
                f"{listed(changed)} {'is' if len(changed) == 1 else 'are'} set, but {listed(stale)} stay "
                f"as they were; --actuator {joint}=FILE changes plant, observer and controller alike"
            )


def _names(joint: str, parameter: str) -> list[str]:
    """Where a plant's parameter may be for a joint."""
    found = [f"{joint}.plant.{parameter}", f"{joint}.motor.{parameter}"]
    if joint in JOINTS:
        found.append(f"machine.plant.{parameter}[{JOINTS.index(joint) + 1}]")
    return found


def _is_there(name: str, system: System) -> bool:
    return any(name.removeprefix(f"{c.name}.") in c.parameters for c in system.components)
