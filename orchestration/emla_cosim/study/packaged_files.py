"""Files that come with the study: joints, machines, scenarios and plans."""

from functools import cache
from importlib.resources import files

from ..base.errors import check_choice
from ..base.toml_structs import read_toml
from .actuator.actuator import Actuator

_PACKAGE = "emla_cosim.study"
_SUFFIX = ".toml"


def list_packaged_names(folder: str) -> list[str]:
    """Return the names of all TOML files in a folder of the study, sorted."""
    names = (file.name for file in (files(_PACKAGE) / folder).iterdir())
    return sorted(name.removesuffix(_SUFFIX) for name in names if name.endswith(_SUFFIX))


def read_packaged_text(folder: str, name: str) -> str:
    """Return the text of a TOML file in a folder of the study."""
    return (files(_PACKAGE) / folder / f"{name}{_SUFFIX}").read_text(encoding="utf-8")


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
