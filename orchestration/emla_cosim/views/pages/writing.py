"""Reports put into files."""

from pathlib import Path

from ...base.errors import RunError
from ...base.files import place_of, written_whole


def write_text(text: str, path: Path, what: str) -> None:
    """Write a text as a file in UTF-8, whole or not at all; `what` is what sentences call it.

    Raises CommandError where no file can be written at the path, RunError where writing failed.
    """
    place = place_of(path, what)
    try:
        with written_whole(place) as stream:
            stream.write(text.encode("utf-8", "replace"))
    except OSError as error:
        raise RunError(f"{what} '{path}' cannot be written: {error.strerror or error}.") from error
