"""`emla info`."""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import groupby, islice
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Column, Table
from rich.text import Text

from ...base.errors import CommandError
from ...base.files import check_output_files, report_write_errors
from ...base.option import INFO, OTHER_OPTIONS, option
from ...base.output_files import OutputFile
from ...inspection.collector import info
from ...inspection.display_rows import LONGEST, DisplayRow, build_display_rows, format_line, list_fmu_facts
from ...inspection.system_info import JSON_FILE, Info, format_start, is_info
from ...pages.text import shorten_text
from ...study.loading import load
from ...study.machines.machine_info import ActuatorInfo, MachineInfo
from ...views.plots.style import is_picture, to_png
from ...views.terminal import OUT, BarProgress, print_exactly, print_line, show, show_table
from ..command import scenario


def show_machine(machine: MachineInfo, has_parameters: bool) -> None:
    """Show what a machine consists of, with its parameters or without."""
    space = "in the plane" if machine.dimensions == 2 else "in space"
    count = machine.degrees_of_freedom
    free = f", {', '.join(machine.passive)} swinging freely" if machine.passive else ""
    print_line(f"Machine {space} with {count} degree{'s' * (count != 1)} of freedom{free}")
    if machine.payload is not None:
        print_line(f"Payload {machine.payload:g} kg at {machine.payload_at}")
    bodies = [(x.name, x.joint, x.on, f"{x.m:.4g}") for x in machine.bodies]
    _show_columns(("body", "joint", "on", "mass / kg"), bodies, 3)
    actuators = [
        (
            x.name,
            " to ".join(x.ends),
            f"{x.length:.4g}",
            f"{x.stroke[0]:.4g} to {x.stroke[1]:.4g}",
            f"{x.start:.4g}",
            f"{x.lever:.3g}",
        )
        for x in machine.actuators
    ]
    _show_columns(
        ("actuator", "between", "length at 0 / m", "stroke / m", "start / m", "lever"), actuators, 2
    )
    header = ["holding force / kN", "at start", "over all strokes", "largest at strokes / m"]
    limits = {"continuous limit": "continuous_force", "largest": "largest_force"}
    limits = {text: x for text, x in limits.items() if any(getattr(a, x) for a in machine.actuators)}
    _show_columns([*header, *limits], [_format_force_row(x, limits.values()) for x in machine.actuators], 1)
    closures = [(", ".join(x.coordinates), ", ".join(x.lengths), x.method) for x in machine.closures]
    _show_columns(("coordinates of", "follow from", "by"), closures, 3)
    if has_parameters:
        _show_columns(
            ("parameter", "value"), [(name, f"{x:.9g}") for name, x in machine.parameters.items()], 1
        )
    print_line(
        "Forces hold the payload at rest, positive against extension. Lever: motion of the tip per stroke."
    )
    if machine.unreachable > 0.0:
        share = f"{100.0 * machine.unreachable:.2g} %"
        print_line(f"{share} of the poses within all strokes do not close and are left out.")
    for actuator in machine.actuators:
        if text := describe_overload(actuator):
            print_line(f"Warning: {text}")


def describe_overload(actuator: ActuatorInfo) -> str:
    """Return a warning if an actuator cannot hold the machine somewhere; empty if it can, or if unknown."""
    largest, force = actuator.largest_force, max(abs(actuator.lowest_force), abs(actuator.highest_force))
    if largest is None or force <= largest:
        return ""
    return f"{actuator.name} needs {1e-3 * force:.4g} kN, but holds {1e-3 * largest:.4g} kN at the most."


def _format_force_row(actuator: ActuatorInfo, limits: Iterable[str]) -> Sequence[str]:
    """Return the row of an actuator in the table of forces, in kN; `limits` are names of its attributes."""
    forces = (getattr(actuator, name) for name in limits)
    return (
        actuator.name,
        f"{1e-3 * actuator.start_force:.4g}",
        f"{1e-3 * actuator.lowest_force:.4g} to {1e-3 * actuator.highest_force:.4g}",
        ", ".join(f"{x:.3g}" for x in actuator.worst_strokes),
        *("unknown" if x is None else f"{1e-3 * x:.4g}" for x in forces),
    )


def _show_columns(header: Sequence[str], rows: Iterable[Sequence[str]], text_columns: int) -> None:
    """Show a table, whose first columns are texts."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for i, name in enumerate(header):
        table.add_column(name, justify="left" if i < text_columns else "right", overflow="fold")
    for row in rows:
        table.add_row(*map(Text, row))
    show_table(table)


OPTIONS = INFO

PICTURES = ("machine", "forces", "levers")
"""Names of the pictures of a machine."""

_TO_SCREEN = "-"
"""Value of `--json` that shows JSON."""

_MOST_ROWS, _MOST_FMUS, _MOST_ENDS = 1000, 40, 20
"""Most rows to show; JSON has all of them."""
_WIDEST_NAME = 120
"""Most letters in a line of names."""
_WIDE_TERMINAL = 120
"""Fewest columns of a terminal to show all columns of a table side by side."""


@dataclass(frozen=True)
class Parameters:
    """Arguments and options of the command."""

    scenario: str = scenario()
    match: Sequence[str] = option(
        [],
        help="Variables to show: a pattern of names with *, or a word in names or descriptions (repeatable).",
        metavar="PATTERN",
        group=OTHER_OPTIONS,
    )
    json: Path | None = option(
        help="Write JSON to a file, or show it if no file follows.",
        metavar="[FILE]",
        flag_value=_TO_SCREEN,
        group=OTHER_OPTIONS,
    )
    pictures: Path | None = option(
        help="Write pictures of the machine to a folder: machine.png with the reach of its tip, and "
        "forces.png and levers.png over the strokes.",
        metavar="FOLDER",
        group=OTHER_OPTIONS,
    )


def command(parameters: Parameters, options: dict[str, Any]) -> None:
    """Show the variables of an FMU, a package or a scenario, and which of them you can set."""
    source, json = parameters.scenario, parameters.json
    overwrite = options.get("overwrite", False)
    to_file = json is not None and str(json) != _TO_SCREEN
    if json is not None and to_file:
        used = {Path(source): "the file to show"}
        with suppress(CommandError):  # collecting the information reports it
            used |= load(source, **options).options.files_read()
        check_output_files({json: JSON_FILE}, used)
        OutputFile(json, JSON_FILE, is_info, overwrite)  # checked before FMUs are built
    folder = parameters.pictures
    names = () if folder is None else tuple(folder / f"{name}.png" for name in PICTURES)
    files = [OutputFile(path, "the picture", is_picture, overwrite, creates_folder=True) for path in names]
    with BarProgress() as progress:
        content = info(source, progress, **options)
    if folder is not None:
        _write_pictures(content, folder, files)
    if parameters.match:
        content = content.matching(*parameters.match)
    if json is None:
        _show(content, header=not parameters.match)
    elif to_file:
        content.save_json(json, overwrite)
    else:
        print_exactly(content.as_json())


def _write_pictures(content: Info, folder: Path, files: Sequence[OutputFile]) -> None:
    """Write the pictures of a machine; raise CommandError without a machine."""
    if content.machine is None:
        raise CommandError(
            f"'{content.name}' has no machine to draw; --pictures needs a machine, such as hdrm-coupled."
        )
    with report_write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    for file, figure in zip(files, content.machine.draw().values(), strict=True):
        file.write(to_png(figure))


def _show(content: Info, header: bool) -> None:
    """Show title, notes and variables; with `header` also times, components and the machine."""
    title = f"{content.name}: {content.description}" if content.description else content.name
    show(Text(format_line(title), style="bold"), soft_wrap=True)
    if header:
        _show_header(content)
        if content.machine is not None:
            show_machine(content.machine, has_parameters=not content.variables)
    for note in content.notes:
        print_line(f"Note: {format_line(note)}.")
    rows = list(islice(build_display_rows(content.variables), _MOST_ROWS + 1))
    _show_rows(rows[:_MOST_ROWS])
    if len(rows) > _MOST_ROWS:
        count = len(content.variables)
        print_line(f"The first {_MOST_ROWS} rows of {count} variables; --match selects, --json has all.")
    settable = next((row.first for row in rows if row.first.settable and row.first.start is not None), None)
    if settable is not None and settable.start is not None:
        print_line(
            "You can set variables marked with +, such as --set "
            f"'{format_line(settable.name)}={format_line(format_start(settable.start))}'"
        )


def _show_header(content: Info) -> None:
    """Show the times of runs and the facts of the FMU, or a table of all FMUs with their components."""
    start, stop, step = content.start_time or 0.0, content.stop_time, content.step_size
    if stop is not None and step is not None:
        print_line(f"Runs from {start:g} to {stop:g} s in steps of {step:g} s.")
    if not content.components:
        return
    if len(content.components) == 1:
        for label, text in list_fmu_facts(content.fmus[0]):
            print_line(f"{label:<12} {text}")
        return
    names: list[list[str]] = [[] for _ in content.fmus]
    for component in content.components:
        names[component.fmu].append(component.name)
    table = _make_table("model", "components", "FMU")
    for fmu, components in list(zip(content.fmus, names, strict=True))[:_MOST_FMUS]:
        table.add_row(*(_make_cell(x) for x in (fmu.model, ", ".join(components), fmu.path)))
    show_table(table)
    if (more := len(content.fmus) - _MOST_FMUS) > 0:
        print_line(f"and {more} more FMUs; --json has all")
    counts = len(content.components), len(content.fmus), len(content.connections), len(content.variables)
    print_line("{} components of {} FMUs, {} connections, {} variables".format(*counts))


def _show_rows(rows: Sequence[DisplayRow]) -> None:
    """Show a table for each component on a terminal, otherwise one table with full names in each row."""
    if not OUT.is_terminal:  # a program reads it line by line
        _show_table(rows, "variable", "")
        return
    for component, component_rows in groupby(rows, lambda row: row.first.component):
        _show_table(list(component_rows), format_line(component), format_line(f"{component}."))


def _show_table(rows: Sequence[DisplayRow], title: str, prefix: str) -> None:
    """Show a table of variables without the prefix of their names. A narrow terminal has fewer columns."""
    if not rows:
        return
    narrow = OUT.is_terminal and OUT.width < _WIDE_TERMINAL
    longest = max(len(title), *(len(row.name) - len(prefix) for row in rows))
    width = min(longest, OUT.width * 2 // 5 if narrow else _WIDEST_NAME)
    name = Column(Text(title), overflow="fold", width=width)
    start = Column("start", overflow="fold", max_width=24)
    mark = Column("", width=1)
    columns = (mark, name, start) if narrow else (mark, name, "", start, "range")
    table = _make_table(*columns, "meaning")
    for row in rows:
        style = "cyan" if row.first.settable else ""
        name_cells = Text("+" if style else "", style), Text(row.name.removeprefix(prefix), style)
        start = Text(row.start, style="bold" if row.is_changed else "")
        cells = (start,) if narrow else (_make_cell(row.kind), start, _make_cell(row.range))
        about = ", ".join(filter(None, (row.kind, row.range))) if narrow else ""
        table.add_row(*name_cells, *cells, _format_meaning(row, about))
    show_table(table)


def _format_meaning(row: DisplayRow, details: str = "") -> Text:
    """Return the description of a variable, followed by `details` and its connections."""
    meaning = _make_cell(row.meaning)
    more = [f"and {len(row.connected) - _MOST_ENDS} more"] if len(row.connected) > _MOST_ENDS else []
    for added in filter(None, (details, *row.connected[:_MOST_ENDS], *more)):
        meaning.append("; " if meaning else "")
        meaning.append(shorten_text(added, LONGEST), style="dim")
    return meaning


def _make_table(*columns: Column | str) -> Table:
    headings = (c if isinstance(c, Column) else Column(c, overflow="fold") for c in columns)
    return Table(*headings, box=SIMPLE_HEAD, pad_edge=False)


def _make_cell(text: str) -> Text:
    """Return a text from a file as one line of limited length, without markup."""
    return Text(shorten_text(format_line(text), LONGEST))
