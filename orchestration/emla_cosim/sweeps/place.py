"""A folder that what comes of many runs is written to."""

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import ClassVar

from ..base.errors import CommandError
from ..base.files import UNFINISHED, check_places, place_of
from ..sandbox.locking import alone


class Place:
    """A folder at `path` to which `files` are written, of `what`; and into `inner`, folders in it."""

    what: ClassVar[str]
    files: ClassVar[tuple[str, ...]]
    inner: ClassVar[tuple[str, ...]] = ()

    def __init__(self, path: Path) -> None:
        """Nothing is made yet; CommandError for a path that cannot be one, or files that cannot be there."""
        self.path = path
        try:
            self._place = path.resolve()
            wrong = path.exists() and not path.is_dir()
        except (OSError, ValueError, RuntimeError) as error:
            reason = getattr(error, "strerror", None) or error
            raise CommandError(f"the output folder {str(path)!r} cannot be written: {reason}.") from error
        if wrong:
            raise CommandError(f"the output folder '{path}' cannot be written: it is a file.")
        for name in self.files if path.is_dir() else ():
            place_of(path / name, f"the file of the {self.what}")

    def check_unread(self, read: Iterable[Mapping[Path, str]]) -> None:
        """Raise CommandError where a file would be written that is read; `read` says what these are."""
        used = {file: what for files in read for file, what in files.items()}
        if self._place.is_dir():
            check_places({self.path / name: f"a file of the {self.what}" for name in self.files}, used)

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """No other run writes here meanwhile, nor is an empty folder left that was made for it.

        Raises CommandError where another run does, or the folder cannot be made.
        """
        missing = [place for place in (self._place, *self._place.parents) if not place.exists()]
        try:
            self._place.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise CommandError(
                f"the output folder '{self.path}' cannot be written: {error.strerror}."
            ) from error
        try:
            with alone(self._place):
                for folder in (self._place, *(self._place / name for name in self.inner)):
                    for left in folder.glob(f"{UNFINISHED}*"):
                        with contextlib.suppress(OSError):
                            left.unlink()
                yield
        finally:
            for place in missing:
                with contextlib.suppress(OSError):  # where there is something in it
                    place.rmdir()
