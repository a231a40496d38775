"""Extras: packages that only some commands need, and what to install where one is missing."""

from collections.abc import Sequence
from importlib.util import find_spec

from .errors import CommandError, join_names

EXTRAS = {
    "plots": ("matplotlib", "bokeh", "contourpy", "pillow"),
    "analyses": ("scipy", "cma", "cloudpickle"),
    "build": ("casadi", "ziglang", "pythonfmu", "matplotlib", "scipy"),
    "cluster": ("distributed",),
    "control": ("control",),
    "mdf": ("asammdf",),
    "pandas": ("pandas",),
    "tdms": ("nptdms",),
    "urdf": ("yourdfpy",),
}
"""Packages by the extra that installs them, as in pyproject.toml; a message names the first that has one."""

_MODULES = {"pillow": "PIL"}
"""Modules of packages that have another name."""

LEFT_OUT = "pictures are left out, because the extra 'plots' is missing; run: pip install 'emla-cosim[plots]'"
"""The note, without a full stop, where pictures would be drawn by default."""


class MissingExtraError(CommandError, ImportError):
    """A package of an extra is not installed; the message says which, and how to install it."""


def has_extra(extra: str) -> bool:
    """Return whether all packages of an extra are installed."""
    return not _list_missing_packages(extra)


def require_extras(extras: Sequence[str], subject: str) -> None:
    """Check that all packages of extras are installed.

    Args:
        extras: Names of extras.
        subject: Subject of the error message, such as "a picture".

    Raises:
        MissingExtraError: If one is not.
    """
    lacking = {extra: missing for extra in extras if (missing := _list_missing_packages(extra))}
    if lacking:
        packages = list(dict.fromkeys(package for missing in lacking.values() for package in missing))
        raise _make_missing_error(list(lacking), subject, packages)


def require_extra(extra: str, subject: str) -> None:
    """Check that all packages of an extra are installed; see `require_extras`."""
    require_extras([extra], subject)


def explain_missing(error: ImportError, subject: str) -> CommandError | None:
    """Return the error message on a module that cannot be imported; None if it is of no extra."""
    if isinstance(error, MissingExtraError):
        return error
    module = (error.name or "").partition(".")[0]
    for extra in EXTRAS:
        for package in _list_missing_packages(extra):  # not those that are installed, but broken
            if module == _MODULES.get(package, package):
                return _make_missing_error([extra], subject, [package])
    return None


def _list_missing_packages(extra: str) -> list[str]:
    """Return the packages of an extra that are not installed."""
    specs = {package: find_spec(_MODULES.get(package) or package) for package in EXTRAS[extra]}
    # a folder of users that has the name has no origin
    return [package for package, spec in specs.items() if spec is None or spec.origin is None]


def _make_missing_error(extras: Sequence[str], subject: str, packages: Sequence[str]) -> MissingExtraError:
    noun = "extra" if len(extras) == 1 else "extras"
    verb = "is" if len(packages) == 1 else "are"
    return MissingExtraError(
        f"{subject} needs the {noun} {join_names(extras)}, because {join_names(packages)} {verb} not "
        f"installed; run: pip install 'emla-cosim[{','.join(extras)}]'.",
        extras=list(extras),
        packages=list(packages),
    )
