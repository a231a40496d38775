"""Files that come with the study: joints, machines, scenarios and plans."""

from importlib.resources import files

_PACKAGE = "emla_cosim.study"
_SUFFIX = ".toml"


def list_packaged_names(folder: str) -> list[str]:
    """Return the names of all TOML files in a folder of the study, sorted."""
    names = (file.name for file in (files(_PACKAGE) / folder).iterdir())
    return sorted(name.removesuffix(_SUFFIX) for name in names if name.endswith(_SUFFIX))


def read_packaged_text(folder: str, name: str) -> str:
    """Return the text of a TOML file in a folder of the study."""
    return (files(_PACKAGE) / folder / f"{name}{_SUFFIX}").read_text(encoding="utf-8")
