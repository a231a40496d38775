"""The files that a report can be written to."""

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from emla_cosim.base.output_files import IsOurs, OutputFile, has_format, has_mark, is_page

if TYPE_CHECKING:
    from .findings import Findings

JSON_FORMAT = "emla-verify"
SARIF_TOOL = "emla verify"
_SARIF_MARK = f'"driver": {{\n          "name": "{SARIF_TOOL}"'
BADGE_MARK = "<metadata>emla verify</metadata>"


@dataclass(frozen=True)
class ReportFile:
    """One kind of file.

    Attributes:
        subject: What messages call it.
        module: Module whose function `render` returns its text. It is imported when a file is written.
        is_ours: Function that recognizes a file that may be overwritten.
    """

    subject: str
    module: str
    is_ours: IsOurs

    def check(self, path: Path, overwrite: bool = False) -> OutputFile:
        """Return the file. Raise CommandError if it must not be written."""
        return OutputFile(path, self.subject, self.is_ours, overwrite)

    def save(self, report: "Findings", path: Path, overwrite: bool = False) -> None:
        """Write a report. Raise CommandError and RunError like `OutputFile`."""
        file = self.check(path, overwrite)
        text: str = import_module(f".{self.module}", __package__).render(report)
        file.write(text.encode("utf-8", "replace"))


REPORT_FILES = {
    "junit": ReportFile("the JUnit report", "junit", has_mark(b'<testsuites name="emla verify"')),
    "json": ReportFile("the JSON report", "json_file", has_format(JSON_FORMAT)),
    "sarif": ReportFile("the SARIF report", "sarif", has_mark(_SARIF_MARK.encode())),
    "html": ReportFile("the HTML report", "page", is_page),
    "badge": ReportFile("the badge", "badge", has_mark(BADGE_MARK.encode())),
}
"""Kinds of files by the option of `emla verify` and the method of `Report`."""
