"""Pictures of a motion: those of the paper, jerks, and the path of the tip."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hdrm_fmu.optimisation.assessment import Course
from hdrm_fmu.optimisation.problem import MotionProblem
from hdrm_fmu.trajectory import JOINTS

from ...base.arrays import Vector
from ...base.errors import CommandError
from ...base.files import check_output_files
from ...base.output_files import OutputFile
from ...study.trajectory_file import check_trajectory
from ...views.plots.style import BLUE, RED, is_picture, new_figure, save, tidy_axes
from .motion import OptimisedMotion
from .path_picture import draw_path

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURES = ("forces-and-speeds", "positions-and-accelerations", "path")
"""Names of the pictures."""

_POINTS = 1501


class _PanelRow(NamedTuple):
    """One row of a picture: values by joint, their bounds if there are any, and a label."""

    label: str
    values: np.ndarray
    bounds: Sequence[Sequence[float]] = ()


def draw_pictures(result: OptimisedMotion) -> "dict[str, Figure]":
    """Return the pictures by name."""
    times = np.linspace(result.spline.start, result.spline.end, _POINTS)
    seen, problem = result.course(times), result.problem
    rows = (_forces_and_speeds(seen, problem), _positions_and_accelerations(seen, problem))
    *by_joint, path = PICTURES
    figures = {name: _picture(times, some) for name, some in zip(by_joint, rows, strict=True)}
    return {**figures, path: draw_path(result, times)}


def picture_places(
    path: Path, wanted: bool = True, problem: object = None, overwrite: bool = False
) -> list[Path]:
    """Return the paths of the pictures, beside the trajectory file.

    Raises:
        CommandError: A file may not be replaced, or is that of the problem.
    """
    if path.suffix.lower() == ".png":
        raise CommandError(f"the trajectory '{path}' must not end in .png, as its pictures do.")
    places = [path.with_name(f"{path.stem}-{name}.png") for name in PICTURES] if wanted else []
    used = {Path(problem): "the problem"} if isinstance(problem, (str, Path)) else {}
    check_output_files({path: "the trajectory"} | dict.fromkeys(places, "the picture"), used)
    check_trajectory(path, overwrite)
    for place in places:
        OutputFile(place, "the picture", is_picture, overwrite)
    return places


def save_pictures(result: OptimisedMotion, path: Path, overwrite: bool = False) -> list[Path]:
    """Draw the pictures beside a trajectory file.

    Raises:
        CommandError: If emla did not write an existing file.
        RunError: If writing fails.
    """
    places = picture_places(path, overwrite=overwrite)
    for place, figure in zip(places, draw_pictures(result).values(), strict=True):
        with OutputFile(place, "the picture", is_picture, overwrite).open() as stream:
            save(figure, stream)
    return places


def _forces_and_speeds(seen: Course, problem: MotionProblem) -> tuple[_PanelRow, _PanelRow]:
    forces = [[x / 1e3 for x in bounds] for bounds in (problem.f_LB, problem.f_UB)]
    speeds = [[x * 1e3 for x in bounds] for bounds in (problem.v_LB, problem.v_UB)]
    return (
        _PanelRow("force / kN", seen.force / 1e3, (forces[0], forces[1])),
        _PanelRow("speed / mm/s", seen.v * 1e3, (speeds[0], speeds[1])),
    )


def _positions_and_accelerations(seen: Course, problem: MotionProblem) -> tuple[_PanelRow, ...]:
    machine = problem.machine
    accelerations, jerks = (
        [[x * 1e3 for x in bounds] for bounds in pair if bounds is not None]
        for pair in ((problem.a_LB, problem.a_UB), (problem.j_LB, problem.j_UB))
    )
    return (
        _PanelRow("stroke / m", seen.q, (machine.q_LB, machine.q_UB)),
        _PanelRow("acceleration / mm/s²", seen.a * 1e3, accelerations),
        _PanelRow("jerk / mm/s³", seen.j * 1e3, jerks),
    )


def _picture(times: Vector, rows: Sequence[_PanelRow]) -> "Figure":
    figure, axes = new_figure(len(rows), len(JOINTS), 3.2)
    for i, row in enumerate(rows):
        for j, joint in enumerate(JOINTS):
            _panel(axes[i, j], times, row, j)
            if i == 0:
                axes[i, j].set_title(joint, fontsize=10)
            if i == len(rows) - 1:
                axes[i, j].set_xlabel("time / s", fontsize=9)
        axes[i, 0].set_ylabel(row.label, fontsize=9)
    figure.align_ylabels(axes[:, 0])
    return figure


def _panel(axes: "Axes", times: Vector, row: _PanelRow, joint: int) -> None:
    axes.plot(times, row.values[:, joint], color=BLUE, linewidth=1.4)
    for bounds in row.bounds:
        axes.axhline(bounds[joint], color=RED, linewidth=0.9, linestyle="--")
    tidy_axes(axes)
