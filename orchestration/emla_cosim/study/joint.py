"""One joint: reference, plant, disturbance, observer and controller, connected."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from emla_fmu import Disturbance, EmlaCompliantPlant, EmlaMotor, EmlaObserver, EmlaPlant, Reference
from fmublock import Block
from fmublock.variables import Variable

from ..base.errors import CommandError
from ..system.model import Component, System, Value

_WIRES = (
    "reference.x_d -> controller.x_d",
    "reference.v_d -> controller.v_d",
    "reference.a_d -> controller.a_d",
    "disturbance.F_L -> plant.F_L",
    "disturbance.d_2 -> plant.d_2",
    "disturbance.d_3 -> plant.d_3",
    "disturbance.d_4 -> plant.d_4",
    "disturbance.supply.sag -> plant.supply.sag",
    "plant.v_L -> disturbance.v_L",  # (82) contains arctan(x_2)
    "plant.x_measured -> observer.y",
    "plant.i_q_measured -> controller.i_q",
    "plant.i_d_measured -> controller.i_d",
    "plant.i_q_measured -> observer.i_q",
    "plant.inverter.u_available -> controller.u_available",
    "observer.d_hat -> controller.d_hat",
    "controller.u_q -> plant.u_q",
    "controller.u_d -> plant.u_d",
    "controller.i_q_ref -> plant.i_q_ref",
    "controller.i_q_ref -> observer.i_q_ref",
)
_ESTIMATED = ("observer.x_hat -> controller.x_hat", "observer.v_hat -> controller.v_hat")
_SAMPLE = ("disturbance", "observer")
"""Components that compute at communication points, like the controller: the disturbance draws random numbers.
"""

_SENSOR_FAULTS = ("sensor.sigma", "sensor.resolution", "sensor.current.sigma", "sensor.current.resolution")

_TRUE = ("plant.x_L -> controller.x_hat", "plant.v_L -> controller.v_hat")


def ideal_sensors(system: System) -> dict[str, Value]:
    """Return start values that switch off noise and steps of the sensors in the plants of joints."""
    own = tuple(block.__name__ for block in (EmlaMotor, EmlaPlant, EmlaCompliantPlant))
    return {f"{c.name}.{p}": 0.0 for c in system.components if c.model in own for p in _SENSOR_FAULTS}


def position_loop(joint: str) -> str:
    """Return the connection at which the position loop of a joint is opened: its measured position."""
    return f"{joint}.plant.x_measured -> {joint}.observer.y"


@dataclass(frozen=True)
class Joint:
    """Components of a joint, and its connections by full names, which may lead to other components."""

    components: tuple[Component, ...]
    wires: tuple[str, ...]

    def alone(self) -> System:
        """Return the joint as a system of its own."""
        return System(self.components, ()).with_connections(*self.wires)


def build_joint(
    name: str,
    *,
    emla: Any,
    controller: type[Block] | Path,
    gains: Any,
    observer_gains: Any,
    reference: Mapping[str, Any] | None,
    disturbance: Mapping[str, Any],
    plant: Mapping[str, Any],
    estimate: float,
    true_feedback: bool = False,
    electrical: bool = False,
    compliant: bool = False,
    elsewhere: Mapping[str, str | None] = MappingProxyType({}),
) -> Joint:
    """Build a joint from its parameters, with a block or an FMU as controller.

    The controller has the outputs u_q and u_d, and any of the inputs x_d, v_d, a_d, x_hat, v_hat, d_hat, i_q,
    i_d and u_available. Its output i_q_ref, if it has one, goes to plant and observer.

    Args:
        name: The name of the joint.
        emla: Parameters that plant, observer and controller share.
        controller: A block, or the file of an FMU.
        gains: Gains of the controller.
        observer_gains: Gains of the observer.
        reference: Values by attribute of the block; None for a joint whose reference is elsewhere.
        disturbance: Values by attribute of the block.
        plant: Values by attribute of the block.
        estimate: The observer's start in m.
        true_feedback: Whether the controller gets the plant's true position and speed.
        electrical: Whether the plant is only its electrical half, `motor`.
        compliant: Whether the plant has a load that is not rigid.
        elsewhere: Full names of variables of other components that replace ends such as reference.x_d; None
            leaves an end open.

    Raises:
        CommandError: The controller lacks u_q or u_d.
    """
    driven = EmlaMotor if electrical else EmlaCompliantPlant if compliant else EmlaPlant
    blocks: dict[type[Block], tuple[str, Sequence[Any]]] = {
        driven: ("motor" if electrical else "plant", [emla, plant]),
        Disturbance: ("disturbance", [disturbance]),
        EmlaObserver: ("observer", [emla, observer_gains, {"x_hat_start": estimate}]),
    }
    if reference is not None:
        blocks = {Reference: ("reference", [reference]), **blocks}
    components = [
        Component(f"{name}.{role}", block.__name__, start_values(block, *sources), samples=role in _SAMPLE)
        for block, (role, sources) in blocks.items()
    ]
    components.append(_controller(f"{name}.controller", controller, emla, gains))
    wires = (*_WIRES, *(_TRUE if true_feedback else _ESTIMATED))
    roles = {"plant": "motor"} if electrical else {}
    ends = [
        [_full_name(name, end, roles, elsewhere) for end in wire.split(" -> ")]
        for wire in wires
        if _has_port(_ports(controller), wire)
    ]
    return Joint(tuple(components), tuple(f"{a} -> {b}" for a, b in ends if a is not None and b is not None))


def _full_name(
    joint: str, end: str, roles: Mapping[str, str], elsewhere: Mapping[str, str | None]
) -> str | None:
    if end in elsewhere:
        return elsewhere[end]
    role, _, port = end.partition(".")
    return f"{joint}.{roles.get(role, role)}.{port}"


def _controller(name: str, controller: type[Block] | Path, emla: Any, gains: Any) -> Component:
    for port in ("u_q", "u_d"):
        if port not in _ports(controller):
            raise CommandError(
                f"the controller {_controller_label(controller)} has no output '{port}'.", name=port
            )
    if isinstance(controller, Path):
        return Component(name, fmu=controller, samples=True)
    model = controller.__name__ if controller.__module__.startswith("rsba_fmu.") else controller
    return Component(name, model, start_values(controller, emla, gains), samples=True)


def _controller_label(controller: type[Block] | Path) -> str:
    return f"'{controller}'" if isinstance(controller, Path) else controller.__name__


def _ports(controller: type[Block] | Path) -> set[str]:
    """Return the names of a controller's variables."""
    if isinstance(controller, Path):
        from ..fmu.interface import read_interface  # slow to import

        return set(read_interface(controller).variables)
    return {scalar.name for scalar in controller.layout().scalars}


def _has_port(ports: set[str], wire: str) -> bool:
    """Return whether the controller has its end of a connection; True for a connection without it."""
    ends = (end.partition(".") for end in wire.split(" -> "))
    return all(port in ports for role, _, port in ends if role == "controller")


def start_values(block: type[Block], *sources: Any) -> dict[str, Value]:
    """Return start values by FMI name, from what sources have under the names of the block's attributes.

    Args:
        block: The block.
        sources: Mappings, or objects with attributes; later ones win.

    Raises:
        KeyError: The block lacks a key of a mapping.
    """
    layout = block.layout()
    settable = {x.attribute: x for x in (*layout.inputs, *layout.parameters, *layout.states)}
    values: dict[str, Value] = {}
    for source in sources:
        if isinstance(source, Mapping):
            if unknown := set(source) - set(settable):
                raise KeyError(f"{block.__name__} has no variable {', '.join(sorted(unknown))}")
            given = dict(source)
        else:
            given = {a: getattr(source, a) for a in settable if hasattr(source, a)}
        for attribute, value in given.items():
            values |= _by_fmi_name(settable[attribute], value)
    return values


def _by_fmi_name(variable: Variable, value: Any) -> dict[str, Value]:
    names = [s.name for s in variable.scalars()]
    return dict(zip(names, variable.flat(value), strict=True))
