"""Tables in files, which replace no file of somebody else."""

from pathlib import Path

from ..base.ownership import OutputFiles
from .table import Table


class FileTable(Table):
    """A table that is written to one file.

    A file that is there already is replaced if it is empty, if an earlier table of ours was written there
    and nobody changed it since, or with `overwrite`; see `base.ownership`.
    """

    def __init__(self, path: str | Path, overwrite: bool = False) -> None:
        self.path = Path(path)
        folder = self.path.parent
        self._files = OutputFiles(folder, folder, "", lambda _: False, (), overwrite)

    def __str__(self) -> str:
        return str(self.path)

    def claim(self, continued: bool) -> None:
        """List the file in the manifest of its folder before it is written, or continued.

        Raises:
            CommandError: Somebody else wrote the file that would be replaced.
            OSError: The manifest cannot be written.

        """
        if not continued:
            self._files.check([self.path.name], "the table")
        self._files.claim([self.path.name])

    def settle(self) -> None:
        """Note in the manifest that the file is complete. May raise OSError."""
        self._files.settle([self.path.name])
