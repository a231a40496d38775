"""The plant of a joint: its parameters in a run, its own equations over a cycle, and its data sheet.

Signals are arrays of shape (rows,) in SI units: position `x`, speed `v` and acceleration `a` of the screw,
force `load` on it, and disturbance `d_2` of its acceleration.
"""

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
from ...run.scenarios.scenario import Scenario
from ...study.actuator.actuator import Actuator
from ...study.joints.schema import JointFile, list_joint_names, load_joint, parse_joint
from ...study.machines.machine_file import load_machine_file
from ...study.machines.systems import BUILT_IN
from ...study.roles import find_element

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
    joint_file = _find_joint(source, joint) or (load_joint(joint) if joint in list_joint_names() else None)
    if joint_file is None:
        raise CommandError(
            f"{joint} has no data sheet to compare with; add --actuator {joint}=FILE.toml.", joint=joint
        )
    return joint_file.sheet


def _find_joint(source: object, joint: str) -> JointFile | None:
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
    return _find_joint(system if system in BUILT_IN else path.parent / system, joint)
