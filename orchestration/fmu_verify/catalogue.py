"""All checks, in the order in which they run and appear: each check comes after those that it needs.

A module in `checks` defines a check, and checks.json says where it comes in this order.
"""

from importlib import import_module
from pkgutil import iter_modules

from . import checks
from .check import TEXTS, Check
from .checks.references import recorded

_MODULES = [import_module(f"{checks.__name__}.{module.name}") for module in iter_modules(checks.__path__)]
_BY_NAME = {c.name: c for module in _MODULES for c in vars(module).values() if isinstance(c, Check)}

STATIC = tuple(_BY_NAME[name] for name in TEXTS["static"])
"""Checks of the file alone. They run no code of the FMU, except what its library does when it is loaded."""

DYNAMIC = tuple(_BY_NAME[name] for name in TEXTS["dynamic"])
"""Checks that call the FMU."""

RECORDED = recorded
"""Runs instead of `CHECKS` to record references."""

CHECKS = (*STATIC, *DYNAMIC, _BY_NAME["reference.agrees"])

VITAL = frozenset(
    {"archive.safe", "description.readable", "binaries.loads", "instance.created", "run.completes"}
)
"""Checks whose failure leaves nothing to run for those that need them."""
