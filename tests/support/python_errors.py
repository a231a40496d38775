"""FMUs that leave an exception of Python set in the interpreter of their host."""

from pathlib import Path

import fmpy

from tests.support.hand_written_fmus import FMI_3, TOYS, build_handwritten_fmu

LEFT = "ValueError: no variable 17"
"""The exception that they leave, in one line."""


def build_python_errors_fmu(
    path: Path,
    version: int = 2,
    *,
    exchange: bool = False,
    when: str = "",
    function: str = "",
    at: float = 0.0,
) -> Path:
    """Build the FMU of `toyfmu/python_errors.c`.

    Args:
        path: The FMU file.
        version: 2 or 3, of FMI.
        exchange: Whether it is for Model Exchange.
        when: LOADS or CREATES to leave an exception then, too.
        function: Start value of its parameter `function`.
        at: Start value of its parameter `at`, in s.
    """
    placeholders = {
        "kind": "ModelExchange" if exchange else "CoSimulation",
        "function": function,
        "at": str(at),
        "varies": "" if exchange else 'canHandleVariableCommunicationStepSize="true"',
    }
    macros: dict[str, int | str] = {
        "FMI": version,
        "EXCHANGE": int(exchange),
        "START_FUNCTION": f'"{function}"',
        "START_TIME": str(at),
        **({when: 1} if when else {}),
    }
    return build_handwritten_fmu(
        path,
        TOYS / "python_errors.c",
        placeholders,
        macros,
        fmpy.platform if version == 2 else FMI_3,
        TOYS / ("python_errors.xml" if version == 2 else "python_errors_3.xml"),
    )
