"""Output folders: files are written completely or not at all, by one command at a time."""

import contextlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, ClassVar

from ..base.errors import CommandError
from ..base.files import check_output_files, remove_unfinished, report_write_errors
from ..base.ownership import IsOurs, OutputFiles
from ..sandbox.locking import exclusive_lock
from .plots.style import save

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Folder:
    """A folder at `path` for `files` that describe `what`, and for the folders `inner` in it.

    `pictures` are further files, which only some commands write. Folders from versions without a manifest are
    recognized by `record_file`, which `is_record` checks.
    """

    what: str
    files: Sequence[str]
    pictures: Sequence[str] = ()
    inner: Sequence[str] = ()
    record_file: str
    is_record: ClassVar[IsOurs]

    def __init__(self, path: Path, overwrite: bool = False) -> None:
        """Check the folder without creating anything.

        Args:
            path: The folder.
            overwrite: Whether to replace files that emla did not write.

        Raises:
            CommandError: If the path cannot be a folder, one of `files` cannot be written, or emla did not
                write the existing one.
        """
        self.path, self.overwrite = path, overwrite
        try:
            self._place = path.resolve()
            wrong = (path.exists() or path.is_symlink()) and not path.is_dir()
        except (OSError, ValueError, RuntimeError) as error:
            reason = getattr(error, "strerror", None) or error
            raise CommandError(f"the output folder {str(path)!r} cannot be written: {reason}.") from error
        if wrong:
            raise CommandError(f"the output folder '{path}' cannot be written: it is no folder.")
        known = (*self.files, *self.pictures)
        kind = type(self)
        self._files = OutputFiles(self._place, path, kind.record_file, kind.is_record, known, overwrite)
        self.check_files(self.files)

    def check_files(self, names: Iterable[str]) -> None:
        """Raise CommandError if a file cannot be written, or emla did not write the existing one."""
        if self._place.is_dir():
            self._files.check(names, f"the file of the {self.what}")

    def write(self, name: str, content: bytes) -> Path:
        """Write a file and return its path. Raises OSError."""
        with self._written(name) as stream:
            stream.write(content)
        return self.path / name

    def write_json(self, name: str, content: Any) -> Path:
        """Write a JSON file and return its path. Raises OSError."""
        return self.write(name, (json.dumps(content, indent=2) + "\n").encode())

    def draw(self, name: str, figure: "Figure") -> Path:
        """Write a plot and return its path. Raises OSError."""
        with self._written(name) as stream:
            save(figure, stream, Path(name).suffix[1:])
        return self.path / name

    @contextlib.contextmanager
    def _written(self, name: str) -> Iterator[IO[bytes]]:
        with self._files.write(name) as stream:
            yield stream

    def settle(self) -> None:
        """Note that all files are complete. Raises RunError."""
        with report_write_errors(self.path):
            self._files.settle()

    def check_unread(self, read: Iterable[Mapping[Path, str]]) -> None:
        """Raise CommandError if an output file is also an input. `read` describes the inputs by path."""
        used = {file: what for files in read for file, what in files.items()}
        if self._place.is_dir():
            check_output_files(self.roles, used)

    @property
    def roles(self) -> dict[Path, str]:
        """Descriptions of `files`, by path."""
        return {self.path / name: f"a file of the {self.what}" for name in self.files}

    @contextlib.contextmanager
    def alone(self, heir_of: int | None = None) -> Iterator[None]:
        """Reserve the folder, and remove it at the end if it was created and is still empty.

        Incomplete files of a killed run are removed; for `heir_of` see `locking.exclusive_lock`.

        Raises:
            CommandError: If another run uses the folder, or it cannot be created.
        """
        missing = [place for place in (self._place, *self._place.parents) if not place.exists()]
        try:
            self._place.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise CommandError(
                f"the output folder '{self.path}' cannot be written: {error.strerror}."
            ) from error
        try:
            with exclusive_lock(self._place, heir_of):
                remove_unfinished(self._place)
                for name in self.inner:
                    if not (self._place / name).is_symlink():
                        remove_unfinished(self._place / name)
                yield
        finally:
            for place in missing:
                with contextlib.suppress(OSError):  # it is not empty
                    place.rmdir()
