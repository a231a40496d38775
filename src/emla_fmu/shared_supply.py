"""The DC link that the inverters of several joints share: a capacitor, its source, and a brake chopper."""

import math
from typing import Any

from fmublock import (
    Block,
    DefaultExperiment,
    Input,
    Output,
    Parameter,
    State,
    clamp,
    maximum,
    minimum,
    sqrt,
)

JOINTS = 8
"""Largest number of joints on a supply."""

_ROOT_3 = math.sqrt(3.0)


class SharedSupply(Block):
    """A DC link with a rectifier, a capacitor and a brake chopper, shared by the inverters of up to 8 joints.

    Electrical powers of the joints in, missing fractions of their voltages out. What one joint returns feeds
    the others, then charges the capacitor; above a voltage, the chopper burns it. The rectifier does not
    return energy. Energies are states, so that their balance is exact.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-4)

    P_el = Input(
        shape=JOINTS,
        unit="W",
        nominal=1e3,
        name="joint.P_el",
        symbol="P_i",
        description="Electrical power of a joint; negative where it returns energy",
    )
    sag_joint = Input(
        shape=JOINTS,
        name="joint.sag",
        symbol=r"\sigma_i",
        description="Fraction of a joint's voltage that lacks for another reason",
    )

    u_max = Parameter(
        445.0,
        shape=JOINTS,
        unit="V",
        minimum=1e-3,
        name="joint.u_max",
        symbol="u_{max,i}",
        description="Longest voltage vector of a joint's inverter",
    )
    C = Parameter(2e-3, unit="F", minimum=1e-9, name="link.C", description="Capacitance")
    u_start = Parameter(
        770.8, unit="V", minimum=1e-3, name="link.u_start", symbol="u_S", description="Voltage at the start"
    )
    u_low = Parameter(
        400.0,
        unit="V",
        minimum=0.0,
        name="link.u_low",
        description="Lowest permitted voltage; drives of this class trip there",
    )
    u_high = Parameter(
        1000.0,
        unit="V",
        minimum=0.0,
        name="link.u_high",
        description="Highest permitted voltage; drives of this class trip there",
    )
    u_0 = Parameter(
        770.8, unit="V", minimum=1e-3, name="source.u_0", description="Voltage of the rectifier without load"
    )
    R = Parameter(
        0.3,
        unit="Ohm",
        minimum=1e-6,
        name="source.R",
        description="Resistance of mains, rectifier and choke, at the link",
    )
    u_on = Parameter(
        880.0,
        unit="V",
        minimum=1e-3,
        name="chopper.u_on",
        symbol="u_{on}",
        description="Voltage above which the chopper burns energy",
    )
    band = Parameter(
        10.0,
        unit="V",
        minimum=1e-3,
        name="chopper.band",
        symbol=r"\Delta u",
        description="Rise of the voltage from there to the full power of the chopper",
    )
    R_chopper = Parameter(
        20.0,
        unit="Ohm",
        minimum=1e-6,
        name="chopper.R",
        symbol="R_C",
        description="Resistance of the brake resistor",
    )

    stored = State(
        0.0,
        unit="J",
        nominal=100.0,
        name="link.stored",
        symbol="E",
        description="Energy that the capacitor gained since the start",
    )
    supplied = State(
        0.0, unit="J", nominal=1e3, name="source.energy", symbol="E_0", description="Energy from the source"
    )
    lost = State(
        0.0,
        unit="J",
        nominal=100.0,
        name="source.loss",
        symbol="E_R",
        description="Part of it that its resistance takes",
    )
    burnt = State(
        0.0, unit="J", nominal=100.0, name="chopper.energy", symbol="E_C", description="Energy of the chopper"
    )
    drawn = State(
        0.0,
        unit="J",
        nominal=1e3,
        name="joint.drawn",
        symbol="E_+",
        description="Energy that joints took while they took power",
    )
    returned = State(
        0.0,
        unit="J",
        nominal=100.0,
        name="joint.returned",
        symbol="E_-",
        description="Energy that joints returned while they returned power",
    )

    u = Output(
        unit="V", nominal=500.0, limits=(u_low, u_high), name="link.u", description="Voltage of the link"
    )
    sag = Output(
        shape=JOINTS,
        name="supply.sag",
        symbol=r"\sigma_{u,i}",
        description="Missing fraction of the voltage of a joint's inverter",
    )
    P_source = Output(
        unit="W", nominal=1e3, name="source.P", symbol="P_0", description="Power from the source"
    )
    P_chopper = Output(
        unit="W", nominal=1e3, name="chopper.P", symbol="P_C", description="Power that the chopper burns"
    )

    def conditions(self, v: Any) -> dict[str, Any]:
        """Require a chopper that does not burn energy of the source."""
        return {"chopper.u_on must be above source.u_0, or the source heats the chopper": v.u_on > v.u_0}

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Return all powers."""
        current, burnt = source_current(v), chopper_power(v)
        drawn = returned = 0.0
        for power in v.P_el:
            drawn += maximum(power, 0.0)
            returned += maximum(-power, 0.0)
        supplied, lost = v.u_0 * current, v.R * current * current
        return {
            "stored": supplied - lost - burnt - drawn + returned,
            "supplied": supplied,
            "lost": lost,
            "burnt": burnt,
            "drawn": drawn,
            "returned": returned,
        }

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return voltage, powers, and what lacks of the voltages of the inverters."""
        u = link_voltage(v)
        lacking = [1.0 - minimum(u / (_ROOT_3 * u_max), 1.0) for u_max in v.u_max]
        return {
            "u": u,
            "sag": [a + b - a * b for a, b in zip(lacking, v.sag_joint, strict=True)],
            "P_source": v.u_0 * source_current(v),
            "P_chopper": chopper_power(v),
        }


def link_voltage(v: Any) -> Any:
    """Return the voltage of the capacitor in V."""
    return sqrt(maximum(v.u_start * v.u_start + 2.0 * v.stored / v.C, 0.0))


def source_current(v: Any) -> Any:
    """Return the current of the rectifier in A, which only flows into the link."""
    return maximum(v.u_0 - link_voltage(v), 0.0) / v.R


def chopper_power(v: Any) -> Any:
    """Return the mean power of the chopper in W: its duty grows from 0 to 1 over a band of the voltage."""
    u = link_voltage(v)
    return clamp((u - v.u_on) / v.band, 0.0, 1.0) * u * u / v.R_chopper
