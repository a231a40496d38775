"""One joint: reference, plant, disturbance, observer and controller, connected."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

from emla_fmu import (
    Disturbance,
    EmlaAxis,
    EmlaCompliantAxis,
    EmlaCompliantPlant,
    EmlaMotor,
    EmlaObserver,
    EmlaPlant,
    HoldingBrake,
    LoadObserver,
    Reference,
    ScrewCommand,
)
from emla_fmu import observer_gains as gain_rules
from emla_fmu.observer_gains import ObserverGains
from emla_fmu.parameters import EmlaParameters
from fmublock import Block
from fmublock.units import parse_unit
from rsba_fmu import BLOCKS
from rsba_fmu.known_drive import KnownDrive

from ..base.errors import CommandError, join_names
from ..base.units import IDENTITY, SiUnit, find_conversion
from ..system.model import Component, System, Value

_CONNECTIONS = (
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
_COMMAND_CONNECTIONS = {
    "reference.x_d -> controller.x_d": (
        "reference.x_d -> command.x_d",
        "reference.v_d -> command.v_d",
        "reference.a_d -> command.a_d",
        "command.x_c -> controller.x_d",
    ),
    "reference.v_d -> controller.v_d": ("command.v_c -> controller.v_d",),
    "reference.a_d -> controller.a_d": ("command.a_c -> controller.a_d",),
}
"""Replacements of connections if the screw does not make the reference motion itself."""

_APPROACH = "plant.x_measured -> command.x_1"
"""Connection that a planned start needs. Elsewhere it would close a loop through a machine that replays the
motion."""

_LOAD_SENSOR = (
    "plant.load.x_measured -> load_observer.y",
    "plant.x_measured -> load_observer.x_1",
    "observer.v_hat -> load_observer.v_1",
    "load_observer.F_0 -> command.F_hat",
    "load_observer.x_hat -> command.load.x",
    "load_observer.v_hat -> command.load.v",
    "load_observer.a_hat -> command.load.a",
)
_BRAKE_OUTPUTS = {"x_d": "x_r", "v_d": "v_r", "a_d": "a_r", "i_q": "i_q_c", "i_d": "i_d_c"}
"""What a brake passes on to the controller, by the inputs that both have."""

_BRAKE_CONNECTIONS = (
    "controller.i_q_ref -> brake.i_q_ref",
    "brake.engaged -> plant.brake.engaged",
    "brake.disabled -> plant.inverter.disabled",
)
_ESTIMATED_FEEDBACK = ("observer.x_hat -> controller.x_hat", "observer.v_hat -> controller.v_hat")
_SAMPLE = ("disturbance", "observer", "load_observer", "command", "brake")
"""Components that compute at communication points, like the controller: the disturbance draws random numbers.
"""

_SENSOR_FAULTS = ("sensor.sigma", "sensor.resolution", "sensor.current.sigma", "sensor.current.resolution")

MACHINE = "machine."
"""Start of the names of parameters that a user's controller takes from the actuator of its joint."""

_TRUE_FEEDBACK = ("plant.x_L -> controller.x_hat", "plant.v_L -> controller.v_hat")


COMPLIANT_PLANTS = (EmlaCompliantPlant, EmlaCompliantAxis)
"""Plants with a load that is not rigid."""

DRIVES = (EmlaMotor, EmlaPlant, EmlaAxis, *COMPLIANT_PLANTS)
"""Components of joints with motor and inverter."""


def ideal_sensors(system: System) -> dict[str, Value]:
    """Return start values that switch off noise and steps of the sensors in the plants of joints."""
    at_load = (*_SENSOR_FAULTS, "load.sensor.sigma", "load.sensor.resolution")
    faults: dict[str, tuple[str, ...]] = {
        block.__name__: at_load if block in COMPLIANT_PLANTS else _SENSOR_FAULTS for block in DRIVES
    }
    return {f"{c.name}.{p}": 0.0 for c in system.components for p in faults.get(str(c.model), ())}


def name_position_loop(joint: str) -> str:
    """Return the connection at which the position loop of a joint is opened: its measured position."""
    return f"{joint}.plant.x_measured -> {joint}.observer.y"


def name_current_path(joint: str) -> str:
    """Return the path on which a joint's loop is opened at its current reference.

    A controller adds the reference acceleration, divided by the inertia's share, to this current.
    """
    return f"{joint}.controller.a_d -> {joint}.controller.i_q_ref"


@dataclass(frozen=True)
class Joint:
    """Components of a joint, and its connections by full names, which may lead to other components."""

    components: tuple[Component, ...]
    wires: tuple[str, ...]

    def to_system(self) -> System:
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
    on_stroke: bool = False,
    command: Mapping[str, Any] | None = None,
    load_observer: Mapping[str, Any] | None = None,
    brake: Mapping[str, Any] | None = None,
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
        on_stroke: Whether the load force also depends on the position, or the plant has a brake.
        command: Values of the `ScrewCommand` between reference and controller, by attribute; None without it.
        load_observer: Values of the `LoadObserver`, by attribute; None without a sensor at the load.
        brake: Values of the `HoldingBrake` before the controller, by attribute; None without it.
        elsewhere: Full names of variables of other components that replace ends such as reference.x_d; None
            leaves an end open.

    Raises:
        CommandError: The controller lacks u_q or u_d.
    """
    rigid, soft = (EmlaAxis, EmlaCompliantAxis) if on_stroke else (EmlaPlant, EmlaCompliantPlant)
    drive = EmlaMotor if electrical else soft if compliant else rigid
    blocks: dict[type[Block], tuple[str, Sequence[Any]]] = {
        drive: ("motor" if electrical else "plant", [emla, plant]),
        Disturbance: ("disturbance", [disturbance]),
        EmlaObserver: ("observer", [emla, observer_gains, {"x_hat_start": estimate}]),
    }
    if load_observer is not None:
        blocks[LoadObserver] = ("load_observer", [load_observer])
    if command is not None:
        blocks[ScrewCommand] = ("command", [command])
    if brake is not None:
        blocks[HoldingBrake] = ("brake", [brake])
    if reference is not None:
        blocks = {Reference: ("reference", [reference]), **blocks}
    components = [
        Component(f"{name}.{role}", block.__name__, start_values(block, *sources), samples=role in _SAMPLE)
        for block, (role, sources) in blocks.items()
    ]
    components.append(_build_controller(f"{name}.controller", controller, emla, gains))
    wires = [*_CONNECTIONS, *(_TRUE_FEEDBACK if true_feedback else _ESTIMATED_FEEDBACK)]
    if command is not None:
        wires = [new for wire in wires for new in _COMMAND_CONNECTIONS.get(wire, (wire,))]
        # without a planned start, it would close a loop through a machine that replays the motion
        wires += [_APPROACH] if "approach_time" in command else []
    if load_observer is not None:
        wires += _LOAD_SENSOR
    if brake is not None:
        wires = [new for wire in wires for new in _insert_brake(wire)] + list(_BRAKE_CONNECTIONS)

    def resolve_end(end: str) -> str | None:
        role, _, port = end.partition(".")
        own_name = f"{name}.{'motor' if electrical and role == 'plant' else role}.{port}"
        return elsewhere.get(end, own_name)

    # a controller has only those connections for which it has a variable
    ports = {f"controller.{port}" for port in _list_variable_names(controller)}
    pairs = [wire.split(" -> ") for wire in wires]
    ends = [
        [resolve_end(end) for end in pair]
        for pair in pairs
        if all(end in ports for end in pair if end.startswith("controller."))
    ]
    return Joint(tuple(components), tuple(f"{a} -> {b}" for a, b in ends if a is not None and b is not None))


def _insert_brake(wire: str) -> list[str]:
    """Return the connections that replace one, so that it leads through the brake if need be."""
    source, target = wire.split(" -> ")
    role, _, port = target.partition(".")
    if target == "controller.x_hat":
        return [wire, f"{source} -> brake.x_hat"]
    if target == "observer.i_q":
        return [f"brake.i_q_c -> {target}"]
    if role == "controller" and port in _BRAKE_OUTPUTS:
        return [f"{source} -> brake.{port}", f"brake.{_BRAKE_OUTPUTS[port]} -> {target}"]
    return [wire]


def _build_controller(name: str, controller: type[Block] | Path, emla: Any, gains: Any) -> Component:
    """Return the component of a controller; raise CommandError if it lacks u_q or u_d."""
    for port in ("u_q", "u_d"):
        if port not in _list_variable_names(controller):
            label = f"'{controller}'" if isinstance(controller, Path) else controller.__name__
            raise CommandError(
                f"the controller {label} has no output '{port}'; it must have u_q and u_d.", name=port
            )
    # its parameters have the names of our gains and of the actuator, so nothing is guessed
    if not isinstance(controller, Path) and controller.__module__.startswith("rsba_fmu."):
        return Component(name, controller.__name__, start_values(controller, emla, gains), samples=True)
    values, note = _find_machine_values(name, controller, emla)
    if isinstance(controller, Path):
        return Component(name, fmu=controller, parameters=values, samples=True, note=note)
    return Component(name, controller, values | start_values(controller, gains), samples=True, note=note)


def _find_machine_values(
    name: str, controller: type[Block] | Path, emla: Any
) -> tuple[dict[str, Value], str]:
    """Return the start values that a user's controller takes from the actuator, and a message on them.

    These are its parameters `machine.R_s` and the like, and those of `KnownDrive` if it has them all. A block
    and its FMU have the same names, so they get the same values.

    Raises:
        CommandError: The actuator has no such value, or the parameter has a unit that does not fit.
    """
    units = _list_parameter_units(controller)
    attributes = {n: n.removeprefix(MACHINE) for n in units if n.startswith(MACHINE)}
    # a change of one of our controllers, which then needs the values that ours get
    if {p.name for p in KnownDrive.layout().parameters} <= units.keys():
        gain_attributes = {p.name: p.attribute for b in BLOCKS for p in b.layout().parameters if p.name}
        attributes |= {n: a for n, a in gain_attributes.items() if n in units and a in _list_actuator_units()}
    values, descriptions = dict[str, Value](), list[str]()
    for parameter, attribute in attributes.items():
        if attribute not in _list_actuator_units():
            raise CommandError(
                f"the actuator has no value for {name}.{parameter}; it has "
                f"{join_names([MACHINE + n for n in _list_actuator_units()])}.",
                name=parameter,
            )
        value = getattr(emla, attribute)
        try:
            conversion = find_conversion(_list_actuator_units()[attribute], units[parameter])
        except ValueError as error:
            raise CommandError(
                f"{name}.{parameter} takes its value from the actuator and has {error}, which cannot be "
                "converted into each other.",
                name=parameter,
            ) from error
        values[parameter] = value if conversion == IDENTITY else conversion(value)
        unit = units[parameter]
        descriptions.append(f"{parameter} = {values[parameter]:.6g}{'' if unit is None else f' {unit}'}")
    return (
        values,
        f"{name} takes start values from the actuator: {', '.join(descriptions)}." if descriptions else "",
    )


@cache
def _list_actuator_units() -> dict[str, SiUnit | None]:
    """Return the units of the values of an actuator by name."""
    units = {v.attribute: v.unit for b in (KnownDrive, EmlaPlant) for v in b.layout().parameters}
    actuator_values = {f.name for f in fields(EmlaParameters)} | {
        n for n, v in vars(EmlaParameters).items() if isinstance(v, property)
    }
    return {
        n: None if unit is None else parse_unit(unit) for n, unit in units.items() if n in actuator_values
    }


def _list_parameter_units(controller: type[Block] | Path) -> dict[str, SiUnit | None]:
    """Return the units of a controller's parameters by FMI name."""
    if isinstance(controller, Path):
        from ..fmu.interface import read_interface  # slow to import

        interface = read_interface(controller)
        return {n: interface.unit(n) for n, v in interface.variables.items() if v.causality == "parameter"}
    return {
        s.name: None if p.unit is None else parse_unit(p.unit)
        for p in controller.layout().parameters
        for s in p.scalars()
    }


def _list_variable_names(controller: type[Block] | Path) -> set[str]:
    """Return the names of a controller's variables."""
    if isinstance(controller, Path):
        from ..fmu.interface import read_interface  # slow to import

        return set(read_interface(controller).variables)
    return {scalar.name for scalar in controller.layout().scalars}


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
            values_by_attribute = dict(source)
        else:
            values_by_attribute = {a: getattr(source, a) for a in settable if hasattr(source, a)}
        for attribute, value in values_by_attribute.items():
            names = [scalar.name for scalar in settable[attribute].scalars()]
            values |= zip(names, settable[attribute].flat(value), strict=True)
    return values


def describe_observer(value: Callable[[str], float | int | bool | str | None]) -> str | None:
    """Return the rule of an observer's gains with its poles; None for an observer with other parameters.

    Args:
        value: Returns the start value of a parameter by its name in the FMU; None if there is no such number.
    """
    names = {p.attribute: p.name for p in EmlaObserver.layout().parameters}
    values: dict[str, Any] = {f.name: value(str(names[f.name])) for f in fields(ObserverGains)}
    return None if None in values.values() else gain_rules.describe(ObserverGains(**values))
