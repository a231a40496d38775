"""Write trajectory files."""

import json
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ...study.trajectory_file import check_trajectory
from .motion import OptimisedMotion

_TOOLS = ("casadi", "emla-cosim", "numpy", "scipy")


def write_trajectory(result: OptimisedMotion, path: Path, overwrite: bool = False) -> None:
    """Write a motion to a file atomically.

    Raises:
        CommandError: If emla did not write the existing file.
        RunError: If writing fails.
    """
    content = json.dumps(build_document(result), indent=1, allow_nan=False) + "\n"
    check_trajectory(path, overwrite).write(content.encode())


def build_document(result: OptimisedMotion) -> dict[str, Any]:
    """Return the content of a trajectory file, in SI units."""
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
