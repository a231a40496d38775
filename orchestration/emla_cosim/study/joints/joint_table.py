"""Joint files as structs of msgspec."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from ...base.errors import CommandError
from ...base.option import RUN
from ...base.table_entries import Location
from ...base.toml_structs import describe, dotted, extend_struct, quantity
from ...run.scenarios.scenario_file import with_options
from ..actuator.actuator import Actuator, read_tables
from ..actuator.sheet_values import ACTUATOR
from .block_tables import DISTURBANCE, PLANT
from .gain_tables import build_controllers_struct, build_observer_table
from .motions import Brake, Compliance, JointExperiment, Load, LoadFeedback, Move, StartPosition


class Cells(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Figures of the paper; in normalised averages they are ratios. The names are those of `JointFigures`."""

    position_error_m: Annotated[float, quantity("m", "position error")]
    velocity_error_m_s: Annotated[float, quantity("m/s", "speed error")]
    torque_effort_N_m: Annotated[float, quantity("N.m", "torque effort")]
    convergence_time_s: Annotated[float, quantity("s", "convergence time")]

    def __iter__(self) -> Iterator[float]:
        return iter(msgspec.structs.astuple(self))


class RunTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The options of the joint's scenario."""

    stop_time: Annotated[float, quantity("s", "stop time in s", 10.0)]
    step_size: Annotated[float, quantity("s", "communication step in s", 1e-4)]


class DriveTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Entries of the actuator in scenarios with a realistic drive."""

    always: Annotated[bool, describe("whether the joint always runs with these entries")] = False
    inverter: Mapping[str, Any] | None = None
    sensor: Mapping[str, Any] | None = None
    friction: Mapping[str, Any] | None = None
    stop: Mapping[str, Any] | None = None
    thermal: Mapping[str, Any] | None = None


class Tuning(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Data for `emla tune`: the convergence time to beat, and values for the case with noise."""

    convergence_time: Annotated[float, quantity("s", "convergence time to beat", 0.085)] | None = None
    noisy: Annotated[
        dict[str, Annotated[int | float, describe("number")]], dotted("start values of the case with noise")
    ] = msgspec.field(default_factory=dict)


def _read_actuator(value: Any, at: Location, folder: Path | None) -> Actuator:
    """Read the actuator, inline or from the file that the entry names."""
    label = f"[actuator] of {at.file}"
    if isinstance(value, str):
        path = (folder or Path()) / value
        label, value = f"the actuator '{path}'", read_tables(path)[0]
    if not isinstance(value, Mapping):
        raise CommandError(f"{label} is {value!r}; it must be a table, or the path of a file.")
    # two places for the same gains could differ
    if "control" in value:
        raise CommandError(
            f"{label} has the table 'control'; remove it, since [gains] of a joint file has all gains.",
            key="control",
        )
    return Actuator.of_tables(value, label)


class JointTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All data of a joint."""

    # `joint_struct` has the types of fields that are Any here

    kind: Literal["joint"]
    description: Annotated[str, describe("line that `emla list` shows")]
    sample_time: Annotated[float, quantity("s", "sample time of observer and controller", 1e-4, gt=0.0)]
    seed: Annotated[int, describe("start of the random sequences")] | None = None
    run: Any
    actuator: Any
    drive: DriveTable = DriveTable()
    start: Annotated[StartPosition, describe("start position of the screw")]
    reference: Annotated[Move, describe("motion of the joint")]
    load: Annotated[Load, describe("load force")]
    disturbance: Any
    plant: Any
    compliance: Compliance | None = None
    load_feedback: LoadFeedback = LoadFeedback()
    brake: Brake | None = None
    observers: Any = msgspec.field(name="observer")
    gains: Any
    tuning: Tuning | None = None
    experiments: dict[str, JointExperiment] = msgspec.field(default_factory=dict, name="experiment")
    printed: dict[str, dict[str, Cells]] = msgspec.field(default_factory=dict, name="paper")


KEYS = frozenset(JointTable.__struct_encode_fields__) - {"description", "actuator", "gains"}
"""Entries that a scenario file does not support."""


def joint_struct() -> type[JointTable]:
    """Return the struct of joint files, with the options and the controllers that are registered."""
    about = "data of motor, screw, inverter and sensor, or the path of a file"
    observers = dict[str, build_observer_table()]  # type: ignore[misc]
    return extend_struct(
        JointTable,
        "Joint",
        [
            ("run", Annotated[with_options(RunTable, "Run", RUN), describe("options of its scenario")]),
            ("actuator", Annotated[str | ACTUATOR, describe(about, read=_read_actuator)]),
            ("disturbance", Annotated[DISTURBANCE, dotted("parameters of the disturbance")], DISTURBANCE()),
            ("plant", Annotated[PLANT, dotted("parameters of the plant")], PLANT()),
            ("observers", observers, msgspec.field(default_factory=dict, name="observer")),
            ("gains", build_controllers_struct(), None),
        ],
    )
