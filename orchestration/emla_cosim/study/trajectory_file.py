"""Trajectory files: JSON with a B-spline for each joint, and the problem that it solves."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from machine_fmu.spline import DEFAULT_FILE, Spline, TrajectoryError, spline_of

from ..base.errors import CommandError
from ..base.files import read_text
from ..base.output_files import OutputFile, has_format

__all__ = ["DEFAULT_FILE", "read_trajectory"]

WHAT = "the trajectory"
"""Name of a trajectory file in error messages."""


def read_trajectory(path: str | Path) -> Spline:
    """Read the spline of a trajectory file.

    Args:
        path: file that `trajectory` or `emla trajectory` wrote.

    Returns:
        The spline of three strokes in m over time in s.

    Raises:
        CommandError: the file does not exist or contains no trajectory.
    """
    return read_motion(path)[0]


def read_motion(path: str | Path) -> tuple[Spline, Mapping[str, Any]]:
    """Read the spline of a trajectory file, and the problem that it solves; empty without one.

    Raises:
        CommandError: As for `read_trajectory`.
    """
    text = read_text(Path(path), WHAT)
    try:
        document = json.loads(text)
        spline, problem = spline_of(document), document.get("problem")
        return spline, problem if isinstance(problem, dict) else {}
    except TrajectoryError as error:
        raise CommandError(f"{WHAT} '{path}' cannot be used: {error}") from error
    except (ValueError, RecursionError) as error:  # ValueError also for numbers with thousands of digits
        raise CommandError(f"{WHAT} '{path}' is not JSON: {error}.") from error


def check_trajectory(path: Path, overwrite: bool = False) -> OutputFile:
    """Return a trajectory file, which may be written. Raises CommandError if it must not be written."""
    return OutputFile(path, WHAT, has_format("emla-cosim trajectory"), overwrite)
