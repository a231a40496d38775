"""Run an analysis, and show its result: its report and its files."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ...analyses.frame.outputs import Outputs, is_drawn
from ...analyses.frame.report import Report, Text
from ...views.output_folder import results_folder
from ...views.terminal import BarProgress, print_line, show


def run_analysis(
    outputs: Outputs[Any], analysis: Callable[..., Any], source: Any, name: str, options: Mapping[str, Any]
) -> tuple[Any, Path]:
    """Run an analysis of a source with progress, and show its result.

    Returns:
        The result and its folder; without `output`, that of this name.
    """
    folder = Path(options.get("output") or results_folder(name))
    with BarProgress() as progress:
        result = analysis(source, **{**options, "output": folder, "progress": progress})
    show_result(outputs, result, folder)
    return result, folder


def show_result(outputs: Outputs[Any], result: Any, folder: Path) -> None:
    """Show the report of a result, then its files in a folder."""
    show_report(outputs.report(result))
    files = dict.fromkeys((outputs.record_name, *outputs.tables, *outputs.folders))
    drawn = (*outputs.pictures, *outputs.list_pictures(result), outputs.page_name)
    names = [name for name in files if (folder / name).exists()]
    names += [name for name in drawn if is_drawn(folder / name)]
    print_line(f"Wrote {folder}/: {', '.join(names)}")


def show_report(report: Report) -> None:
    """Show the lines and tables of a report, without the sections that are details."""
    for section in report.sections:
        if section.is_detail:
            continue
        lines = section.lines[: section.most]
        _show_lines(lines)
        if more := len(section.lines) - len(lines):
            print_line(f"and {more} more, in the files")
        for table in section.tables:
            show(table.rich())
            _show_lines(table.under)
        _show_lines(section.under)


def _show_lines(lines: Sequence[Text | str]) -> None:
    for line in lines:
        if isinstance(line, Text):
            show(line.styled(), highlight=False, soft_wrap=True)
        else:
            print_line(line)
