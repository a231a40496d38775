"""Output folders: files are written completely or not at all, by one command at a time."""

import contextlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from ..base.errors import CommandError
from ..base.files import (
    NotAFileError,
    check_output_files,
    remove_unfinished,
    report_write_errors,
    resolve_output_path,
    write_atomically,
)
from ..base.folder_lock import exclusive_lock
from ..base.output_files import RECORDS, has_format, has_record, is_new, is_regular
from .plots.style import save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_OLD_MANIFEST = ".emla.json"
"""A file that earlier versions wrote to output folders."""


class Folder:
    """A folder at `path` for `files` that describe `what`, and for the folders `inner` in it.

    `pictures` are further files, which only some commands write. The folder belongs to a command of this kind
    once it holds `record_file`, a key of `RECORDS`: write that file first.
    """

    subject: str
    files: Sequence[str]
    pictures: Sequence[str] = ()
    inner: Sequence[str] = ()
    record_file: str

    def __init__(self, path: Path, overwrite: bool = False) -> None:
        """Check the folder without creating anything.

        Args:
            path: The folder.
            overwrite: Whether to replace files that emla did not write.

        Raises:
            CommandError: If the path cannot be a folder, a file cannot be written, or the folder has files
                that emla did not write and no record of emla.
        """
        self.path, self.overwrite = path, overwrite
        try:
            self._real_path = path.resolve()
            is_not_folder = (path.exists() or path.is_symlink()) and not path.is_dir()
        except (OSError, ValueError, RuntimeError) as error:
            reason = getattr(error, "strerror", None) or error
            raise CommandError(f"the output folder {str(path)!r} cannot be written: {reason}.") from error
        if is_not_folder:
            raise CommandError(f"the output folder '{path}' cannot be written: it is not a folder.")
        self.check_files((*self.files, *self.pictures))

    def check_files(self, names: Iterable[str]) -> None:
        """Raise CommandError if files of these names cannot be written, or the folder is not emla's."""
        # a new folder has nothing to lose
        if not self._real_path.is_dir():
            return
        names = [name for name in names if os.path.lexists(self._real_path / name)]
        for name in names:
            resolve_output_path(self.path / name, f"the file of the {self.subject}")
        try:
            unknown = None if self.overwrite or self.has_own_record() else self._find_foreign_file(names)
        except OSError as error:
            raise CommandError(
                f"the output folder '{self.path}' cannot be read: {error.strerror or error}."
            ) from error
        if unknown is not None:
            raise CommandError(
                f"the output folder '{self.path}' has '{unknown}', which was not written by emla. Choose "
                "another output folder, or use --overwrite.",
                path=str(self.path / unknown),
            )

    def _find_foreign_file(self, names: Sequence[str]) -> str | None:
        """Return a file that a command of this kind must not touch; None if it may write here."""
        if (
            nonempty := next((name for name in names if not is_new(self._real_path / name)), None)
        ) is not None:
            return nonempty
        if any(has_record(self._real_path, record) for record in RECORDS):
            return None
        # hidden files, such as those of a killed command, disturb no user, nor do empty ones
        unknown = sorted(set(os.listdir(self._real_path)).difference(names))  # noqa: PTH208
        return next((name for name in unknown if not name.startswith(".")), None)

    def has_own_record(self) -> bool:
        """Return whether a command of this kind wrote to the folder. Raises OSError."""
        return has_record(self._real_path, self.record_file)

    def write(self, name: str, content: bytes) -> Path:
        """Write a file and return its path. Raises RunError."""
        with self.open(name) as stream:
            stream.write(content)
        return self.path / name

    def write_json(self, name: str, content: Any) -> Path:
        """Write a JSON file and return its path. Raises RunError."""
        return self.write(name, (json.dumps(content, indent=2) + "\n").encode())

    def draw(self, name: str, figure: "Figure") -> Path:
        """Write a plot and return its path. Raises RunError."""
        with self.open(name) as stream:
            save(figure, stream, Path(name).suffix[1:])
        return self.path / name

    @contextlib.contextmanager
    def open(self, name: str) -> Iterator[IO[bytes]]:
        """Open a stream for a file, which appears when it is complete. Raises RunError."""
        with (
            report_write_errors(self.path),
            write_atomically(self._real_path / name, self._check_still_ours) as stream,
        ):
            yield stream

    def _check_still_ours(self, path: Path) -> None:
        """Raise NotAFileError if a file of the user appeared while the command ran."""
        if not (self.overwrite or is_new(path) or has_record(path.parent, self.record_file)):
            raise NotAFileError(0, f"'{path.name}' appeared while emla ran, and emla did not write it")

    def remove(self, names: Iterable[str]) -> None:
        """Remove files that a command of this kind wrote.

        Links, and everything else that is not a regular file, stay. Raises RunError.
        """
        with report_write_errors(self.path):
            # without a record, the files may be those of the user
            for name in names if self.has_own_record() else ():
                if is_regular(self._real_path / name):
                    (self._real_path / name).unlink()

    def check_unread(self, read: Iterable[Mapping[Path, str]]) -> None:
        """Raise CommandError if an output file is also an input. `read` describes the inputs by path."""
        used = {file: label for files in read for file, label in files.items()}
        if self._real_path.is_dir():
            check_output_files(self.roles, used)

    @property
    def roles(self) -> dict[Path, str]:
        """Descriptions of `files`, by path."""
        return {self.path / name: f"a file of the {self.subject}" for name in self.files}

    @contextlib.contextmanager
    def reserve(self) -> Iterator[None]:
        """Reserve the folder, and remove it at the end if it was created and is still empty.

        Incomplete files of a killed command are removed.

        Raises:
            CommandError: If another command uses the folder, or it cannot be created.
        """
        missing = [folder for folder in (self._real_path, *self._real_path.parents) if not folder.exists()]
        try:
            self._real_path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise CommandError(
                f"the output folder '{self.path}' cannot be written: {error.strerror}."
            ) from error
        try:
            with exclusive_lock(self._real_path):
                self._remove_leftovers()
                yield
        finally:
            # a command that failed early leaves no empty folder
            for folder in missing:
                with contextlib.suppress(OSError):  # it is not empty
                    folder.rmdir()

    def _remove_leftovers(self) -> None:
        """Remove incomplete files of killed commands, and a file of earlier versions."""
        for folder in (self._real_path, *(self._real_path / name for name in self.inner)):
            if not folder.is_symlink():
                remove_unfinished(folder)
        with contextlib.suppress(OSError):
            # earlier versions wrote it; nothing reads it any more
            manifest = self._real_path / _OLD_MANIFEST
            if is_regular(manifest) and has_format("emla-output")(manifest):
                manifest.unlink()
