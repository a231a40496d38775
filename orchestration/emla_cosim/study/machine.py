"""The built-in systems of the manipulator: three joints that one trajectory leads and one machine loads."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from emla_fmu.parameters import EMLAS
from hdrm_fmu import HdrmPlant

from ..system.model import Component, System, Value
from .joint import start_values
from .roles import JOINTS
from .systems import STUDY, UNCERTAINTIES, Choice, study_joint
from .trajectory import Motion, motion

_LED: dict[str, str | None] = {
    f"reference.{name}": f"machine.trajectory.{name}[{{element}}]" for name in ("x_d", "v_d", "a_d")
}
_LOADED = {**_LED, "disturbance.F_L": "machine.manipulator.F_L[{element}]"}
_MOVED = {
    **_LED,
    "plant.x_L": "machine.plant.x_L[{element}]",
    "plant.v_L": "machine.plant.v_L[{element}]",
    "plant.d_2": "machine.plant.d_2[{element}]",
    "plant.F_L": None,
}
_REPLAYED = (
    "machine.trajectory.x_d[{element}] -> machine.manipulator.x_L[{element}]",
    "machine.trajectory.v_d[{element}] -> machine.manipulator.v_L[{element}]",
    "machine.trajectory.a_d[{element}] -> machine.manipulator.a_L[{element}]",
)
_COUPLED = (
    "{joint}.plant.x_L -> machine.manipulator.x_L[{element}]",
    "{joint}.plant.v_L -> machine.manipulator.v_L[{element}]",
    "{joint}.plant.a_L -> machine.manipulator.a_L[{element}]",
)
_MERGED = (
    "{joint}.motor.tau_m -> machine.plant.tau_m[{element}]",
    "machine.plant.x_L[{element}] -> {joint}.motor.x_L",
    "machine.plant.v_L[{element}] -> {joint}.motor.v_L",
)


def _replay(controller: Choice, gains: Choice, trajectory: Path | None = None) -> System:
    """Load forces of the motion that is wanted, as the paper takes them: nobody's motion changes them."""
    machine = Component("machine.manipulator", "HdrmManipulator")
    return _system(controller, gains, motion(trajectory), machine, _LOADED, _REPLAYED)


def _coupled(controller: Choice, gains: Choice, trajectory: Path | None = None) -> System:
    """Load forces of the motion that there is: plants and manipulator exchange motion and force."""
    machine = Component("machine.manipulator", "HdrmManipulator")
    return _system(controller, gains, motion(trajectory), machine, _LOADED, _COUPLED)


def _merged(controller: Choice, gains: Choice, trajectory: Path | None = None) -> System:
    """The mechanics of plants and manipulator in one component, which need not agree on a force."""
    wanted = motion(trajectory)
    machine = Component("machine.plant", "HdrmPlant", _mechanics(wanted))
    return _system(controller, gains, wanted, machine, _MOVED, _MERGED, electrical=True)


def _system(
    controller: Choice,
    gains: Choice,
    wanted: Motion,
    machine: Component,
    elsewhere: Mapping[str, str | None],
    wires: Sequence[str],
    electrical: bool = False,
) -> System:
    """Three joints with what they share; names in `elsewhere` and `wires` are made for each of them."""
    components, connections = list[Component](), list[str]()
    for element, joint in enumerate(JOINTS, 1):
        made = study_joint(
            joint,
            controller,
            gains,
            reference=None,
            load={},
            ahead=wanted.ahead[joint],
            on_machine=True,
            electrical=electrical,
            elsewhere={
                end: None if place is None else place.format(joint=joint, element=element)
                for end, place in elsewhere.items()
            },
        )
        components += made.components
        connections += [*made.wires, *(wire.format(joint=joint, element=element) for wire in wires)]
    shared = (Component("machine.trajectory", "Trajectory", wanted.parameters), machine)
    return System((*components, *shared), ()).with_connections(*connections)


def _mechanics(wanted: Motion) -> dict[str, Value]:
    """The actuators' part in the merged plant, and where it starts."""
    emlas = [EMLAS[joint] for joint in JOINTS]
    known = {x.attribute for x in HdrmPlant.layout().parameters if x.shape}
    actuators: dict[str, Any] = {
        name: [getattr(emla, name) for emla in emlas] for name in sorted(known) if hasattr(emlas[0], name)
    }
    start = [STUDY[joint].x_start + wanted.ahead[joint] for joint in JOINTS]
    uncertain = [UNCERTAINTIES["F_2"]] * len(JOINTS)
    return start_values(HdrmPlant, {**actuators, "x_L_start": start, "F_2": uncertain})


SYSTEMS: dict[str, Callable[..., System]] = {
    "hdrm-replay": _replay,
    "hdrm-coupled": _coupled,
    "hdrm-merged": _merged,
}
"""Systems by name, made for a controller, a set of its gains, and maybe the file of a trajectory."""
