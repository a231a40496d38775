"""The data sheets of a scenario's joints: those of the options, and those of joint files."""

from collections.abc import Mapping
from pathlib import Path

from ...base.errors import CommandError
from ...base.files import read_text
from ...base.toml_structs import read_toml
from ...run.scenarios.scenario import Scenario
from ...study.actuator.actuator import Actuator
from ...study.joints.schema import JointFile, list_joint_names, load_joint, parse_joint


def find_data_sheet(scenario: Scenario, source: object, joint: str) -> Actuator:
    """Return the actuator of a joint.

    Args:
        scenario: The scenario.
        source: What the scenario was loaded from.
        joint: The joint.

    Raises:
        CommandError: The joint has no data sheet.
    """
    own = scenario.options.actuator.get(joint)
    if isinstance(own, Actuator):
        return own
    file = _own_joint(source, joint)
    if file is None and joint in list_joint_names():
        file = load_joint(joint)
    if file is None:
        raise CommandError(
            f"{joint} has no data sheet to compare with; add --actuator {joint}=FILE.toml.", joint=joint
        )
    return file.sheet


def _own_joint(source: object, joint: str) -> JointFile | None:
    """Return the user's joint file of a scenario, for this joint."""
    if not isinstance(source, (str, Path)) or not str(source).lower().endswith(".toml"):
        return None
    path = Path(source)
    content: Mapping[str, object] = read_toml(read_text(path, "the scenario"), f"the scenario '{path}'")
    if content.get("kind") == "joint":
        same = path.stem == joint
        return parse_joint(content, f"the joint file '{path}'", joint, path.parent) if same else None
    system = content.get("system")
    return _own_joint(path.parent / system, joint) if isinstance(system, str) else None
