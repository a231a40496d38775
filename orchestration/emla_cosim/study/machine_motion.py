"""The motion of the manipulator's joints."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fmublock import Block
from machine_fmu.spline import Spline, TrajectoryError, default_spline, trajectory_parameters
from machine_fmu.trajectory import JOINTS

from ..base.errors import CommandError
from ..system.model import System, Value
from .joints.schema import load_joint
from .machines.former_names import FORMER_NAMES
from .trajectory_file import read_motion

_SHOWN = 3
"""The number of differences that a message lists."""


@dataclass(frozen=True)
class Motion:
    """Parameters of the block Trajectory, and each joint's start relative to q_S in m.

    `problem` is the one that the motion solves; empty if its file has none.
    """

    parameters: Mapping[str, Value]
    ahead: Mapping[str, float]
    spline: Spline
    problem: Mapping[str, Any] = field(default_factory=dict)

    def travel(self, joint: str, start: float, stop: float) -> tuple[float, float, float]:
        """Return lowest and highest position of a joint in m, and its largest speed in m/s.

        They are sampled at 5,000 moments from `start` to `stop` in s. Before and after the motion the joint
        rests
        at its ends.
        """
        import numpy as np

        first, last = np.clip([start, stop], self.spline.start, self.spline.end)
        times, place = np.linspace(first, last, 5000), JOINTS.index(joint)
        x, v = (self.spline.evaluated(times, order)[:, place] for order in (0, 1))
        return float(x.min()), float(x.max()), float(abs(v).max())


def load_motion(file: Path | None) -> Motion:
    """Return the motion of a trajectory file, or the optimised one. Raises CommandError."""
    if file is None:
        return _motion(default_spline())
    try:
        spline, problem = read_motion(file)
        return _motion(spline, problem)
    except TrajectoryError as error:
        raise CommandError(f"the trajectory '{file}' cannot be used: {error}") from error


def _motion(spline: Spline, problem: Mapping[str, Any] | None = None) -> Motion:
    parameters = trajectory_parameters(spline)
    first = spline.evaluated([min(max(0.0, spline.start), spline.end)])[0]
    starts = [load_joint(joint).reference.q_S for joint in JOINTS]
    ahead = {joint: float(x) - q_S for joint, x, q_S in zip(JOINTS, first, starts, strict=True)}
    return Motion(parameters, ahead, spline, problem or {})


def describe_other_machine(problem: Mapping[str, Any], name: str, block: type[Block], system: System) -> str:
    """Return a message on what the machine of a motion's problem has and that of the system has not.

    Args:
        problem: The problem that the motion solves.
        name: The component of the machine.
        block: Its block.
        system: The system with all start values.
    """
    values, driven = system.component(name).parameters, {x.input for x in system.into(name)}
    given = _table(problem.get("machine"))
    known = {"payload.m": problem.get("payload"), **{FORMER_NAMES.get(k, k): x for k, x in given.items()}}
    layout = block.layout()
    shown = []
    for variable in (*layout.inputs, *layout.parameters):
        given = known.get(str(variable.name))
        if given is None:
            continue
        elements = given if isinstance(given, list) else [given]
        for scalar, theirs in zip(variable.scalars(), elements, strict=False):
            ours = values.get(scalar.name, scalar.start)
            if not isinstance(theirs, (int, float)) or not isinstance(ours, (int, float)):
                continue
            if scalar.name not in driven and not math.isclose(ours, theirs, rel_tol=1e-9):
                unit = f" {variable.unit}" if variable.unit else ""
                shown.append(f"{name}.{scalar.name} is {ours:.6g}{unit}, but {theirs:.6g}{unit} there")
    if any(x.get("payload") is not None for x in problem.get("via") or ()) and "payload.m" not in driven:
        shown.insert(
            0,
            f"its payload changes; use --input NAME-payload.csv:{name}.payload.m=payload,interpolation=held",
        )
    more = f" and {len(shown) - _SHOWN} more" if len(shown) > _SHOWN else ""
    return f"the motion was found for another machine: {'; '.join(shown[:_SHOWN])}{more}." if shown else ""


def _table(found: object) -> Mapping[str, Any]:
    return found if isinstance(found, dict) else {}
