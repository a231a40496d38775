"""The blocks of machines: written as Python files into the cache, so that they are built like all others."""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path

from emla_fmu.parameters import EmlaParameters
from fmublock import Block
from fmublock.cache import cache_folder
from fmublock.errors import BuildError
from fmublock.files import write_atomically
from fmublock.loading import load_blocks
from machine_fmu import Machine, MachineError, Trajectory, write_module
from machine_fmu.actuators import actuator_values

from ...base.errors import CommandError, RunError, check_choice
from ...base.values import convert_value
from ..packaged_files import list_joint_names, load_actuator
from .schema import (
    MachineTable,
    build_machine,
    list_machine_names,
    load_machine,
    read_machine_content,
)

MANIPULATOR = "hdrm"
"""The machine whose blocks are models of this project."""


@dataclass(frozen=True)
class MachineBlocks:
    """The blocks of a machine.

    Attributes:
        load: the machine as a load: motion of its actuators in, forces out.
        plant: the machine with the mechanics of its actuators: motor torques in, motion out.
        trajectory: the motion of its actuators.
        file: the Python file that defines them, but for the trajectory of the paper's manipulator.
    """

    load: type[Block]
    plant: type[Block]
    trajectory: type[Block]
    file: Path

    @property
    def all(self) -> tuple[type[Block], ...]:
        """All blocks."""
        return self.load, self.plant, self.trajectory

    def model(self, block: type[Block]) -> str:
        """Return the name of one of the blocks as the model of a component: FILE.py:BLOCK."""
        name = block.__name__
        return name if self.trajectory is Trajectory else f"{self.file}:{name}"


def build_machine_blocks(
    machine: Machine, name: str, actuators: Sequence[EmlaParameters] | None = None
) -> MachineBlocks:
    """Return the blocks of a machine.

    Args:
        machine: The machine.
        name: Its name; names of blocks follow from it, such as CraneLoad.
        actuators: Data of the actuators in the machine's order, whose mechanics are start values of the
            plant. Default: those of the built-in joints with the actuators' names, if all of them exist.

    Raises:
        CommandError: The machine has no actuators, or one whose name cannot be part of a variable's name.
        RunError: The file with the blocks cannot be written.
    """
    # machines that do not run here need no joints
    if actuators is None and set(machine.actuators) <= set(list_joint_names()):
        actuators = [load_actuator(joint).emla for joint in machine.actuators]
    is_manipulator = name == MANIPULATOR and machine == load_machine(MANIPULATOR)
    names = _MANIPULATOR_NAMES if is_manipulator else _make_block_names(name)
    try:
        text = write_module(
            machine,
            name,
            names.load,
            names.plant,
            None if is_manipulator else names.trajectory,
            actuator_values(actuators or ()),
        )
        file, blocks = _load_module(text, f"{names.module}_blocks")
    except MachineError as error:
        raise CommandError(f"the machine '{name}' cannot be used: {error}.") from error
    except (BuildError, OSError) as error:
        raise RunError(f"the blocks of the machine '{name}' cannot be made: {error}") from error
    trajectory = Trajectory if is_manipulator else blocks[names.trajectory]
    return MachineBlocks(blocks[names.load], blocks[names.plant], trajectory, file)


def read_machine_blocks(machine: str | Path) -> MachineBlocks:
    """Return the blocks of a machine, to run them in Python or to build their FMUs.

    Args:
        machine: path of a machine file, or the name of a built-in machine.

    Returns:
        The blocks, such as CraneLoad, CranePlant and CraneTrajectory of `crane.toml`.

    Raises:
        CommandError: the file or the machine does not exist, or has errors.
        RunError: the cache folder cannot be written.

    Examples:
        >>> import emla_cosim as ec
        >>> from fmublock import Instance
        >>> blocks = ec.read_machine_blocks("hdrm")
        >>> Instance(blocks.load())["x_L"]
        [0.244, 0.389, 0.499]
    """
    from .machine_joints import find_joint  # loads NumPy

    content, label, name, folder = read_machine_content(machine)
    table = convert_value(content, MachineTable, label, folder)
    joints = [find_joint(actuator, x.joint, label, folder) for actuator, x in table.actuators.items()]
    emlas = [joint.emla for joint in joints if joint is not None]
    built = build_machine(table, label, folder)
    return build_machine_blocks(built, name, emlas if len(emlas) == len(joints) else None)


def is_machine_file(name: str | Path) -> bool:
    """Return whether this is the path of a machine file, not the name of a built-in machine."""
    return Path(name).suffix == ".toml"


def find_machine_blocks(text: str) -> dict[str, str | type[Block]]:
    """Return the blocks of a machine by name, or the one that a text names; none without a machine.

    Blocks that are models of this project are returned by their name.

    Args:
        text: Path of a machine file, optionally with :BLOCK, or name of a built-in machine.

    Raises:
        CommandError: As `read_machine_blocks`, or the machine has no such block.
        RunError: As `read_machine_blocks`.
    """
    file, colon, block = text.rpartition(":")
    machine = file if colon and is_machine_file(file) else text
    if not is_machine_file(machine) and machine not in list_machine_names():
        return {}
    blocks = read_machine_blocks(machine)
    blocks_by_name = {block_class.__name__: block_class for block_class in blocks.all}
    if machine != text:
        check_choice("block of this machine", block, blocks_by_name)
        blocks_by_name = {block: blocks_by_name[block]}
    project_blocks = blocks.all if machine == MANIPULATOR else ()
    return {
        name: name if block_class in project_blocks else block_class
        for name, block_class in blocks_by_name.items()
    }


@cache
def manipulator_blocks() -> MachineBlocks:
    """Return the blocks of the paper's manipulator."""
    return build_machine_blocks(load_machine(MANIPULATOR), MANIPULATOR)


@dataclass(frozen=True)
class _BlockNames:
    module: str
    load: str
    plant: str
    trajectory: str


# not of another machine in a file of the same name, such as a changed copy
_MANIPULATOR_NAMES = _BlockNames(MANIPULATOR, "HdrmManipulator", "HdrmPlant", Trajectory.__name__)


def _make_block_names(name: str) -> _BlockNames:
    """Return the names of a machine's module and blocks."""
    words = re.findall(r"[A-Za-z0-9]+", name)
    module = "_".join(words) or "machine"
    title = "".join(word[0].upper() + word[1:] for word in words) or "Machine"
    if title[0].isdigit():
        module, title = f"machine_{module}", f"Machine{title}"
    return _BlockNames(module, f"{title}Load", f"{title}Plant", f"{title}Trajectory")


@cache
def _load_module(text: str, module: str) -> tuple[Path, dict[str, type[Block]]]:
    """Write a module into the cache, unless it is there, and return its blocks by name."""
    content = text.encode()
    # by content, so that processes that make different machines do not disturb each other
    file = cache_folder() / "machines" / sha256(content).hexdigest()[:24] / f"{module}.py"
    if not file.is_file() or file.read_bytes() != content:
        file.parent.mkdir(parents=True, exist_ok=True)
        with write_atomically(file) as stream:
            stream.write(content)
        os.utime(file, (0, 0))  # a process that has loaded it meanwhile has the same text
    return file, load_blocks(file)
