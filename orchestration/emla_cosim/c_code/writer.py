"""Write components of a system as plain C."""

import re
from collections.abc import Collection, Mapping
from pathlib import Path

from ..base.errors import CommandError
from ..base.output_files import OutputFile
from ..master.algorithms.algorithm import Algorithm
from ..master.stepping.timing import CommunicationPoints
from ..system.model import System
from .plan import make_identifier, plan_code
from .text import MARK, render_header, render_source


def list_files(path: Path) -> tuple[Path, Path]:
    """Return the source and its header.

    Raises:
        CommandError: The file's name is not a name in C.
    """
    if make_identifier(path.stem) != path.stem or not re.fullmatch(r"[A-Za-z]\w*", path.stem, re.ASCII):
        raise CommandError(
            f"'{path.name}' begins all names in C, so it needs letters, digits and _, such as control.c."
        )
    return path, path.with_suffix(".h")


def check_code(path: Path, overwrite: bool = False) -> list[OutputFile]:
    """Return the files, which may be written. Raises CommandError if one must not be replaced."""
    return [
        OutputFile(file, "the C file", _is_ours, overwrite, creates_folder=True) for file in list_files(path)
    ]


def _is_ours(path: Path) -> bool:
    with path.open("rb") as stream:
        return stream.read(len(MARK)) == MARK.encode()


def write_code(
    path: Path,
    system: System,
    fmus: Mapping[str, Path],
    components: Collection[str],
    algorithm: Algorithm,
    times: CommunicationPoints,
    outputs: Collection[str],
    precision: str,
    overwrite: bool = False,
) -> None:
    """Write components as a C file and its header.

    Args:
        path: The C file.
        system: The system, with its start values.
        fmus: FMU file of every component.
        components: Names or patterns of the components.
        algorithm: The algorithm that steps the system.
        times: Start, stop and step size.
        outputs: Names or patterns of the outputs. Default: those that drive other components, else all.
        precision: Type of all numbers, one of `PRECISIONS`.
        overwrite: Whether to replace files that emla did not write.

    Raises:
        CommandError: The components cannot be plain C, or a file must not be replaced.
        RunError: They cannot be initialized, or a file cannot be written.
    """
    source, header = check_code(path, overwrite)
    plan = plan_code(path.stem, system, fmus, components, algorithm, times, outputs)
    # both before one is written, because rendering can fail
    texts = render_header(plan, precision), render_source(plan, precision)
    for file, text in zip((header, source), texts, strict=True):
        file.write(text.encode())
