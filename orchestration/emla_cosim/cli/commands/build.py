"""`emla build`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from ...base.errors import CommandError, check_choice
from ...base.option import BUILD
from ...fmu.models import FLAVOURS, FMU_FOLDER, MODELS, PLATFORMS, build, check_build_path, find_block
from ...views.progress_bars import BarProgress
from ...views.terminal import show_file

OPTIONS = BUILD
"""Options of the command."""

EXAMPLES = (
    "emla build EmlaPlant",
    "emla build mine.py:Drive --output mine",
)
"""Examples in the help."""


def command(
    models: Annotated[
        list[str] | None,
        typer.Argument(help="Models, or blocks as FILE.py:BLOCK. Default: all built-in models."),
    ] = None,
    flavour: Annotated[str, typer.Option(help=f"FMU flavour: {' or '.join(FLAVOURS)}.")] = "native",
    platform: Annotated[
        list[str] | None,
        typer.Option(
            help=f"FMI platform of a native FMU's binaries (repeatable): {', '.join(PLATFORMS)}. Default: "
            "all."
        ),
    ] = None,
    output: Annotated[Path, typer.Option(help="Output folder.")] = FMU_FOLDER,
    *,
    given: dict[str, Any],
) -> None:
    """Build the FMUs of models for other tools and all platforms."""
    chosen = models or list(MODELS)
    check_choice("flavour", flavour, FLAVOURS)
    if platform and flavour != "native":
        raise CommandError(
            "FMUs of the flavour python contain the binaries of PythonFMU; leave out --platform."
        )
    platforms = platform or list(PLATFORMS)
    blocks = {name: name if name in MODELS else find_block(name) for name in chosen}
    overwrite = given.get("overwrite", False)
    for model in blocks.values():
        check_build_path(model, flavour, output, overwrite)
    with BarProgress() as progress:
        paths = []
        for name, model in blocks.items():
            progress.begin(name, len(platforms) if flavour == "native" else 1)
            paths.append(build(model, flavour, platforms, output, lambda: progress.advance(1), overwrite))
            progress.finish()
    for path in paths:
        show_file(path)
