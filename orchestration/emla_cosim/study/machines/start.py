"""The state of a machine at the start of a run: its pose, what swings freely, and masses at the screws."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

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

from ...base.errors import CommandError
from ...base.extras import require_extra

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
        pose = _reach(mechanism, closure, strokes, label)
        guess = {i: pose[i] for i in closure.iterated}
    passive = _find_rest(machine, strokes, label) if mechanism.passive else []
    at_rest = Dynamics(mechanism, closure, strokes, passive, guess, _ITERATIONS)
    M = at_rest.mass_matrix()
    masses = [float(plain(M[i][i])) for i in range(len(strokes))]
    # formulas give NaN where a triangle does not close
    if not all(map(math.isfinite, masses)):
        _reach(mechanism, closure, strokes, label)  # the message says which triangle does not close
    numbers = at_rest.pose.numbers
    values = {f"start.pose[{n}]": float(plain(numbers[i])) for n, i in enumerate(closure.iterated, 1)}
    values |= {f"start.passive.q[{n}]": x for n, x in enumerate(passive, 1)}
    return Start(values, masses)


def _reach(mechanism: Mechanism, closure: Closure, strokes: Sequence[float], label: str) -> list[float]:
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
