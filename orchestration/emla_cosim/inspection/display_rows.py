"""Variables as rows of a table: elements of an array share a row."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from ..views.pages.text import make_visible
from .system_info import Start, VariableInfo, format_start

_ELEMENT = re.compile(r"(.*)\[([0-9]{1,9})\]", re.DOTALL)
_MOST_STARTS = 4
"""Most different start values of an array's elements to show."""
_USUAL = ("continuous", "fixed", "discrete")
"""Default variabilities, which are not shown: of a Real, of a parameter, of other variables."""


@dataclass(frozen=True)
class DisplayRow:
    """A row of the table as texts. `first` is the variable, or the first element of an array."""

    name: str
    kind: str
    start: str
    default: str
    unit: str
    range: str
    meaning: str
    connected: tuple[str, ...]
    first: VariableInfo


def build_display_rows(variables: Sequence[VariableInfo]) -> Iterator[DisplayRow]:
    """Yield a row for each variable, and one for adjacent, equal elements of an array."""
    for _, group in groupby(enumerate(variables), lambda one: _grouping_key(*one)):
        yield _row([v for _, v in group])


def _grouping_key(place: int, variable: VariableInfo) -> tuple[object, ...]:
    """Return what adjacent elements of an array must have in common to share a row."""
    found = _ELEMENT.fullmatch(variable.name)
    if found is None or variable.driven_by or variable.read_by:
        return (variable.name,)
    v, distance = variable, int(found[2]) - place
    alike = v.causality, v.variability, v.type, v.unit, v.minimum, v.maximum, v.description, v.settable
    return found[1], distance, *alike


def _row(elements: Sequence[VariableInfo]) -> DisplayRow:
    first, last = elements[0], elements[-1]
    name = format_line(first.name)
    if len(elements) > 1:
        name = f"{name.removesuffix(']')}..{last.name.rpartition('[')[2]}"
    starts, defaults = _values([v.start for v in elements]), _values([v.default for v in elements])
    ends = (f"from {first.driven_by}",) if first.driven_by else ()
    ends += tuple(f"to {reader}" for reader in first.read_by)
    ends += (f"at {' and '.join(first.clocks)}",) if first.clocks else ()
    return DisplayRow(
        name=name,
        kind=_kind(first),
        start=starts,
        default="" if defaults == starts else defaults,
        unit=format_line(first.unit or ""),
        range=", ".join(map(format_line, first.choices)) or _range(first.minimum, first.maximum),
        meaning=format_line(first.description),
        connected=tuple(map(format_line, ends)),
        first=first,
    )


def format_line(text: str) -> str:
    """Return a text from a file as one line without invisible characters."""
    return make_visible(text).replace("\n", "\\n").replace("\t", "\\t")


def _kind(variable: VariableInfo) -> str:
    variability = variable.interval_variability or variable.variability
    variability = "" if variability in _USUAL else variability
    kind = "" if variable.data_type in ("Real", "Float64") else variable.data_type
    is_whole = variable.dimensions and not variable.name.endswith("]")
    size = f"[{', '.join(map(str, variable.dimensions))}]" if is_whole else ""
    return format_line(" ".join(filter(None, (variability, kind, size, variable.causality))))


def _values(values: Sequence[Start | None]) -> str:
    """Format the start values of elements: one if all are equal, otherwise the first few."""
    texts = ["" if x is None else _number(x) for x in values]
    if len(set(texts)) == 1:
        return texts[0]
    more = ", ..." if len(texts) > _MOST_STARTS else ""
    return ", ".join(texts[:_MOST_STARTS]) + more


def _number(value: Start) -> str:
    """Format a number; whole numbers, such as seeds, have all digits."""
    if not isinstance(value, float):
        return format_line(format_start(value))
    text = f"{value:.9g}"
    return str(int(value)) if value.is_integer() and float(text) != value else text


def _range(low: float | None, high: float | None) -> str:
    if low is None:
        return "" if high is None else f"<= {_number(high)}"
    return f">= {_number(low)}" if high is None else f"{_number(low)} to {_number(high)}"
