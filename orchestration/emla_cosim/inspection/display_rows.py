"""Variables as rows of a table: elements of an array share a row."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from ..pages.text import make_visible, shorten_text
from .system_info import FmuInfo, Start, VariableInfo, format_start

_ELEMENT = re.compile(r"(.*)\[([0-9]{1,9})\]", re.DOTALL)


LONGEST = 300
"""Most letters in a text of a table."""


_MOST_STARTS = 4
"""Most different start values of an array's elements to show."""


_DEFAULT_VARIABILITIES = ("continuous", "fixed", "discrete")
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
    """Return the row of a variable, or of elements of an array that share one."""
    first, last = elements[0], elements[-1]
    name = format_line(first.name)
    if len(elements) > 1:
        name = f"{name.removesuffix(']')}..{last.name.rpartition('[')[2]}"
    start, default = (
        _format_values([v.start for v in elements]),
        _format_values([v.default for v in elements]),
    )
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
    """Return variability, type, size and causality, without those that are the default."""
    variability = variable.interval_variability or variable.variability
    variability = "" if variability in _DEFAULT_VARIABILITIES else variability
    kind = "" if variable.data_type in ("Real", "Float64") else variable.data_type
    is_whole = variable.dimensions and not variable.name.endswith("]")
    size = f"[{', '.join(map(str, variable.dimensions))}]" if is_whole else ""
    return format_line(" ".join(filter(None, (variability, kind, size, variable.causality))))


def _format_values(values: Sequence[Start | None]) -> str:
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
