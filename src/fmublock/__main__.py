"""`python -m fmublock build mine.py:Drive`: build FMUs of blocks in any folder."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from .archive import check_replaceable
from .building import build
from .disclosure import Disclosure
from .errors import BuildError, DisclosureError, LoadError, VersionError
from .loading import load_block
from .platforms import FMI_VERSIONS, TARGETS
from .recipe import FLAVOURS, Recipe


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"Error: {message}; see {self.prog} --help.\n")


def _check_output_path(path: Path, overwrite: bool) -> None:
    """Raise LoadError if the FMU may not be written there: the command is wrong."""
    try:
        check_replaceable(path, overwrite)
    except BuildError as error:
        raise LoadError(str(error)) from error


def _read_disclosure(options: argparse.Namespace) -> Disclosure:
    values = dict[str, str]()
    for text in options.set:
        name, _, value = text.partition("=")
        if not (name and value):
            raise LoadError(f"--set {text} has no name or no value; write --set NAME=VALUE.")
        values[name.strip()] = value.strip()
    return Disclosure(not options.no_sources, values, options.fix, options.hide)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Returns:
        The exit code: 0, 1 if an FMU could not be built, 2 if the command is wrong.
    """
    parser = _Parser("python -m fmublock", description="Build blocks as FMUs.")
    command = parser.add_subparsers(required=True, metavar="build", parser_class=_Parser).add_parser(
        "build", help="build FMUs of blocks", description="Build FMUs of blocks."
    )
    command.add_argument("blocks", nargs="+", metavar="FILE.py:BLOCK", help="file and class of a block")
    command.add_argument(
        "--flavour", choices=FLAVOURS, default="native", help="kind of FMU (default: native)"
    )
    command.add_argument(
        "--fmi",
        type=int,
        choices=FMI_VERSIONS,
        default=2,
        help="version of FMI; 3 is native only (default: 2)",
    )
    command.add_argument(
        "--clock",
        type=float,
        metavar="SECONDS",
        help="interval of a periodic input clock, at whose ticks the block steps; FMI 3 only",
    )
    command.add_argument(
        "--platform",
        action="append",
        choices=TARGETS,
        default=[],
        help="FMI platform of a native FMU's binaries, repeatable (default: this machine's)",
    )
    command.add_argument(
        "--output",
        type=Path,
        default=Path(),
        metavar="DIR",
        help="folder to write BLOCK.fmu to (default: the current folder)",
    )
    command.add_argument(
        "--no-sources", action="store_true", help="leave out the C sources, and equations in the page"
    )
    command.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="start value (repeatable)"
    )
    for option, meaning in (("--fix", "can be seen but not set"), ("--hide", "can neither be seen nor set")):
        command.add_argument(
            option,
            action="append",
            default=[],
            metavar="NAME",
            help=f"parameter, or pattern of parameters, that {meaning} (repeatable)",
        )
    command.add_argument("--overwrite", action="store_true", help="replace files that fmublock did not build")
    options = parser.parse_args(arguments)
    try:
        if options.platform and options.flavour != "native":
            raise LoadError("FMUs of the flavour python contain PythonFMU's own binaries; omit --platform.")
        blocks = [load_block(block_path) for block_path in options.blocks]
        names = [block.__name__ for block in blocks]
        if repeated := {name for name in names if names.count(name) > 1}:
            raise LoadError(f"{', '.join(sorted(repeated))} would be written twice to the same file.")
        disclosure = _read_disclosure(options)
        if len(blocks) > 1 and (disclosure.values or disclosure.fixed or disclosure.hidden):
            raise LoadError("--set, --fix and --hide are for one block.")
        for block in blocks:
            Recipe.of(block, options.flavour, disclosure=disclosure, fmi=options.fmi, clock=options.clock)
        paths = [options.output / f"{name}.fmu" for name in names]
        # before anything is compiled, so that the last of many blocks does not fail after minutes
        for path in paths:
            _check_output_path(path, options.overwrite)
        for block, path in zip(blocks, paths, strict=True):
            build(
                block,
                path,
                flavour=options.flavour,
                fmi=options.fmi,
                clock=options.clock,
                platforms=options.platform,
                disclosure=disclosure,
                overwrite=options.overwrite,
            )
            print(f"{path}  {path.stat().st_size / 1024:.0f} KiB")
    except BuildError as error:
        print(f"Error: {error}", file=sys.stderr)
        return 2 if isinstance(error, (LoadError, DisclosureError, VersionError)) else 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
