"""The payload over time, as data for an input of a scenario: the file beside a trajectory."""

from pathlib import Path

from hdrm_fmu.optimisation.problem import MotionProblem

from ..base.errors import RunError
from ..base.files import write_atomically
from ..base.ownership import check_replaceable, has_mark, refuse_others
from .motion import OptimisedMotion

WHAT = "the payload"
"""Name of the file in error messages."""

_MARK = "# emla-cosim payload 1\n"
_is_payload = has_mark(_MARK.encode())


def payload_place(path: Path, problem: MotionProblem, overwrite: bool = False) -> Path | None:
    """Return where the payload of a motion is written; None if it does not change.

    Raises:
        CommandError: The file may not be replaced.
    """
    if len(problem.loads) == 1:
        return None
    return check_replaceable(path.with_name(f"{path.stem}-payload.csv"), WHAT, _is_payload, overwrite)


def save_payload(result: OptimisedMotion, path: Path, overwrite: bool = False) -> None:
    """Write times in s and the payloads in kg from then on, if the payload changes.

    Raises:
        CommandError: If emla did not write an existing file.
        RunError: If writing fails.
    """
    place, spline = payload_place(path, result.problem, overwrite), result.spline
    if place is None:
        return
    rows = [(spline.start + x.first * (spline.end - spline.start), x.payload) for x in result.problem.loads]
    content = f"{_MARK}time [s],payload [kg]\n" + "".join(
        f"{time!r},{float(payload)!r}\n" for time, payload in rows
    )
    try:
        with write_atomically(place, refuse_others(_is_payload, overwrite)) as stream:
            stream.write(content.encode())
    except OSError as error:
        raise RunError(f"{WHAT} '{place}' cannot be written: {error.strerror or error}.") from error
