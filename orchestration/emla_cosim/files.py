"""Files of others, read with one sentence for whatever is wrong with their names or contents."""

from pathlib import Path

from .errors import CommandError


def read_file(path: Path, what: str) -> bytes:
    """The content of a file; CommandError that says `what` it should have been where it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise CommandError(f"{what} '{path}' cannot be read: {error.strerror}.") from error
    except ValueError as error:  # a name that no file can have
        raise CommandError(f"{what} {str(path)!r} cannot be read: {error}.") from error


def read_text(path: Path, what: str) -> str:
    """The text of a file in UTF-8, with a byte-order mark or without; CommandError as in `read_file`."""
    try:
        return read_file(path, what).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise CommandError(f"{what} '{path}' is not a text in UTF-8.") from error
