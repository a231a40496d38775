"""One cycle of a joint: what the run recorded, and what the motion requires of the motor."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from emla_fmu.parameters import EmlaParameters

from ...base.arrays import Vector
from ...base.errors import CommandError
from ...run.result import Result
from ...study.roles import RoleNames, find_variable
from .plant import JointPlant

_NEEDED = ("x_L", "v_L", "F_L", "tau_m", "omega_m", "P_el", "i_q", "i_d", "x_c")
_FURTHER = ("a_L", "x_s", "v_s", "a_s", "d_2", "F_T", "temperature_rise")
SIGNALS = (*_NEEDED, *_FURTHER)
"""Roles of the signals of a cycle."""


@dataclass(frozen=True)
class Cycle:
    """Signals of a joint over one cycle, arrays of shape (rows,) in SI units.

    Attributes:
        emla: Parameters of the actuator as the run used them.
        time: Times in s.
        x: Position in m.
        v: Speed in m/s.
        a: Acceleration in m/s2.
        load: Force on the screw in N, positive against extension: the load force, or that of a transmission.
        torque: Torque of the motor in N m.
        omega: Speed of the motor in rad/s.
        P_el: Electrical power into the motor in W.
        i_q: q-axis current in A.
        i_d: d-axis current in A.
        required: Torque in N m that reference and load require of a rigid plant; NaN if the reference lacks
            speed or acceleration.
        rise: Temperature rise of the winding in K in the run; 0 if the plant does not compute it.
        error: Position minus commanded position in m.
    """

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
    rise: Vector | float = 0.0
    error: Vector | float = 0.0

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
        return math.sqrt(max(self.mean(values * values), 0.0))  # rounding can make a mean of 0 negative


def list_joints(signals: Sequence[str], roles: Mapping[str, str]) -> list[str]:
    """Return the joints that have all needed signals, with roles as in the option of this name."""
    names = RoleNames(dict.fromkeys(signals))
    joints = dict.fromkeys(name.partition(".")[0] for name in (*signals, *roles))
    return [
        joint
        for joint in joints
        if all(find_variable(joint, role, names, roles) is not None for role in _NEEDED)
    ]


def read_cycle(result: Result, plant: JointPlant, start: float, end: float) -> Cycle:
    """Return a joint's cycle of a run with a table, from `start` to `end` in s.

    Raises:
        CommandError: The run has fewer than two rows in the cycle.
    """
    data = _read_signals(result, plant.joint, SIGNALS)
    # times are multiples of the step, which are rounded
    inside = (data["time"] >= start - 1e-9) & (data["time"] <= end + 1e-9)
    if np.count_nonzero(inside) < 2:
        raise CommandError(f"the cycle from {start:g} to {end:g} s has fewer than two rows of {plant.joint}.")
    signal = {role: values[inside] for role, values in data.items()}
    time = signal["time"]
    required = np.full(len(time), np.nan)
    if "v_s" in signal and "a_s" in signal:
        x, v, a = (signal[role] for role in ("x_s", "v_s", "a_s"))
        required = plant.required_torque(x, v, a, signal["F_L"] + plant.load_mass * a, np.zeros_like(a))
    names = {"x": "x_L", "v": "v_L", "torque": "tau_m", "omega": "omega_m"}
    return Cycle(
        plant.emla,
        time,
        a=signal["a_L"] if "a_L" in signal else np.gradient(signal["v_L"], time),
        load=signal.get("F_T", signal["F_L"]),
        required=required,
        rise=signal.get("temperature_rise", 0.0),
        error=signal["x_L"] - signal["x_c"],
        **{name: signal[role] for name, role in names.items()},
        **{name: signal[name] for name in ("P_el", "i_q", "i_d")},
    )


def follow_reference(cycle: Cycle, plant: JointPlant, result: Result) -> Cycle:
    """Return the cycle as it would be on the reference, against load and disturbance, with i_d = 0.

    The required torque of the cycle must be known; `result` is the run from which it is.
    """
    data = _read_signals(result, plant.joint, ("x_s", "v_s", "a_s", "F_L", "d_2"))
    # the cycle is a part of the run, on rows of it
    rows = np.searchsorted(data["time"], cycle.time)
    signal = {role: values[rows] for role, values in data.items()}
    x, v, a = (signal[role] for role in ("x_s", "v_s", "a_s"))
    load = signal["F_L"] + plant.load_mass * a
    torque = plant.required_torque(x, v, a, load, signal.get("d_2", np.zeros_like(load)))
    # cogging acts on the shaft without any current
    current_torque = torque - plant.cogging_torque(x)
    emla, omega = cycle.emla, cycle.emla.alpha_RL * v
    i_q = current_torque / (1.5 * emla.N_p * emla.Phi_PM)
    power = current_torque * omega + 1.5 * emla.R_s * i_q * i_q
    signals = (x, v, a, load, torque, omega, power, i_q, np.zeros_like(i_q), cycle.required)
    return Cycle(emla, cycle.time, *signals)


def _read_signals(result: Result, joint: str, roles: Sequence[str]) -> dict[str, Vector]:
    """Return the time, and the signals of a joint that exist, by role."""
    names = RoleNames(dict.fromkeys(result.names))
    signals = {role: find_variable(joint, role, names, result.roles) for role in roles}
    present = {"time": "time"} | {role: name for role, name in signals.items() if name is not None}
    data = result.read([*dict.fromkeys(present.values())])
    return {role: np.asarray(data[name], dtype=float) for role, name in present.items()}
