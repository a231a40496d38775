"""The files of the result of an analysis: record, tables, pictures and page, in one folder."""

from base64 import b64encode
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from ...base.extras import has_extra, require_extra
from ...base.output_files import is_page, is_regular
from ...pages.text import to_plain
from ...views.folder import Folder
from ...views.plots.style import is_picture, to_png
from .report import Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure


R = TypeVar("R")
"""The type of a result."""


@dataclass(frozen=True)
class Outputs(Generic[R]):
    """The files and the report of an analysis whose result is an `R`.

    Attributes:
        subject: What messages call the analysis, such as "sizing".
        name: Name of the record and of the page, without suffix, such as "size".
        tables: Functions that return the content of further files, by name; None for one that this result
            does not have.
        report: Returns the report.
        record: Returns the content of the record; None if `record_file` is the first table. Default: the
            `record` of the result.
        draw: Returns the pictures by file name.
        pictures: Names of the pictures that are known before the analysis.
        folders: Names of folders with further files.
        record_file: Name of the record. Default: `name`.json.
        list_pictures: Returns the names of further pictures, which depend on the result.
    """

    subject: str
    name: str
    tables: Mapping[str, Callable[[R], str | bytes | None]]
    report: Callable[[R], Report]
    record: Callable[[R], Mapping[str, Any]] | None = attrgetter("record")
    draw: "Callable[[R], Iterable[tuple[str, Figure]]]" = lambda _: ()
    pictures: Sequence[str] = ()
    folders: Sequence[str] = ()
    record_file: str = ""
    list_pictures: Callable[[R], Sequence[str]] = lambda _: ()

    @property
    def record_name(self) -> str:
        """Name of the record."""
        return self.record_file or f"{self.name}.json"

    @property
    def page_name(self) -> str:
        """Name of the page."""
        return f"{self.name}.html"


def is_drawn(path: Path) -> bool:
    """Return whether emla drew the picture or wrote the page at this path."""
    return is_regular(path) and (is_picture(path) or is_page(path))


class AnalysisFolder(Folder, Generic[R]):
    """The output folder of an analysis.

    Args:
        outputs: The files of the analysis.
        path: The folder.
        overwrite: Whether to replace files that emla did not write.
        plots: Whether to draw pictures.
        report: Whether to write a page.

    Raises:
        CommandError: As `Folder`; or a page needs an extra that is not installed.
    """

    lacks_pictures: bool
    """Whether pictures are left out because of an extra that is not installed."""

    def __init__(
        self,
        outputs: Outputs[R],
        path: Path,
        overwrite: bool = False,
        plots: bool = True,
        report: bool = False,
    ) -> None:
        if report:
            require_extra("plots", "a page")
        self.outputs, self._plots, self._report = outputs, plots and has_extra("plots"), report
        self.lacks_pictures = plots and not self._plots
        self.subject, self.record_file = outputs.subject, outputs.record_name
        self.files = tuple(dict.fromkeys([outputs.record_name, *outputs.tables]))
        self.pictures = (*outputs.pictures, outputs.page_name)
        super().__init__(path, overwrite)

    def keep(self, result: R, is_final: bool = True) -> None:
        """Write the files of a result, the record first, and remove those that it does not have.

        Args:
            result: The result.
            is_final: Whether to draw pictures and write the page, too.

        Raises:
            RunError: A file cannot be written.
        """
        outputs = self.outputs
        # all contents first: an error must not leave files of two results
        contents = {name: build(result) for name, build in outputs.tables.items()}
        if outputs.record is not None:
            self.write_json(outputs.record_name, to_plain(outputs.record(result)))
        for name, content in contents.items():
            if content is None:
                self.remove([name])
            else:
                self.write(name, content.encode() if isinstance(content, str) else content)
        if is_final:
            self.draw_result(result)
        else:
            self.remove_drawn([*self.pictures, *outputs.list_pictures(result)])

    def draw_result(self, result: R) -> None:
        """Draw the pictures and write the page, as asked for. Raises RunError."""
        outputs = self.outputs
        figures = outputs.draw(result) if self._plots or self._report else ()
        # drawn once, for the files and for the page
        pictures = {name: to_png(figure) for name, figure in figures}
        names = list(pictures) if self._plots else []
        for name in names:
            self.write(name, pictures[name])
        if self._report:
            self.write(outputs.page_name, render_page(outputs.report(result), pictures))
            names.append(outputs.page_name)
        possible = (*self.pictures, *outputs.list_pictures(result))
        self.remove_drawn(name for name in possible if name not in names)

    def remove_drawn(self, names: Iterable[str]) -> None:
        """Remove pictures and pages of emla with these names. Raises RunError."""
        self.remove(name for name in names if is_drawn(self.path / name))


def render_page(report: Report, pictures: Mapping[str, bytes]) -> bytes:
    """Return the self-contained page of a report, with its pictures (PNG) by file name."""
    from ...pages.page import Plots, render_template  # importing it loads jinja2

    images = {name: f"data:image/png;base64,{b64encode(png).decode()}" for name, png in pictures.items()}
    page = render_template(__package__ or "", "page.html", Plots(), report=report, pictures=images)
    return page.encode("utf-8", "replace")  # names of variables can have lone surrogates
