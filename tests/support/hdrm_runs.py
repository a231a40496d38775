"""Results of the manipulator made by hand: a smooth motion from rest to rest, and small errors."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from emla_cosim.master.stepping.timing import CommunicationPoints
from emla_cosim.recorders.recorder import RunLayout
from emla_cosim.recorders.table import TimeSeries
from emla_cosim.run.result import Result
from tests.support.machines import named_values
from tests.support.manipulator_geometry import HDRM, Manipulator
from tests.support.reference_manipulator import Lagrangian

JOINTS = ("lift", "tilt", "telescope")
MACHINE_ROLES = {f"{joint}.x_d": f"machine.trajectory.x_d[{i}]" for i, joint in enumerate(JOINTS, 1)}
Q_S, Q_E = np.array([0.244, 0.389, 0.499]), np.array([0.270, 0.442, 0.348])


def replayed(
    p: Manipulator = HDRM,
    rows: int = 201,
    duration: float = 10.0,
    payload: float = 470.0,
    merged: bool = False,
    leave_out: tuple[str, ...] = (),
    **changed: Any,
) -> Result:
    """A run such as hdrm-replay gives, or hdrm-merged, without signals whose names begin as in `leave_out`.

    `changed` are strokes in place of those made, by joint.
    """
    machine = "machine.plant" if merged else "machine.manipulator"
    time, q_d, v_d, a_d, q = _motion(rows, duration)
    for joint, values in changed.items():
        q[:, JOINTS.index(joint)] = values
    states = zip(q_d.tolist(), v_d.tolist(), a_d.tolist(), strict=True)
    lagrangian = Lagrangian(p)
    force = np.array([lagrangian.forces(*state, payload) for state in states])
    columns = {}
    for i, joint in enumerate(JOINTS):
        columns |= {f"machine.trajectory.{n}[{i + 1}]": x[:, i] for n, x in _by_suffix(q_d, v_d, a_d).items()}
        stroke = f"machine.plant.x_L[{i + 1}]" if merged else f"{joint}.plant.x_L"
        columns |= {stroke: q[:, i], f"{machine}.F_L[{i + 1}]": force[:, i]}
    columns = {n: x for n, x in columns.items() if not n.startswith(leave_out)}
    return result_of(time, columns, parameters(p, machine), {machine: {"payload.m": payload}})


def result_of(
    time: np.ndarray,
    columns: Mapping[str, np.ndarray],
    parameters: Mapping[str, float],
    start_values: Mapping[str, Mapping[str, float]],
) -> Result:
    """A result with these signals and parameters, and components that were given these start values."""
    times = CommunicationPoints(float(time[0]), float(time[1] - time[0]), len(time) - 1)
    table = TimeSeries()
    table.begin(RunLayout(list(columns), [None] * len(columns), times, range(len(columns))))
    table.append(np.column_stack([time, *columns.values()]))
    return Result(
        name="hdrm-replay",
        units=dict.fromkeys(columns),
        times=times,
        table=table,
        metrics={},
        displays={},
        remarks=(),
        steps=len(time) - 1,
        simulated_s=float(time[-1] - time[0]),
        end_s=float(time[-1]),
        wall_s=1.0,
        stepping={},
        pacing=None,
        problem=None,
        interrupted=False,
        record={
            "components": {name: {"parameters": dict(values)} for name, values in start_values.items()},
            "connections": [],
            "settings": {"output_format": "csv"},
        },
        parameters=parameters,
        roles=MACHINE_ROLES,
    )


def parameters(p: Manipulator, machine: str = "machine.manipulator") -> dict[str, float]:
    """Those of the manipulator, by full name."""
    return {f"{machine}.{name}": value for name, value in named_values(p).items()}


def _by_suffix(x: np.ndarray, v: np.ndarray, a: np.ndarray) -> dict[str, np.ndarray]:
    return {"x_d": x, "v_d": v, "a_d": a}


def _motion(rows: int, duration: float) -> tuple[np.ndarray, ...]:
    """Time, reference with its derivatives by the quintic from rest to rest, and strokes near to it."""
    time = np.linspace(0.0, duration, rows)
    s = time[:, None] / duration
    way = Q_E - Q_S
    q = Q_S + way * s**3 * (10 - 15 * s + 6 * s**2)
    v = way * s**2 * (30 - 60 * s + 30 * s**2) / duration
    a = way * s * (60 - 180 * s + 120 * s**2) / duration**2
    error = 1e-5 * np.sin(8.0 * time)[:, None] - 4e-3 * np.exp(-50.0 * time)[:, None]
    return time, q, v, a, q + error
