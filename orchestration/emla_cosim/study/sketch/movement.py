"""The movement of a machine in a run: its geometry, with strokes, forces and payload over time."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import Vector
from ...run.result import Result
from ..machines.run_machine import COMPONENTS, find_component, find_machine
from ..roles import find_element, find_variable, list_given_joints

if TYPE_CHECKING:
    from machine_fmu.model import MachineModel

MADE, WANTED, FORCE = "x_L", "x_s", "F_L"
"""The roles of the signals of a movement."""


@dataclass(frozen=True)
class Movement:
    """A machine over `time` in s.

    `strokes` in m, `wanted` (reference) strokes in m and `forces` in N have a column for each actuator;
    `payload` is in kg. `passive` has the coordinates in m or rad of what swings freely; where they were not
    recorded, it hangs at rest. Other values that were not recorded are None. If only the reference was
    recorded, it is in `strokes`.
    """

    machine: "MachineModel"
    time: Vector
    strokes: Vector
    payload: Vector
    passive: Vector
    wanted: Vector | None = None
    forces: Vector | None = None

    @cached_property
    def path(self) -> Vector:
        """The position of the tip, in m."""
        return self.machine.tip(self.strokes, self.passive)

    @cached_property
    def wanted_path(self) -> Vector | None:
        """The reference position of the tip in m, with what swings freely at rest."""
        if self.wanted is None:
            return None
        return self.machine.tip(self.wanted, payload=self.payload)

    @property
    def errors(self) -> Vector | None:
        """Strokes minus reference strokes, in m."""
        return None if self.wanted is None else self.strokes - self.wanted

    def until(self, row: int) -> "Movement":
        """Return the rows before this one."""
        wanted = None if self.wanted is None else self.wanted[:row]
        forces = None if self.forces is None else self.forces[:row]
        time, strokes, payload, passive = (
            x[:row] for x in (self.time, self.strokes, self.payload, self.passive)
        )
        return Movement(self.machine, time, strokes, payload, passive, wanted, forces)


def animated_signals(names: Collection[str], roles: Mapping[str, str]) -> list[str] | None:
    """Return the strokes, reference strokes and forces among the signals; None without a machine."""
    joints = [joint for joint in list_given_joints(roles) if find_element(joint, roles) is not None]
    found = [_signals(joints, role, names, roles) for role in (MADE, WANTED, FORCE)]
    there = any(name.startswith(f"{machine}.") for name in names for machine in COMPONENTS)
    return [name for signals in found for name in signals] if there and all(found) else None


def recorded_signals(result: Result) -> list[str]:
    """Return the recorded signals of the machine; an empty list without a machine."""
    machine = find_machine(result)
    if machine is None:
        return []
    found = [
        name
        for role in (MADE, WANTED, FORCE)
        for name in _signals(machine.names, role, result.names, result.roles)
    ]
    driver = _payload_driver(result)
    return [*found, *_passive_names(machine, result.names, result), *([] if driver is None else [driver])]


def read_movement(result: Result, data: Mapping[str, Vector]) -> Movement | None:
    """Return the movement of a run, as far as the machine closes; None if it is unknown.

    `data` has the columns of `recorded_signals`, and `time`.
    """
    machine = find_machine(result)
    if machine is None:
        return None
    made, wanted, forces = (_columns(machine, role, data, result.roles) for role in (MADE, WANTED, FORCE))
    if made is None:
        made, wanted = wanted, None
    if made is None:
        return None
    payload = _payload(machine, result, data)
    names = _passive_names(machine, data, result)
    passive = np.column_stack([data[n] for n in names]) if names else machine.hanging(made, payload)
    found = Movement(machine, data["time"], made, payload, passive, wanted, forces)
    broken = np.flatnonzero(~np.isfinite(found.path).all(axis=1))
    found = found.until(broken[0]) if len(broken) else found
    return found if len(found.time) > 1 else None


def _signals(joints: Iterable[str], role: str, names: Collection[str], roles: Mapping[str, str]) -> list[str]:
    """Return the signals of all joints in this role; an empty list if a joint lacks it."""
    found = [find_variable(joint, role, names, roles) for joint in joints]
    return [] if None in found else [name for name in found if name is not None]


def _columns(
    machine: "MachineModel", role: str, data: Mapping[str, Vector], roles: Mapping[str, str]
) -> Vector | None:
    names = _signals(machine.names, role, data, roles)
    return np.column_stack([data[name] for name in names]) if names else None


def _passive_names(machine: "MachineModel", names: Collection[str], result: Result) -> list[str]:
    """Return the signals of all passive coordinates; an empty list if one was not recorded."""
    count = len(machine.mechanism.passive)
    found = [f"{find_component(result)}.passive.q[{i}]" for i in range(1, count + 1)]
    return found if all(name in names for name in found) else []


def _payload_driver(result: Result) -> str | None:
    """Return the signal that drives the payload, if it was recorded."""
    target = f"{find_component(result)}.payload.m"
    ends = (text.partition(" -> ") for text in result.record["connections"])
    source = next((source for source, _, end in ends if f"{end} ".startswith(f"{target} ")), None)
    return source if source in result.names else None


def _payload(machine: "MachineModel", result: Result, data: Mapping[str, Vector]) -> Vector:
    """Return the payload in kg at every row."""
    driver = _payload_driver(result)
    if driver is not None:
        return data[driver]
    given = result.record["components"][find_component(result)]["parameters"]
    return np.full(len(data["time"]), float(given.get("payload.m", machine.payload)))
