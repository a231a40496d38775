"""Reports put into files."""

from pathlib import Path

from ...base.errors import RunError
from ...base.files import write_atomically
from ...base.ownership import IsOurs, check_replaceable


def write_text(text: str, path: Path, what: str, is_ours: IsOurs, overwrite: bool = False) -> None:
    """Write a text as a file in UTF-8, whole or not at all; `what` is what sentences call it.

    `is_ours` recognizes an earlier file of emla, others are only replaced with `overwrite`. Raises
    CommandError where no file may be written at the path, RunError where writing failed.
    """
    place = check_replaceable(path, what, is_ours, overwrite)
    try:
        with write_atomically(place) as stream:
            stream.write(text.encode("utf-8", "replace"))
    except OSError as error:
        raise RunError(f"{what} '{path}' cannot be written: {error.strerror or error}.") from error
