"""The joint files that come with the study, by name."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path

from ...base.errors import CommandError, check_choice
from ...base.toml_structs import read_toml
from .schema import JointFile, read_joint

_FOLDER = "emla_cosim.study.joints"


def list_joint_names() -> list[str]:
    """Return the names of all joint files, sorted."""
    found = (file.name for file in files(_FOLDER).iterdir())
    return sorted(name.removesuffix(".toml") for name in found if name.endswith(".toml"))


def read_joint_text(name: str) -> str:
    """Return the text of a joint file; raise CommandError for an unknown name."""
    check_choice("joint", name, list_joint_names())
    return (files(_FOLDER) / f"{name}.toml").read_text(encoding="utf-8")


def has_tuning(name: str) -> bool:
    """Return whether a joint file has the table `[tuning]`; False for a file that is not TOML."""
    text = read_joint_text(name)
    try:
        return "tuning" in text and "tuning" in read_toml(text, name)  # reading takes longer
    except CommandError:
        return False


@cache
def load_joint(name: str) -> JointFile:
    """Return a joint by name; raise CommandError for an unknown name or an error in the file."""
    return read_joint(read_joint_text(name), f"the joint '{name}'", name, Path())


class Joints(Mapping[str, JointFile]):
    """Joints by name; each is read at its first use."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)

    def __getitem__(self, name: str) -> JointFile:
        if name not in self._names:
            raise KeyError(name)
        return load_joint(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)
