"""The payload over time, as data for an input of a scenario: the file beside a trajectory."""

from pathlib import Path

from hdrm_fmu.optimisation.problem import MotionProblem

from ...base.output_files import OutputFile, has_mark
from .motion import OptimisedMotion

_MARK = "# emla-cosim payload 1\n"


def check_payload(path: Path, problem: MotionProblem, overwrite: bool = False) -> OutputFile | None:
    """Return the file for the payload of a motion; None if it does not change.

    Raises:
        CommandError: The file may not be replaced.
    """
    if len(problem.loads) == 1:
        return None
    place = path.with_name(f"{path.stem}-payload.csv")
    return OutputFile(place, "the payload", has_mark(_MARK.encode()), overwrite)


def save_payload(result: OptimisedMotion, path: Path, overwrite: bool = False) -> None:
    """Write times in s and the payloads in kg from then on, if the payload changes.

    Raises:
        CommandError: If emla did not write an existing file.
        RunError: If writing fails.
    """
    file, spline = check_payload(path, result.problem, overwrite), result.spline
    if file is None:
        return
    rows = [(spline.start + x.first * (spline.end - spline.start), x.payload) for x in result.problem.loads]
    content = f"{_MARK}time [s],payload [kg]\n" + "".join(
        f"{time!r},{float(payload)!r}\n" for time, payload in rows
    )
    file.write(content.encode())
