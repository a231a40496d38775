"""Start, motion, load and holding brake of a joint, and forces along its stroke, as tables."""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import msgspec

from emla_fmu import EmlaAxis, motion_law, stroke_load
from emla_fmu.disturbance import LEVELS
from emla_fmu.holding_brake import PHASES
from emla_fmu.reference import MOVES, quintic_duration, rest_to_rest
from emla_fmu.schedule import NEVER
from emla_fmu.stroke_load import INTERPOLATIONS

from ...base.errors import CommandError
from ...base.quantities import Quantity, parse_unit_name
from ...base.table_entries import Location
from ...base.toml_structs import describe, quantity

_COLUMNS = (("position", "m"), ("force", "N"))
"""Columns of a file, with the units of numbers without a unit."""


class StrokeTable(NamedTuple):
    """A load force along the stroke: forces in N at positions in m, which increase."""

    position: tuple[float, ...]
    force: tuple[float, ...]
    interpolation: int = stroke_load.LINEAR

    def force_at(self, x: float) -> float:
        """Return the force in N at a position of the load in m."""
        return stroke_load.force_at(x, *self._fill(), self.interpolation)

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the plant, by attribute."""
        position, force = self._fill()
        return {"position": position, "force": force, "interpolation": self.interpolation}

    def check(self) -> "StrokeTable":
        """Return this table unchanged; raise ValueError if its points cannot be used."""
        count = len(self.position)
        if count != len(self.force):
            raise ValueError(
                f"has {count} values of position and {len(self.force)} of force; they must agree."
            )
        if not 2 <= count <= stroke_load.POINTS:
            raise ValueError(
                f"has {count} points of force over position; it must have 2 to {stroke_load.POINTS}."
            )
        for a, b in pairwise(self.position):
            if not a < b:
                raise ValueError(f"has the position {b:g} m after {a:g} m; positions must increase.")
        return self

    def _fill(self) -> tuple[list[float], list[float]]:
        """Return positions and forces of as many points as the plant has; the last point is repeated."""
        missing = stroke_load.POINTS - len(self.position)
        return [*self.position, *[self.position[-1]] * missing], [*self.force, *[self.force[-1]] * missing]


def read_plant_table(value: Callable[[str], float | None]) -> StrokeTable | None:
    """Return the load along the stroke of a plant; None if a value is unknown, or all forces are 0.

    Args:
        value: Returns the plant's parameter of an FMI name; None if it is unknown.
    """
    names = {x.attribute: [s.name for s in x.scalars()] for x in EmlaAxis.layout().parameters}
    position, force, (kind,) = (
        [value(name) for name in names[attribute]] for attribute in ("position", "force", "interpolation")
    )
    if kind is None or None in position or None in force or not any(force):
        return None
    return StrokeTable(tuple(map(float, position)), tuple(map(float, force)), int(kind))  # type: ignore[arg-type]


def read_stroke_file(value: Any, at: Location, folder: Path | None) -> StrokeTable:
    """Read positions and forces from the two columns of a table file that an entry names.

    Raises:
        CommandError: The file cannot be read, or is not such a table.
    """
    from ...inputs.table_files import read_table  # slow to import

    if not isinstance(value, str):
        raise CommandError(f"{at.label} is {value!r}; it must be the path of a CSV file.")
    data = read_table((folder or Path()) / value, "the load table")
    if len(data.headers) != len(_COLUMNS):
        raise CommandError(
            f"{data.label} has {len(data.headers)} columns; it must have two: positions and forces, with "
            "headers such as 'position [mm]' and 'force [kN]'."
        )
    columns = list[tuple[float, ...]]()
    for index, (subject, unit) in enumerate(_COLUMNS):
        header, target = data.headers[index], parse_unit_name(unit, "")
        label = f"the column '{header.text}' of {data.label}"
        header.check_unit_like_end(target, label, f"the {subject}", header.text)
        column_unit = None if header.unit is None else parse_unit_name(header.unit, label, target)
        numbers: Sequence[float] = data.numbers(index, padded=True).tolist()
        columns.append(tuple(Quantity(x, column_unit).in_unit(target, label) for x in numbers))
    try:
        return StrokeTable(columns[0], columns[1]).check()
    except ValueError as error:
        raise CommandError(f"{data.label} {error}") from error


class StartPosition(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The start position of a joint."""

    x_L: Annotated[float, quantity("m", "initial screw position", 0.24)]


class Move(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The motion of a joint: one quintic move, defined by its peak speed or its duration."""

    q_S: Annotated[float, quantity("m", "start of the reference", 0.244)]
    q_E: Annotated[float, quantity("m", "end of the reference", 0.27)]
    v_peak: Annotated[float, quantity("m/s", "peak speed", 0.06, gt=0.0)] | None = None
    duration: Annotated[float, quantity("s", "duration of the move", 2.0, gt=0.0)] | None = None

    def __post_init__(self) -> None:
        """Check that the move has a length and one duration."""
        if (self.v_peak is None) == (self.duration is None):
            has = "neither v_peak nor duration" if self.v_peak is None else "both v_peak and duration"
            raise ValueError(f"has {has}; write one of them.")
        if self.q_S == self.q_E:
            raise ValueError("has q_S = q_E; they must differ.")

    @property
    def peak(self) -> float:
        """The peak speed in m/s."""
        if self.v_peak is not None:
            return self.v_peak
        return 15.0 * abs(self.q_E - self.q_S) / (8.0 * (self.duration or 1.0))

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the reference."""
        return rest_to_rest(self.q_S, self.q_E, self.peak)


class Cycle(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A periodic motion: moves with one peak speed between way-points, and equal dwells."""

    way_points: Annotated[tuple[float, ...], quantity("m", "way-points of a cycle", [0.05, 0.3, 0.05])]
    v_peak: Annotated[float, quantity("m/s", "peak speed of every move", 0.026, gt=0.0)]
    period: Annotated[float, quantity("s", "time after which the motion repeats", 40.0, gt=0.0)]

    def __post_init__(self) -> None:
        """Check the way-points and the period."""
        points = self.way_points
        if not 2 <= len(points) <= MOVES + 1 or any(a == b for a, b in pairwise(points)):
            raise ValueError(
                f"has the way_points {list(points)}; they must be 2 to {MOVES + 1} positions, each different "
                "from the one before."
            )
        if sum(self.durations) > self.period:
            raise ValueError(
                f"has a period that is {self.period:g} s, but the moves take {sum(self.durations):g} s in "
                "total."
            )

    @property
    def durations(self) -> list[float]:
        """The durations of the moves in s."""
        return [quintic_duration(b - a, self.v_peak) for a, b in pairwise(self.way_points)]

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the reference."""
        durations = self.durations
        moves = len(durations)
        dwell = (self.period - sum(durations)) / moves
        starts = [sum(durations[:i]) + i * dwell for i in range(moves)]
        padding = MOVES - moves
        return {
            "x": [*self.way_points, *[self.way_points[-1]] * padding],
            "start": [*starts, *[NEVER] * padding],
            "duration": [*durations, *[1.0] * padding],
            "period": self.period,
        }


class Load(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Load force: levels in N, positive against extension, a ripple, and a force along the stroke.

    `start` has the times in s at which the second and later levels begin. `position` and `force`, or `file`,
    are the force along the stroke, which is added.
    """

    level: Annotated[tuple[float, ...], quantity("N", "load force", 57e3)] | None = None
    start: Annotated[tuple[float, ...], quantity("s", "times of the levels", [2.0])] | None = None
    ramp: Annotated[float, quantity("s", "time between levels", 0.5, gt=0.0)] | None = None
    ripple: Annotated[float, quantity("N", "width of the ripple", 5e3)] | None = None
    ripple_omega: Annotated[float, quantity("rad/s", "angular frequency of the ripple", 628.0)] | None = None
    position: Annotated[tuple[float, ...], quantity("m", "positions of the load", [0.0, 0.1])] | None = None
    force: Annotated[tuple[float, ...], quantity("N", "forces at the positions", [20e3, 35e3])] | None = None
    file: (
        Annotated[str, describe("CSV file with positions and forces", "lever.csv", read=read_stroke_file)]
        | None
    ) = None
    interpolation: Annotated[
        Literal[tuple(INTERPOLATIONS)],  # type: ignore[valid-type]
        describe("force between two positions", "linear"),
    ] = "linear"

    def __post_init__(self) -> None:
        """Check the number of levels and of times, and the force along the stroke."""
        if (self.position is None) != (self.force is None):
            has = "position without force" if self.force is None else "force without position"
            raise ValueError(f"has {has}; write both.")
        if self.file is not None and self.position is not None:
            raise ValueError("has both file and position; write one of them.")
        if self.level is None and self.table is None:
            raise ValueError(
                "lacks level, the load force; write level = 57000.0, or position and force for a load along "
                "the stroke."
            )
        if self.table is not None:
            self.table.check()
        count, times = len(self.levels), len(self.start or ())
        if not 1 <= count <= LEVELS:
            raise ValueError(f"has {count} values of level; it must have 1 to {LEVELS}.")
        if times != count - 1:
            raise ValueError(
                f"has {count} levels and {times} times in start; each level except the first needs one."
            )

    @property
    def levels(self) -> tuple[float, ...]:
        """The levels in N; 0 if the force is along the stroke only."""
        return (0.0,) if self.level is None else self.level

    @property
    def table(self) -> StrokeTable | None:
        """The force along the stroke; None without one."""
        interpolation = INTERPOLATIONS[self.interpolation]
        if isinstance(self.file, StrokeTable):
            return self.file._replace(interpolation=interpolation)
        if self.position is None or self.force is None:
            return None
        return StrokeTable(self.position, self.force, interpolation)

    @property
    def largest(self) -> float:
        """The load force in N of the largest magnitude."""
        stroke_forces = (0.0,) if self.table is None else self.table.force
        # a bound: levels and positions may not coincide
        level = max((a + b for a in self.levels for b in stroke_forces), key=abs)
        return level + math.copysign(0.5 * (self.ripple or 0.0), level)

    def force_at_start(self, x: float, compliance: "Compliance | None" = None) -> float:
        """Return the load force in N at rest at the start.

        Args:
            x: Start position of the screw in m.
            compliance: What is between screw and load; None for a rigid load.
        """
        force = self.levels[0]
        if self.table is None:
            return force
        deflection = 0.0
        # the force depends on the position, and the position on the force
        for _ in range(_ITERATIONS if compliance is not None else 1):
            force = self.levels[0] + self.table.force_at(x - deflection)
            if compliance is not None:
                deflection = resting_deflection(force, compliance.stiffness, compliance.backlash)
        return force

    def parameters(self) -> dict[str, Any]:
        """Return the load as parameters of the disturbance."""
        options = {"ramp": self.ramp, "ripple": self.ripple, "ripple_omega": self.ripple_omega}
        levels = self.levels
        parameters: dict[str, Any] = {"level": (*levels, *[levels[-1]] * (LEVELS - len(levels)))}
        if self.start is not None:
            parameters["level_start"] = (NEVER, *self.start, *[NEVER] * (LEVELS - 1 - len(self.start)))
        return parameters | {name: value for name, value in options.items() if value is not None}


_ITERATIONS = 60
"""Rounds to find where a load rests whose force depends on its position. A load is softer than its spring."""

ACTUATOR_PARTS = ("bearing", "screw", "nut", "backlash")
"""What of a load that is not rigid belongs to the actuator."""


def _make_stiffness_meta(part: str) -> msgspec.Meta:
    return quantity("N/m", f"stiffness of the {part}", "1200 N/um", gt=0.0)


def resting_deflection(force: float, stiffness: float, backlash: float) -> float:
    """Return the deflection in m of a load that rests under a force in N, for N/m and a play in m."""
    return force / stiffness + math.copysign(0.5 * backlash, force)


class Compliance(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A load that is not rigid: its mass, what is in series between it and the motor, and backlash.

    `damping_ratio` is that of the load swinging against a screw that is held. `backlash` is the whole play.
    """

    always: Annotated[bool, describe("whether the joint always runs with this load")] = False
    mass: Annotated[float, quantity("kg", "mass of the load", 5e3, gt=0.0)]
    bearing: Annotated[float, _make_stiffness_meta("bearing")]
    screw: Annotated[float, _make_stiffness_meta("screw")]
    nut: Annotated[float, _make_stiffness_meta("nut")]
    structure: Annotated[float, _make_stiffness_meta("structure")]
    damping_ratio: Annotated[float, quantity("", "damping ratio of the load", 0.02)] = 0.0
    backlash: Annotated[float, quantity("m", "backlash", 3e-6)] = 0.0

    @property
    def stiffness(self) -> float:
        """The stiffness of all parts in series, N/m (7)."""
        return motion_law.k_L(self.bearing, self.screw, self.nut, self.structure)

    def with_actuator(self, values: Mapping[str, float]) -> "Compliance":
        """Return the load with the parts of an actuator, from the values of its entries in SI units."""
        parts = {part: f"compliance.{part}" for part in ACTUATOR_PARTS}
        return msgspec.structs.replace(
            self, **{part: values[entry] for part, entry in parts.items() if entry in values}
        )

    @property
    def damping(self) -> float:
        """The damping between screw and load, N s/m."""
        return 2.0 * self.damping_ratio * math.sqrt(self.stiffness * self.mass)

    @property
    def omega(self) -> float:
        """The angular frequency in rad/s with which the load swings against a held screw."""
        return math.sqrt(self.stiffness / self.mass)

    def parameters(self, force: float) -> dict[str, Any]:
        """Return the parameters of the plant, for a load that rests under `force` in N at the start."""
        return {
            "m_load": self.mass,
            "stiffness": self.stiffness,
            "damping": self.damping,
            "backlash": self.backlash,
            "deflection_start": resting_deflection(force, self.stiffness, self.backlash),
        }


class LoadFeedback(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Control of the load by a position sensor at the load.

    `damping_ratio`, `integral` and `observer` are about the poles of load and feedback, relative to the
    frequency of the load on a held screw. `sigma` and `resolution` are those of the sensor.

    The defaults leave reserve for other stiffnesses and masses. More damping takes it, and lets the lift of
    the study oscillate at rest, where friction acts.
    """

    damping_ratio: Annotated[float, quantity("", "damping ratio added to the load", 0.05, ge=0.0)] = 0.05
    integral: Annotated[float, quantity("", "pole of the integral part", 0.05, ge=0.0)] = 0.05
    observer: Annotated[float, quantity("", "poles of the observer of the load", 5.0, gt=0.0)] = 5.0
    sigma: Annotated[float, quantity("m", "noise of the load sensor", 1e-6, ge=0.0)] = 1e-6
    resolution: Annotated[float, quantity("m", "position step of the load sensor", 1e-6, ge=0.0)] = 1e-6

    def gains(self, omega: float) -> dict[str, float]:
        """Return the gains of `ScrewCommand` for a load of `omega` rad/s.

        The screw follows its command at once, so that the load is a swing of omega without damping whose base
        moves. With z' = -(k_0 e + k_1 e' + k_2 e''), its error e has the characteristic polynomial
        (s + p omega) (s^2 + 2 zeta omega s + omega^2), where p is `integral` and zeta `damping_ratio`.
        """
        p, zeta = self.integral, self.damping_ratio
        return {"k_0": p * omega, "k_1": 2.0 * zeta * p, "k_2": (2.0 * zeta + p) / omega}


class JointExperiment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Motion and load of a joint in an experiment of the paper."""

    reference: Annotated[Cycle, describe("motion of the joint")]
    load: Annotated[Load, describe("load force")]


_TIME = Annotated[float, quantity("s", "time of a hold phase", 2.0, ge=0.0)]


class Brake(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A holding brake at the motor shaft: its torque there, its delays, and the phases in which it holds.

    The brake gets the command to close at the start of a phase, and is open at its end.
    """

    torque: Annotated[float, quantity("N.m", "torque at the motor up to which the brake holds", 60.0, gt=0.0)]
    engage_delay: Annotated[float, quantity("s", "time until the brake holds", 0.05, ge=0.0)] = 0.05
    release_delay: Annotated[float, quantity("s", "time until the brake is open", 0.1, ge=0.0)] = 0.1
    phases: tuple[tuple[_TIME, _TIME], ...]

    def __post_init__(self) -> None:
        """Check number, order and length of the phases."""
        if not 1 <= len(self.phases) <= PHASES:
            raise ValueError(f"has {len(self.phases)} phases; it must have 1 to {PHASES}.")
        delays = self.engage_delay + self.release_delay
        for start, end in self.phases:
            if not end - start > delays:
                raise ValueError(
                    f"has the phase from {start:g} to {end:g} s; it must be longer than engage_delay "
                    f"and release_delay together, {delays:g} s."
                )
        for (_, end), (start, _) in pairwise(self.phases):
            if start < end:
                raise ValueError(
                    f"has a phase that starts at {start:g} s, before the previous one ends at {end:g} s; "
                    "phases must be in order and must not overlap."
                )

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of `HoldingBrake`, by attribute."""
        padding = [NEVER] * (PHASES - len(self.phases))
        return {
            "start": [*(start for start, _ in self.phases), *padding],
            "end": [*(end for _, end in self.phases), *padding],
            "engage_delay": self.engage_delay,
            "release_delay": self.release_delay,
        }
