"""Write reports to files."""

from pathlib import Path

from ...base.errors import RunError
from ...base.files import write_atomically
from ...base.ownership import IsOurs, check_replaceable, refuse_others


def write_text(text: str, path: Path, what: str, is_ours: IsOurs, overwrite: bool = False) -> None:
    """Write a text as a UTF-8 file, completely or not at all.

    Args:
        text: Content of the file.
        path: The file.
        what: Name of the file in messages.
        is_ours: Function that recognizes an earlier file of emla.
        overwrite: Whether to replace other files.

    Raises:
        CommandError: If no file may be written at the path.
        RunError: If writing fails.
    """
    place = check_replaceable(path, what, is_ours, overwrite)
    try:
        with write_atomically(place, refuse_others(is_ours, overwrite)) as stream:
            stream.write(text.encode("utf-8", "replace"))
    except OSError as error:
        raise RunError(f"{what} '{path}' cannot be written: {error.strerror or error}.") from error
