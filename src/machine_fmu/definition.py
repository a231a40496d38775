"""Descriptions of machines as plain data, and as Python files with their blocks.

A file of its own makes the blocks of a machine what all other blocks are: `emla build FILE.py:BLOCK` builds
them, the cache of FMUs knows their text, and PythonFMU FMUs contain it.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from .closure import start_strokes
from .description import Actuator, Body, Joint, Link, Machine, MachineError, Parameter, Payload, Point
from .trajectory import join_joints

_MODULE = '''"""Blocks of the machine {name}, written by EMLA-Cosim from its description."""

from machine_fmu import {imports}

MACHINE = read_definition(
    r"""
{definition}
"""
)


class {load}(load_block(MACHINE)):
    """The machine {name} as a load: motion of its actuators in, forces out.

    {elements}
    """


class {plant}(plant_block(MACHINE, actuators={actuators!r})):
    """The machine {name} with the mechanics of its actuators: motor torques in, motion out.

    {elements}
    """
'''

_TRAJECTORY = '''

class {trajectory}(trajectory_block({joints!r}, {moves!r})):
    """A B-spline of the strokes of the machine {name}, held before its first and after its last knot.

    {elements}
    """
'''


def write_definition(machine: Machine) -> str:
    """Return a machine as JSON."""
    return json.dumps(asdict(machine), indent=1)


def read_definition(text: str) -> Machine:
    """Return the machine of a text by `write_definition`; raise MachineError for another one."""
    try:
        return _machine(json.loads(text))
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise MachineError(f"the definition of the machine cannot be read: {error}") from error


def write_module(
    machine: Machine,
    name: str,
    load: str,
    plant: str,
    trajectory: str | None = None,
    actuators: Mapping[str, Sequence[float]] | None = None,
) -> str:
    """Return the text of a Python file with the blocks of a machine.

    Args:
        machine: The machine.
        name: Its name in the docstring.
        load: Name of its block as a load.
        plant: Name of its block with the mechanics of the actuators.
        trajectory: Name of the block with the motion of its actuators, which rest at their strokes of the
            start. Default: no such block.
        actuators: Start values of the actuators' parameters by attribute.
    """
    imports = ["load_block", "plant_block", "read_definition"]
    joints = list(machine.actuators)
    values = {
        "name": name,
        "definition": write_definition(machine),
        "load": load,
        "plant": plant,
        "elements": "Elements of vectors are " + join_joints(joints) + ".",
        "actuators": dict(actuators or {}),
    }
    text = _MODULE
    if trajectory is not None:
        imports.append("trajectory_block")
        starts = dict(zip(joints, start_strokes(machine), strict=True))
        values |= {
            "trajectory": trajectory,
            "joints": tuple(joints),
            "moves": {joint: (stroke, stroke) for joint, stroke in starts.items()},
        }
        text += _TRAJECTORY
    return text.format(imports=", ".join(imports), **values)


def _machine(data: Mapping[str, Any]) -> Machine:
    payload = data["payload"]
    return Machine(
        dimensions=data["dimensions"],
        bodies={name: _body(x) for name, x in data["bodies"].items()},
        ground=_points(data["ground"]),
        actuators={name: Actuator(**_tuples(x)) for name, x in data["actuators"].items()},
        links={name: Link(**_tuples(x)) for name, x in data["links"].items()},
        loops={name: (a, b) for name, (a, b) in data["loops"].items()},
        payload=None if payload is None else Payload(**payload),
        parameters={name: Parameter(**x) for name, x in data["parameters"].items()},
        gravity=data["gravity"],
        outline=_outline(data),
    )


def _body(data: Mapping[str, Any]) -> Body:
    values = {
        **data,
        "joint": Joint(**_tuples(data["joint"])),
        "points": _points(data["points"]),
        "outline": _outline(data),
    }
    return Body(**_tuples(values))


def _outline(data: Mapping[str, Any]) -> tuple[Point, ...]:
    return tuple(Point(**_tuples(x)) for x in data.get("outline", ()))


def _points(data: Mapping[str, Any]) -> dict[str, Point]:
    return {name: Point(**_tuples(x)) for name, x in data.items()}


def _tuples(data: Mapping[str, Any]) -> dict[str, Any]:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in data.items()}
