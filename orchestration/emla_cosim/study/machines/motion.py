"""The motion of a machine's actuators."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

from fmublock import Block
from machine_fmu.spline import Spline, TrajectoryError, trajectory_parameters
from machine_fmu.spline_window import COEFFICIENTS, DEGREE

from ...base.errors import CommandError, join_names
from ...system.model import System, Value
from ..trajectory_file import read_motion
from .former_names import FORMER_NAMES
from .schema import MotionTable

_SHOWN = 3
"""The number of differences that a message lists."""

_AT_REST = (DEGREE + 1) // 2
"""Equal coefficients of a way-point: position, speed and acceleration are given there."""

_SAMPLES = 5000
"""Number of moments at which a motion is examined."""

_FIRST_COEFFICIENT = re.compile(r"coefficient\.(.*)\[1\]")

COMPONENT = "machine.trajectory"
"""The component with the motion."""


@dataclass(frozen=True)
class Motion:
    """The motion of actuators. `problem` is the one that it solves; empty if its file has none."""

    spline: Spline
    problem: Mapping[str, Any] = field(default_factory=dict)

    @property
    def parameters(self) -> Mapping[str, Value]:
        """The parameters of the block with the motion; raise CommandError if it has no room for them."""
        try:
            return trajectory_parameters(self.spline)
        except TrajectoryError as error:
            raise CommandError(f"the motion cannot be used: {error}") from error

    @property
    def first(self) -> Mapping[str, float]:
        """The stroke of each actuator in m at 0 s."""
        row = self.spline.evaluated([min(max(0.0, self.spline.start), self.spline.end)])[0]
        return dict(zip(self.spline.joints, row.tolist(), strict=True))

    @property
    def quarters(self) -> Sequence[float]:
        """The times in s at which the motion begins, has quarters behind it, and ends."""
        length = self.spline.end - self.spline.start
        return [self.spline.start + 0.25 * part * length for part in range(5)]

    def travel(self, joint: str, start: float, stop: float) -> tuple[float, float, float]:
        """Return lowest and highest position of a joint in m, and its largest speed in m/s.

        They are sampled from `start` to `stop` in s. Before and after the motion the joint rests at its ends.
        """
        import numpy as np

        first, last = np.clip([start, stop], self.spline.start, self.spline.end)
        times, index = np.linspace(first, last, _SAMPLES), self.spline.joints.index(joint)
        x, v = (self.spline.evaluated(times, order)[:, index] for order in (0, 1))
        return float(x.min()), float(x.max()), float(abs(v).max())


def load_motion(file: Path, joints: Sequence[str]) -> Motion:
    """Return the motion of a trajectory file for these joints; raise CommandError if it has others."""
    spline, problem = read_motion(file)
    try:
        motion = Motion(spline.ordered(joints), problem)
        trajectory_parameters(motion.spline)
    except TrajectoryError as error:
        raise CommandError(f"the trajectory '{file}' cannot be used: {error}") from error
    return motion


def read_motion_table(
    table: MotionTable | None, start: Mapping[str, float], label: str, folder: Path
) -> Motion | None:
    """Return the motion of a machine file; None without one.

    Args:
        table: The table of the file.
        start: Strokes at the start in m, by actuator.
        label: What error messages call the file.
        folder: The folder of relative paths.

    Raises:
        CommandError: An entry is wrong.
    """
    if table is None:
        return None
    where = f"[motion] of {label}"
    if table.file is not None:
        if table.times or table.strokes:
            raise CommandError(f"{where} has a file, and also times or strokes; write one of both.")
        return load_motion(folder / table.file, list(start))
    if len(table.times) < 2 or not table.strokes:
        raise CommandError(f"{where} needs a file, or at least two times and strokes by actuator.")
    if any(b <= a for a, b in pairwise(table.times)):
        raise CommandError(
            f"'times' in {where} is {list(table.times)}; each time must be after the one before."
        )
    if _AT_REST * len(table.times) > COEFFICIENTS:
        raise CommandError(
            f"'times' in {where} has {len(table.times)} times; {COEFFICIENTS // _AT_REST} are the most."
        )
    if unknown := [name for name in table.strokes if name not in start]:
        raise CommandError(
            f"[motion.strokes] of {label} has {join_names(unknown)}; the actuators are {join_names(start)}."
        )
    for name, strokes in table.strokes.items():
        if len(strokes) != len(table.times):
            raise CommandError(
                f"'{name}' in [motion.strokes] of {label} has {len(strokes)} strokes for "
                f"{len(table.times)} times."
            )
    return Motion(_rest_to_rest(table.times, table.strokes, start))


def hold(start: Mapping[str, float]) -> Motion:
    """Return the motion that stays at strokes in m, without speed to the last bit."""
    return Motion(Spline(1, [0.0, 0.0, 1.0, 1.0], {joint: [x, x] for joint, x in start.items()}))


def _rest_to_rest(
    times: Sequence[float], strokes: Mapping[str, Sequence[float]], start: Mapping[str, float]
) -> Spline:
    """Return quintic moves between strokes, at which all actuators rest.

    With knots of this multiplicity, each coefficient is the position at a time: the polynomials have no
    speed and no acceleration there.
    """
    inner = [t for t in times[1:-1] for _ in range(_AT_REST)]
    knots = [*[times[0]] * (DEGREE + 1), *inner, *[times[-1]] * (DEGREE + 1)]
    coefficients = {
        name: [x for x in strokes.get(name, [first] * len(times)) for _ in range(_AT_REST)]
        for name, first in start.items()
    }
    return Spline(DEGREE, knots, coefficients)


def motion_of_system(system: System) -> Motion:
    """Return the motion of a system from the parameters of its component."""
    values = system.component(COMPONENT).parameters
    start, end = "coefficient.", "[1]"
    joints = [
        name[len(start) : -len(end)] for name in values if name.startswith(start) and name.endswith(end)
    ]
    degree = int(values["degree"])
    knots = _array(values, "knot")
    count = knots.index(knots[-1]) + degree + 1  # the rest repeats the last one
    size = count - degree - 1
    coefficients = {joint: _array(values, f"coefficient.{joint}")[:size] for joint in joints}
    return Motion(Spline(degree, knots[:count], coefficients))


def _array(values: Mapping[str, Value], name: str) -> list[float]:
    found = list[float]()
    while (element := values.get(f"{name}[{len(found) + 1}]")) is not None:
        found.append(float(element))
    return found


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


def _table(entry: object) -> Mapping[str, Any]:
    return entry if isinstance(entry, dict) else {}
