"""Extras: packages that only some commands need, and what to install where one is missing."""

import importlib.util
from types import MappingProxyType

from .errors import CommandError, join_names

EXTRAS = MappingProxyType(
    {
        "plots": ("matplotlib", "bokeh", "contourpy", "PIL"),
        "build": ("casadi", "ziglang", "pythonfmu", "matplotlib"),
        "analyses": ("scipy", "cma", "cloudpickle"),
        "cluster": ("distributed", "dask"),
        "control": ("control",),
        "mdf": ("asammdf",),
        "pandas": ("pandas",),
        "tdms": ("nptdms",),
        "urdf": ("yourdfpy",),
    }
)
"""Modules by the extra that installs them, the first extra for each; pyproject.toml has the packages."""


LEFT_OUT = (
    "pictures are left out, because the extra 'plots' is not installed; run: pip install 'emla-cosim[plots]'"
)
"""What is said, without a full stop, where pictures would be drawn by default."""


class MissingExtraError(CommandError, ImportError):
    """A package of an extra is not installed; the message says which, and how to install it."""


def has_extra(extra: str) -> bool:
    """Return whether all packages of an extra are installed."""
    return not _missing(extra)


def require_extra(extra: str, what: str) -> None:
    """Check that all packages of an extra are installed.

    Args:
        extra: Name of the extra.
        what: Subject of the error message, such as "a picture".

    Raises:
        MissingExtraError: If one is not.
    """
    if not has_extra(extra):
        raise _missing_error(extra, what, _missing(extra))


def explain_missing(error: ImportError, what: str) -> CommandError | None:
    """Return the error message on a module that cannot be imported; None if it is of no extra."""
    if isinstance(error, MissingExtraError):
        return error
    module = (error.name or "").partition(".")[0]
    extra = next((extra for extra, modules in EXTRAS.items() if module in modules), None)
    return None if extra is None else _missing_error(extra, what, [module])


def _missing(extra: str) -> list[str]:
    return [module for module in EXTRAS[extra] if importlib.util.find_spec(module) is None]


def _missing_error(extra: str, what: str, modules: list[str]) -> MissingExtraError:
    verb = "is" if len(modules) == 1 else "are"
    return MissingExtraError(
        f"{what} needs the extra '{extra}', because {join_names(modules)} {verb} not installed; "
        f"run: pip install 'emla-cosim[{extra}]'.",
        extra=extra,
        modules=modules,
    )
