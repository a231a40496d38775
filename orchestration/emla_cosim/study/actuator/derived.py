"""Parameters of plant, observer and controller that follow from an actuator's entries.

Functions take `Values`: entries by "table.key", in SI units, currents and voltages as peak values of a
phase. Optional entries may be missing.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from emla_fmu.parameters import EmlaParameters

from .entries import ROOT_3, TURN

Values = Mapping[str, float]

PLANT_ATTRIBUTES = {
    "sensor.sigma": "sigma",
    "sensor.sigma_i": "sigma_i",
    "sensor.resolution_i": "resolution_i",
    "inverter.delay": "delay",
    "inverter.dead_time": "dead_time",
    "inverter.f_PWM": "f_PWM",
    "inverter.i_0": "i_0",
    "friction.F_C": "F_C",
    "friction.F_S": "F_S",
    "friction.v_S": "v_S",
    "friction.v_0": "v_0",
    "friction.eta_back": "eta_back",
    "stop.stiffness": "stop_stiffness",
    "stop.damping": "stop_damping",
    "thermal.tau_th": "tau_th",
    "thermal.permitted_rise": "permitted_rise",
}
"""Entries that are parameters of the plant, by its attributes."""

# the rest is for disturbances
BRAKING_SHARE = 0.25
"""Share of the spare braking torque that `a_max` uses; the rest is for disturbances."""


def pole_pairs(v: Values) -> int:
    """Return N_p."""
    return round(v["motor.N_p"] if "motor.N_p" in v else v["motor.poles"] / 2.0)


def fluxes(v: Values) -> dict[str, float]:
    """Return Phi_PM in Wb by constant: 1.5 N_p Phi_PM i_q is torque, N_p Phi_PM omega_m is back-EMF."""
    values = {}
    # first, because torque moves the load: `flux` takes the first one
    if "motor.kT" in v:
        values["kT"] = v["motor.kT"] / (1.5 * pole_pairs(v))
    if "motor.K_E" in v:
        values["K_E"] = v["motor.K_E"] / pole_pairs(v)
    return values


def flux(v: Values) -> float:
    """Return Phi_PM in Wb, from the torque constant if there is one, since torque moves the load."""
    return next(iter(fluxes(v).values()))


def torque_per_current(v: Values) -> float:
    """Return 1.5 N_p Phi_PM, in N m per A of i_q."""
    return 1.5 * pole_pairs(v) * flux(v)


def voltage(v: Values) -> float:
    """Return u_max in V: the limit of linear modulation of the DC link, or a supply phase's peak voltage."""
    if "inverter.U_DC" in v:
        return v["inverter.U_DC"] / ROOT_3
    return v["inverter.U_supply"] if "inverter.U_supply" in v else v["inverter.u_max"]


def torques(v: Values) -> Iterator[tuple[str, float]]:
    """Yield what limits the motor's torque, with the limit in N m."""
    per_current = torque_per_current(v)
    if "motor.tau_max" in v:
        yield "motor.tau_max", v["motor.tau_max"]
    for name in ("motor.i_max", "inverter.i_max"):
        if name in v:
            yield name, per_current * v[name]


def speeds(v: Values) -> Iterator[tuple[str, float]]:
    """Yield what limits the screw's speed, with the limit in m/s."""
    yield "motor.n_max", v["motor.n_max"] * ratio(v) * v["screw.lead"] / TURN
    if "screw.v_max" in v:
        yield "screw.v_max", v["screw.v_max"]


def ratio(v: Values) -> float:
    """Return rho: turns of the screw per turn of the motor."""
    return 1.0 / v.get("gearbox.ratio", 1.0)


def emla(v: Values) -> EmlaParameters:
    """Return the parameters that plant, observer and controller share."""
    rho, q_LB, L = ratio(v), v.get("screw.q_LB", 0.0), v.get("motor.L", math.nan)
    return EmlaParameters(
        R_s=v["motor.R"],
        L_d=v.get("motor.L_d", L),
        L_q=v.get("motor.L_q", L),
        Phi_PM=flux(v),
        N_p=pole_pairs(v),
        J_m=v["motor.J_m"],
        tau_max=min(torque for _, torque in torques(v)),
        rho=rho,
        lead=v["screw.lead"],
        M_BS=v["screw.M_BS"],
        u_max=voltage(v),
        q_LB=q_LB,
        q_UB=q_LB + v["screw.stroke"],
        v_max=min(speed for _, speed in speeds(v)),
        eta_GB=v.get("gearbox.efficiency", 1.0) * v["screw.efficiency"],
        B_m=v.get("motor.B_m", 0.0),
        J_c=v.get("coupling.J_c", 0.0) + rho * rho * v.get("screw.J_BS", 0.0),
        J_GB=v.get("gearbox.J_GB", 0.0),
        B_BS=v.get("screw.B_BS", 0.0),
    )


def resolution(v: Values) -> float:
    """Return the position step in m."""
    if "sensor.resolution" in v:
        return v["sensor.resolution"]
    steps = 2.0 ** v["sensor.bits"] if "sensor.bits" in v else v["sensor.steps"]
    return ratio(v) * v["screw.lead"] / steps


def plant(v: Values) -> dict[str, Any]:
    """Return the other parameters of the plant by attribute: sensors, inverter, friction, stops, heat."""
    parameters: dict[str, Any] = {"resolution": resolution(v)}
    parameters |= {attribute: v[entry] for entry, attribute in PLANT_ATTRIBUTES.items() if entry in v}
    if "friction.F_C" in v:
        alpha = emla(v).alpha_RL
        # at 10 and 0.1 rad/s of the motor, as in `emla_fmu.drive`
        defaults = {"F_S": v["friction.F_C"], "v_S": 10.0 / alpha, "v_0": 0.1 / alpha}
        parameters = defaults | parameters
    if "friction.directional" in v:
        parameters["directional"] = bool(v["friction.directional"])
    if "thermal.tau_th" in v:
        parameters["i_N"] = v["motor.i_N"]
    return parameters


def holding_torque(v: Values, load: float) -> float:
    """Return the motor torque in N m that holds a load force in N at rest: |D_eq F_L|."""
    return abs(emla(v).D_eq * load)


def braking(v: Values, load: float) -> float:
    """Return a_max in m/s2: as entered, or from a share of the peak torque that the load leaves.

    At least a tenth of the peak torque counts as left.
    """
    if "control.a_max" in v:
        return v["control.a_max"]
    shared = emla(v)
    available = max(shared.tau_max - holding_torque(v, load), 0.1 * shared.tau_max)
    # the load acts while the joint brakes, so only the rest of the torque decelerates
    return BRAKING_SHARE * available / shared.A_eq
