"""One cycle of a joint: what the run recorded, and what the motion requires of the motor."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from emla_fmu import motion_law
from emla_fmu.parameters import EmlaParameters

from ..base.arrays import Vector
from ..base.errors import CommandError
from ..run.result import Result
from ..study.roles import JOINTS, RoleNames, find_variable

_NEEDED = ("x_L", "v_L", "F_L", "tau_m", "omega_m", "P_el", "i_q", "i_d", "x_d")
_FURTHER = ("a_L", "v_d", "a_d")
SIGNALS = (*_NEEDED, *_FURTHER)
"""Roles of the signals of a cycle."""

_PARAMETERS = {
    "R_s": "motor.R_s",
    "L_d": "motor.L_d",
    "L_q": "motor.L_q",
    "Phi_PM": "motor.Phi_PM",
    "N_p": "motor.N_p",
    "J_m": "motor.J_m",
    "B_m": "motor.B_m",
    "J_c": "coupling.J_c",
    "rho": "gearbox.rho",
    "J_GB": "gearbox.J_GB",
    "eta_GB": "gearbox.eta_GB",
    "lead": "screw.lead",
    "M_BS": "screw.M_BS",
    "B_BS": "screw.B_BS",
    "u_max": "inverter.u_max",
}
"""Parameters of the plant by field of `EmlaParameters`."""


@dataclass(frozen=True)
class Cycle:
    """Signals of a joint over one cycle, arrays of shape (rows,) in SI units.

    Attributes:
        joint: Name of the joint.
        emla: Parameters of the actuator as the run used them.
        time: Times in s.
        x: Position in m.
        v: Speed in m/s.
        a: Acceleration in m/s2.
        load: Load force in N, positive against extension.
        torque: Torque of the motor in N m.
        omega: Speed of the motor in rad/s.
        P_el: Electrical power into the motor in W.
        i_q: q-axis current in A.
        i_d: d-axis current in A.
        required: Torque in N m that the reference and the load require; NaN if the reference lacks speed or
            acceleration.
    """

    joint: str
    emla: EmlaParameters
    time: Vector
    x: Vector
    v: Vector
    a: Vector
    load: Vector
    torque: Vector
    omega: Vector
    P_el: Vector
    i_q: Vector
    i_d: Vector
    required: Vector

    @property
    def duration(self) -> float:
        """Length of the cycle in s."""
        return float(self.time[-1] - self.time[0])

    @property
    def current(self) -> Vector:
        """Amplitude of the phase currents in A, peak."""
        return np.hypot(self.i_q, self.i_d)

    @property
    def force(self) -> Vector:
        """Axial force of the screw in N, positive in compression: load, and inertia of what it moves."""
        return self.load + self.emla.M_BS * self.a

    @property
    def has_required(self) -> bool:
        """Whether the required torque is known."""
        return bool(np.isfinite(self.required).all())

    def mean(self, values: Vector) -> float:
        """Return the mean over the cycle."""
        return float(np.trapezoid(values, self.time)) / self.duration

    def rms(self, values: Vector) -> float:
        """Return the root mean square over the cycle."""
        return math.sqrt(max(self.mean(values * values), 0.0))


def list_joints(signals: Sequence[str], roles: Mapping[str, str]) -> list[str]:
    """Return the joints that have all needed signals, with roles as in the option of this name."""
    names = RoleNames(dict.fromkeys(signals))
    joints = dict.fromkeys(name.partition(".")[0] for name in (*signals, *roles))
    return [
        joint
        for joint in joints
        if all(find_variable(joint, role, names, roles) is not None for role in _NEEDED)
    ]


def read_cycle(result: Result, joint: str, emla: EmlaParameters, start: float, end: float) -> Cycle:
    """Return a joint's cycle of a run.

    Args:
        result: The run, with a table.
        joint: The joint.
        emla: Parameters of the data sheet; those of the run override them.
        start: Begin of the cycle in s.
        end: End of the cycle in s.

    Raises:
        CommandError: The run has fewer than two rows in the cycle.
    """
    names = RoleNames(dict.fromkeys(result.names))
    found = {role: find_variable(joint, role, names, result.roles) for role in SIGNALS}
    wanted = {role: name for role, name in found.items() if name is not None}
    data = result.read(["time", *dict.fromkeys(wanted.values())])
    inside = (data["time"] >= start - 1e-9) & (data["time"] <= end + 1e-9)
    if np.count_nonzero(inside) < 2:
        raise CommandError(f"the cycle from {start:g} to {end:g} s has fewer than two rows of {joint}.")
    time = data["time"][inside]
    signal = {role: np.asarray(data[name][inside], dtype=float) for role, name in wanted.items()}
    parameter = _PlantParameters(joint, result.parameters)
    known = {field: parameter(name) for field, name in _PARAMETERS.items()}
    emla = replace(emla, **{field: value for field, value in known.items() if value is not None})
    a = signal["a_L"] if "a_L" in signal else np.gradient(signal["v_L"], time)
    required = np.full(len(time), np.nan)
    if "v_d" in signal and "a_d" in signal:
        required = _require_torque(emla, parameter, signal["v_d"], signal["a_d"], signal["F_L"])
    return Cycle(
        joint,
        emla,
        time,
        signal["x_L"],
        signal["v_L"],
        a,
        signal["F_L"],
        signal["tau_m"],
        signal["omega_m"],
        signal["P_el"],
        signal["i_q"],
        signal["i_d"],
        required,
    )


def follow_reference(cycle: Cycle, result: Result) -> Cycle:
    """Return the cycle as it would be if the motor made the required torque: on the reference, with i_d = 0.

    Args:
        cycle: A cycle whose required torque is known.
        result: The run from which it is.
    """
    names = RoleNames(dict.fromkeys(result.names))
    places = {role: str(find_variable(cycle.joint, role, names, result.roles)) for role in _REFERENCE}
    data = result.read(["time", *dict.fromkeys(places.values())])
    rows = np.searchsorted(data["time"], cycle.time)
    x, v, a = (np.asarray(data[places[role]][rows], dtype=float) for role in _REFERENCE)
    emla, omega = cycle.emla, cycle.emla.alpha_RL * v
    i_q = cycle.required / (1.5 * emla.N_p * emla.Phi_PM)
    power = cycle.required * omega + 1.5 * emla.R_s * i_q * i_q
    return replace(
        cycle,
        x=x,
        v=v,
        a=a,
        torque=cycle.required,
        omega=omega,
        P_el=power,
        i_q=i_q,
        i_d=np.zeros_like(i_q),
    )


_REFERENCE = ("x_d", "v_d", "a_d")


class _PlantParameters:
    """Finds parameters of the plant of a joint in those of a run."""

    def __init__(self, joint: str, parameters: Mapping[str, float]) -> None:
        self._parameters = parameters
        self._places = [f"{joint}.plant.{{}}", f"{joint}.motor.{{}}"]
        if joint in JOINTS:
            self._places.append(f"machine.plant.{{}}[{JOINTS.index(joint) + 1}]")

    def __call__(self, name: str) -> float | None:
        """Return a value; None if the plant lacks the parameter."""
        places = (place.format(name) for place in self._places)
        return next((self._parameters[p] for p in places if p in self._parameters), None)


def _require_torque(
    emla: EmlaParameters, parameter: _PlantParameters, v: Vector, a: Vector, load: Vector
) -> Vector:
    """Return the torque in N m of (5), with friction and losses of the plant in each direction.

    Args:
        emla: Parameters of the actuator.
        parameter: Returns further parameters of the plant.
        v: Speed of the reference in m/s.
        a: Acceleration of the reference in m/s2.
        load: Load force in N.
    """
    alpha = motion_law.alpha_RL(emla)
    torque = motion_law.A_eq(emla) * a + motion_law.B_eq(emla) * v
    if parameter("gearbox.directional"):
        forward, back = 1.0 / emla.eta_GB, parameter("gearbox.eta_back") or 2.0 - 1.0 / emla.eta_GB
        factor = np.where(v == 0.0, 1.0, np.where(load * v > 0.0, forward, back))
        torque = torque + factor * load / alpha
    else:
        torque = torque + motion_law.D_eq(emla) * load
    return torque + (parameter("friction.F_C") or 0.0) * np.sign(v) / alpha
