"""Build the FMU of a block."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from .archive import check_replaceable
from .block import Block
from .disclosure import Disclosure
from .errors import BuildError
from .export import Draft
from .files import accept
from .native import native_binaries, native_draft
from .platforms import host_platform
from .python_flavour import python_binaries, python_draft
from .recipe import Documents, Producer, Recipe
from .units import parse_unit


def build(
    block: Block | type[Block],
    path: str | os.PathLike[str],
    *,
    flavour: str = "native",
    fmi: int = 2,
    clock: float | None = None,
    platforms: Sequence[str] = (),
    producer: Producer | None = None,
    documents: Documents | None = None,
    disclosure: Disclosure | None = None,
    advance: Callable[[], None] = lambda: None,
    overwrite: bool = False,
) -> Path:
    """Build the FMU of a block.

    The same block, documents and tools give the same bytes.

    Args:
        block: a class or an instance of a block.
        path: path of the FMU.
        flavour: native (compiled C) or python (PythonFMU).
        fmi: version of FMI: 2, or 3 for native FMUs.
        clock: interval in s of a periodic input clock, for FMI 3.0: the block then steps at its ticks only.
            Default: no clock.
        platforms: platforms of a native FMU, by their names in FMI 2.0: "linux64", "win64", "darwin64",
            "aarch64-linux", "aarch64-darwin". Default: this machine's.
        producer: generation tool, version and license in the model description.
        documents: page and license to include. Default: the docstring of the class and a table of its
            variables.
        disclosure: what the FMU contains and lets its user set, for FMUs that go to other companies.
            Default: everything.
        advance: called after each compiled binary.
        overwrite: replace a file that fmublock did not build.

    Returns:
        The path of the FMU.

    Raises:
        BuildError: an argument is wrong, the equations would differ between C and Python, or the file cannot
            be written.

    Examples:
        >>> import fmublock
        >>> from emla_fmu import SignalFault
        >>> fmublock.build(SignalFault, "SignalFault.fmu").name
        'SignalFault.fmu'
    """
    recipe = Recipe.of(block, flavour, producer, documents, disclosure, fmi, clock)
    if platforms and flavour != "native":
        raise BuildError("FMUs of the flavour python contain PythonFMU's own binaries; omit the platforms.")
    check_replaceable(Path(path), overwrite)
    draft = draft_of(recipe)
    # any key marks the file as built here, so that it can be replaced
    key = recipe.key() or draft.key
    write_fmu(draft, key, flavour, platforms, Path(path), advance, lambda p: check_replaceable(p, overwrite))
    return Path(path)


def draft_of(recipe: Recipe) -> Draft:
    """Return the FMU of a recipe without its binaries. Raises BuildError."""
    for scalar in recipe.block.layout().scalars:
        try:
            parse_unit(scalar.variable.unit or "1")
        except ValueError as error:
            raise BuildError(f"{scalar.name} of {recipe.model} has a wrong unit: {error}.") from error
    if recipe.flavour == "native":
        return native_draft(
            recipe.block, recipe.producer, recipe.documents, recipe.sources, recipe.fmi, recipe.clock
        )
    return python_draft(recipe.block, recipe.producer, recipe.documents)


def write_fmu(
    draft: Draft,
    key: str,
    flavour: str,
    platforms: Sequence[str],
    path: Path,
    advance: Callable[[], None] = lambda: None,
    check: Callable[[Path], object] = accept,
) -> None:
    """Add the binaries to a draft and write the FMU. Raises BuildError, and what `check` raises."""
    if flavour == "native":
        binaries = native_binaries(draft, platforms or (host_platform(),), advance)
    else:
        binaries = python_binaries(draft)
    try:
        draft.write(path, binaries, key, check)
    except OSError as error:
        raise BuildError(f"the FMU '{path}' cannot be written: {error.strerror or error}.") from error
