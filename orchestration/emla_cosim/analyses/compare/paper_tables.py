"""The tables of the paper with our figures beside the printed ones, and normalised averages of both."""

import math
from collections.abc import Iterator, Mapping, Sequence

from ...base.wording import format_rounded
from ...study.controllers import CONTROLLERS
from ...study.paper import PRINTED, REFERENCE, Cells, PrintedTable
from .data import CompareData
from .remarks import describe_ranking, name_observers
from .rows import SHOWN, Row, label_variant
from .statistics import SeedStatistics, group_by_variant, mark_winner
from .text_table import Cell, TextTable

_FIGURES = tuple(SHOWN[name] for name in Cells.__struct_fields__)
_ROUNDED = 0.006
"""Averages that differ by more are different: the paper prints two or three digits."""


def build_paper_tables(result: CompareData) -> list[TextTable]:
    """Return the cells and the averages of each table of the paper of which something was run."""
    return [grid for printed in PRINTED for grid in _grids(result, printed)]


def _grids(result: CompareData, printed: PrintedTable) -> Iterator[TextTable]:
    rows = [r for r in result.rows.rows(named=True) if (r["scenario"], r["joint"]) in printed.cells]
    if rows:
        yield _cells(rows, printed)
        yield _averages(rows, printed)


def _cells(rows: Sequence[Row], printed: PrintedTable) -> TextTable:
    body, lines = list[Sequence[Cell]](), list[int]()
    for (scenario, joint), paper in printed.cells.items():
        own = [row for row in rows if (row["scenario"], row["joint"]) == (scenario, joint)]
        found = group_by_variant(own)
        columns = {figure.name: mark_winner(found, figure) for figure in _FIGURES}
        lines.append(len(body))
        place = joint if len(printed.scenarios) == 1 else scenario
        observers = name_observers(own)
        for name, one in found.items():
            cells = [Cell(place), Cell(f"{name}\nobserver {observers[name]}")]
            for figure, said in zip(_FIGURES, paper.get(one.controller, (None,) * 4), strict=True):
                cells.append(columns[figure.name][name])
                cells.append(Cell("" if said is None else format_rounded(figure.factor * said)))
            body.append(cells)
    header = ["", "controller/gains", *(h for f in _FIGURES for h in (f"{f.label} / {f.unit}", "paper"))]
    title = f"{printed.name}: ours beside the paper's; the winner of ours is marked"
    return TextTable(title, header, body, [*describe_ranking(rows), printed.references], lines)


def _averages(rows: Sequence[Row], printed: PrintedTable) -> TextTable:
    """Return ratios of the means over all rows of the table to those of RSBA with its recommended gains."""
    usual = f"{REFERENCE}/{CONTROLLERS[REFERENCE].recommended}"
    by_entrant = {name: [r for r in rows if label_variant(r) == name] for name in map(label_variant, rows)}
    base = _means(by_entrant.get(usual, ()), len(printed.cells))
    body = [[Cell(name), *_ratios(_means(own, len(printed.cells)), base)] for name, own in by_entrant.items()]
    body += [[Cell(f"paper, {c}"), *_numbers(cells)] for c, cells in printed.averages.items()]
    body += [
        [Cell(f"paper, {c}, from its cells"), *_numbers(printed.recomputed(c))]
        for c in printed.averages
        if c != REFERENCE
    ]
    header = ["normalised average", *(figure.label for figure in _FIGURES)]
    said = [f"Averages are ratios of means, ours to {usual}.", *_describe_difference(printed)]
    return TextTable(f"{printed.name}: normalised averages", header, body, said, [len(by_entrant)])


def _means(rows: Sequence[Row], places: int) -> Cells | None:
    """Return sums over all places of means over seeds; None if a joint was not held or is missing."""
    of_places: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        of_places.setdefault((row["scenario"], row["joint"]), []).append(row)
    found = [SeedStatistics(own) for own in of_places.values()]
    if len(found) < places or not all(one.is_held for one in found):
        return None
    means = [[one.mean(name) for one in found] for name in Cells.__struct_fields__]
    return Cells(
        *(math.nan if None in column else math.fsum(x for x in column if x is not None) for column in means)
    )


def _ratios(means: Cells | None, base: Cells | None) -> list[Cell]:
    if means is None:
        return [Cell("not held", lost=True)] * len(_FIGURES)
    if base is None:
        return [Cell("none")] * len(_FIGURES)
    return [Cell(format_rounded(ours / of)) for ours, of in zip(means, base, strict=True)]


def _numbers(cells: Cells) -> list[Cell]:
    return [Cell(f"{value:.3f}".rstrip("0").rstrip(".")) for value in cells]


def _describe_difference(printed: PrintedTable) -> list[str]:
    """Return a remark on averages of the paper that do not follow from its own cells."""
    wrong: Mapping[str, list[str]] = {figure.label: [] for figure in _FIGURES}
    for controller, said in printed.averages.items():
        found = printed.recomputed(controller)
        for figure, ours, theirs in zip(_FIGURES, found, said, strict=True):
            if abs(ours - theirs) > _ROUNDED:
                wrong[figure.label].append(f"{theirs:.3g} for {controller}, where its cells give {ours:.3f}")
    differences = [f"{label} {' and '.join(ones)}" for label, ones in wrong.items() if ones]
    if not differences:
        return ["The paper's averages follow from its own cells."]
    return [f"The paper's averages follow from its own cells, except {'; '.join(differences)}."]
