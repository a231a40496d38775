"""Keep controllers-results.csv, and make tables and figures of controllers-results.md and paper.md from it.

    python -m docs.controller_results STUDY FOLDER     put a comparison of `emla compare` into the CSV file
    python -m docs.controller_results                  make tables and figures of the CSV file

A row has means and standard deviations over seeds, and the largest figures if a joint was not held.
"""

import csv
import itertools
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
import polars
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from docs.paste import pasted
from emla_cosim.analyses.compare.report import FIGURES as RUN_FIGURES
from emla_cosim.analyses.compare.result import DISPLAYS, LOST_AT, WHY, group_rows
from emla_cosim.analyses.compare.statistics import group_by_variant, rank
from emla_cosim.base.wording import format_rounded
from emla_cosim.study.joints.joint_table import Cells
from emla_cosim.study.paper import PRINTED
from emla_cosim.study.systems import STUDY
from emla_cosim.views.plots.style import GREY, RED, make_figure, save

HERE = Path(__file__).parent
PAGES = (HERE / "controllers-results.md", HERE / "paper.md")
TABLE = HERE / "controllers-results.csv"
FIGURES = (*RUN_FIGURES, "convergence_time_s")
LABELS = ("study", "joint", "case", "controller", "gains", "seeds", "not_held", "why", "wins")
COLUMNS = (*LABELS, *(name for figure in FIGURES for name in (figure, f"{figure}_std")))
PICTURES = {"robustness-damped": ("damped", "others"), "robustness-other-sets": ("robustness",)}
"""Figures of robustness, each with the studies that it shows."""

PRINTED_CONTROLLERS = ("rsba", "cac", "anatc")
ERROR = "position_error_m"
WORST_RATIO = 1000.0
"""Errors relative to the nominal case from which the colour does not change any more."""

Row = Mapping[str, str]


def read_rows() -> list[Row]:
    """Return the rows of the CSV file."""
    with TABLE.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def summarize(study: str, folder: Path) -> Iterator[Row]:
    """Yield the rows of a comparison: one for each joint, case and controller."""
    runs = polars.read_csv(folder / "comparison.csv").rows(named=True)
    for (scenario, joint, case), group in group_rows(runs, "scenario", "joint", "case").items():
        variants = group_by_variant(group)
        wins = dict[str, list[str]]()
        for figure in FIGURES:
            if (ranking := rank(variants, DISPLAYS[figure])) and ranking.wins:
                wins.setdefault(ranking.best, []).append(f"{figure} {ranking.wins}")
        for name, statistics in variants.items():
            controller, _, gains = name.partition("/")
            lost = sorted(
                statistics.failures, key=lambda row: np.inf if row[LOST_AT] is None else row[LOST_AT]
            )
            row: dict[str, str] = {"study": study, "joint": joint if joint in STUDY else scenario}
            row |= {"case": case, "controller": controller, "gains": gains}
            row |= {"seeds": str(len(statistics.rows)), "not_held": str(len(lost))}
            row |= {"why": lost[0][WHY] if lost else "", "wins": "; ".join(wins.get(name, ()))}
            for figure in FIGURES:
                largest = max((run[figure] for run in lost if run[figure] is not None), default=None)
                value = largest if lost else statistics.mean(figure)
                row[figure] = "" if value is None else f"{value:.3g}"
                row[f"{figure}_std"] = "" if lost or value is None else f"{statistics.spread(figure):.2g}"
            yield row


def take(study: str, folder: Path) -> None:
    """Replace the rows of a study by those of a comparison."""
    rows = [row for row in read_rows() if row["study"] != study]
    with TABLE.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, COLUMNS, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows([*rows, *summarize(study, folder)])


def make_tables(rows: Sequence[Row]) -> dict[str, str]:
    """Return the tables of the page by the names of their places."""
    short = (ERROR, "torque_effort_N_m", "torque_peak_N_m")
    return {
        "drive": _nominal([row for row in rows if row["study"] == "drive"], short),
        "equal": _nominal([row for row in rows if row["study"] == "equal"], (ERROR,)),
        "paper": _beside_paper([row for row in rows if row["study"] == "paper"]),
        "held": _held([row for row in rows if any(row["study"] in names for names in PICTURES.values())]),
    }


def fill(page: str, rows: Sequence[Row]) -> str:
    """Return the text of a page with those tables for which it has a place."""
    for name, table in make_tables(rows).items():
        if f"<!-- {name} begins -->" in page:
            page = pasted(page, name, table)
    return page


def _nominal(rows: Sequence[Row], figures: Sequence[str]) -> str:
    """Return joints and figures in rows, controllers in columns; what is below all others is bold."""
    variants = list(dict.fromkeys((row["controller"], row["gains"]) for row in rows))
    lines = [
        f"| | {' | '.join(f'`{controller}/{gains}`' for controller, gains in variants)} |",
        f"|---|{'---:|' * len(variants)}",
    ]
    for joint in dict.fromkeys(row["joint"] for row in rows):
        for figure in figures:
            shown, cells = DISPLAYS[figure], []
            for controller, gains in variants:
                labels = (joint, controller, gains)
                row = next(r for r in rows if (r["joint"], r["controller"], r["gains"]) == labels)
                cell = _mean(row, figure)
                wins = f"{figure} {row['seeds']}" in row["wins"].split("; ")
                cells.append(f"**{cell}**" if wins else cell)
            lines.append(f"| {joint}: {shown.label} / {shown.unit} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _beside_paper(rows: Sequence[Row]) -> str:
    """Return means of the sets that are held beside the printed numbers; the CSV file has the spreads."""
    ours = [
        ("rsba", "damped"),
        ("rsba", "compensated"),
        ("foc", "tuned"),
        ("cac", "tuned"),
        ("anatc", "tuned"),
    ]
    head = [
        *(f"`{controller}/{gains}`" for controller, gains in ours),
        *(f"paper, {c}" for c in PRINTED_CONTROLLERS),
    ]
    lines = [f"| | {' | '.join(head)} |", f"|---|{'---:|' * len(head)}"]
    cells = {(row["joint"], row["controller"], row["gains"]): row for row in rows}
    for table in PRINTED:
        for (scenario, joint), printed in table.cells.items():
            label = joint if joint in STUDY else scenario
            for figure in Cells.__struct_fields__:
                shown, texts = DISPLAYS[figure], list[str]()
                for controller, gains in ours:
                    row = cells.get((label, controller, gains))
                    texts.append(format_rounded(shown.factor * float(row[figure])) if row else "")
                values = [getattr(printed[controller], figure) for controller in PRINTED_CONTROLLERS]
                texts += [format_rounded(shown.factor * value) for value in values]
                lines.append(f"| {label}: {shown.label} / {shown.unit} | {' | '.join(texts)} |")
    return "\n".join(lines)


def _mean(row: Row, figure: str) -> str:
    """Return a mean and its spread in the unit that tables show."""
    shown = DISPLAYS[figure]
    spread = shown.factor * float(row[f"{figure}_std"])
    return format_rounded(shown.factor * float(row[figure])) + (f" ± {spread:.2g}" if spread else "")


def _held(rows: Sequence[Row]) -> str:
    """Return the number of cases that each set holds with all seeds."""
    joints = list(dict.fromkeys(row["joint"] for row in rows))
    lines = [f"| Set | Cases | {' | '.join(joints)} |", f"|---|---:|{'---:|' * len(joints)}"]
    for (controller, gains), group in group_rows(rows, "controller", "gains").items():
        held = [sum(r["not_held"] == "0" for r in group if r["joint"] == joint) for joint in joints]
        cases = len({row["case"] for row in group})
        lines.append(f"| `{controller}/{gains}` | {cases} | {' | '.join(map(str, held))} |")
    return "\n".join(lines)


def draw(rows: Iterable[Row]) -> Figure:
    """Return a map of cases and sets: position error in µm, coloured by its ratio to the nominal case."""
    rows = list(rows)
    cases = list(dict.fromkeys(row["case"] for row in rows))
    joints = list(dict.fromkeys(row["joint"] for row in rows))
    sets = list(dict.fromkeys((row["controller"], row["gains"]) for row in rows))
    figure = make_figure(4.6 + 0.62 * len(sets) * len(joints), 1.3 + 0.235 * len(cases), layout="constrained")
    colors = mpl.colormaps["YlOrBr"]
    for k, (joint, axes) in enumerate(
        zip(joints, figure.subplots(1, len(joints), squeeze=False)[0], strict=True)
    ):
        ratios = np.full((len(cases), len(sets)), np.nan)
        cells = {(r["case"], (r["controller"], r["gains"])): r for r in rows if r["joint"] == joint}
        for (i, case), (j, variant) in itertools.product(enumerate(cases), enumerate(sets)):
            row = cells[case, variant]
            nominal = float(cells["nominal", variant][ERROR])
            is_held = row["not_held"] == "0"
            if is_held:
                ratios[i, j] = float(row[ERROR]) / nominal
            text = format_rounded(1e6 * float(row[ERROR])) if is_held else "not held"
            is_dark = is_held and ratios[i, j] > WORST_RATIO**0.6
            color = "white" if is_dark or not is_held else "black"
            axes.text(j, i, text, ha="center", va="center", fontsize=6.5, color=color)
        axes.set_facecolor(RED)
        image = axes.imshow(ratios, cmap=colors, norm=LogNorm(1.0, WORST_RATIO), aspect="auto")
        axes.set_xticks(range(len(sets)), [f"{c}\n{g}" for c, g in sets], fontsize=7)
        axes.set_yticks(range(len(cases)), cases if k == 0 else [""] * len(cases), fontsize=7.5)
        axes.tick_params(length=0, top=True, labeltop=True, bottom=False, labelbottom=False)
        axes.set_title(joint, fontsize=10, color=GREY)
        for line in range(1, len(sets)):
            axes.axvline(line - 0.5, color="white", linewidth=1.0)
        if k == len(joints) - 1:
            bar = figure.colorbar(image, ax=axes, shrink=0.4)
            bar.set_label("error relative to the nominal case", fontsize=8)
    return figure


def main(arguments: Sequence[str]) -> None:
    """Take a comparison, or make tables and figures."""
    if arguments:
        take(arguments[0], Path(arguments[1]))
    rows = read_rows()
    for page in PAGES:
        page.write_text(fill(page.read_text(encoding="utf-8"), rows), encoding="utf-8", newline="\n")
    for name, studies in PICTURES.items():
        with (HERE / f"images/{name}.png").open("wb") as stream:
            save(draw(row for row in rows if row["study"] in studies), stream)


if __name__ == "__main__":
    main(sys.argv[1:])
