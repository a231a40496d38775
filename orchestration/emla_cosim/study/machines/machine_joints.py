"""The joints of a machine's actuators: their data sheets and gains, from joint files."""

from pathlib import Path

import msgspec

from ...base.errors import CommandError, join_names
from ...base.files import read_text
from ...base.toml_structs import read_toml
from ..joints.schema import JointFile, list_joint_names, load_joint, parse_joint


def is_toml_path(joint: str | None) -> bool:
    """Return whether an entry is the path of a TOML file, not the name of a built-in joint or machine."""
    return joint is not None and joint.lower().endswith(".toml")


def find_joint(actuator: str, joint: str | None, label: str, folder: Path | None) -> JointFile | None:
    """Return the joint of an actuator, with the name of the actuator; None without a joint.

    Args:
        actuator: The name of the actuator.
        joint: A built-in joint or the path of a joint file; None for a built-in joint of the actuator's name.
        label: What error messages call the machine file.
        folder: The folder of relative paths.

    Raises:
        CommandError: The joint does not exist, or its file has an error.
    """
    if joint is None and actuator not in list_joint_names():
        return None
    name = joint or actuator
    if is_toml_path(name):
        path = (folder or Path()) / name
        file_label = f"the joint file '{path}'"
        content = read_toml(read_text(path, "the joint"), file_label)
        if content.get("kind") != "joint":
            raise CommandError(
                f"'joint' in [actuators.{actuator}] of {label} is '{path}', not a joint file; it lacks "
                'kind = "joint".'
            )
        return parse_joint(content, file_label, actuator, path.parent)
    if name not in list_joint_names():
        raise CommandError(
            f"'joint' in [actuators.{actuator}] of {label} is '{name}'; it must be "
            f"{join_names(list_joint_names())}, or the path of a joint file that ends in .toml.",
            joint=name,
        )
    return msgspec.structs.replace(load_joint(name), name=actuator)


def require_joint(actuator: str, joint: str | None, label: str, folder: Path | None) -> JointFile:
    """Return the joint of an actuator as `find_joint` does; raise CommandError if it has none."""
    joint_file = find_joint(actuator, joint, label, folder)
    if joint_file is None:
        raise CommandError(
            f"[actuators.{actuator}] of {label} has no 'joint'; to run the machine, write joint = with "
            f"{join_names(list_joint_names())}, or the path of a joint file.",
            actuator=actuator,
        )
    return joint_file
