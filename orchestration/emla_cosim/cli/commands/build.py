"""`emla build`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from ...base.errors import CommandError, check_choice
from ...base.option import BUILD
from ...fmu.models import (
    FLAVOURS,
    FMI_VERSIONS,
    FMU_FOLDER,
    MODELS,
    PLATFORMS,
    Disclosure,
    build,
    check_build_path,
    check_disclosure,
    find_block,
    fmu_path,
)
from ...inputs.input import is_data
from ...views.progress_bars import BarProgress
from ...views.terminal import print_line, show_file
from .options import pairs

_SUPPLY = "FMUs for other companies"

OPTIONS = BUILD
"""Options of the command."""

EXAMPLES = (
    "emla build EmlaPlant",
    "emla build mine.py:Drive --output mine",
    "emla build EmlaPlant --fmi 3 --output fmi3",
    "emla build RsbaController --fmi 3 --clock 1e-3 --output clocked",
    "emla build EmlaPlant --hide 'motor.*' --output handout",
    "emla build measured.csv:interpolation=held --output data",
)
"""Examples in the help."""


def command(
    models: Annotated[
        list[str] | None,
        typer.Argument(
            help="Models, blocks as FILE.py:BLOCK, or data as FILE.csv. Default: all built-in models."
        ),
    ] = None,
    flavour: Annotated[str, typer.Option(help=f"FMU flavour: {' or '.join(FLAVOURS)}.")] = "native",
    fmi: Annotated[
        int,
        typer.Option(
            help=f"Version of FMI: {' or '.join(map(str, FMI_VERSIONS))} "
            "(3: native FMUs only, and in another folder)."
        ),
    ] = 2,
    clock: Annotated[
        float | None,
        typer.Option(
            help="Interval of a periodic input clock in s, at whose ticks the block steps (FMI 3 only). "
            "Default: no clock.",
            metavar="SECONDS",
        ),
    ] = None,
    platform: Annotated[
        list[str] | None,
        typer.Option(
            help=f"FMI platform of a native FMU's binaries (repeatable): {', '.join(PLATFORMS)}. Default: "
            "all."
        ),
    ] = None,
    no_sources: Annotated[
        bool,
        typer.Option(
            "--no-sources",
            help="Leave out the C sources, and equations in the documentation.",
            rich_help_panel=_SUPPLY,
        ),
    ] = False,
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="Start value in the FMU (repeatable).",
            metavar="NAME=VALUE",
            rich_help_panel=_SUPPLY,
        ),
    ] = None,
    fix: Annotated[
        list[str] | None,
        typer.Option(
            help="Parameter, or pattern, that can be seen but not set (repeatable).",
            metavar="NAME",
            rich_help_panel=_SUPPLY,
        ),
    ] = None,
    hide: Annotated[
        list[str] | None,
        typer.Option(
            help="Parameter, or pattern, that can neither be seen nor set; leaves out the sources, too "
            "(repeatable).",
            metavar="NAME",
            rich_help_panel=_SUPPLY,
        ),
    ] = None,
    output: Annotated[Path, typer.Option(help="Output folder.")] = FMU_FOLDER,
    *,
    given: dict[str, Any],
) -> None:
    """Build the FMUs of models, blocks and data for other tools and all platforms."""
    data = [name for name in models or () if ".py:" not in name and is_data(name)]
    chosen = [name for name in models or MODELS if name not in data]
    check_choice("flavour", flavour, FLAVOURS)
    check_choice("version of FMI", str(fmi), [str(version) for version in FMI_VERSIONS])
    if platform and flavour != "native":
        raise CommandError(
            "FMUs of the flavour python contain the binaries of PythonFMU; leave out --platform."
        )
    platforms = platform or list(PLATFORMS)
    blocks = {name: name if name in MODELS else find_block(name) for name in chosen}
    disclosure = Disclosure(not no_sources, pairs("--set", set_ or []), fix or (), hide or ())
    if data and (flavour != "native" or clock is not None or disclosure != Disclosure()):
        raise CommandError(f"'{data[0]}' has data, for which there are only --fmi, --platform and --output.")
    if len(blocks) > 1 and (set_ or fix or hide):
        raise CommandError("--set, --fix and --hide are for one model; name it.")
    for model in blocks.values():
        check_disclosure(model, flavour, output, disclosure, fmi, clock)
    overwrite = given.get("overwrite", False)
    places = dict[str, str]()
    for name, model in blocks.items():
        check_build_path(model, flavour, output, overwrite)
        place = str(fmu_path(model if isinstance(model, str) else model.__name__, flavour, output))
        if (other := places.setdefault(place.casefold(), name)) != name:  # some file systems ignore case
            raise CommandError(f"the FMUs of '{other}' and '{name}' have the same name; build one at a time.")
    for name in data:
        from ...inputs.table_fmus import data_fmu_path  # loads polars

        place = str(data_fmu_path(name, output))
        if (other := places.setdefault(place.casefold(), name)) != name:
            raise CommandError(f"the FMUs of '{other}' and '{name}' have the same name; build one at a time.")
    with BarProgress() as progress:
        paths, notes = [], []
        for name, model in blocks.items():
            progress.begin(name, len(platforms) if flavour == "native" else 1)
            paths.append(
                build(
                    model,
                    flavour,
                    platforms,
                    output,
                    lambda: progress.advance(1),
                    overwrite,
                    disclosure,
                    fmi,
                    clock,
                )
            )
            progress.finish()
        for name in data:
            from ...inputs.table_fmus import build_data_fmu

            path, told = build_data_fmu(name, output, platforms, overwrite, fmi)
            paths.append(path)
            notes += told
    for note in notes:
        print_line(f"Note: {note}")
    for path in paths:
        show_file(path)
