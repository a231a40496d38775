"""Load compiled functions, whose modules are imported only to be compiled."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from ...fmu import fmi_3_calls
from ...sandbox import crash_page
from ..algorithms import extrapolation, quasi_newton, strong, tasks
from ..instances import call_codes, typed_values
from . import machine_code, record_layout

_TEXTS = ("by_address.py", "compiled_calls.py", "compiled_groups.py", "compiled_steps.py")
"""Modules that are compiled into every loop, and imported only to be compiled."""


def compiled_address(name: str, module: str, beside: Sequence[str] = ()) -> int:
    """Return the address of a compiled function. Its module is imported only to be compiled.

    Args:
        name: Name of the function.
        module: Name of its module in this package.
        beside: Names of further modules in this package that it is compiled from.

    Raises:
        ImportError: It must be compiled, and numba is missing.
    """

    def generate() -> str:
        return import_module(f".{module}", __package__).text(name)

    modules = (
        *(record_layout, call_codes, tasks, strong, quasi_newton, extrapolation, crash_page),
        *(typed_values, fmi_3_calls),
    )
    names = (*_TEXTS, f"{module}.py", *(f"{other}.py" for other in beside))
    texts = [Path(__file__).with_name(text) for text in names]
    files = [*(Path(str(m.__file__)) for m in modules), *texts]
    return machine_code.load(name, b"".join(f.read_bytes() for f in files), generate)
