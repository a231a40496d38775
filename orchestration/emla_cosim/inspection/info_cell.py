"""The content of an FMU or a system as the output of a cell of a notebook."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import NamedTuple

from ..base.wording import format_count
from ..pages.page import Plots, render_template
from ..pages.text import make_visible, shorten_text
from ..ssp.diagram import build_diagrams, group_connections
from ..views.notebook_cells import MOST, make_arrow_id
from .system_info import FmuInfo, Info, Start, VariableInfo, format_start

_ELEMENT = re.compile(r"(.*)\[([0-9]{1,9})\]", re.DOTALL)
LONGEST = 300
"""Most letters in a text of a table."""

_MOST_STARTS = 4
"""Most different start values of an array's elements to show."""
_USUAL = ("continuous", "fixed", "discrete")
"""Default variabilities, which are not shown: of a Real, of a parameter, of other variables."""


@dataclass(frozen=True)
class DisplayRow:
    """A row of the table as texts.

    Attributes:
        name: The variable, or the elements of an array.
        kind: Variability, type and causality, without defaults.
        start: The start value with its unit, and that of the FMU if it differs.
        is_changed: Whether it differs.
        range: What the value may be.
        meaning: The description; with the unit if there is no start value.
        connected: Connections and Clocks.
        first: The variable, or the first element.
    """

    name: str
    kind: str
    start: str
    is_changed: bool
    range: str
    meaning: str
    connected: tuple[str, ...]
    first: VariableInfo


def build_display_rows(variables: Sequence[VariableInfo]) -> Iterator[DisplayRow]:
    """Yield a row for each variable, and one for adjacent, equal elements of an array."""
    for _, group in groupby(enumerate(variables), lambda entry: _make_grouping_key(*entry)):
        yield _make_row([v for _, v in group])


def _make_grouping_key(position: int, v: VariableInfo) -> tuple[object, ...]:
    """Return what adjacent elements of an array must have in common to share a row."""
    element = _ELEMENT.fullmatch(v.name)
    if element is None or v.driven_by or v.read_by:
        return (v.name,)
    alike = v.causality, v.variability, v.type, v.unit, v.minimum, v.maximum, v.description, v.settable
    # constant for elements that follow each other
    return element[1], int(element[2]) - position, *alike


def _make_row(elements: Sequence[VariableInfo]) -> DisplayRow:
    first, last = elements[0], elements[-1]
    name = format_line(first.name)
    if len(elements) > 1:
        name = f"{name.removesuffix(']')}..{last.name.rpartition('[')[2]}"
    start, default = _values([v.start for v in elements]), _values([v.default for v in elements])
    unit, meaning = format_line(first.unit or ""), format_line(first.description)
    is_changed = default not in ("", start)
    if unit and not start:
        meaning = f"[{unit}] {meaning}"
    elif unit:
        start = f"{start} {unit}"
    if is_changed:
        start = f"{start} (FMU: {default})"
    ends = (f"from {first.driven_by}",) if first.driven_by else ()
    ends += tuple(f"to {reader}" for reader in first.read_by)
    ends += (f"at {' and '.join(first.clocks)}",) if first.clocks else ()
    return DisplayRow(
        name=name,
        kind=_describe_kind(first),
        start=start,
        is_changed=is_changed,
        range=", ".join(map(format_line, first.choices)) or _format_range(first.minimum, first.maximum),
        meaning=meaning,
        connected=tuple(map(format_line, ends)),
        first=first,
    )


def list_fmu_facts(fmu: FmuInfo) -> list[tuple[str, str]]:
    """Return what the model description says of an FMU, as labels and texts."""
    experiment = {
        "from": fmu.start_time,
        "to": fmu.stop_time,
        "step": fmu.step_size,
        "tolerance": fmu.tolerance,
    }
    facts = {
        "model": fmu.model,
        "file": f"{fmu.path} ({fmu.size / 1024:.0f} KiB)",
        "FMI": f"{fmu.fmi_version}, {' and '.join(fmu.kinds) or 'of no kind'}",
        "capabilities": "; ".join(f"{kind}: {', '.join(f)}" for kind, f in fmu.capabilities.items() if f),
        "terminals": ", ".join(fmu.terminals),
        "binaries": ", ".join(fmu.platforms) or "none",
        "experiment": ", ".join(f"{name} {x:g}" for name, x in experiment.items() if x is not None),
        "made by": ", ".join(filter(None, (fmu.tool, fmu.author))),
        "version": fmu.version,
        "license": fmu.license,
        "GUID": fmu.guid,
        "SHA-256": fmu.sha256,
    }
    return [(label, shorten_text(format_line(text), LONGEST)) for label, text in facts.items() if text]


def format_line(text: str) -> str:
    """Return a text from a file as one line without invisible characters."""
    return make_visible(text).replace("\n", "\\n").replace("\t", "\\t")


def _describe_kind(variable: VariableInfo) -> str:
    variability = variable.interval_variability or variable.variability
    variability = "" if variability in _USUAL else variability
    kind = "" if variable.data_type in ("Real", "Float64") else variable.data_type
    is_whole = variable.dimensions and not variable.name.endswith("]")
    size = f"[{', '.join(map(str, variable.dimensions))}]" if is_whole else ""
    return format_line(" ".join(filter(None, (variability, kind, size, variable.causality))))


def _values(values: Sequence[Start | None]) -> str:
    """Format the start values of elements: one if all are equal, otherwise the first few."""
    texts = ["" if x is None else _format_number(x) for x in values]
    if len(set(texts)) == 1:
        return texts[0]
    more = ", ..." if len(texts) > _MOST_STARTS else ""
    return ", ".join(texts[:_MOST_STARTS]) + more


def _format_number(value: Start) -> str:
    """Format a number; whole numbers, such as seeds, have all digits."""
    if not isinstance(value, float):
        return format_line(format_start(value))
    text = f"{value:.9g}"
    return str(int(value)) if value.is_integer() and float(text) != value else text


def _format_range(low: float | None, high: float | None) -> str:
    if low is None:
        return "" if high is None else f"<= {_format_number(high)}"
    return f">= {_format_number(low)}" if high is None else f"{_format_number(low)} to {_format_number(high)}"


_FEW = 12
"""Most rows of a table that is open at first."""

_GROUPS = {
    "input": ("input",),
    "output": ("output",),
    "parameter": ("parameter", "structuralParameter"),
    "other variable": (),
}
"""Headings of the tables of variables, and the causalities that they have; the last one has all others."""


class FmuRow(NamedTuple):
    """An FMU, and the components that use it."""

    model: str
    components: str
    path: str


class VariableGroup(NamedTuple):
    """Variables with a heading, such as the inputs."""

    heading: str
    rows: Sequence[DisplayRow]
    is_open: bool


def render_cell(content: Info) -> str:
    """Return the content as HTML for a cell, with the texts of `emla info`."""
    names: list[list[str]] = [[] for _ in content.fmus]
    for component in content.components:
        names[component.fmu].append(component.name)
    start, stop, step = content.start_time or 0.0, content.stop_time, content.step_size
    connections = [f"{c.output} -> {c.input}" for c in content.connections]
    components = {c.name: c.model for c in content.components}
    machine = content.machine
    is_fmu = len(components) == 1
    facts = [format_count(len(content.variables), "variable")]
    if not is_fmu:
        facts = [format_count(len(components), "component"), format_count(len(names), "FMU"), *facts]
    if machine is not None:
        facts.append(f"{format_count(len(machine.bodies), 'body', 'bodies')} in .machine")
    facts += [] if stop is None else [f"{start:g} s to {stop:g} s"]
    facts += [] if step is None else [f"step {step:g} s"]
    return render_template(
        __package__ or "",
        "info_cell.html",
        Plots(),
        content=content,
        facts=facts,
        fmu=list_fmu_facts(content.fmus[0]) if is_fmu else [],
        fmus=[
            FmuRow(fmu.model, ", ".join(used), fmu.path)
            for fmu, used in zip(content.fmus, names, strict=True)
        ],
        diagrams=[] if is_fmu else build_diagrams(components, group_connections(components, connections)),
        arrow=make_arrow_id(content.name),
        connections=connections,
        groups=_group_variables(content),
        most=MOST,
        counted=format_count,
    )


def _group_variables(content: Info) -> list[VariableGroup]:
    """Return the variables by causality, without groups that are empty."""
    groups: dict[str, list[DisplayRow]] = {heading: [] for heading in _GROUPS}
    headings = {causality: heading for heading, group in _GROUPS.items() for causality in group}
    for row in build_display_rows(content.variables):
        groups[headings.get(row.first.causality, "other variable")].append(row)
    return [
        VariableGroup(format_count(len(rows), heading), rows, len(rows) <= _FEW)
        for heading, rows in groups.items()
        if rows
    ]
