"""`emla build`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from fmublock import Block

from ...base.errors import CommandError
from ...base.option import BUILD, OTHER_OPTIONS, argument, option, switch
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

_SUPPLY = "FMUs for other companies"

OPTIONS = BUILD

EXAMPLES = (
    "emla build EmlaPlant",
    "emla build mine.py:Drive --output mine",
    "emla build crane.toml --output crane",
    "emla build crane.toml:CraneLoad --output crane",
    "emla build EmlaPlant --fmi 3 --output fmi3",
    "emla build RsbaController --fmi 3 --clock 1e-3 --output clocked",
    "emla build EmlaPlant --hide 'motor.*' --output handout",
    "emla build measured.csv:interpolation=held --output data",
)

_other = partial(option, group=OTHER_OPTIONS)
_supply = partial(option, group=_SUPPLY)


@dataclass(frozen=True)
class Parameters:
    """Arguments and options of the command."""

    models: Sequence[str] = argument(
        [],
        help="Models, blocks as FILE.py:BLOCK, machines or one block of them as FILE.toml and "
        "FILE.toml:BLOCK, or data as FILE.csv. Default: all built-in models.",
        metavar="MODEL",
    )
    output: Path = _other(FMU_FOLDER, help="Output folder. Default: fmus.")
    flavour: str = _other("native", help="FMU flavour.", choices=lambda: FLAVOURS)
    fmi: int = _other(
        2, help="Version of FMI (3: native FMUs only, and in another folder).", choices=lambda: FMI_VERSIONS
    )
    platform: Sequence[str] = _other(
        [],
        help="FMI platform of a native FMU's binaries (repeatable). Default: all.",
        choices=lambda: PLATFORMS,
    )
    clock: float | None = _other(
        help="Interval of a periodic input clock, at whose ticks the block steps (FMI 3 only). "
        "Default: no clock.",
        unit="s",
    )
    set: Mapping[str, str] = _supply({}, help="Start value in the FMU (repeatable).", metavar="NAME=VALUE")
    fix: Sequence[str] = _supply(
        [], help="Parameter, or pattern, that can be seen but not set (repeatable).", metavar="NAME"
    )
    hide: Sequence[str] = _supply(
        [],
        help="Parameter, or pattern, that can neither be seen nor set; leaves out the sources, too "
        "(repeatable).",
        metavar="NAME",
    )
    no_sources: bool = switch("Leave out the C sources, and equations in the documentation.", _SUPPLY)


def command(chosen: Parameters, given: dict[str, Any]) -> None:
    """Build the FMUs of models, blocks, machines and data for other tools and all platforms."""
    flavour, fmi, output = chosen.flavour, chosen.fmi, chosen.output
    data = [name for name in chosen.models if ".py:" not in name and is_data(name)]
    names = [name for name in chosen.models or MODELS if name not in data]
    if chosen.platform and flavour != "native":
        raise CommandError(
            "FMUs of the flavour python contain the binaries of PythonFMU; leave out --platform."
        )
    platforms = chosen.platform or list(PLATFORMS)
    blocks = {name: block for text in names for name, block in _find_blocks(text).items()}
    disclosure = Disclosure(not chosen.no_sources, dict(chosen.set), tuple(chosen.fix), tuple(chosen.hide))
    if data and (flavour != "native" or chosen.clock is not None or disclosure != Disclosure()):
        raise CommandError(f"'{data[0]}' has data, for which there are only --fmi, --platform and --output.")
    if len(blocks) > 1 and (chosen.set or chosen.fix or chosen.hide):
        raise CommandError("--set, --fix and --hide are for one model; name it.")
    for model in blocks.values():
        check_disclosure(model, flavour, output, disclosure, fmi, chosen.clock)
    overwrite = given.get("overwrite", False)
    places = dict[str, Path]()
    for name, model in blocks.items():
        check_build_path(model, flavour, output, overwrite)
        places[name] = fmu_path(model if isinstance(model, str) else model.__name__, flavour, output)
    for name in data:
        from ...inputs.table_fmus import data_fmu_path  # loads polars

        places[name] = data_fmu_path(name, output)
    names_of = dict[str, str]()
    for name, place in places.items():
        other = names_of.setdefault(str(place).casefold(), name)  # some file systems ignore case
        if other != name:
            raise CommandError(f"the FMUs of '{other}' and '{name}' have the same name; build one at a time.")
    with BarProgress() as progress:
        paths, notes = [], []
        for name, model in blocks.items():
            progress.begin(name, len(platforms) if flavour == "native" else 1)
            done = partial(progress.advance, 1)
            more = overwrite, disclosure, fmi, chosen.clock
            paths.append(build(model, flavour, platforms, output, done, *more))
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


def _find_blocks(name: str) -> dict[str, str | type[Block]]:
    """Return the blocks that an argument names: a model, one of a file, or those of a machine."""
    if name in MODELS:
        return {name: name}
    from ...study.machines.blocks import find_machine_blocks  # loads the reader of machine files

    return find_machine_blocks(name) or {name: find_block(name)}
