"""Tables of a machine in the terminal: actuators with their forces, bodies, and how poses are found."""

from collections.abc import Iterable, Sequence

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from ..study.machines.machine_info import ActuatorInfo, MachineInfo
from ..views.terminal import print_line, show_table


def show_machine(machine: MachineInfo, has_parameters: bool) -> None:
    """Show what a machine consists of, with its parameters or without."""
    space = "in the plane" if machine.dimensions == 2 else "in space"
    count = machine.degrees_of_freedom
    free = f", {', '.join(machine.passive)} swinging freely" if machine.passive else ""
    print_line(f"Machine {space} with {count} degree{'s' * (count != 1)} of freedom{free}")
    if machine.payload is not None:
        print_line(f"Payload {machine.payload:g} kg at {machine.payload_at}")
    bodies = [(x.name, x.joint, x.on, f"{x.m:.4g}") for x in machine.bodies]
    _show_columns(("body", "joint", "on", "mass / kg"), bodies, 3)
    actuators = [
        (
            x.name,
            " to ".join(x.ends),
            f"{x.length:.4g}",
            f"{x.stroke[0]:.4g} to {x.stroke[1]:.4g}",
            f"{x.start:.4g}",
            f"{x.lever:.3g}",
        )
        for x in machine.actuators
    ]
    _show_columns(
        ("actuator", "between", "length at 0 / m", "stroke / m", "start / m", "lever"), actuators, 2
    )
    header = ["holding force / kN", "at start", "over all strokes", "largest at strokes / m"]
    limits = {"continuous limit": "continuous_force", "largest": "largest_force"}
    limits = {text: x for text, x in limits.items() if any(getattr(a, x) for a in machine.actuators)}
    _show_columns([*header, *limits], [_format_forces(x, limits.values()) for x in machine.actuators], 1)
    closures = [(", ".join(x.coordinates), ", ".join(x.lengths), x.method) for x in machine.closures]
    _show_columns(("coordinates of", "follow from", "by"), closures, 3)
    if has_parameters:
        _show_columns(
            ("parameter", "value"), [(name, f"{x:.9g}") for name, x in machine.parameters.items()], 1
        )
    print_line(
        "Forces hold the payload at rest, positive against extension. Lever: motion of the tip per stroke."
    )
    if machine.unreachable > 0.0:
        share = f"{100.0 * machine.unreachable:.2g} %"
        print_line(f"{share} of the poses within all strokes do not close and are left out.")
    for actuator in machine.actuators:
        if text := describe_overload(actuator):
            print_line(f"Warning: {text}")


def describe_overload(actuator: ActuatorInfo) -> str:
    """Return a warning if an actuator cannot hold the machine somewhere; empty if it can, or if unknown."""
    largest, force = actuator.largest_force, max(abs(actuator.lowest_force), abs(actuator.highest_force))
    if largest is None or force <= largest:
        return ""
    return f"{actuator.name} needs {1e-3 * force:.4g} kN, but holds {1e-3 * largest:.4g} kN at the most."


def _format_forces(actuator: ActuatorInfo, limits: Iterable[str]) -> Sequence[str]:
    forces = (getattr(actuator, name) for name in limits)
    return (
        actuator.name,
        f"{1e-3 * actuator.start_force:.4g}",
        f"{1e-3 * actuator.lowest_force:.4g} to {1e-3 * actuator.highest_force:.4g}",
        ", ".join(f"{x:.3g}" for x in actuator.worst_strokes),
        *("unknown" if x is None else f"{1e-3 * x:.4g}" for x in forces),
    )


def _show_columns(header: Sequence[str], rows: Iterable[Sequence[str]], texts: int) -> None:
    """Show a table, whose first columns are texts."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for i, name in enumerate(header):
        table.add_column(name, justify="left" if i < texts else "right", overflow="fold")
    for row in rows:
        table.add_row(*map(Text, row))
    show_table(table)
