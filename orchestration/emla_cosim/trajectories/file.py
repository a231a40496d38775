"""Trajectory files: JSON with a B-spline by joint, and what it is the solution of."""

import json
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdrm_fmu.spline import DEFAULT_FILE, Spline, TrajectoryError, spline_of

from ..base.errors import CommandError
from ..base.files import place_of, read_text, written_whole

if TYPE_CHECKING:
    from .result import TrajectoryResult

__all__ = ["DEFAULT_FILE", "read_trajectory", "write_trajectory"]

_WHAT = "the trajectory"
_TOOLS = ("casadi", "emla-cosim", "numpy", "scipy")


def read_trajectory(path: str | Path) -> Spline:
    """The spline of a trajectory file; CommandError for one that has none."""
    text = read_text(Path(path), _WHAT)
    try:
        return spline_of(json.loads(text))
    except TrajectoryError as error:
        raise CommandError(f"{_WHAT} '{path}' cannot be used: {error}") from error
    except (ValueError, RecursionError) as error:  # also of numbers with thousands of digits
        raise CommandError(f"{_WHAT} '{path}' is no JSON: {error}.") from error


def write_trajectory(result: "TrajectoryResult", path: Path) -> None:
    """Write a motion to a file, whole or not at all. Raises CommandError where that cannot be."""
    place = place_of(path, _WHAT)
    content = json.dumps(document(result), indent=1, allow_nan=False) + "\n"
    try:
        with written_whole(place) as stream:
            stream.write(content.encode())
    except OSError as error:
        raise CommandError(f"{_WHAT} '{path}' cannot be written: {error.strerror or error}.") from error


def document(result: "TrajectoryResult") -> dict[str, Any]:
    """What a trajectory file holds, all in SI units."""
    spline, figures = result.spline, asdict(result.assessment)
    return {
        "format": "emla-cosim trajectory 1",
        "degree": spline.degree,
        "knots": list(spline.knots),
        "coefficients": {joint: list(values) for joint, values in spline.coefficients.items()},
        "units": {"knots": "s", "coefficients": "m"},
        "problem": asdict(result.given),
        "end_speed": result.end_speed.value,
        "discretisation": asdict(result.discretisation),
        "contradictions": list(result.contradictions),
        "figures": {**figures, "iterations": result.solution.iterations},
        "versions": {tool: version(tool) for tool in _TOOLS},
    }
