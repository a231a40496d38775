"""The movement of a machine in a run: its geometry, with strokes, forces and payload over time."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import Vector
from ...run.result import Result
from ..machines.machine_info import COMPONENTS, find_component, find_machine
from ..roles import find_element, find_variable, list_joints_with_roles

if TYPE_CHECKING:
    from machine_fmu.model import MachineModel

STROKE, REFERENCE, FORCE = "x_L", "x_s", "F_L"
"""The roles of the signals of a movement."""


@dataclass(frozen=True)
class Movement:
    """A machine over `time` in s.

    `strokes` in m, `reference` strokes in m and `forces` in N have a column for each actuator;
    `payload` is in kg. `passive` has the coordinates in m or rad of what swings freely; where they were not
    recorded, it hangs at rest. Other values that were not recorded are None. If only the reference was
    recorded, it is in `strokes`.
    """

    machine: "MachineModel"
    time: Vector
    strokes: Vector
    payload: Vector
    passive: Vector
    reference: Vector | None = None
    forces: Vector | None = None

    @cached_property
    def path(self) -> Vector:
        """The position of the tip, in m."""
        return self.machine.tip(self.strokes, self.passive)

    @cached_property
    def reference_path(self) -> Vector | None:
        """The reference position of the tip in m, with what swings freely at rest."""
        if self.reference is None:
            return None
        return self.machine.tip(self.reference, payload=self.payload)

    @property
    def errors(self) -> Vector | None:
        """Strokes minus reference strokes, in m."""
        return None if self.reference is None else self.strokes - self.reference

    def until(self, row: int) -> "Movement":
        """Return the rows before this one."""
        columns = {f.name: getattr(self, f.name) for f in fields(self)}
        return replace(self, **{n: x[:row] for n, x in columns.items() if isinstance(x, np.ndarray)})


def find_animated_signals(names: Collection[str], roles: Mapping[str, str]) -> list[str] | None:
    """Return the strokes, reference strokes and forces among the signals; None if one of them is missing."""
    joints = [joint for joint in list_joints_with_roles(roles) if find_element(joint, roles) is not None]
    signals_by_role = [_find_signals(joints, role, names, roles) for role in (STROKE, REFERENCE, FORCE)]
    has_machine = any(name.startswith(f"{machine}.") for name in names for machine in COMPONENTS)
    return (
        [name for signals in signals_by_role for name in signals]
        if has_machine and all(signals_by_role)
        else None
    )


def list_recorded_signals(result: Result) -> list[str]:
    """Return the recorded signals of the machine; an empty list without a machine."""
    machine = find_machine(result)
    if machine is None:
        return []
    signals = [
        name
        for role in (STROKE, REFERENCE, FORCE)
        for name in _find_signals(machine.names, role, result.names, result.roles)
    ]
    driver = _find_payload_driver(result)
    return [
        *signals,
        *_find_passive_signals(machine, result.names, result),
        *([] if driver is None else [driver]),
    ]


def read_movement(result: Result, data: Mapping[str, Vector]) -> Movement | None:
    """Return the movement of a run until the machine no longer closes; None for fewer than two rows.

    Also None without a machine, or if neither strokes nor reference strokes were recorded.

    `data` has the columns of `list_recorded_signals`, and `time`.
    """
    machine = find_machine(result)
    if machine is None:
        return None
    strokes, reference, forces = (
        _stack_columns(machine, role, data, result.roles) for role in (STROKE, REFERENCE, FORCE)
    )
    if strokes is None:
        strokes, reference = reference, None
    if strokes is None:
        return None
    payload = _read_payload(machine, result, data)
    names = _find_passive_signals(machine, data, result)
    passive = np.column_stack([data[n] for n in names]) if names else machine.hanging(strokes, payload)
    movement = Movement(machine, data["time"], strokes, payload, passive, reference, forces)
    # a run that diverges opens its triangles
    broken = np.flatnonzero(~np.isfinite(movement.path).all(axis=1))
    movement = movement.until(broken[0]) if len(broken) else movement
    return movement if len(movement.time) > 1 else None


def _find_signals(
    joints: Iterable[str], role: str, names: Collection[str], roles: Mapping[str, str]
) -> list[str]:
    """Return the signals of all joints in this role; an empty list if a joint lacks it."""
    variables = [find_variable(joint, role, names, roles) for joint in joints]
    return [] if None in variables else [name for name in variables if name is not None]


def _stack_columns(
    machine: "MachineModel", role: str, data: Mapping[str, Vector], roles: Mapping[str, str]
) -> Vector | None:
    """Return the signals of a role as columns, one for each actuator; None if an actuator lacks it."""
    names = _find_signals(machine.names, role, data, roles)
    return np.column_stack([data[name] for name in names]) if names else None


def _find_passive_signals(machine: "MachineModel", names: Collection[str], result: Result) -> list[str]:
    """Return the signals of all passive coordinates; an empty list if one was not recorded."""
    count = len(machine.mechanism.passive)
    signals = [f"{find_component(result)}.passive.q[{i}]" for i in range(1, count + 1)]
    return signals if all(name in names for name in signals) else []


def _find_payload_driver(result: Result) -> str | None:
    """Return the signal that drives the payload; None if there is none, or if it was not recorded."""
    target = f"{find_component(result)}.payload.m"
    ends = (text.partition(" -> ") for text in result.record["connections"])
    source = next((source for source, _, end in ends if f"{end} ".startswith(f"{target} ")), None)
    return source if source in result.names else None


def _read_payload(machine: "MachineModel", result: Result, data: Mapping[str, Vector]) -> Vector:
    """Return the payload in kg at every row."""
    driver = _find_payload_driver(result)
    if driver is not None:
        return data[driver]
    parameters = result.record["components"][find_component(result)]["parameters"]
    return np.full(len(data["time"]), float(parameters.get("payload.m", machine.payload)))
