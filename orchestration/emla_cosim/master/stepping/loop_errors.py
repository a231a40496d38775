"""Check the rows of loops in C, and make the error of an exception of Python."""

import numpy as np

from ...base import crash_page
from ...base.arrays import Vector
from ...base.errors import RunError
from ...fmu.instance import FINE
from ...fmu.python_exceptions import REMEDY, describe_left_exception, uses_python
from ..instances.described_instance import DescribedInstance
from ..instances.fmu_instance import PythonExceptionError
from ..instances.measured_calls import decode_call
from ..network import Network

_MOST_NAMES = 4
"""Most names of components in a message."""


def check_room(network: Network, rows: Vector, needed: int) -> None:
    """Raise ValueError if a loop would write past the end of the rows, or into gaps.

    Args:
        network: The network whose signals and observed variables are recorded.
        rows: The room, shape (rows, values).
        needed: Number of rows to fill.
    """
    width = 1 + len(network.signals) + len(network.observer.values)
    fits = rows.ndim == 2 and len(rows) >= needed and rows.shape[1] == width
    if not fits or rows.dtype != np.float64 or not rows.flags.c_contiguous:
        raise ValueError(f"rows must have at least {needed} times {width} contiguous doubles")


def make_python_exception_error(
    network: Network, error: SystemError, begin: float, end: float, failed: int, status: int
) -> RunError:
    """Return the error for an exception of Python that an FMU left between two times.

    The exception hides what the loop returned. If a call failed, the loop still has its status.

    Args:
        network: The network.
        error: What the call of the loop raised.
        begin: First time in s.
        end: Last time in s.
        failed: Position of the instance whose call failed last.
        status: What that call returned.
    """
    text, instances = describe_left_exception(error), network.instances
    if status not in FINE:
        instance, (_, call) = instances[failed], decode_call(crash_page.current_activity())
        message = str(instance.error(call, status))
        return RunError(f"{message} A Python exception was left: {text}. {REMEDY}", component=instance.name)
    suspects = [x for x in instances if isinstance(x, DescribedInstance) and uses_python(x.file.library)]
    names = [x.name for x in suspects or instances]
    return PythonExceptionError(
        " or ".join(names) if len(names) <= _MOST_NAMES else f"one of {len(names)} FMUs",
        f"a call between t = {begin:.9g} s and t = {end:.9g} s",
        text,
        [],
        "To find the call, run with `--isolate`.",
    )
