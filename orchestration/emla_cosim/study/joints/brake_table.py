"""The holding brake of a joint, as a table of its file."""

from itertools import pairwise
from typing import Annotated, Any

import msgspec

from emla_fmu.holding_brake import PHASES
from emla_fmu.schedule import NEVER

from ...base.toml_structs import quantity

_TIME = Annotated[float, quantity("s", "time of a hold phase", 2.0, ge=0.0)]


class Brake(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A holding brake at the motor shaft: its torque there, its delays, and the phases in which it holds.

    The brake gets the command to close at the start of a phase, and is open at its end.
    """

    torque: Annotated[float, quantity("N.m", "torque at the motor up to which the brake holds", 60.0, gt=0.0)]
    engage_delay: Annotated[float, quantity("s", "time until the brake holds", 0.05, ge=0.0)] = 0.05
    release_delay: Annotated[float, quantity("s", "time until the brake is open", 0.1, ge=0.0)] = 0.1
    phases: tuple[tuple[_TIME, _TIME], ...]

    def __post_init__(self) -> None:
        """Check number, order and length of the phases."""
        if not 1 <= len(self.phases) <= PHASES:
            raise ValueError(f"has {len(self.phases)} phases; it must have 1 to {PHASES}.")
        delays = self.engage_delay + self.release_delay
        for start, end in self.phases:
            if not end - start > delays:
                raise ValueError(
                    f"has the phase from {start:g} to {end:g} s; it must be longer than both delays, "
                    f"{delays:g} s."
                )
        for (_, end), (start, _) in pairwise(self.phases):
            if start < end:
                raise ValueError(f"has a phase from {start:g} s on after one to {end:g} s; sort them.")

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of `HoldingBrake`, by attribute."""
        padding = [NEVER] * (PHASES - len(self.phases))
        return {
            "start": [*(start for start, _ in self.phases), *padding],
            "end": [*(end for _, end in self.phases), *padding],
            "engage_delay": self.engage_delay,
            "release_delay": self.release_delay,
        }
