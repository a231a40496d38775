"""Tables in files, which do not replace files of other programs."""

from pathlib import Path

from ..base.ownership import OutputFiles
from .table import Table


class FileTable(Table):
    """A table in one file.

    An existing file is replaced if it is empty, if it is an unchanged table of an earlier run, or with
    `overwrite`; see `base.ownership`.
    """

    def __init__(self, path: str | Path, overwrite: bool = False) -> None:
        self.path = Path(path)
        folder = self.path.parent
        self._files = OutputFiles(folder, folder, "", lambda _: False, (), overwrite)

    def __str__(self) -> str:
        return str(self.path)

    def claim(self, continued: bool) -> None:
        """Add the file to the manifest of its folder before it is written.

        Args:
            continued: Whether the run continues an existing file. Otherwise the file is replaced.

        Raises:
            CommandError: The existing file was not written by a run, or was changed since.
            OSError: The manifest cannot be written.
        """
        if not continued:
            self._files.check([self.path.name], "the table")
        self._files.claim([self.path.name])

    def settle(self) -> None:
        """Mark the file as complete in the manifest. May raise OSError."""
        self._files.settle([self.path.name])
