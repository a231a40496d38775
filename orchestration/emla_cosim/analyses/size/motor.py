"""The motor: its torque over speed, and its winding as one thermal body over a cycle that repeats.

Arguments are in SI units. Arrays have a value for each motor speed, or for each time of the cycle. `load` is
the copper loss relative to that of the rated current, `rise` the temperature rise, `permitted_rise` that at
the rated current, and `tau_th` the thermal time constant.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from emla_fmu.parameters import EmlaParameters

from ...base.arrays import Vector
from ...base.errors import join_names
from ...study.actuator.derived import torque_per_current
from .cycle import Cycle, JointPlant


def peak_torque(emla: EmlaParameters, speed: Vector) -> Vector:
    """Return the largest torque in N m at each motor speed, from tau_max and the voltage, with i_d = 0."""
    omega = emla.N_p * np.abs(speed)
    a = emla.R_s**2 + (omega * emla.L_q) ** 2
    b, c = emla.R_s * omega * emla.Phi_PM, (omega * emla.Phi_PM) ** 2 - emla.u_max**2
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    # |u| = u_max is a quadratic equation of i_q; its larger root, and 0 where the voltage is used up
    current = np.maximum((root - b) / np.maximum(a, 1e-300), 0.0)
    # below the base speed the current limits the torque, above it the voltage
    return np.minimum(1.5 * emla.N_p * emla.Phi_PM * current, emla.tau_max)


def continuous_torque(values: Mapping[str, float], speed: Vector) -> Vector | None:
    """Return the continuous torque in N m at each motor speed; None if the data sheet does not have it.

    The curve is a straight line from tau_N, or the torque of i_N, through tau_R at n_R. Without these it is
    constant.
    """
    stall = values.get("motor.tau_N")
    if stall is None and "motor.i_N" in values:
        stall = torque_per_current(values) * values["motor.i_N"]
    if stall is None:
        return None
    slope = (values["motor.tau_R"] - stall) / values["motor.n_R"] if "motor.tau_R" in values else 0.0
    return np.maximum(stall + min(slope, 0.0) * np.abs(speed), 0.0)


def heat(time: Vector, load: Vector, permitted_rise: float, tau_th: float, start: float = 0.0) -> Vector:
    """Return the temperature rise in K over a cycle.

    The solution of d rise / dt = (load * permitted_rise - rise) / tau_th is exact for a load that is linear
    between its values; `start` is the rise at the first time.
    """
    steps = np.diff(time) / tau_th
    decay, gained = np.exp(-steps), -np.expm1(-steps)
    # integral of exp(s - step) times the share of the second value, by series for short steps
    share = np.where(steps > 1e-4, 1.0 - gained / np.maximum(steps, 1e-300), 0.5 * steps - steps**2 / 6.0)
    targets = permitted_rise * load
    gains = (gained - share) * targets[:-1] + share * targets[1:]
    rises, rise = [start], start
    for part, gain in zip(decay.tolist(), gains.tolist(), strict=True):
        rise = part * rise + gain
        rises.append(rise)
    return np.array(rises)


def repeat_cycle(time: Vector, load: Vector, permitted_rise: float, tau_th: float) -> Vector:
    """Return the temperature rise in K over a cycle that has repeated permanently: it ends as it begins.

    The rise at the end is linear in that at the start, so the start follows in closed form.
    """
    cold = heat(time, load, permitted_rise, tau_th)[-1]
    # the rise at the start decays over the cycle, and must be what it was at its end
    start = float(cold) / -math.expm1(-(time[-1] - time[0]) / tau_th)
    return heat(time, load, permitted_rise, tau_th, start)


def cycles_until_warm(period: float, tau_th: float) -> int:
    """Return the number of cycles after which a cold motor has 95 % of its final rise."""
    return max(math.ceil(-math.log1p(-0.95) * tau_th / period), 1)


def time_until_rise(time: Vector, rise: Vector, tau_th: float, threshold: float) -> float:
    """Return the time in s from cold after which a repeated cycle exceeds a rise; infinity if it never does.

    A cold motor differs from a warm one, whose `rise` is given, by the rise at the start, which decays.
    """
    rows = rise > threshold
    if not rows.any():
        return math.inf
    phase, period = (time - time[0])[rows], time[-1] - time[0]
    decayed = tau_th * np.log(rise[0] / (rise[rows] - threshold))
    cycles = np.maximum(np.ceil((decayed - phase) / period), 0.0)
    return float((phase + cycles * period).min())


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
        """Return the temperature rise in K over the cycle once it has repeated permanently."""
        return repeat_cycle(cycle.time, self.load(cycle), self.permitted_rise, self.tau_th)


def find_winding(plant: JointPlant, values: Mapping[str, float], over_temperature: float) -> Winding | str:
    """Return the thermal data of the plant, else of the data sheet; without any, what is missing.

    A joint trips at the fraction `over_temperature` beyond the permitted rise.
    """
    entry, data = "thermal.permitted_rise", ("i_N", "permitted_rise", "tau_th")
    if plant.values["i_N"] > 0.0 and all(name in plant.names for name in data):
        i_N, rise, tau = (plant.values[name] for name in data)
        source = entry if values.get(entry) == rise else plant.names["permitted_rise"]
    elif entry in values:
        i_N, rise, tau = (values[name] for name in ("motor.i_N", entry, "thermal.tau_th"))
        source = entry
    else:
        names = [plant.names[name] for name in data if name in plant.names]
        return f"[thermal] in the data sheet{f', or --set of {join_names(names)}' if names else ''}"
    return Winding(i_N, rise, tau, (1.0 + over_temperature) * rise, source)


def warm_up(cycle: Cycle, plant: JointPlant, rise: Vector) -> Cycle:
    """Return the cycle with copper loss and resistance of the winding at `rise`, not at that of the run."""
    emla, alpha_R = cycle.emla, plant.values["alpha_R"]
    # the run had the resistance at its own temperature already
    loss = 1.5 * emla.R_s * alpha_R * (rise - cycle.rise) * cycle.current**2
    hot = replace(emla, R_s=emla.R_s * (1.0 + alpha_R * float(rise.max())))
    return replace(cycle, P_el=cycle.P_el + loss, emla=hot)
