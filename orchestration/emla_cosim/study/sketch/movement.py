"""The movement of a manipulator in a run: geometry, strokes, forces and payload over time."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from hdrm_fmu import HdrmManipulator, HdrmParameters
from hdrm_fmu.kinematics import tip
from hdrm_fmu.parameters import PAYLOAD
from machine_fmu.trajectory import JOINTS

from ...base.arrays import Vector
from ...run.result import Result
from ..roles import find_variable

MACHINES = ("machine.manipulator", "machine.plant")
"""Components that may have the geometry."""

MADE, WANTED, FORCE = "x_L", "x_s", "F_L"
"""The roles of the signals of a movement."""


@dataclass(frozen=True)
class Movement:
    """A manipulator over `time` in s.

    `strokes` in m, `wanted` (reference) strokes in m and `forces` in N have a column for each joint;
    `payload`
    is in kg. Values that were not recorded are None. If only the reference was recorded, it is in `strokes`.
    """

    p: HdrmParameters
    time: Vector
    strokes: Vector
    payload: Vector
    wanted: Vector | None = None
    forces: Vector | None = None

    @cached_property
    def path(self) -> Vector:
        """The position of the tip, in m from O1."""
        return _path(self.p, self.strokes)

    @cached_property
    def wanted_path(self) -> Vector | None:
        """The reference position of the tip, in m from O1."""
        return None if self.wanted is None else _path(self.p, self.wanted)

    @property
    def errors(self) -> Vector | None:
        """Strokes minus reference strokes, in m."""
        return None if self.wanted is None else self.strokes - self.wanted

    def until(self, row: int) -> "Movement":
        """Return the rows before this one."""
        wanted = None if self.wanted is None else self.wanted[:row]
        forces = None if self.forces is None else self.forces[:row]
        return Movement(self.p, self.time[:row], self.strokes[:row], self.payload[:row], wanted, forces)


def animated_signals(names: Collection[str], roles: Mapping[str, str]) -> list[str] | None:
    """Return the strokes, reference strokes and forces among the signals; None without a manipulator."""
    found = [_signals(role, names, roles) for role in (MADE, WANTED, FORCE)]
    there = any(name.startswith(f"{machine}.") for name in names for machine in MACHINES)
    return [name for signals in found for name in signals] if there and all(found) else None


def recorded_signals(result: Result) -> list[str]:
    """Return the recorded signals of the manipulator; an empty list without a manipulator."""
    if _machine(result) is None:
        return []
    found = [name for role in (MADE, WANTED, FORCE) for name in _signals(role, result.names, result.roles)]
    driver = _payload_driver(result)
    return found if driver is None else [*found, driver]


def read_movement(result: Result, data: Mapping[str, Vector]) -> Movement | None:
    """Return the movement of a run, as far as the manipulator's triangles close; None if it is unknown.

    `data` has the columns of `recorded_signals`, and `time`.
    """
    p = _geometry(result)
    made, wanted, forces = (_columns(role, data, result.roles) for role in (MADE, WANTED, FORCE))
    if made is None:
        made, wanted = wanted, None
    if p is None or made is None:
        return None
    found = Movement(p, data["time"], made, _payload(result, data), wanted, forces)
    broken = np.flatnonzero(~np.isfinite(found.path).all(axis=1))
    found = found.until(broken[0]) if len(broken) else found
    return found if len(found.time) > 1 else None


def _signals(role: str, names: Collection[str], roles: Mapping[str, str]) -> list[str]:
    """Return the signals of all joints in this role; an empty list if a joint lacks it."""
    found = [name for joint in JOINTS if (name := find_variable(joint, role, names, roles)) is not None]
    return found if len(found) == len(JOINTS) else []


def _columns(role: str, data: Mapping[str, Vector], roles: Mapping[str, str]) -> Vector | None:
    names = _signals(role, data, roles)
    return np.column_stack([data[name] for name in names]) if names else None


def _machine(result: Result) -> str | None:
    """Return the component that has the geometry."""
    return next((name for name in MACHINES if name in result.record["components"]), None)


def _geometry(result: Result) -> HdrmParameters | None:
    """Return the parameters of the run; None if they are not those of our blocks, or invalid."""
    values = {}
    for name in (field.name for field in fields(HdrmParameters)):
        declared = getattr(HdrmManipulator, name)
        elements = [result.parameters.get(f"{_machine(result)}.{x.name}") for x in declared.scalars()]
        if None in elements:
            return None
        values[name] = tuple(elements) if declared.shape else elements[0]
    try:
        return HdrmParameters(**values)
    except ValueError:
        return None


def _payload_driver(result: Result) -> str | None:
    """Return the signal that drives the payload, if it was recorded."""
    target = f"{_machine(result)}.payload.m"
    ends = (text.partition(" -> ") for text in result.record["connections"])
    source = next((source for source, _, end in ends if f"{end} ".startswith(f"{target} ")), None)
    return source if source in result.names else None


def _payload(result: Result, data: Mapping[str, Vector]) -> Vector:
    """Return the payload in kg at every row."""
    driver = _payload_driver(result)
    if driver is not None:
        return data[driver]
    given = result.record["components"][_machine(result)]["parameters"].get("payload.m", PAYLOAD)
    return np.full(len(data["time"]), float(given))


def _path(p: HdrmParameters, strokes: Vector) -> Vector:
    """Return the tip at these strokes; NaN if a triangle does not close."""
    return np.array([tip(p, q) for q in strokes.tolist()])
