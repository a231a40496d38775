"""The joint files that come with the study, as far as they are read without the rest of the study."""

from functools import cache

from ...base.errors import check_choice
from ...base.toml_structs import read_toml
from ..actuator.actuator import Actuator
from ..packaged_files import list_packaged_names, read_packaged_text

_FOLDER = "joints"


def list_joint_names() -> list[str]:
    """Return the names of all joint files, sorted."""
    return list_packaged_names(_FOLDER)


def read_joint_text(name: str) -> str:
    """Return the text of a joint file; raise CommandError for an unknown name."""
    check_choice("joint", name, list_joint_names())
    return read_packaged_text(_FOLDER, name)


@cache
def load_actuator(name: str) -> Actuator:
    """Return the actuator of a joint; raise CommandError for an unknown name."""
    label = f"the joint '{name}'"
    return Actuator.of_tables(read_toml(read_joint_text(name), label)["actuator"], f"[actuator] of {label}")
