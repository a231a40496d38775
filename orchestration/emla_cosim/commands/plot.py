"""`emla plot`."""

from pathlib import Path
from typing import Annotated

import typer

from .. import loading  # for the pictures that are registered there
from ..errors import CommandError
from ..files import check_places, writing_to, written_whole
from ..quantities import quantity, unit_named
from ..results.kept import KeptRun, Window, kept_runs
from ..results.overlay import (
    TracePanel,
    check_runs,
    chosen_signals,
    missing,
    overlaid,
    picture_panels,
    signal_panels,
)
from ..results.style import save
from ..terminal import say

__all__ = ["command", "loading"]


def command(
    runs: Annotated[
        list[Path], typer.Argument(help="Folders of results, or tables (.csv, .parquet).", metavar="RUN...")
    ],
    signals: Annotated[
        list[str] | None,
        typer.Option(
            help="Signals to draw, * for anything (repeatable). Without: the pictures of a run.",
            metavar="PATTERN",
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option(help="The picture; of several, the beginning of their names.", metavar="FILE.png")
    ] = Path("plot.png"),
    begin: Annotated[
        str | None, typer.Option("--from", help="Beginning of what is shown, in s.", metavar="TIME")
    ] = None,
    end: Annotated[
        str | None, typer.Option("--to", help="End of what is shown, in s.", metavar="TIME")
    ] = None,
) -> None:
    """Draw signals of runs that were kept, one over the other."""
    window = Window(_time("--from", begin, float("-inf")), _time("--to", end, float("inf")))
    if not window.start < window.end:
        raise CommandError(f"--from {begin} must be before --to {end}.")
    if output.suffix.lower() != ".png":
        raise CommandError(f"the picture '{output}' must end in .png.")
    found = kept_runs(runs)
    check_runs(found)
    drawn = _panels(found, signals or [], window, output)
    check_places(dict.fromkeys(drawn, "the picture"), {run.stored.path: "a run" for run in found})
    for path, (title, panels) in drawn.items():
        with writing_to(path.parent), written_whole(path) as stream:
            save(overlaid(panels, found, title), stream)
    say(f"Wrote {', '.join(map(str, drawn))}")


def _panels(
    runs: list[KeptRun], patterns: list[str], window: Window, output: Path
) -> dict[Path, tuple[str, list[TracePanel]]]:
    """Title and panels of every picture by its path."""
    if not patterns:
        pictures = picture_panels(runs, window)
        return {output.with_stem(f"{output.stem}-{name}"): found for name, found in pictures.items()}
    names = chosen_signals(runs, patterns)
    panels = signal_panels(runs, names, window)
    for note in missing(runs, names, window):
        say(f"Note: {note}.")
    return {output: ("", panels)}


def _time(flag: str, text: str | None, otherwise: float) -> float:
    return otherwise if text is None else quantity(text, flag).in_unit(unit_named("s", flag), flag)
