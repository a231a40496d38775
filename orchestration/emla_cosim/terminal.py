"""What a person sees of a run in the terminal: progress bars and the table of results."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

if TYPE_CHECKING:
    from .recorders.metrics import Figures, Shown
    from .results.output_folder import OutputFolder
    from .results.result import Result

OUT, ERR = Console(), Console(stderr=True)
"""Results go to standard output, progress and errors to standard error."""


def show_result(
    result: "Result", notes: Sequence[str], output: "OutputFolder", pictures: Sequence[Path]
) -> None:
    """The metrics as tables, how the steps were made, and where everything is."""
    span = result.end_s - result.times.start
    for kind, figures in result.metrics.items():
        if result.shown[kind]:
            OUT.print(_figures(f"{result.name}, {span:g} s simulated", figures, result.shown[kind]))
    late = [
        name
        for figures in result.metrics.values()
        for name, f in figures.items()
        if f.get("convergence_time_s", 0.0) > span - 0.5 * result.times.step
    ]
    if late:
        OUT.print(f"Not converged by the end: {', '.join(late)}.", highlight=False)
    for note in notes:
        OUT.print(f"Note: {note}.", highlight=False, soft_wrap=True)
    for line in _speed(result):
        OUT.print(line, highlight=False, soft_wrap=True)
    files = f"{output.results.name}, metrics.json, run.json"
    OUT.print(f"Wrote {output.path}/: {files}", highlight=False, soft_wrap=True)
    if pictures:
        names = ", ".join(path.name for path in pictures)
        OUT.print(f"Pictures: {names}", highlight=False, soft_wrap=True)


def _figures(title: str, figures: "Figures", shown: "Sequence[Shown]") -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column("")
    for name in figures:
        table.add_column(name, justify="right")
    table.add_column("")
    for figure in shown:
        values = (_number(figure.factor * f[figure.name]) for f in figures.values())
        table.add_row(figure.label, *values, figure.unit)
    return table


def _speed(result: "Result") -> Iterator[str]:
    if not (result.wall_s > 0 and result.steps):
        return
    rate, factor = result.steps / result.wall_s, result.simulated_s / result.wall_s
    rejected = result.stepping.get("rejected_steps")
    tried = f" ({rejected} more rejected)" if rejected is not None else ""
    slowly = "" if result.stepping.get("compiled", True) else ", not compiled"
    yield (
        f"{result.steps} steps{tried} in {result.wall_s:.2f} s: "
        f"{rate:,.0f} steps/s, {factor:.2g} x real time{slowly}"
    )
    sweeps = result.stepping.get("sweeps_over_loops")
    if sweeps is not None:
        loops = result.stepping["loops"]
        yield f"{len(loops)} loops agreed, {sweeps / max(len(loops), 1):,.0f} sweeps each"
    late = result.stepping["late_connections"]
    if late:
        yield f"{len(late)} connections come one step late; run.json names them"
    if result.pacing is not None:
        kept = result.pacing
        yield (
            f"{kept['overruns']} overruns at {kept['points']} points of {kept['factor']:g} x real time; "
            f"the longest delay was {1e3 * kept['worst_delay_s']:.2f} ms"
        )


def _number(value: float) -> str:
    return "-" if value != value else f"{value:.4g}"
