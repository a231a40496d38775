"""The winding of a motor as one thermal body: its data, and its temperature over a cycle that repeats."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from ...base.arrays import Vector
from ...base.errors import join_names
from . import thermal
from .cycle import Cycle
from .plant import JointPlant


@dataclass(frozen=True)
class Winding:
    """Thermal data of a winding.

    Attributes:
        i_N: Current (peak) that leads to the permitted rise in A.
        permitted_rise: Permitted temperature rise in K.
        tau_th: Thermal time constant in s.
        trip_rise: Rise in K beyond which a joint trips.
        source: Entry or parameter with the permitted rise.
    """

    i_N: float
    permitted_rise: float
    tau_th: float
    trip_rise: float
    source: str

    def load(self, cycle: Cycle) -> Vector:
        """Return the copper loss relative to that of i_N, as the plant's `motor.load`."""
        return (cycle.current / self.i_N) ** 2

    def rise(self, cycle: Cycle) -> Vector:
        """Return the temperature rise in K over the cycle once it has repeated for ever."""
        return thermal.repeat_cycle(cycle.time, self.load(cycle), self.permitted_rise, self.tau_th)


def find_winding(plant: JointPlant, values: Mapping[str, float], over_temperature: float) -> Winding | str:
    """Return the thermal data of the plant, else of the data sheet; without any, what is missing.

    Args:
        plant: The plant.
        values: Entries of the data sheet, in SI units and peak values.
        over_temperature: Fraction beyond the permitted rise at which a joint trips.
    """
    entry, data = "thermal.permitted_rise", ("i_N", "permitted_rise", "tau_th")
    if plant.values["i_N"] > 0.0 and all(name in plant.names for name in data):
        i_N, rise, tau = (plant.values[name] for name in data)
        source = entry if values.get(entry) == rise else plant.names["permitted_rise"]
        return Winding(i_N, rise, tau, (1.0 + over_temperature) * rise, source)
    if entry in values:
        i_N, rise, tau = (values[name] for name in ("motor.i_N", entry, "thermal.tau_th"))
        return Winding(i_N, rise, tau, (1.0 + over_temperature) * rise, entry)
    names = [plant.names[name] for name in data if name in plant.names]
    return f"[thermal] in the data sheet{f', or --set of {join_names(names)}' if names else ''}"


def warm_up(cycle: Cycle, plant: JointPlant, rise: Vector) -> Cycle:
    """Return the cycle with the copper loss and the resistance of the warm winding.

    Args:
        cycle: The cycle, with the loss of the temperature that the winding had in the run.
        plant: The plant; its resistance grows with `motor.alpha_R`.
        rise: Temperature rise in K of the repeated cycle.
    """
    emla, alpha_R = cycle.emla, plant.values["alpha_R"]
    loss = 1.5 * emla.R_s * alpha_R * (rise - cycle.rise) * cycle.current**2
    hot = replace(emla, R_s=emla.R_s * (1.0 + alpha_R * float(rise.max())))
    return replace(cycle, P_el=cycle.P_el + loss, emla=hot)
