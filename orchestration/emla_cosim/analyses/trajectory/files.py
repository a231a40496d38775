"""The files of an optimised motion: the trajectory, pictures, a page, and a payload that changes."""

from pathlib import Path

from machine_fmu.optimisation.problem import MotionProblem

from ...base.errors import CommandError
from ...base.extras import has_extra, require_extra
from ...base.files import check_output_files, report_write_errors
from ...base.output_files import OutputFile, has_mark, is_page
from ...study.trajectory_file import WHAT, check_trajectory
from ...views.plots.style import is_picture, to_png
from ..frame.outputs import is_drawn, render_page
from .pictures import PICTURES, draw_pictures
from .report import build_report
from .result import TrajectoryResult

_PAYLOAD_MARK = "# emla-cosim payload 1\n"


class MotionFiles:
    """The files to write. They are checked before anything is computed.

    Args:
        path: The trajectory file.
        problem: The problem.
        source: What the user passed as the problem, such as a file.
        overwrite: Whether to replace files that emla did not write.
        plots: Whether to draw pictures.
        report: Whether to write a page.

    Raises:
        CommandError: A file may not be replaced, or is that of the problem.
    """

    def __init__(
        self, path: Path, problem: MotionProblem, source: object, overwrite: bool, plots: bool, report: bool
    ) -> None:
        if (suffix := path.suffix.lower()) in (".png", ".html"):
            subject = "pictures do" if suffix == ".png" else "page does"
            raise CommandError(f"the trajectory '{path}' must not end in {suffix}, as its {subject}.")
        if report:
            require_extra("plots", "a page")
        drawn = [path.with_name(f"{path.stem}-{name}.png") for name in PICTURES]
        pictures = drawn if plots and has_extra("plots") else []
        page = path.with_suffix(".html")
        self._possible = [*drawn, page]
        used = {Path(source): "the problem"} if isinstance(source, (str, Path)) else {}
        check_output_files({path: WHAT} | dict.fromkeys(pictures, "the picture"), used)
        self._path, self._overwrite = path, overwrite
        check_trajectory(path, overwrite)
        self._pictures = [OutputFile(picture, "the picture", is_picture, overwrite) for picture in pictures]
        self._page = self._payload = None
        if report:
            self._page = OutputFile(page, "the page", is_page, overwrite)
        if len(problem.loads) > 1:
            payload = path.with_name(f"{path.stem}-payload.csv")
            is_ours = has_mark(_PAYLOAD_MARK.encode())
            self._payload = OutputFile(payload, "the payload", is_ours, overwrite)

    @property
    def paths(self) -> list[Path]:
        """All files, the trajectory first."""
        further = [self._payload, *self._pictures, self._page]
        return [self._path, *(file.path for file in further if file is not None)]

    def write(self, result: TrajectoryResult) -> None:
        """Write all files, and remove pictures and pages of the motion before. Raises RunError."""
        result.save(self._path, self._overwrite)
        with report_write_errors(self._path.parent):
            for path in self._possible:
                if path not in self.paths and is_drawn(path):
                    path.unlink()
        if self._payload is not None:
            self._payload.write(_format_payload(result).encode())
        figures = draw_pictures(result) if self._pictures or self._page else {}
        pictures = {name: to_png(figure) for name, figure in figures.items()}
        for file, picture in zip(self._pictures, pictures.values(), strict=False):
            file.write(picture)
        if self._page is not None:
            self._page.write(render_page(build_report(result), pictures))


def _format_payload(result: TrajectoryResult) -> str:
    """Return times in s and the payloads in kg from then on, as data for an input of a scenario."""
    spline = result.spline
    rows = [(spline.start + x.first * (spline.end - spline.start), x.payload) for x in result.problem.loads]
    lines = "".join(f"{time!r},{float(payload)!r}\n" for time, payload in rows)
    return f"{_PAYLOAD_MARK}time [s],payload [kg]\n{lines}"
