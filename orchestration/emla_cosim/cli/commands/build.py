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
from ...views.terminal import BarProgress, print_line, show_file

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

_other_option = partial(option, group=OTHER_OPTIONS)
_supply_option = partial(option, group=_SUPPLY)


@dataclass(frozen=True)
class Parameters:
    """Arguments and options of the command."""

    models: Sequence[str] = argument(
        [],
        help="Models, blocks as FILE.py:BLOCK, machines or one block of them as FILE.toml and "
        "FILE.toml:BLOCK, or data as FILE.csv. Default: all built-in models.",
        metavar="MODEL",
    )
    output: Path = _other_option(FMU_FOLDER, help="Output folder. Default: fmus.")
    flavour: str = _other_option("native", help="FMU flavour.", choices=lambda: FLAVOURS)
    fmi: int = _other_option(
        2, help="Version of FMI (3: native FMUs only, and in another folder).", choices=lambda: FMI_VERSIONS
    )
    platform: Sequence[str] = _other_option(
        [],
        help="FMI platform of a native FMU's binaries (repeatable). Default: all.",
        choices=lambda: PLATFORMS,
    )
    clock: float | None = _other_option(
        help="Interval of a periodic input clock, at whose ticks the block steps (FMI 3 only). "
        "Default: no clock.",
        unit="s",
    )
    set: Mapping[str, str] = _supply_option(
        {}, help="Start value in the FMU (repeatable).", metavar="NAME=VALUE"
    )
    fix: Sequence[str] = _supply_option(
        [], help="Parameter, or pattern, that can be seen but not set (repeatable).", metavar="NAME"
    )
    hide: Sequence[str] = _supply_option(
        [],
        help="Parameter, or pattern, that can neither be seen nor set; leaves out the sources, too "
        "(repeatable).",
        metavar="NAME",
    )
    no_sources: bool = switch("Leave out the C sources, and equations in the documentation.", _SUPPLY)


def command(parameters: Parameters, options: dict[str, Any]) -> None:
    """Build the FMUs of models, blocks, machines and data for other tools and all platforms."""
    flavour, fmi, output = parameters.flavour, parameters.fmi, parameters.output
    data = [name for name in parameters.models if ".py:" not in name and is_data(name)]
    names = [name for name in parameters.models or MODELS if name not in data]
    if parameters.platform and flavour != "native":
        raise CommandError(
            "FMUs of the flavour python contain the binaries of PythonFMU; leave out --platform."
        )
    platforms = parameters.platform or list(PLATFORMS)
    blocks = {name: block for text in names for name, block in _find_blocks(text).items()}
    disclosure = Disclosure(
        not parameters.no_sources, dict(parameters.set), tuple(parameters.fix), tuple(parameters.hide)
    )
    if data and (flavour != "native" or parameters.clock is not None or disclosure != Disclosure()):
        raise CommandError(f"'{data[0]}' has data, for which there are only --fmi, --platform and --output.")
    if len(blocks) > 1 and (parameters.set or parameters.fix or parameters.hide):
        raise CommandError("--set, --fix and --hide are for one model; name it.")
    # all mistakes are reported before the first FMU is built
    for model in blocks.values():
        check_disclosure(model, flavour, output, disclosure, fmi, parameters.clock)
    overwrite = options.get("overwrite", False)
    paths_by_name = dict[str, Path]()
    for name, model in blocks.items():
        check_build_path(model, flavour, output, overwrite)
        paths_by_name[name] = fmu_path(model if isinstance(model, str) else model.__name__, flavour, output)
    for name in data:
        from ...inputs.wired_inputs import data_fmu_path  # loads polars

        paths_by_name[name] = data_fmu_path(name, output)
    name_by_path = dict[str, str]()
    for name, file in paths_by_name.items():
        first_name = name_by_path.setdefault(str(file).casefold(), name)  # some file systems ignore case
        if first_name != name:
            raise CommandError(
                f"the FMUs of '{first_name}' and '{name}' have the same name; build one at a time."
            )
    with BarProgress() as progress:
        paths, notes = [], []
        for name, model in blocks.items():
            # an FMU of the flavour python contains the binaries of PythonFMU for all platforms
            progress.begin(name, len(platforms) if flavour == "native" else 1)
            on_platform = partial(progress.advance, 1)
            settings = overwrite, disclosure, fmi, parameters.clock
            paths.append(build(model, flavour, platforms, output, on_platform, *settings))
            progress.finish()
        for name in data:
            from ...inputs.wired_inputs import build_data_fmu

            path, data_notes = build_data_fmu(name, output, platforms, overwrite, fmi)
            paths.append(path)
            notes += data_notes
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
