"""The motion of a machine's actuators: its file, and the state of the machine at the start."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from fmublock import Block
from machine_fmu import (
    Closure,
    Dynamics,
    Machine,
    MachineError,
    Mechanism,
    assemble,
    find_closure,
    reach_pose,
)
from machine_fmu.exact import plain
from machine_fmu.model import MachineModel
from machine_fmu.spline import Spline, TrajectoryError, spline_of, trajectory_parameters
from machine_fmu.spline_window import COEFFICIENTS, DEGREE

from ...base.errors import CommandError, join_names
from ...base.extras import require_extra
from ...base.files import read_text
from ...base.output_files import OutputFile, has_format
from ...system.model import System, Value
from .schema import MotionTable

WHAT = "the trajectory"
"""Name of a trajectory file in error messages."""


def read_trajectory(path: str | Path) -> Spline:
    """Read the spline of a trajectory file.

    Args:
        path: file that `trajectory` or `emla trajectory` wrote.

    Returns:
        The spline of three strokes in m over time in s.

    Raises:
        CommandError: the file does not exist or contains no trajectory.
    """
    return read_motion(path)[0]


def read_motion(path: str | Path) -> tuple[Spline, Mapping[str, Any]]:
    """Read the spline of a trajectory file, and the problem that it solves; empty without one.

    Raises:
        CommandError: As for `read_trajectory`.
    """
    text = read_text(Path(path), WHAT)
    try:
        document = json.loads(text)
        spline, problem = spline_of(document), document.get("problem")
        return spline, problem if isinstance(problem, dict) else {}
    except TrajectoryError as error:
        raise CommandError(f"{WHAT} '{path}' cannot be used: {error}") from error
    except (ValueError, RecursionError) as error:  # ValueError also for numbers with thousands of digits
        raise CommandError(f"{WHAT} '{path}' is not JSON: {error}.") from error


def check_trajectory(path: Path, overwrite: bool = False) -> OutputFile:
    """Return a trajectory file, which may be written. Raises CommandError if it must not be written."""
    return OutputFile(path, WHAT, has_format("emla-cosim trajectory"), overwrite)


_MAX_DIFFERENCES = 3
"""The number of differences that a message lists."""

_COEFFICIENTS_PER_POINT = (DEGREE + 1) // 2
"""Equal coefficients of a way-point: position, speed and acceleration are given there."""

_SAMPLES = 5000
"""Number of moments at which a motion is examined."""

COMPONENT = "machine.trajectory"
"""The component with the motion."""


FORMER_NAMES: Mapping[str, str] = {
    **{
        f"{joint}_{name}": f"{joint}.{name}"
        for joint in ("lift", "tilt")
        for name in ("a", "b", "L_0", "delta", "epsilon")
    },
    "lift_length": "lift_boom.length",
    **{
        f"{boom}_{name}": f"{boom}_boom.{name}"
        for boom in ("lift", "outer", "inner")
        for name in ("m", "c", "J")
    },
    "reach": "inner_boom.reach",
    "payload_J": "payload.J",
    "M_BS": "screw.M_BS",
    "tube_share": "tube.share",
    "motor_m": "motor.m",
    "housing_c": "housing.c",
    "housing_J": "housing.J",
    "tube_c": "tube.c",
    "tube_J": "tube.J",
    "q_LB": "screw.q_LB",
    "q_UB": "screw.q_UB",
    "gravity": "gravity",
}
"""FMI names by the names that problem files have for parameters of the paper's manipulator."""


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
        """The stroke of each actuator in m at 0 s, or at the end of the motion that is nearest to it."""
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
    """Return the motion of a trajectory file for these joints.

    Raises:
        CommandError: The file cannot be read, has other joints, or has more coefficients than the block.
    """
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
            raise CommandError(f"{where} has a file, and also times or strokes; remove one or the other.")
        return load_motion(folder / table.file, list(start))
    if len(table.times) < 2 or not table.strokes:
        raise CommandError(f"{where} needs a file, or at least two times and strokes by actuator.")
    if any(b <= a for a, b in pairwise(table.times)):
        raise CommandError(
            f"'times' in {where} is {list(table.times)}; each time must be after the one before."
        )
    if _COEFFICIENTS_PER_POINT * len(table.times) > COEFFICIENTS:
        raise CommandError(
            f"'times' in {where} has {len(table.times)} times; "
            f"{COEFFICIENTS // _COEFFICIENTS_PER_POINT} are the most."
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
    return Motion(_build_rest_moves(table.times, table.strokes, start))


def rest_at(start: Mapping[str, float]) -> Motion:
    """Return the motion that stays at strokes in m, without speed to the last bit."""
    return Motion(Spline(1, [0.0, 0.0, 1.0, 1.0], {joint: [x, x] for joint, x in start.items()}))


def _build_rest_moves(
    times: Sequence[float], strokes: Mapping[str, Sequence[float]], start: Mapping[str, float]
) -> Spline:
    """Return quintic moves between strokes, at which all actuators rest.

    With knots of this multiplicity, each coefficient is the position at a time: the polynomials have no
    speed and no acceleration there.
    """
    inner = [t for t in times[1:-1] for _ in range(_COEFFICIENTS_PER_POINT)]
    knots = [*[times[0]] * (DEGREE + 1), *inner, *[times[-1]] * (DEGREE + 1)]
    coefficients = {
        name: [x for x in strokes.get(name, [first] * len(times)) for _ in range(_COEFFICIENTS_PER_POINT)]
        for name, first in start.items()
    }
    return Spline(DEGREE, knots, coefficients)


def read_system_motion(system: System) -> Motion:
    """Return the motion of a system from the parameters of its component."""
    values = system.component(COMPONENT).parameters
    start, end = "coefficient.", "[1]"
    joints = [
        name[len(start) : -len(end)] for name in values if name.startswith(start) and name.endswith(end)
    ]
    degree = int(values["degree"])
    knots = _read_array(values, "knot")
    # the block has room for more, which is filled
    count = knots.index(knots[-1]) + degree + 1  # the rest repeats the last one
    size = count - degree - 1
    coefficients = {joint: _read_array(values, f"coefficient.{joint}")[:size] for joint in joints}
    return Motion(Spline(degree, knots[:count], coefficients))


def _read_array(values: Mapping[str, Value], name: str) -> list[float]:
    elements = list[float]()
    while (element := values.get(f"{name}[{len(elements) + 1}]")) is not None:
        elements.append(float(element))
    return elements


def describe_other_machine(problem: Mapping[str, Any], name: str, block: type[Block], system: System) -> str:
    """Return a message on the differences of a motion's machine from that of the system; empty without any.

    Args:
        problem: The problem that the motion solves.
        name: The component of the machine.
        block: Its block.
        system: The system with all start values.
    """
    values, driven = system.component(name).parameters, {x.input for x in system.into(name)}
    machine = problem.get("machine")
    other_values = {
        "payload.m": problem.get("payload"),
        **({FORMER_NAMES.get(k, k): x for k, x in machine.items()} if isinstance(machine, dict) else {}),
    }
    layout = block.layout()
    differences = []
    for variable in (*layout.inputs, *layout.parameters):
        other_value = other_values.get(str(variable.name))
        if other_value is None:
            continue
        elements = other_value if isinstance(other_value, list) else [other_value]
        for scalar, other_number in zip(variable.scalars(), elements, strict=False):
            number = values.get(scalar.name, scalar.start)
            if not isinstance(other_number, (int, float)) or not isinstance(number, (int, float)):
                continue
            # a start value of a driven input has no effect
            if scalar.name not in driven and not math.isclose(number, other_number, rel_tol=1e-9):
                unit = f" {variable.unit}" if variable.unit else ""
                differences.append(
                    f"{name}.{scalar.name} is {number:.6g}{unit}, but {other_number:.6g}{unit} there"
                )
    if any(x.get("payload") is not None for x in problem.get("via") or ()) and "payload.m" not in driven:
        differences.insert(
            0,
            f"its payload changes; use --input NAME-payload.csv:{name}.payload.m=payload,interpolation=held",
        )
    more = f" and {len(differences) - _MAX_DIFFERENCES} more" if len(differences) > _MAX_DIFFERENCES else ""
    return (
        f"the motion was found for another machine: {'; '.join(differences[:_MAX_DIFFERENCES])}{more}."
        if differences
        else ""
    )


_ITERATIONS = 30


@dataclass(frozen=True)
class Start:
    """A machine at rest.

    Attributes:
        values: Start values of its blocks by FMI name.
        masses: Mass in kg that each screw moves while the others are held.
    """

    values: Mapping[str, float]
    masses: Sequence[float]


def find_start(machine: Machine, strokes: Sequence[float], label: str) -> Start:
    """Return the state at strokes in m. Passive coordinates rest where they hang.

    Raises:
        CommandError: The machine cannot take this pose, or does not come to rest in it.
    """
    closure, mechanism = find_closure(machine), assemble(machine)
    if closure.iterated or mechanism.passive:  # now, not when pictures are drawn after the run
        require_extra("build", f"{label}, whose poses no formula gives,")
    guess = None
    if closure.iterated:
        pose = _compute_coordinates(mechanism, closure, strokes, label)
        guess = {i: pose[i] for i in closure.iterated}
    passive = _find_rest(machine, strokes, label) if mechanism.passive else []
    at_rest = Dynamics(mechanism, closure, strokes, passive, guess, _ITERATIONS)
    M = at_rest.mass_matrix()
    masses = [float(plain(M[i][i])) for i in range(len(strokes))]
    # formulas give NaN where a triangle does not close
    if not all(map(math.isfinite, masses)):
        _compute_coordinates(
            mechanism, closure, strokes, label
        )  # the message says which triangle does not close
    numbers = at_rest.pose.numbers
    values = {f"start.pose[{n}]": float(plain(numbers[i])) for n, i in enumerate(closure.iterated, 1)}
    values |= {f"start.passive.q[{n}]": x for n, x in enumerate(passive, 1)}
    return Start(values, masses)


def _compute_coordinates(
    mechanism: Mechanism, closure: Closure, strokes: Sequence[float], label: str
) -> list[float]:
    """Return the coordinates at strokes in m; raise CommandError if the machine cannot take this pose."""
    lengths = dict(closure.lengths)
    for bar, stroke in zip(mechanism.actuators, strokes, strict=True):
        lengths[bar.name] = float(plain(bar.length)) + stroke
    try:
        return reach_pose(mechanism, closure, lengths)
    except MachineError as error:
        text = ", ".join(f"{x:.6g}" for x in strokes)
        raise CommandError(f"{label} cannot start at the strokes {text} m: {error}.") from error


def _find_rest(machine: Machine, strokes: Sequence[float], label: str) -> list[float]:
    """Return the passive coordinates at rest; raise CommandError if there are none."""
    model = MachineModel(machine)
    passive = model.hanging(np.array([strokes]))[0].tolist()
    if not all(map(math.isfinite, passive)):
        names = ", ".join(f"'{frame.name}'" for frame in model.passive_frames)
        raise CommandError(
            f"{label} does not come to rest at its start: {names} moves freely; change its assembly pose, "
            "mass or centre."
        )
    return passive
