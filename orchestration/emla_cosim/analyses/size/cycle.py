"""One cycle of a joint: what the run recorded, and the equations of its plant."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from emla_fmu import EmlaPlant, electrics, friction, motion_law
from emla_fmu.parameters import EmlaParameters
from emla_fmu.plant import screw_acceleration
from fmublock.row_array import evaluate_rows

from ...base.arrays import Vector
from ...base.errors import CommandError
from ...base.files import read_text
from ...base.toml_structs import read_toml
from ...run.result import Result
from ...run.scenarios.scenario import Scenario
from ...study.actuator.actuator import Actuator
from ...study.joints.schema import JointFile, list_joint_names, load_joint, parse_joint
from ...study.machines.machine_file import load_machine_file
from ...study.machines.systems import BUILT_IN
from ...study.roles import RoleNames, find_element, find_variable

_LIMITS = ("tau_max", "q_LB", "q_UB", "v_max")
"""Fields of `EmlaParameters` that stay those of the data sheet, with which a cycle is compared."""


@dataclass(frozen=True)
class JointPlant:
    """Parameters of a joint's plant by attribute of `EmlaPlant`.

    Attributes:
        values: Parameters as the run used them. What the plant lacks is that of the data sheet, or the
            default of `EmlaPlant`, which switches a property off.
        names: Full names of the parameters that the plant has.
        load_mass: Mass in kg that the screw moves through a transmission; 0 for a rigid load.
        sheet: Parameters of the data sheet.
    """

    joint: str
    values: Mapping[str, float]
    names: Mapping[str, str]
    load_mass: float
    sheet: EmlaParameters

    @property
    def emla(self) -> EmlaParameters:
        """Parameters of the actuator as the run used them, with the limits of the data sheet."""
        changed = {f.name: self.values[f.name] for f in fields(self.sheet) if f.name not in _LIMITS}
        return replace(self.sheet, **changed)

    def load_torque(self, v: Vector, load: Vector, directional: float) -> Vector:
        """Return the torque at the motor that a load takes, with losses that are `directional` or not."""
        return self._evaluate(
            lambda p: friction.load_torque(p, p.load), {"v_L": v, "load": load}, directional=directional
        )

    def required_torque(self, x: Vector, v: Vector, a: Vector, load: Vector, d_2: Vector) -> Vector:
        """Return the torque with which the plant's equation (9) gives an acceleration, with i_d = 0."""
        signals = {"x_L": x, "v_L": v, "load": load, "d_2": d_2}
        without = self._evaluate(
            lambda p: screw_acceleration(p, p.load), signals, i_q=0.0, i_q_ref=0.0, i_d=0.0
        )
        return motion_law.A_eq(self.emla) * (a - without) + self.cogging_torque(x)

    def cogging_torque(self, x: Vector) -> Vector:
        """Return the part of the torque that the motor makes without current."""
        return self._evaluate(electrics.cogging_torque, {"x_L": x})

    def _evaluate(
        self, equation: Callable[[Any], Any], signals: Mapping[str, Vector], **values: float
    ) -> Vector:
        """Return an equation of the plant for each row of signals, shape (rows,)."""

        def evaluate(numbers: Sequence[Any]) -> Sequence[Any]:
            arguments = dict(zip(signals, numbers, strict=True))
            return [equation(SimpleNamespace(**{**self.values, **values, **arguments}))]

        return evaluate_rows(evaluate, np.column_stack(list(signals.values())))[:, 0]


def find_plant(
    joint: str, parameters: Mapping[str, float], sheet: EmlaParameters, roles: Mapping[str, str] | None = None
) -> JointPlant:
    """Return the plant of a joint from the parameters of a run by full name, and those of its data sheet."""
    patterns = [f"{joint}.plant.{{}}", f"{joint}.motor.{{}}"]
    if (element := find_element(joint, roles)) is not None:
        patterns.append(f"machine.plant.{{}}[{element}]")

    def find(name: str) -> str | None:
        return next((p for p in (pattern.format(name) for pattern in patterns) if p in parameters), None)

    # defaults switch properties off that a foreign plant does not have
    defaults = EmlaPlant.layout().parameters
    names = {p.attribute: name for p in defaults if (name := find(p.name or p.attribute)) is not None}
    values = {p.attribute: float(p.start) for p in defaults}
    values |= asdict(sheet) | {attribute: parameters[name] for attribute, name in names.items()}
    load_mass = find("load.m")
    return JointPlant(joint, values, names, 0.0 if load_mass is None else parameters[load_mass], sheet)


def find_data_sheet(scenario: Scenario, source: object, joint: str) -> Actuator:
    """Return the actuator of a joint; `source` is what the scenario was loaded from.

    Raises:
        CommandError: The joint has no data sheet.
    """
    actuator = scenario.options.actuator.get(joint)
    if isinstance(actuator, Actuator):
        return actuator
    joint_file = _find_joint_file(source, joint) or (
        load_joint(joint) if joint in list_joint_names() else None
    )
    if joint_file is None:
        raise CommandError(
            f"{joint} has no data sheet to compare with; add --actuator {joint}=FILE.toml.", joint=joint
        )
    return joint_file.sheet


def _find_joint_file(source: object, joint: str) -> JointFile | None:
    """Return the joint of a scenario's machine, or the user's joint file of a scenario, for this joint."""
    if source in BUILT_IN:
        return load_machine_file(str(source)).joints.get(joint)
    if not isinstance(source, (str, Path)) or not str(source).lower().endswith(".toml"):
        return None
    path = Path(source)
    content: Mapping[str, object] = read_toml(read_text(path, "the scenario"), f"the scenario '{path}'")
    if content.get("kind") == "joint":
        same = path.stem == joint
        return parse_joint(content, f"the joint file '{path}'", joint, path.parent) if same else None
    if content.get("kind") == "machine":
        return load_machine_file(path).joints.get(joint)
    system = content.get("system")
    if not isinstance(system, str):
        return None
    return _find_joint_file(system if system in BUILT_IN else path.parent / system, joint)


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
