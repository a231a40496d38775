"""Losses of gearbox and screw in a cycle, and what another convention for them would change."""

from dataclasses import dataclass

from .cycle import Cycle
from .limits import format_value
from .plant import JointPlant

_DIVIDE = "divide the load by the efficiency in both directions, as the paper prints"
_OPPOSE = "oppose the motion"


@dataclass(frozen=True)
class Losses:
    """Losses of gearbox and screw that the figures contain.

    Attributes:
        convention: What they do in the plant.
        torque_rms_N_m: Rms torque over the cycle.
        other_convention: What else they could do; None if the plant does not state its own.
        other_torque_rms_N_m: Rms torque over the same motion with the other convention.
        setting: Value for `--set` that chooses the other convention; None if the plant does not offer it.
    """

    convention: str
    torque_rms_N_m: float
    other_convention: str | None = None
    other_torque_rms_N_m: float | None = None
    setting: str | None = None

    @property
    def sentence(self) -> str:
        """Which losses were used, and the effect of the other convention; without full stop."""
        text = f"the losses of gearbox and screw {self.convention}"
        if self.other_torque_rms_N_m is None:
            return text
        condition = f"with --set {self.setting}" if self.setting else "if"
        other, rms = format_value(self.other_torque_rms_N_m), format_value(self.torque_rms_N_m)
        return (
            f"{text}; {condition} they {self.other_convention}: rms torque {other} N m instead of {rms} N m"
        )


def describe_losses(cycle: Cycle, plant: JointPlant) -> Losses:
    """Return the losses of a cycle.

    Args:
        cycle: The cycle.
        plant: The plant of its joint.
    """
    rms = cycle.rms(cycle.torque)
    if "eta_GB" not in plant.names:
        return Losses("are those of its FMU, which has no gearbox.eta_GB", rms)
    directional = plant.values["directional"]
    if plant.values["eta_GB"] == 1.0 and plant.values["eta_back"] in (0.0, 1.0):
        return Losses(f"are none: {plant.names['eta_GB']} is 1", rms)
    used, other = (plant.load_torque(cycle.v, cycle.load, x) for x in (directional, 1.0 - directional))
    conventions = (_OPPOSE, _DIVIDE) if directional else (_DIVIDE, _OPPOSE)
    name = plant.names.get("directional")
    return Losses(
        conventions[0],
        rms,
        conventions[1],
        cycle.rms(cycle.torque + other - used),
        None if name is None else f"{name}={'false' if directional else 'true'}",
    )
